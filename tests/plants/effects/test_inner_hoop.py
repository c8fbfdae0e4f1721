"""The inner hoop: landing, rolling, leaving it and falling back, by SciPy's integrator and forces written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hoopd.files.model import InnerHoop, ModelFile, model_text
from hoopd.files.reading import InputError
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.contact_modes import LEAST_REBOUND_M_S
from hoopd.plants.model_file import effects_of, load_model, parse_model
from hoopd.sim.plant import RigPlant
from tests.plants.effects.carried_over import changes_of

Array = NDArray[np.float64]
FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
V = {**FILE.values(), "bh": 0.0, "bb": 0.0}
RI = 0.0445
OUTER, INNER = V["Ro"] - V["Rb"], RI + V["Rb"]
# Half a radian above the horizontal, as fast as the hoop just holds it, in a hoop that turns as the ball rolls.
OFF = np.pi / 2 + 0.62
RATE = float(np.sqrt(-V["g"] * np.cos(OFF) / OUTER))
THROWN = np.array([0.0, 12.0, OFF, RATE])


def with_inner(radius_m: float) -> ModelFile:
    return msgspec.structs.replace(FILE, device=msgspec.structs.replace(FILE.device, inner=InnerHoop(radius_m)))


class Body(NamedTuple):
    """Hoop and ball in the plane: x across, y up; angles count from the bottom to the right."""

    theta: float
    dtheta: float
    spin: float
    place: Array
    speed: Array

    def packed(self) -> Array:
        return np.array([self.theta, self.dtheta, self.spin, *self.place, *self.speed])

    @property
    def energy(self) -> float:
        kinetic = V["Ih"] * self.dtheta**2 + V["Ib"] * self.spin**2 + V["mb"] * float(self.speed @ self.speed)
        return kinetic / 2 + V["mb"] * V["g"] * float(self.place[1])

    @property
    def momentum(self) -> float:
        """About the axis, of all."""
        across = self.place[0] * self.speed[1] - self.place[1] * self.speed[0]
        return float(V["Ih"] * self.dtheta + V["Ib"] * self.spin + V["mb"] * across)


def unpacked(y: Array) -> Body:
    return Body(float(y[0]), float(y[1]), float(y[2]), np.array(y[3:5]), np.array(y[5:7]))


def flown(t: float, body: Body, until: float) -> tuple[float, Body, bool]:
    """A flight to the next touch of either track, or to the end."""

    def rate(t: float, y: Array) -> list[float]:
        return [y[1], 0.0, 0.0, y[5], y[6], 0.0, -V["g"]]

    def outer(t: float, y: Array) -> float:
        return float(np.hypot(y[3], y[4]) - OUTER - 1e-9)

    def inner(t: float, y: Array) -> float:
        return float(np.hypot(y[3], y[4]) - INNER + 1e-9)

    for event, direction in ((outer, 1), (inner, -1)):
        event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    run = solve_ivp(rate, (t, until), body.packed(), events=(outer, inner), rtol=1e-11, atol=1e-12, max_step=1e-3)
    return float(run.t[-1]), unpacked(run.y[:, -1]), run.status == 1


def struck(body: Body, e: float, mu: float) -> tuple[Body, float]:
    """After a touch of the inner track, and the speed across that is left."""
    out = body.place / np.linalg.norm(body.place)
    along = np.array([-out[1], out[0]])
    across = float(body.speed @ out)  # inwards: below zero
    back = -e * across if -e * across > LEAST_REBOUND_M_S else 0.0
    # J along on the ball; its lowest point is at -Rb out, the hoop's at Ri
    slide = RI * body.dtheta - (float(body.speed @ along) - V["Rb"] * body.spin)
    most = mu * V["mb"] * (abs(across) + back)
    j = np.clip(slide / (1 / V["mb"] + RI**2 / V["Ih"] + V["Rb"] ** 2 / V["Ib"]), -most, most)
    speed = along * (float(body.speed @ along) + j / V["mb"]) + out * back
    return Body(body.theta, body.dtheta - j * RI / V["Ih"], body.spin - j * V["Rb"] / V["Ib"], body.place, speed), back


def rolled(t: float, body: Body, until: float) -> tuple[float, Body, bool]:
    """On the inner track until nothing presses the ball on it, by the friction force f that keeps it rolling:

    m r psi'' = -m g sin psi + f,  Ib w' = -Rb f,  Ih theta'' = -Ri f,  r psi' - Rb w = Ri theta'
    """
    psi = float(np.arctan2(body.place[0], -body.place[1])) % (2 * np.pi)
    dpsi = float(body.speed @ np.array([np.cos(psi), np.sin(psi)])) / INNER

    def rate(t: float, y: Array) -> list[float]:
        f = V["g"] * np.sin(y[3]) / (1 / V["mb"] + V["Rb"] ** 2 / V["Ib"] + RI**2 / V["Ih"])
        acceleration = (-V["g"] * np.sin(y[3]) + f / V["mb"]) / INNER
        return [y[1], -RI * f / V["Ih"], -V["Rb"] * f / V["Ib"], y[4], acceleration]

    def pressed(t: float, y: Array) -> float:
        return float(-(INNER * y[4] ** 2 + V["g"] * np.cos(y[3])))

    pressed.terminal = True  # type: ignore[attr-defined]
    start = [body.theta, body.dtheta, body.spin, psi, dpsi]
    run = solve_ivp(rate, (t, until), start, events=pressed, rtol=1e-11, atol=1e-12, max_step=1e-3)
    theta, dtheta, spin, psi, dpsi = run.y[:, -1]
    place = INNER * np.array([np.sin(psi), -np.cos(psi)])
    speed = INNER * dpsi * np.array([np.cos(psi), np.sin(psi)])
    return float(run.t[-1]), Body(theta, dtheta, spin, place, speed), run.status == 1


def thrown_body() -> Body:
    """Right when it leaves the outer hoop, rolling."""
    out = np.array([np.sin(OFF), -np.cos(OFF)])
    along = np.array([np.cos(OFF), np.sin(OFF)])
    spin = (V["Ro"] * THROWN[1] - OUTER * RATE) / V["Rb"]
    return Body(0.0, float(THROWN[1]), float(spin), OUTER * out, OUTER * RATE * along)


def plant(restitution: float, mu: float, x0: Array = THROWN, *, inner: bool = False) -> RigPlant:
    entries = (
        FoundEffect("ball.lift_off", {"restitution": restitution, "grip": mu}),
        FoundEffect("ball.inner_hoop", {"radius": RI}),
    )
    return RigPlant(FoundEffects(FILE.structure, V, entries), x0, inner=inner)


@pytest.mark.parametrize(("restitution", "mu"), [(0.0, 1e3), (0.3, 1e3), (0.3, 0.02)])
def test_it_lands_rolls_and_falls_as_an_independent_integrator_says(restitution: float, mu: float) -> None:
    rig, t, body, modes = plant(restitution, mu), 0.0, thrown_body(), []
    changes: list[tuple[float, str]] = []
    for _ in range(60):
        t, body, touched = flown(t, body, 1.0)
        if not touched or np.linalg.norm(body.place) > (OUTER + INNER) / 2:
            break
        before = body
        body, back = struck(body, restitution, mu)
        # an impulse between hoop and ball moves no momentum about the axis, and takes energy away
        assert body.momentum == pytest.approx(before.momentum, abs=1e-10) and body.energy < before.energy
        changes.append((t, "air" if back > 0.0 else "inner"))
        if back > 0.0:
            continue
        if mu < 1.0:
            break  # without grip it slides on, where a track without slip rolls at once
        energy = body.energy
        t, body, left = rolled(t, body, 1.0)
        assert left and body.energy == pytest.approx(energy, abs=1e-9)
        changes.append((t, "air"))
    for k in range(1, 51):
        rig.advance(0.02 * k, 0.0)
        modes.append(rig.ball_mode)
    told = [(one.t, one.target) for one in rig._course._course.changes if one.t > 1e-6]  # type: ignore[union-attr]
    assert [mode for _, mode in told[: len(changes)]] == [mode for _, mode in changes]
    assert [at for at, _ in told[: len(changes)]] == pytest.approx([at for at, _ in changes], abs=2e-6)
    if mu > 1.0:
        assert "inner" in modes and told[len(changes)][0] == pytest.approx(t, abs=1e-5)


@pytest.mark.parametrize(("restitution", "mu"), [(0.0, 1e3), (0.3, 0.3), (0.0, 0.02)])
@pytest.mark.parametrize("torque_nm", [-0.5, 0.0, 0.5])
def test_no_change_of_mode_makes_energy_or_momentum(restitution: float, mu: float, torque_nm: float) -> None:
    entries = (
        FoundEffect("ball.lift_off", {"restitution": restitution, "grip": mu}),
        FoundEffect("ball.inner_hoop", {"radius": RI}),
    )
    found = FoundEffects(FILE.structure, V, entries)
    changes = changes_of(found, THROWN, torque_nm, 1.0)
    assert {(one.source, one.target) for one in changes} >= {("air", "inner")}
    for one in changes:
        assert one.momenta[1] == pytest.approx(one.momenta[0], abs=1e-9), one
        assert one.energies[1] <= one.energies[0] + 1e-9, one


def test_at_rest_on_the_top_it_stays_until_something_moves_it_and_energy_is_kept() -> None:
    rig = plant(0.0, 1e3, np.array([0.0, 0.0, np.pi, 0.0]), inner=True)
    rig.advance(0.5, 0.0)
    assert rig.ball_mode == "inner" and rig.state[2] == pytest.approx(np.pi, abs=1e-9)
    assert rig.distance == pytest.approx(INNER / OUTER)
    moved = plant(0.0, 1e3, np.array([0.0, 0.0, np.pi + 0.01, 0.0]), inner=True)
    moved.advance(1.0, 0.0)
    assert moved.ball_mode != "inner"


def test_a_torque_moves_ball_and_hoop_as_forces_by_hand_say() -> None:
    rig, torque = plant(0.0, 1e3, np.array([0.0, 0.0, np.pi + 0.1, 0.5]), inner=True), 0.2
    for k in range(1, 6):
        rig.advance(0.01 * k, torque)

    def rate(t: float, y: Array) -> list[float]:
        # Ri theta'' = r psi'' - Rb w'
        free = V["g"] * np.sin(y[2]) + RI * torque / V["Ih"]
        f = free / (1 / V["mb"] + V["Rb"] ** 2 / V["Ib"] + RI**2 / V["Ih"])
        return [y[1], (torque - RI * f) / V["Ih"], y[3], (-V["g"] * np.sin(y[2]) + f / V["mb"]) / INNER]

    run = solve_ivp(rate, (0.0, 0.05), [0.0, 0.0, np.pi + 0.1, 0.5], rtol=1e-11, atol=1e-12)
    assert rig.ball_mode == "inner" and rig.state == pytest.approx(tuple(run.y[:, -1]), abs=1e-7)


def test_the_model_file_tells_it_and_refuses_what_cannot_be() -> None:
    entry = effects_of(with_inner(RI)).entries[-1]
    assert entry.name == "ball.inner_hoop" and entry.parameters == {"radius": RI}
    assert not effects_of(FILE).entries
    text = model_text(with_inner(RI))
    assert parse_model(text, "m.yaml").device.inner == InnerHoop(RI)
    told = yaml.safe_load(text)
    told["device"]["inner"]["radius_m"] = 0.09
    with pytest.raises(InputError, match=r"m.yaml: device.inner.radius_m"):
        parse_model(yaml.safe_dump(told), "m.yaml")
