"""A user's own law: what it may do wrong, and that torque is zero when it does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoopd.commands import cli
from hoopd.daemon import app
from hoopd.daemon.build import load_law
from hoopd.daemon.replay import replay
from hoopd.files.reading import InputError
from hoopd.recording.mcap import read_run

WELL = "class Law:\n    def reset(self):\n        self.n = 0\n"
UPDATE = "    def update(self, m):\n        self.n += 1\n        "
LAWS = {
    "raises": WELL + UPDATE + "return (0.1 if self.n < 50 else 1 / 0), {}\n",
    "gives no pair": WELL + UPDATE + "return 0.1\n",
    "gives a text": WELL + UPDATE + "return 'much', {}\n",
    "changes the estimate": WELL + UPDATE + "m.x[2] = 0.0; return 0.1, {}\n",
    "cannot be reset": "class Law:\n    n = 0\n    def reset(self):\n        self.n += 1; self.n < 9 or 1 / 0\n"
    "    def update(self, m):\n        return 0.1, {}\n",
}


def run(tmp_path: Path, law: str, seconds: float = 4.0, *sets: str) -> tuple[dict[str, Any], Path]:
    path = tmp_path / "law.py"
    path.write_text(law)
    options = app.Options(True, None, (f"control.law={path}", *sets), seconds, tmp_path, 0, "max", True)
    return app.run_daemon(options), tmp_path / "run-0001.mcap"


@pytest.mark.parametrize("name", list(LAWS))
def test_a_law_that_fails_is_a_cut_and_not_the_end(tmp_path: Path, name: str) -> None:
    summary, path = run(tmp_path, LAWS[name])
    assert summary["faults"]["not_finite"] >= 1
    assert summary["seconds"] > 3.9
    rows = read_run(path)
    failed = next(event.t for event in rows.events if event.event == "law_failed")
    assert all(tick.u == 0.0 for tick in rows.ticks if tick.t >= failed)
    assert rows.ticks[-1].mode in ("FAULT", "DISARMED")


def test_a_law_without_tune_refuses_to_be_tuned(tmp_path: Path) -> None:
    law = WELL + UPDATE + "return 0.0, {}\n"
    summary, _ = run(tmp_path, law, 3.0, "sim.commands=[{at_s: 2, name: tune, key: gain, value: 1.0}]")
    assert "not_finite" not in summary["faults"]
    assert summary["seconds"] > 2.9


@pytest.mark.parametrize(
    "text",
    ["x = ", "x = 1", "class Law: pass", WELL, "class Law:\n  def __init__(self):\n    raise KeyError(1)\n"],
)
def test_a_file_that_is_no_law_is_one_clear_line(text: str) -> None:
    with pytest.raises(InputError, match=r"^law\.py: "):
        load_law(text, "law.py")


def test_a_recorded_law_runs_only_when_that_is_wanted(tmp_path: Path) -> None:
    tune = "    def tune(self, key, value):\n        self.gain = value\n        return True\n"
    law = WELL + "        self.gain = 1.0\n" + UPDATE + "return -0.01 * self.gain * m.x[1] - 0.1 * m.x[2], {}\n" + tune
    _, path = run(tmp_path, law, 3.0, "sim.commands=[{at_s: 2, name: tune, key: gain, value: 2.0}]")
    with pytest.raises(InputError, match="law: holds a law of a user's own"):
        cli.app(["replay", str(path)], standalone_mode=False)
    with pytest.raises(InputError, match="law: holds a law of a user's own"):
        replay(path)
    assert replay(path, run_law=True)["equal"]
