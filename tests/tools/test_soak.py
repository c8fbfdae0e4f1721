"""The soak gives every missed tick an owner; how many there are is judged on a quiet machine, not here."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from harness.timing import on_the_clock

ROOT = Path(__file__).resolve().parents[2]
BENCH = ROOT / "tools" / "bench"
PERIOD_S, STEP_S = 0.02, 0.004


@pytest.fixture
def attribution(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The rule."""
    monkeypatch.syspath_prepend(str(BENCH))
    from soaking import attribution

    return attribution


def accounts(watched: list[tuple[float, float]] | None = None, **columns: list[float]) -> object:
    """0.1 s of rows in which nothing happens but what these columns say, each spread over the rows."""
    from soaking.accounts import Accounts, Watcher
    from soaking.follower import COLUMNS, RUNNABLE

    t = np.arange(0.0, 0.1 + STEP_S / 2, STEP_S)
    given = {"t": t, "place": np.full(len(t), float(RUNNABLE))}
    given |= {name: np.interp(t, np.linspace(0.0, 0.1, len(values)), values) for name, values in columns.items()}
    rows = np.stack([given.get(name, np.zeros(len(t))) for name in COLUMNS], axis=1)
    return Accounts(rows, [Watcher(0, watched or [])])


@pytest.mark.parametrize(
    ("columns", "watched", "owner", "shares"),
    [
        ({"loop_wait_s": [0.0, 0.08], "loop_run_s": [0.0, 0.02]}, [], "machine", (0, 3, 0)),
        ({"loop_wait_s": [0.0, 0.08], "rig_run_s": [0.0, 0.09]}, [], "rig", (3, 0, 0)),
        ({"loop_run_s": [0.0, 0.1]}, [], "daemon", (0, 0, 3)),
        ({"loop_run_s": [0.0, 0.1]}, [(0.0, 0.1)], "machine", (0, 3, 0)),  # charged with what a still core took
        ({"loop_run_s": [0.0, 0.04], "loop_wait_s": [0.0, 0.06]}, [], "machine", (0, 2, 1)),
        ({"loop_run_s": [0.0, 0.04], "loop_wait_s": [0.0, 0.06], "rig_run_s": [0.0, 0.06]}, [], "rig", (2, 0, 1)),
    ],
)
def test_the_owner_of_a_gap(
    columns: dict[str, list[float]],
    watched: list[tuple[float, float]],
    owner: str,
    shares: tuple[int, int, int],
    attribution: ModuleType,
) -> None:
    parts = attribution.split(accounts(watched, **columns), attribution.Span(0.0, 0.02, 0.08))
    gap = attribution.Missed(0.0, 3, parts, False)
    assert parts.owner == owner
    assert tuple(gap.shares(PERIOD_S)[name] for name in attribution.OWNERS) == shares


@pytest.mark.parametrize(
    ("call", "helpers", "part", "owner"),
    [
        ("TIMERS", 0.0, "timer", "machine"),
        ("LOCKS", 0.0, "interpreter", "daemon"),
        ("LOCKS", 0.1, "interpreter_waited", "machine"),
        ("FETCHING", 0.0, "fetching", "daemon"),
        ("", 0.0, "asleep", "daemon"),
    ],
)
def test_asleep_past_the_deadline(call: str, helpers: float, part: str, owner: str, attribution: ModuleType) -> None:
    calls = {"TIMERS": attribution.TIMERS, "LOCKS": attribution.LOCKS, "FETCHING": (attribution.FETCHING,)}.get(call)
    if calls == ():
        pytest.skip("the calls of this machine are not known")
    place = float(calls[0] if calls else 7)
    kept = accounts(place=[place, place], helpers_wait_s=[0.0, helpers])
    parts = attribution.split(kept, attribution.Span(0.0, 0.02, 0.08))
    assert getattr(parts, part) == pytest.approx(0.06)  # not the 20 ms in which it should sleep
    assert parts.owner == owner


def test_follower_sees_who_runs_and_who_is_stopped(tmp_path: Path, attribution: ModuleType) -> None:
    from soaking import accounts as kept

    out = tmp_path / "accounts"
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        command = [sys.executable, "-S", str(BENCH / "soaking" / "follower.py"), str(busy.pid), str(out)]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as follower:
            time.sleep(1.0)
            busy.send_signal(signal.SIGSTOP)
            stopped = time.monotonic()
            time.sleep(0.5)
            assert follower.stdin is not None
            follower.stdin.close()
            follower.wait(20)
        busy.kill()
    found = kept.read(out, [])
    begin, end = found.span
    at_work = found.grown("loop_run_s", begin, stopped) + found.grown("loop_wait_s", begin, stopped)
    with on_the_clock():
        assert at_work == pytest.approx(stopped - begin, rel=0.3)
    with on_the_clock():
        assert found.grown("loop_run_s", stopped + 0.2, end) < 0.05  # it is told when it next runs


def test_soak_prints_every_owner(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    command = [sys.executable, str(BENCH / "soak.py"), "--minutes", "0.1", "--load", "2", "--direct"]
    done = subprocess.run(
        [*command, "--json", str(path)], capture_output=True, text=True, timeout=110, check=False, cwd=ROOT
    )
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    figures = json.loads(path.read_text())
    assert figures["ticks"] > 50
    assert figures["missed"] == figures["missed as the daemon counted"] - figures["missed before anybody watched"]
    assert figures["missed"] == sum(figures[f"missed, {owner}'s"] for owner in ("rig", "machine", "daemon"))
    assert "missed ticks are the daemon's, bound 0" in done.stdout
