"""Every effect against a second derivation: the rolling device and the effect typed again by hand, integrated by other
means (an adaptive solver from switch to switch; for dry friction tiny steps)."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, exp, sin

import numpy as np
import pytest
from harness.effectcases import SIZES, VALUES, composite, sizes, two_level
from scipy.integrate import solve_ivp

from hoopd.plants.free_run import readings, run

V = VALUES["rolling"]
MB, RO, RB, G, IB, IH, BB, BH = (V[n] for n in ("mb", "Ro", "Rb", "g", "Ib", "Ih", "bb", "bh"))
RATIO, R = RO / RB, RO - RB
# the table of combinations of the rolling ball
M11, M12, M22 = IH + IB * RATIO**2, -IB * RATIO * (RATIO - 1), MB * R**2 + IB * (RATIO - 1) ** 2
DET, D = M11 * M22 - M12**2, BB * RATIO**2
X0 = np.array([0.2, -1.0, 0.5, 2.0])
T, U = two_level(1.0, 0.1)

Rate = Callable[[float, np.ndarray, float], list[float]]


def device(x: np.ndarray, on_theta: float, on_psi: float, tilt: float = 0.0) -> tuple[float, float]:
    """(theta'', psi'') under generalised forces."""
    a = on_theta - (D + BH) * x[1] + D * x[3]
    b = on_psi + D * x[1] - D * x[3] - MB * G * R * sin(x[2] - tilt)
    return (M22 * a - M12 * b) / DET, (M11 * b - M12 * a) / DET


def second(force: Callable[[float, np.ndarray, float], tuple[float, float]], tilt: float = 0.0) -> Rate:
    """A rate function from the torque on the hoop and the force on psi at (t, x, demand)."""

    def rate(t: float, x: np.ndarray, u: float) -> list[float]:
        one, two = device(x, *force(t, x, u), tilt)
        return [x[1], one, x[3], two]

    return rate


def solved(rate: Rate, start: np.ndarray = X0, late: float = 0.0) -> np.ndarray:
    """States at the nodes; the torque switches `late` seconds after its node, before the first one it is the first."""
    switches = np.unique(np.concatenate([[0.0], T[1:-1] + late, T]))
    x, states = start, {0.0: start}
    for begin, end in pairwise(switches):
        u = U[np.clip(np.searchsorted(T + late, (begin + end) / 2) - 1, 0, len(U) - 1)]
        x = solve_ivp(rate, (begin, end), x, args=(u,), rtol=1e-9, atol=1e-11, max_step=0.01).y[:, -1]
        states[float(end)] = x
    return np.array([states[float(t)] for t in T])


def clip(value: float, most: float) -> float:
    return max(-most, min(most, value))


def edge(t: float) -> float:
    return max(0.0, min(1.0, t / 0.010 + 0.5))


P = SIZES
SMOOTH: dict[str, Rate] = {
    "actuator.torque_gain": second(lambda t, x, u: (1.3 * u, 0.0)),
    "actuator.torque_bias": second(lambda t, x, u: (u + 0.006, 0.0)),
    "actuator.deadzone": second(lambda t, x, u: (0.0 if abs(u) < 0.02 else u - 0.02 * np.sign(u), 0.0)),
    "actuator.saturation": second(lambda t, x, u: (clip(u, 0.06), 0.0)),
    "actuator.cogging": second(lambda t, x, u: (u + 0.008 * sin(7 * x[0] + 0.4), 0.0)),
    "actuator.ripple": second(lambda t, x, u: (u * (1 + 0.2 * sin(3 * x[0] - 0.7)), 0.0)),
    "actuator.back_emf_limit": second(lambda t, x, u: (clip(u, max(0.0, 0.7 * (1 - abs(x[1]) / 9.0))), 0.0)),
    "hoop.quadratic_drag": second(lambda t, x, u: (u - 1e-4 * x[1] * abs(x[1]), 0.0)),
    "hoop.imbalance": second(lambda t, x, u: (u - 0.01 * sin(x[0] + 0.9), 0.0)),
    "hoop.friction_drift": second(lambda t, x, u: (u - BH * 0.8 * (1 - exp(-t / 0.7)) * x[1], 0.0)),
    "ball.quadratic_drag": second(lambda t, x, u: (u, -1e-4 * x[3] * abs(x[3]))),
    "frame.tilt": second(lambda t, x, u: (u, 0.0), tilt=0.05),
    "frame.vibration": second(lambda t, x, u: (u, MB * R * 0.5 * cos(x[2]) * sin(25 * t + 0.3))),
    "external.disturbance": second(lambda t, x, u: (u + 0.03 * (edge(t - 0.313) - edge(t - 0.622)), 0.0)),
}
# RK4 over 5 ms against a kink of a limit, of a pulse's ramp or of |rate|; everything else is smooth within a step
KINKS = {"actuator.back_emf_limit": 1e-3, "external.disturbance": 1e-3}


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_effects(name: str) -> None:
    z = run(composite("rolling", name), sizes(name), X0, T, U)
    assert np.abs(z - solved(SMOOTH[name])).max() < KINKS.get(name, 1e-5)
    # the base alone is far from it
    assert np.abs(z - solved(second(lambda t, x, u: (u, 0.0)))).max() > 1e-2


def test_lag() -> None:
    def rate(t: float, x: np.ndarray, u: float) -> list[float]:
        one, two = device(x, x[4], 0.0)
        return [x[1], one, x[3], two, (u - x[4]) / 0.03]

    z = run(composite("rolling", "actuator.lag"), sizes("actuator.lag"), X0, T, U)
    # the mean of the torque over a substep stands for its course
    assert np.abs(z[:, :4] - solved(rate, np.append(X0, U[0]))[:, :4]).max() < 1e-3
    fine = run(composite("rolling", "actuator.lag", substeps=40), sizes("actuator.lag"), X0, T, U)
    assert np.abs(fine - solved(rate, np.append(X0, U[0]))).max() < 5e-5


def test_lag_stands_behind_the_maps() -> None:
    def rate(t: float, x: np.ndarray, u: float) -> list[float]:
        one, two = device(x, x[4], 0.0)
        return [x[1], one, x[3], two, (u + 0.008 * sin(7 * x[0] + 0.4) - x[4]) / 0.03]

    names = ("actuator.lag", "actuator.cogging")
    z = run(composite("rolling", *names), sizes(*names), X0, T, U)
    assert np.abs(z - solved(rate, np.append(X0, U[0]))).max() < 2e-3


def test_delay_is_a_fraction_of_a_sample() -> None:
    base = second(lambda t, x, u: (u, 0.0))
    c = composite("rolling", "actuator.delay")
    for late in (0.02, 0.04):
        z = run(c, {"actuator.delay.d": late}, X0, T, U)
        assert np.abs(z - solved(base, late=late)).max() < 1e-5
    # a switch within a substep: its mean torque stands for it
    z = run(c, {"actuator.delay.d": 0.027}, X0, T, U)
    assert np.abs(z - solved(base, late=0.027)).max() < 3e-3
    assert np.abs(z[:, [0, 2]] - solved(base, late=0.027)[:, [0, 2]]).max() < 2e-4


# ---------------------------------------------------------------------------------------------- dry friction

STEP = 2e-5


def crept(friction: Callable[[list[float]], tuple[float, float, float]], seconds: float = 0.6) -> np.ndarray:
    """States at the nodes by tiny steps: velocity first, then friction as a clipped impulse, then position."""
    x, rows, per_node = [float(v) for v in X0], [X0], round(0.02 / STEP)
    for u in U[: round(seconds / 0.02)]:
        for _ in range(per_node):
            one, two = device(x, u, 0.0)  # type: ignore[arg-type]
            x[1], x[3] = x[1] + STEP * one, x[3] + STEP * two
            level, a, b = friction(x)
            # M^-1 a,  and the impulse that stops the rate
            pa, pb = (M22 * a - M12 * b) / DET, (M11 * b - M12 * a) / DET
            impulse = clip(-(a * x[1] + b * x[3]) / (a * pa + b * pb), level * STEP)
            x[1], x[3] = x[1] + pa * impulse, x[3] + pb * impulse
            x[0], x[2] = x[0] + STEP * x[1], x[2] + STEP * x[3]
        rows.append(np.array(x))
    return np.array(rows)


def normal(x: list[float]) -> float:
    return max(MB * (R * x[3] ** 2 + G * cos(x[2])), 0.0)


DRY: dict[str, Callable[[list[float]], tuple[float, float, float]]] = {
    "hoop.coulomb_friction": lambda x: (0.005, 1.0, 0.0),
    "hoop.stribeck_friction": lambda x: (0.004 + 0.004 * exp(-((x[1] / 0.8) ** 2)), 1.0, 0.0),
    "ball.coulomb_friction": lambda x: (1e-4, RATIO, -RATIO),
    "ball.rolling_resistance": lambda x: (1.5e-4 * normal(x), RATIO, -RATIO),
}


@pytest.mark.parametrize("name", DRY)
def test_dry_friction(name: str) -> None:
    z, small = run(composite("rolling", name), sizes(name), X0, T, U), crept(DRY[name])
    assert np.abs(z[: len(small), [0, 2]] - small[:, [0, 2]]).max() < 5e-4
    assert np.abs(z[: len(small)] - small).max() < 5e-3
    assert np.abs(crept(lambda x: (0.0, 1.0, 0.0)) - small).max() > 2e-2


def test_coast_down_under_dry_friction_is_the_closed_form() -> None:
    # the hoop alone: Ih theta'' = -bh theta' - Fc:  theta' = (w + Fc/bh) e^(-bh t/Ih) - Fc/bh until it stops
    speed, fc = 4.0, 0.005
    end = IH / BH * np.log(1 + speed * BH / fc)
    t = np.arange(101) * 0.02
    moving = np.minimum(t, end)
    decay = np.exp(-BH / IH * moving)
    expected = (speed + fc / BH) * IH / BH * (1 - decay) - fc / BH * moving
    c = composite("rolling", "hoop.coulomb_friction", moving="hoop")
    z = run(c, {"hoop.coulomb_friction.Fc": fc}, [0.0, speed], t, np.zeros(100))
    assert 0.5 < end < 1.5
    assert np.abs(z[:, 0] - expected).max() < 1e-5
    # and stays there to the last bit
    after = z[t > end + 0.02]
    assert len(np.unique(after[:, 0])) == 1
    assert not after[:, 1].any()


# ---------------------------------------------------------------------------------------------- slip


def slipping(t: float, x: np.ndarray, u: float) -> list[float]:
    """Hoop, path and spin w = x[4] as three bodies; the contact a steep smooth friction of mu N."""
    slide = RATIO * x[1] - (RATIO - 1) * x[3] - x[4]
    f = -0.08 * normal(list(x)) * np.tanh(slide / 0.02)
    # the rolling friction turns with phi' = w - psi'
    drag = BB * (x[4] - x[3])
    theta2 = (u - BH * x[1] + RATIO * RB * f) / IH
    psi2 = (drag - MB * G * R * sin(x[2]) - (RATIO - 1) * RB * f) / (MB * R**2)
    return [x[1], theta2, x[3], psi2, (-RB * f - drag) / IB]


def test_slip_is_hoop_path_and_spin_with_a_contact_of_mu_n() -> None:
    n = 16
    spin = RATIO * X0[1] - (RATIO - 1) * X0[3]
    x, rows = np.append(X0, spin), []
    for k in range(n):
        x = solve_ivp(slipping, (0, 0.02), x, "LSODA", args=(U[k],), rtol=1e-7, atol=1e-9).y[:, -1]
        rows.append(x)
    z = run(composite("rolling", "ball.slip"), sizes("ball.slip"), X0, T[: n + 1], U[:n])
    slide = [RATIO * x[1] - (RATIO - 1) * x[3] - x[4] for x in rows]
    assert np.abs(slide).max() > 3.0
    assert np.abs(z[1:, :4] - np.array(rows)[:, :4]).max() < 5e-3
    assert np.abs(z[1:, 5] - slide).max() < 0.1


# ---------------------------------------------------------------------------------------------- sensors

C_BASE = composite("rolling")
Z = run(C_BASE, {}, X0, T, U)


def seen(name: str, **changes: float) -> dict[str, np.ndarray]:
    c = composite("rolling", name)
    values = {**sizes(name), **{f"{name}.{key}": value for key, value in changes.items()}}
    return readings(c, values, X0, T, U)


def test_angle_offset_and_center_offset() -> None:
    assert np.abs(seen("camera.angle_offset")["psi"] - (Z[:, 2] + 0.05)).max() < 1e-15
    # whole turns: unwrapped as the true angle is
    far = np.array([0.2, -1.0, 40.0, 2.0])
    c, values = composite("rolling", "camera.center_offset"), sizes("camera.center_offset")
    z = run(c, values, far, T, U)
    expected = np.unwrap(np.arctan2(np.sin(z[:, 2]) + 0.05, np.cos(z[:, 2]) - 0.08))
    found = readings(c, values, far, T, U)["psi"]
    assert np.abs(found - expected - 2 * np.pi * np.round((found - expected)[0] / (2 * np.pi))).max() < 1e-12
    assert np.abs(found - z[:, 2]).max() < 0.2


def test_eccentricity_in_both_ways() -> None:
    angle = Z[:, 0] + 0.2
    for follows in (0.0, 1.0):
        y = seen("encoder.eccentricity", follows=follows)
        assert np.abs(y["theta"] - (Z[:, 0] + 0.05 * np.sin(angle))).max() < 1e-15
        assert np.abs(y["dtheta"] - Z[:, 1] * (1 + follows * 0.05 * np.cos(angle))).max() < 1e-14


def test_an_uneven_scale_in_both_ways() -> None:
    angle = 3.0 * Z[:, 0] + 0.4
    for follows in (0.0, 1.0):
        y = seen("encoder.harmonic", follows=follows)
        assert np.abs(y["theta"] - (Z[:, 0] + 0.03 * np.sin(angle))).max() < 1e-15
        assert np.abs(y["dtheta"] - Z[:, 1] * (1 + follows * 0.09 * np.cos(angle))).max() < 1e-14


@pytest.mark.parametrize(("name", "late"), [("camera.latency", 0.033), ("encoder.latency", 0.011)])
def test_latency_is_the_state_of_an_earlier_time(name: str, late: float) -> None:
    y = seen(name)
    dense, held = np.arange(0, 1001) * 0.001, np.repeat(U, 20)
    z = run(C_BASE, {}, X0, dense, held)
    at = np.round((T - late) / 0.001).astype(int)
    for channel, index in (("psi", 2),) if name.startswith("camera") else (("theta", 0), ("dtheta", 1)):
        assert np.abs(y[channel] - z[at, index])[at >= 0].max() < 1e-5
        # before the start: on the way that leads to the first state
        assert np.abs(y[channel][0] - (X0[index] - late * {0: X0[1], 1: 60.0, 2: X0[3]}[index])) < 0.5


def test_latency_in_a_filter_is_that_of_a_free_run() -> None:
    names = ("actuator.lag", "camera.latency", "hoop.coulomb_friction", "encoder.speed_lag", "encoder.latency")
    c, values = composite("rolling", *names), sizes(*names)
    z = run(c, values, X0, T, U)
    y = readings(c, values, X0, T, U)
    # a long hold: the mean torques of the way back are the torque itself
    nodes = [k for k in range(5, len(U)) if len(set(U[k - 4 : k])) == 1]
    for k in nodes:
        back = np.full((3, 3), U[k - 1])
        found = c.output_function(z[k], back, np.zeros(2), T[k], c.vector(values)).full().ravel()
        for channel, value in zip(c.channels, found, strict=True):
            assert abs(value - y[channel][k]) < {"theta": 2e-4, "dtheta": 3e-2, "psi": 1e-3}[channel]
    assert len(nodes) > 5


def test_speed_lag() -> None:
    c, values = composite("rolling", "encoder.speed_lag"), sizes("encoder.speed_lag")
    base = second(lambda t, x, u: (u, 0.0))
    expected = solved(lambda t, x, u: [*base(t, x, u), (x[1] - x[4]) / 0.06], np.append(X0, X0[1]))
    y = readings(c, values, X0, T, U)
    assert np.abs(y["dtheta"] - expected[:, 4]).max() < 5e-4
    assert np.array_equal(y["theta"], Z[:, 0])
