"""A law that shows itself once: what was set aside for it tells it from what the rest does not exclude."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hoopd.commands import diagnose
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.diagnose.search import told_by_intervals
from hoopd.diagnose.search.candidates import Settings
from hoopd.diagnose.search.screen import Score

CHAMBER = """
schema: hoopd.plant/1
name: chamber
states: {Ta: {unit: degC, usual: 30}, Tw: {unit: degC, usual: 30}}
inputs: {duty: {unit: "-", limit: 1}}
parameters:
  P: {value: 800, unit: W, held: true}
  T0: {value: 22, unit: degC, held: true}
  Ca: {value: 5000, unit: J/K, bounds: [1, 1.0e+6]}
  Cw: {value: 30000, unit: J/K, bounds: [1, 1.0e+6]}
  Uaw: {value: 20, unit: W/K, bounds: [0, .inf]}
  Uwa: {value: 5, unit: W/K, bounds: [0, .inf]}
equations:
  Ta: Ca*Ta' = P*duty - Uaw*(Ta - Tw)
  Tw: Cw*Tw' = Uaw*(Ta - Tw) - Uwa*(Tw - T0)
channels: {Ta: {reads: Ta, sensor: thermometer}}
sample_time_s: 30
"""
ROWS, BLOCK, STEPS, DEAD = 720, 20, 30, 0.08


def recorded(path: Path, weakest: float) -> Path:
    """Six hours of a heater that does nothing below 8 %, which is asked for so little in one block alone."""
    random = np.random.default_rng(1)
    blocks = random.uniform(0.12, 1.0, ROWS // BLOCK)
    blocks[9] = weakest
    duty, air, wall, rows = np.repeat(blocks, BLOCK), 22.0, 22.0, []
    for k, u in enumerate(duty):
        rows.append(f"{30 * k},{u:.4f},{air + 0.05 * random.standard_normal():.2f}")
        for _ in range(STEPS):
            into_wall = 25.0 * (air - wall)
            air += 30.0 / STEPS * (800.0 * max(0.0, u - DEAD) - into_wall) / 6000.0
            wall += 30.0 / STEPS * (into_wall - 6.0 * (wall - 22.0)) / 40000.0
    path.write_text("\n".join(["t,duty,Ta [degC]", *rows]))
    return path


def test_the_one_demand_below_a_dead_zone_tells_it_from_a_constant_input(tmp_path: Path) -> None:
    (tmp_path / "chamber.yaml").write_text(CHAMBER)
    path = recorded(tmp_path / "chamber.csv", 0.03)
    found = diagnose.run(DiagnoseOptions(recordings=(str(path),), plant=str(tmp_path / "chamber.yaml"), free_run=False))
    (one,) = found.effects
    assert one.name == "actuator.deadzone" and not one.not_excluded
    low, high = one.parameters["d"].ci95 or (0.0, 0.0)
    assert low < DEAD < high and high - low < 0.01
    assert [one.segments_ignored for one in found.data_quality.recordings.values()] == [[]]


def test_what_was_screened_on_other_intervals_is_fitted_from_the_base(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first screen is about a fit of the stretches that counted then; some of what was set aside may be back."""
    monkeypatch.setattr(told_by_intervals, "neighbours", lambda *_: [])
    member: Any = SimpleNamespace(effect=SimpleNamespace(name="store.leak"))
    before: Any = object()
    score = Score(member, 50.0, {}, np.zeros(1), before)
    one: Any = SimpleNamespace(effect=SimpleNamespace(name="thermometer.scale"), score=score)
    named: Any = SimpleNamespace(accepted=[one], scores=[score], base=None)
    asked: list[Score] = []

    def tried(_: Any, score: Score) -> Any:
        asked.append(score)
        return SimpleNamespace(fit=SimpleNamespace(criterion=0.0))

    judge: Any = SimpleNamespace(settings=Settings(), tried=tried)
    told_by_intervals._others(named, judge, one)
    assert [score.origin for score in asked] == [None]
