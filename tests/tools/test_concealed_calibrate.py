"""Calibration of the threshold: the tail of what nulls reach, and the rates beside it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import cli, report  # noqa: E402
from concealed.calibrate import calibration, largest_surprise, tail_threshold  # noqa: E402
from concealed.judged import Judged  # noqa: E402


def case(family: str, verdict: str, *surprises: float, hidden: str = "") -> Judged:
    effects = [{"name": hidden, "nats": 100.0}] if hidden else []
    candidates = [{"name": f"slot.{i}", "surprise": s, "threshold": 12.0} for i, s in enumerate(surprises)]
    said: dict[str, Any] = {"verdict": verdict, "effects": [], "candidates": candidates}
    return Judged({"family": family, "effects": effects, "flags": {}}, said)


def test_the_tail_of_a_known_law() -> None:
    # P(S > s) = exp(-s/1.5): 2 % beyond 1.5 log 50
    found = [tail_threshold(np.random.default_rng(seed).exponential(1.5, 400), aim=0.02) for seed in range(20)]
    assert np.mean(found) == pytest.approx(1.5 * np.log(50.0), rel=0.05)
    assert tail_threshold(np.ones(8), aim=0.02) == 1.0


def test_rates_by_threshold_and_alarms_without_a_name() -> None:
    cases = [
        case("null", "parameters", 3.0, 7.0),
        case("decoy", "missing_physics", 13.0),
        case("null", "unknown_physics", 1.0),
        case("null", "consistent"),
        case("single", "missing_physics", 40.0, hidden="hoop.imbalance"),
        case("single", "parameters", 9.0, hidden="hoop.imbalance"),
        case("unknown", "unknown_physics", 90.0, hidden="unknown.cable"),
    ]
    found = calibration(cases)
    at = {row["threshold"]: (row["alarms"]["k"], row["seen"]["k"]) for row in found["by_threshold"]}
    assert (found["nulls"], found["singles"]) == (4, 2)
    assert at[6.0] == (2, 2) and at[8.0] == (1, 2) and at[12.0] == (1, 1) and at[14.0] == (0, 1)
    assert found["other_alarms"]["k"] == 1  # the unknown one; the decoy's name asked for its alarm
    assert found["largest"] == [0.0, 1.0, 7.0, 13.0]
    assert largest_surprise({}) == 0.0
    assert "| 12 | 25 % (1/4" in report.calibration_markdown(found, "made up")


def test_only_tuning_seeds_calibrate(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        cli.main(["calibrate", "--tuning", str(2**33), "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()
