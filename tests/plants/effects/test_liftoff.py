"""Free flight: the parabola, what the air and the impact conserve, and that a ball that stays is untouched."""

from __future__ import annotations

import numpy as np
import pytest
from harness.effectcases import VALUES, composite, two_level

from hoopd.plants.free_run import readings, run
from hoopd.plants.hoop.effects.flight import PRESSED, FlightRun

V = VALUES["rolling"]
R = V["Ro"] - V["Rb"]
# fast enough to pass the axis, too slow for the top
X0 = np.array([0.0, 17.0 * R / V["Ro"], 0.0, 17.0])


def axis(step: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(round(1.0 / step) + 1) * step
    return t, np.zeros(len(t) - 1)


def normal(x: np.ndarray) -> np.ndarray:
    return np.asarray(V["mb"] * (R * x[:, 3] ** 2 + V["g"] * np.cos(x[:, 2])))


def test_a_ball_that_stays_on_the_hoop_is_untouched() -> None:
    t, u = two_level(1.0, 0.03)
    x0 = np.array([0.0, 0.0, 0.4, 0.0])
    rolls = run(composite("rolling"), {}, x0, t, u)
    assert normal(rolls).min() > V["mb"] * PRESSED
    assert np.array_equal(run(composite("rolling", "ball.lift_off"), {}, x0, t, u), rolls)
    # just before the top of what it can do, it is followed in smaller steps
    x0 = np.array([0.0, 0.0, 1.4, 0.0])
    rolls = run(composite("rolling", substeps=10), {}, x0, t, 0 * u)
    assert 0.0 < normal(rolls).min() < V["mb"] * PRESSED
    assert np.abs(run(composite("rolling", "ball.lift_off"), {}, x0, t, 0 * u) - rolls).max() < 1e-4


@pytest.mark.parametrize("structure", ["rolling", "published", "entries"])
def test_it_leaves_where_the_normal_force_ends_and_flies_a_parabola(structure: str) -> None:
    t, u = axis(0.002)
    c = composite(structure, "ball.lift_off")
    free = FlightRun(c.declared, c.effects)
    x = free.run([], X0, t, u).states
    begin, end = free.flights[0]
    at = int(np.ceil(begin / 0.002 - 1e-6))
    # the contact's force is positive a step before
    assert normal(x[: at - 1]).min() > 0.0
    assert abs(normal(x[at : at + 1])[0]) < 0.02
    # from there x = x0 + v t, y = y0 + v t - g t^2/2 in the plane: its direction is psi
    air = np.arange(at, int(end / 0.002))
    s, (psi, rate) = t[air] - t[at], x[at, 2:]
    across = R * np.sin(psi) + R * rate * np.cos(psi) * s
    up = -R * np.cos(psi) + R * rate * np.sin(psi) * s - V["g"] * s**2 / 2
    # (off its line of sight by less than 0.05 mm: the run took off up to a node earlier)
    assert np.abs(across * np.cos(x[air, 2]) + up * np.sin(x[air, 2])).max() < 5e-5
    assert x[air[-1], 2] < 0.5 < 2.0 < x[at, 2]
    # it lands where the parabola meets the hoop
    assert np.hypot(across, up)[1:].max() < R
    late = end - t[at]
    landing = np.hypot(R * np.sin(psi) + R * rate * np.cos(psi) * late,
                       -R * np.cos(psi) + R * rate * np.sin(psi) * late - V["g"] * late**2 / 2)  # fmt: skip
    assert landing == pytest.approx(R, rel=1e-3)


def test_the_impact_keeps_the_angular_momentum_about_the_axis_and_takes_energy() -> None:
    c = composite("rolling", "ball.lift_off", bb=0.0, bh=0.0)
    free = FlightRun(c.declared, c.effects)
    t, u = axis(0.001)
    x = free.run([], X0, t, u).states
    begin, end = free.flights[0]
    before, after, leave = int(end / 0.001), int(end / 0.001) + 1, round(begin / 0.001)
    # in the air hoop and spin keep their rates
    assert np.abs(x[leave + 1 : before, 1] - x[leave, 1]).max() < 1e-9
    # Ih theta'' + M12 psi''... of rolling, the impulse P: Ih d(theta') = (Ro/Rb) Rb P = Ro P, Ib d(w) = -Rb P
    ratio = V["Ro"] / V["Rb"]
    spin_before = ratio * x[leave, 1] - (ratio - 1) * x[leave, 3]
    spin_after = ratio * x[after, 1] - (ratio - 1) * x[after, 3]
    impulse = -V["Ib"] * (spin_after - spin_before) / V["Rb"]
    assert V["Ih"] * (x[after, 1] - x[before, 1]) == pytest.approx(V["Ro"] * impulse, rel=0.05)
    # gravity acts for the rest of a step only
    assert V["mb"] * R**2 * (x[after, 3] - x[before, 3]) == pytest.approx(-R * impulse, abs=2e-4)


def test_a_slippery_landing_leaves_the_ball_slipping() -> None:
    names, t_u = ("ball.slip", "ball.lift_off"), axis()
    grips, slips = (run(composite("rolling", *names), {"ball.slip.mu": mu}, X0, *t_u) for mu in (5.0, 0.1))
    assert np.abs(grips[:, 5]).max() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(slips[:, 5]).max() > 10.0


def test_the_hoop_and_the_sensors_go_on_in_the_air() -> None:
    names = ("ball.lift_off", "hoop.coulomb_friction", "actuator.lag", "encoder.speed_lag", "camera.latency")
    values = {
        "hoop.coulomb_friction.Fc": 0.01,
        "actuator.lag.T": 0.03,
        "encoder.speed_lag.T": 0.05,
        "camera.latency.d": 0.02,
    }
    c, (t, u) = composite("rolling", *names), axis()
    z = run(c, values, X0, t, u)
    y = readings(c, values, X0, t, u)
    assert y["psi"][1:] == pytest.approx(z[:-1, 2], abs=1e-6)
    assert np.abs(y["dtheta"] - z[:, 1]).max() > 0.1
    alone = run(composite("rolling", *names), {**values, "hoop.coulomb_friction.Fc": 0.0}, X0, t, u)
    assert z[10, 1] < alone[10, 1]
    assert np.isfinite(z).all()
