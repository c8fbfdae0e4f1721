"""Plants of other kinds against their closed forms: first-order states, no input, several inputs, read expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.free_run import readings, run
from hoopd.plants.plant_with_effects import Composite

# An RC low pass: R C y' = u - y.
CIRCUIT = Plant(
    name="low pass",
    first_order=("y",),
    rates=lambda s: (s.source - s.y) / (s.p["R"] * s.p["C"]),
    inputs=(Input("source", "V"),),
    values={"R": 1e3, "C": 1e-6},
    channels={"y": Channel("y", "V")},
    time_scale_s=1e-5,
)


def _outflow(level: Any, c: Any) -> Any:
    return c * ca.sqrt(ca.fmax(level, 0.0))


# A1 h1' = q1 - c1 sqrt(h1),  A2 h2' = q2 + c1 sqrt(h1) - c2 sqrt(h2)
TANKS = Plant(
    name="tanks",
    first_order=("h1", "h2"),
    rates=lambda s: ca.vertcat(
        (s.q1 - _outflow(s.h1, s.p["c1"])) / s.p["A1"],
        (s.q2 + _outflow(s.h1, s.p["c1"]) - _outflow(s.h2, s.p["c2"])) / s.p["A2"],
    ),
    inputs=(Input("q1", "m3/s"), Input("q2", "m3/s")),
    values={"A1": 0.02, "A2": 0.03, "c1": 1.2e-4, "c2": 1e-4},
    channels={"h2": Channel("h2", "m"), "flow": Channel(unit="m3/s", reading=lambda s: s.p["c2"] * ca.sqrt(s.h2))},
    time_scale_s=1.0,
)
# m l^2 q'' = -m g l sin q; nothing drives it.
PENDULUM = Plant(
    name="pendulum",
    coordinates=("q",),
    accelerations=lambda s, force: force / (s.p["m"] * s.p["l"] ** 2) - s.p["g"] / s.p["l"] * ca.sin(s.q),
    values={"m": 0.2, "l": 0.4, "g": 9.81},
    channels={"q": Channel("q", "rad")},
    slots={"pivot": Slot("body", "q", turns=True)},
    energy=lambda s: s.p["m"] * s.p["l"] * (s.p["l"] * s.dq**2 / 2 - s.p["g"] * ca.cos(s.q)),
)


def test_a_low_pass_follows_its_exponential() -> None:
    t, u = np.arange(301) * 1e-5, np.where(np.arange(300) < 150, 5.0, -1.0)
    y = run(Composite(CIRCUIT), {}, [0.0], t, u)[:, 0]
    decay = np.exp(-(t[:151]) / 1e-3)
    assert y[:151] == pytest.approx(5.0 * (1 - decay), abs=1e-10)
    assert y[150:] == pytest.approx(-1.0 + (y[150] + 1.0) * decay, abs=1e-10)


def test_two_tanks_with_two_inputs_agree_with_another_solver() -> None:
    t = np.arange(0.0, 121.0)
    u = np.column_stack([np.where(t[:-1] < 60, 9e-5, 2e-5), np.where(t[:-1] < 30, 0.0, 4e-5)])
    composite = Composite(TANKS)
    z = run(composite, {}, [0.3, 0.2], t, u)

    def rate(k: int) -> Any:
        v = TANKS.values
        return lambda _, h: [
            (u[k, 0] - v["c1"] * np.sqrt(h[0])) / v["A1"],
            (u[k, 1] + v["c1"] * np.sqrt(h[0]) - v["c2"] * np.sqrt(h[1])) / v["A2"],
        ]

    h = np.array([0.3, 0.2])
    for k in range(len(t) - 1):
        h = solve_ivp(rate(k), (0.0, 1.0), h, rtol=1e-11, atol=1e-13).y[:, -1]
        assert z[k + 1] == pytest.approx(h, abs=1e-8)
    read = readings(composite, {}, [0.3, 0.2], t, u)
    assert np.array_equal(read["h2"], z[:, 1])
    assert read["flow"] == pytest.approx(TANKS.values["c2"] * np.sqrt(z[:, 1]))


def test_inputs_that_do_not_fit_are_one_line() -> None:
    with pytest.raises(ValueError, match="n - 1 rows of 2 inputs"):
        run(Composite(TANKS), {}, [0.3, 0.2], [0.0, 1.0], [1e-5])


def test_a_pendulum_without_input_keeps_its_energy() -> None:
    t = np.arange(0.0, 5.0, 0.02)
    z = run(Composite(PENDULUM), {}, [2.0, 0.0], t)
    point = PENDULUM.point(z.T, PENDULUM.values)
    assert PENDULUM.energy is not None
    energy = np.array([float(PENDULUM.energy(PENDULUM.point(x, PENDULUM.values))) for x in z])
    assert np.ptp(energy) < 1e-6 * (energy.max() + 0.2 * 0.4 * 9.81)
    assert np.abs(point.q).max() == pytest.approx(2.0, abs=1e-3)


def test_an_effect_may_act_on_a_first_order_state_and_on_the_drive() -> None:
    leak = Effect(
        "tank.leak",
        (EffectParameter("k", "1/s", 0.0, 0.0, 1.0, grid=(0.01,)),),
        force=lambda s, e: {"h1": -e.k * s.h1},
    )
    gain = Effect("pump.gain", (EffectParameter("k", "-", 1.0, 0.0, 3.0),), torque=lambda s, e: e.k * s.u)
    t, u = np.arange(0.0, 31.0), np.tile([5e-5, 1e-5], (30, 1))
    composite = Composite(TANKS, (leak, gain))
    assert np.array_equal(run(composite, {}, [0.3, 0.2], t, u), run(Composite(TANKS, (), 4), {}, [0.3, 0.2], t, u))
    doubled = run(composite, {"pump.gain.k": 2.0}, [0.3, 0.2], t, u)
    assert np.array_equal(doubled, run(Composite(TANKS), {}, [0.3, 0.2], t, u * [2.0, 1.0]))
    h1 = run(composite, {"tank.leak.k": 0.01, "c1": 0.0}, [0.3, 0.2], t, 0 * u)[:, 0]
    assert h1 == pytest.approx(0.3 * np.exp(-0.01 * t), rel=1e-9)


def test_a_lag_and_a_delay_are_those_of_the_first_input() -> None:
    motor = Plant(
        name="motor",
        coordinates=("q",),
        accelerations=lambda s, force: (force + s.p["k"] * s.i) / s.p["J"],
        first_order=("i",),
        rates=lambda s: (s.v - s.p["R"] * s.i - s.p["k"] * s.dq) / s.p["L"],
        inputs=(Input("v", "V", 24.0), Input("load", "N m", coordinate="q")),
        values={"J": 1e-3, "k": 0.05, "R": 2.0, "L": 1e-2},
        channels={"q": Channel("q", "rad")},
        slots={"amplifier": Slot("actuator", "q")},
    )
    late = Effect("amplifier.late", (EffectParameter("d", "s", 0.0, 0.0, 1.0),), delay="d")
    t = np.arange(0.0, 1.001, 0.02)
    u = np.column_stack([np.where(t[:-1] < 0.5, 6.0, -6.0), np.where(t[:-1] < 0.2, 0.0, 0.03)])
    moved = np.column_stack([np.where(t[:-1] < 0.54, 6.0, -6.0), u[:, 1]])
    z = run(Composite(motor, (late,)), {"amplifier.late.d": 0.04}, np.zeros(3), t, u)
    assert z == pytest.approx(run(Composite(motor), {}, np.zeros(3), t, moved), abs=1e-9)


@pytest.mark.parametrize("plant", [CIRCUIT, TANKS, PENDULUM], ids=lambda one: one.name)
def test_halving_the_step_changes_nothing(plant: Plant) -> None:
    n, h = 100, plant.time_scale_s
    t = np.arange(n + 1) * h
    u = None if not plant.inputs else np.full((n, len(plant.inputs)), 3e-5).squeeze()
    x0 = np.full(len(plant.states), 0.4)
    coarse, fine = (run(Composite(plant, (), substeps), {}, x0, t, u) for substeps in (4, 8))
    assert coarse == pytest.approx(fine, abs=1e-7)


@pytest.mark.parametrize("plant", [CIRCUIT, TANKS, PENDULUM], ids=lambda one: one.name)
def test_jacobians_agree_with_differences(plant: Plant) -> None:
    c = Composite(plant)
    free = tuple(plant.values)
    z0, w, p = np.full(c.nz, 0.4), np.zeros(c.nw), c.vector({})
    u, h = np.full(c.nu, 3e-5), plant.time_scale_s
    function = c.substep_derivatives(free)
    _, by = (one.full() for one in function(z0, u, w, h, 0.0, p))

    def after(z: Any, w: Any, u: Any, p: Any) -> Any:
        return function(z, u, w, h, 0.0, p)[0].full().ravel()

    arguments = [z0, w, u, p]
    columns = []
    for index, one in enumerate(arguments):
        for j in range(len(one)):
            step = 1e-5 * abs(one[j]) or 1e-8
            moved = [
                [*arguments[:index], one + sign * step * np.eye(len(one))[j], *arguments[index + 1 :]]
                for sign in (1, -1)
            ]
            columns.append((after(*moved[0]) - after(*moved[1])) / (2 * step))
    assert by == pytest.approx(np.column_stack(columns), rel=1e-5, abs=1e-6 * np.abs(by).max())
