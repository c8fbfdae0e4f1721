"""Frictions that follow the normal force, in a frame that leans or shakes: its formula by another way to the same
motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.free_run import FreeRun
from hoopd.plants.hoop.effects.flight import FlightRun
from hoopd.plants.model_file import load_model

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = FILE.values()
RESISTANCE = FoundEffect("ball.rolling_resistance", {"r": 8e-4})
SLIP = FoundEffect("ball.slip", {"mu": 0.06})
LIFT_OFF = FoundEffect("ball.lift_off", {"restitution": 0.0, "grip": 0.2})
INNER = FoundEffect("ball.inner_hoop", {"radius": 0.0445})
T = np.arange(0.0, 0.6, 0.02)
TORQUE = 0.15 * np.sign(np.sin(9.0 * T[:-1]))


def run(x0: list[float], *effects: FoundEffect, base: dict[str, float] = V, steps: int = 1) -> Array:
    """States (n, 4) or more, of a free run in small steps."""
    found = FoundEffects(FILE.structure, base, effects)
    flies = any(one.name == LIFT_OFF.name for one in effects)
    free = (FlightRun if flies else FreeRun)(found.plant, found.effects(), values=found.values)
    t = np.linspace(0.0, T[-1], (len(T) - 1) * steps + 1)
    return np.asarray(free.run([], np.array(x0), t, np.repeat(TORQUE, steps)).states[::steps, :4])


@pytest.mark.parametrize("effect", [RESISTANCE, SLIP])
@pytest.mark.parametrize("lean", [-0.4, 0.3])
def test_a_frame_that_leans_turns_the_motion_and_nothing_else(effect: FoundEffect, lean: float) -> None:
    upright = run([0.0, 0.0, 1.2, 0.0], effect)
    leaning = run([0.0, 0.0, 1.2 + lean, 0.0], effect, FoundEffect("frame.tilt", {"d": lean}))
    free = run([0.0, 0.0, 1.2, 0.0])
    assert leaning - [0.0, 0.0, lean, 0.0] == pytest.approx(upright, abs=1e-9)
    assert np.abs(upright - free)[:, 2].max() > 0.01


@pytest.mark.parametrize("effect", [RESISTANCE, SLIP])
@pytest.mark.parametrize("psi", [1.1, -0.7])
def test_a_frame_that_is_pushed_steadily_is_one_that_leans_under_more_gravity(effect: FoundEffect, psi: float) -> None:
    """sqrt(g^2 + a^2), leaning by atan(a/g)."""
    a = 3.0
    heavy = {**V, "g": float(np.hypot(V["g"], a))}
    leaning = FoundEffect("frame.tilt", {"d": float(np.arctan(a / V["g"]))})
    pushed = FoundEffect("frame.vibration", {"A": a, "w": 1e-9, "phi": np.pi / 2})
    x = [run([0.0, 0.0, psi, 0.0], effect, pushed), run([0.0, 0.0, psi, 0.0], effect, leaning, base=heavy)]
    assert x[0] == pytest.approx(x[1], abs=1e-6)


def test_on_the_inner_hoop_too() -> None:
    """A ball on its top for a while, rolling with resistance: turned gravity turns it."""
    ends = []
    for lean in (0.0, 0.2):
        tilt = (FoundEffect("frame.tilt", {"d": lean}),) if lean else ()
        x = run([0.0, 0.0, 2.2 + lean, 9.5], LIFT_OFF, INNER, RESISTANCE, *tilt, steps=10)
        ends.append(x - [0.0, 0.0, lean, 0.0])
    assert ends[1] == pytest.approx(ends[0], abs=1e-6)
    assert ends[0] != pytest.approx(run([0.0, 0.0, 2.2, 9.5], LIFT_OFF, RESISTANCE, steps=10), abs=0.1)  # it was on it


def test_on_the_inner_hoop_a_frame_that_is_pushed_is_one_that_leans_under_more_gravity() -> None:
    a = 2.0
    heavy = {**V, "g": float(np.hypot(V["g"], a))}
    leaning = FoundEffect("frame.tilt", {"d": float(np.arctan(a / V["g"]))})
    pushed = FoundEffect("frame.vibration", {"A": a, "w": 1e-9, "phi": np.pi / 2})
    on_it = (LIFT_OFF, INNER, RESISTANCE)
    x = [
        run([0.0, 0.0, 2.3, 9.5], *on_it, *more, base=base, steps=10)
        for more, base in (((pushed,), V), ((leaning,), heavy))
    ]
    assert x[0] == pytest.approx(x[1], abs=1e-5)
    assert x[0] != pytest.approx(run([0.0, 0.0, 2.3, 9.5], LIFT_OFF, RESISTANCE, pushed, steps=10), abs=0.1)


def test_a_frame_at_rest_changes_no_bit() -> None:
    still = FoundEffect("frame.tilt", {"d": 0.0}), FoundEffect("frame.vibration", {"A": 0.0, "w": 5.0, "phi": 0.0})
    assert np.array_equal(run([0.0, 0.0, 1.2, 0.0], RESISTANCE, *still), run([0.0, 0.0, 1.2, 0.0], RESISTANCE))
