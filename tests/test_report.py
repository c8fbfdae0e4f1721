"""The summary at the end of a run: what it measures, over which seconds, and when it says how fast the run was."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from pathlib import Path
from typing import Any

import pytest
from system.rigrun import run_rig

from hoopd.core.records import Inputs, TickRecord
from hoopd.report import RELEASE_S, SETTLED_S, WELL, Watch, _summary_rows


def ticks(modes: str, error_rad: float = 0.5, settled_rad: float = 0.01) -> Iterator[TickRecord]:
    """A letter a tenth of a second: R controlled, else not; the error falls when the release is over."""
    since = 0
    for k, letter in enumerate(modes):
        since = since + 1 if letter == "R" else 0
        psi = settled_rad if since > 10 * RELEASE_S else error_rad
        mode = "RUNNING" if letter == "R" else "READY"
        yield TickRecord(0.1 * k, k, mode, 0, 0, 0, nan, 0, 0, 0, (0, 0, psi + 0.1, 0), 0.1, 0, 0, 0, 0)


def watched(modes: str) -> list[tuple[float, float]]:
    watch = Watch()
    for record in ticks(modes):
        watch.put(record, Inputs(record.id, record.t, None, None, WELL, (), 0.0, 0.0, False, 0))
    return list(watch.settled)


def test_the_angle_s_error_leaves_the_release_out() -> None:
    settled = watched("-" * 10 + "R" * 40)
    assert max(error for _, error in settled) == pytest.approx(0.01)
    assert settled[0][0] == pytest.approx(1.0 + RELEASE_S) and settled[-1][0] == pytest.approx(4.9)
    assert watched("-" * 10 + "R" * 20) == []


def test_it_is_that_of_the_last_seconds_and_a_pause_is_another_release() -> None:
    settled = watched("R" * 200)
    assert settled[0][0] == pytest.approx(19.9 - SETTLED_S, abs=0.11)
    again = watched("R" * 60 + "-" * 5 + "R" * 40)
    assert max(error for _, error in again) == pytest.approx(0.01)
    assert not any(5.95 < t < 6.45 + RELEASE_S for t, _ in again)


def rows(summary: dict[str, Any], virtual: bool = True) -> dict[str, str]:
    return dict(_summary_rows(summary, virtual))


def test_what_is_printed(tmp_path: Path) -> None:
    long, short = (run_rig(tmp_path / str(end), duration_s=end).summary for end in (6.0, 3.0))
    shown = rows(long)
    assert "x real time" in shown["duration"] and "x real time" not in rows(long, virtual=False)["duration"]
    (name,) = (name for name in shown if name.startswith("psi error"))
    assert name == "psi error, 3.6 to 6.0 s" and float(shown[name].split()[0]) < 0.01
    assert rows(short)["psi error"].startswith("- (controlled for less than 2.5 s")
    assert short["psi_error_rms_last_5s_rad"] is None
