"""What a machine cannot do for `make check-pi` is skipped and said; what fails, fails."""

from __future__ import annotations

import errno
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "pi"]:
        del sys.modules[name]


def test_what_needs_a_failed_step_is_skipped_and_the_table_fails(capsys: pytest.CaptureFixture[str]) -> None:
    from pi.steps import SkippedError, Step, demand, perform, show

    def absent() -> str:
        raise SkippedError("needs apt install something")

    def fail() -> str:
        demand(False, "no port")
        return ""

    steps = [Step("a", lambda: "seen"), Step("b", absent), Step("c", fail, needed=True), Step("d", lambda: "never")]
    rows = perform(steps)
    assert [(row.name, row.verdict) for row in rows] == [
        ("a", "ok"), ("b", "skipped"), ("c", "FAILED"), ("d", "skipped")
    ]  # fmt: skip
    assert rows[1].detail == "needs apt install something" and rows[3].detail == "needs: c"
    assert show(rows) == 1
    assert "1 ok, 1 FAILED, 2 skipped" in capsys.readouterr().out


def test_a_step_that_takes_too_long_ends_with_all_that_it_started(tmp_path: Path) -> None:
    from pi.steps import StepError, run

    alive = tmp_path / "alive"
    command = f"(while sleep 0.1; do date +%s.%N > {alive}; done) & sleep 60"
    with pytest.raises(StepError, match="not done after 1 s"):
        run(["sh", "-c", command], 1.0)
    before = alive.read_text()
    time.sleep(0.5)
    assert alive.read_text() == before


@pytest.mark.parametrize(
    "text",
    [
        "# ours\ndeb [arch=amd64] mirror://here/debian bookworm main\n",
        "Types: deb\nURIs: mirror://here/debian\nSuites: bookworm bookworm-updates\nComponents: main\n",
    ],
)
def test_the_machines_own_mirror(text: str) -> None:
    from pi.machine import Mirror, parse_sources

    assert parse_sources(text) == Mirror("mirror://here/debian", "bookworm")
    assert parse_sources("# nothing\n") is None


def test_without_root_everything_is_skipped_and_said(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from pi import cli, machine

    monkeypatch.setattr(machine.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(sys, "argv", ["pi"])
    assert cli.main() == 0
    assert "0 ok, 0 FAILED, 2 skipped" in capsys.readouterr().out


def test_the_probe_tells_a_refusal_from_what_is_not_there() -> None:
    from pi import probe

    def refused() -> None:
        raise PermissionError(errno.EACCES, "permission denied")

    assert probe.outcome(lambda: None) == 0
    assert probe.outcome(lambda: Path("/nowhere/at/all").read_text()) not in probe.REFUSED
    assert probe.outcome(refused) == errno.EACCES in probe.REFUSED
    assert set(probe.HIDDEN) <= set(probe.MUST_NOT)


def test_an_unknown_part_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "tools/pi", "riscv"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2 and "no such part: riscv" in done.stderr
