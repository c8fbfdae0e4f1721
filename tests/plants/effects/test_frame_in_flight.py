"""A frame that leans under a ball that flies: gravity and beginning turned by one angle give the same motion, turned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.flight import FlightRun
from hoopd.plants.model_file import load_model
from hoopd.sim.plant import RigPlant

FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = FILE.values()
LIFT_OFF = FoundEffect("ball.lift_off", {"restitution": 0.3, "grip": 0.2})
INNER = FoundEffect("ball.inner_hoop", {"radius": 0.0445})


def found(lean: float, *more: FoundEffect) -> FoundEffects:
    tilt = (FoundEffect("frame.tilt", {"d": lean}),) if lean else ()
    return FoundEffects(FILE.structure, V, (LIFT_OFF, *more, *tilt))


def thrown(lean: float, *more: FoundEffect) -> RigPlant:
    plant = RigPlant(found(lean, *more), np.array([0.0, 0.0, 2.2 + lean, 9.5]))
    for k in range(1, 16):
        plant.advance(0.02 * k, 0.05)
    return plant


@pytest.mark.parametrize("lean", [-0.3, 0.1, 0.5])
@pytest.mark.parametrize("more", [(), (INNER,)])
def test_turned_gravity_turns_the_motion_and_nothing_else(lean: float, more: tuple[FoundEffect, ...]) -> None:
    upright, leaning = thrown(0.0, *more), thrown(lean, *more)
    assert leaning.flights == [pytest.approx(one, abs=1e-9) for one in upright.flights]
    assert np.array(leaning.state) - [0.0, 0.0, lean, 0.0] == pytest.approx(np.array(upright.state), abs=1e-6)
    assert leaning.ball_mode == upright.ball_mode and leaning.distance == pytest.approx(upright.distance, abs=1e-9)


def test_a_free_run_lets_the_ball_go_where_leaning_gravity_does() -> None:
    t = np.arange(0.0, 0.3, 0.02)
    runs = []
    for lean in (0.0, 0.2):
        one = found(lean)
        run = FlightRun(one.plant, one.effects(), values=one.values)
        run.run([], np.array([0.0, 0.0, 2.2 + lean, 9.5]), t, np.full(len(t) - 1, 0.05))
        runs.append(run.flights)
    assert runs[1] == [pytest.approx(one, abs=1e-9) for one in runs[0]] and runs[0]
