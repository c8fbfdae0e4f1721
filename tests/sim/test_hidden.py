"""The rig's plant with hidden physics: late torque, late pictures, friction that holds; nothing hidden: no change."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.files.reading import InputError
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model
from hoopd.shell import config as configuration
from hoopd.sim import parts
from hoopd.sim.plant import RigPlant, make_plant

FILE = load_model(Path(__file__).resolve().parents[2] / "config" / "models" / "hoop.yaml")
BASE = HoopPlant(FILE.structure, FILE.values())
START = np.array([0.0, 0.0, 0.3, 0.0])


def hidden(held: bool = False, hold_s: float = 0.0, **effects: dict[str, float]) -> RigPlant:
    entries = tuple(FoundEffect(name.replace("__", "."), values) for name, values in effects.items())
    return RigPlant(FoundEffects(FILE.structure, FILE.values(), entries), START, held=held, hold_s=hold_s)


def test_without_effects_the_rig_is_the_one_it_was() -> None:
    plant, x = make_plant(FILE.structure, FILE.values(), START.tolist(), effects={}), START
    for k in range(1, 60):
        u = 0.05 * (-1) ** (k // 7)
        x = BASE.advance(x, u, 0.013 * k - plant.t)
        plant.advance(0.013 * k, u)
        assert plant.state == plant.shown == pytest.approx(tuple(x), abs=1e-9)  # in other steps of a millisecond


def test_a_neutral_effect_moves_as_the_base() -> None:
    plant, base = (
        hidden(hoop__coulomb_friction={"Fc": 0.0}),
        RigPlant(FoundEffects(FILE.structure, FILE.values()), START),
    )
    for k in range(1, 60):
        for one in (plant, base):
            one.advance(0.013 * k, 0.05 * (-1) ** (k // 7))
    assert plant.state == pytest.approx(base.state, abs=1e-8)


def test_a_late_torque_arrives_when_it_should_whatever_the_steps() -> None:
    late = hidden(actuator__delay={"d": 0.0133})
    for t, u in ((0.020, 0.0), (0.027, 0.1), (0.040, 0.1), (0.061, -0.1), (0.10, -0.1)):
        late.advance(t, u)
    x = START
    for begin, until, u in ((0.0, 0.0333, 0.0), (0.0333, 0.0533, 0.1), (0.0533, 0.10, -0.1)):
        for _ in range(10):
            x = BASE.advance(x, u, (until - begin) / 10)
    assert late.state == pytest.approx(tuple(x), abs=1e-6)


def test_a_late_camera_shows_the_past_and_the_state_is_the_present() -> None:
    late, plain = hidden(camera__latency={"d": 0.04}), RigPlant(FoundEffects(FILE.structure, FILE.values()), START)
    past = {}
    for k in range(1, 300):
        t = 0.002 * k
        late.advance(t, 0.05)
        plain.advance(t, 0.05)
        past[k] = plain.state
    assert late.state == pytest.approx(plain.state, abs=1e-8)
    assert late.shown[2] == pytest.approx(past[299 - 20][2], abs=1e-8)
    theta, dtheta, current = late.sample()
    assert (theta, dtheta) == pytest.approx(plain.state[:2], abs=1e-8) and isnan(current)


def test_sensors_err_as_they_are_told() -> None:
    wrong = hidden(encoder__eccentricity={"a": 0.1, "phi": 0.3, "follows": 0.0}, camera__angle_offset={"d": 0.02})
    wrong.advance(0.3, 0.05)
    theta, _, psi, _ = wrong.state
    assert wrong.sample()[0] == pytest.approx(theta + 0.1 * np.sin(theta + 0.3))
    assert wrong.shown[2] == pytest.approx(psi + 0.02)


def test_friction_holds_the_hoop_and_a_hand_holds_both() -> None:
    stuck = hidden(hoop__coulomb_friction={"Fc": 0.02})
    for k in range(1, 100):
        stuck.advance(0.01 * k, 0.005)
    assert abs(stuck.state[1]) < 1e-4
    held = hidden(held=True, hold_s=0.5, hoop__coulomb_friction={"Fc": 0.02})
    held.advance(0.3, 0.1)
    assert held.state == tuple(START)
    held.advance(0.6, 0.0)
    held.advance(0.7, 0.1)
    assert held.state != tuple(START)


def effects_in(*sets: str) -> dict[str, dict[str, float]]:
    config = configuration.load(None, sim=True, overrides=list(sets))
    return parts.rig_effects(config, FILE)


def test_neutral_effects_are_none_and_phases_may_be_left_out() -> None:
    assert effects_in("sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0}}]") == {}
    told = effects_in("sim.effects=[{name: actuator.cogging, parameters: {A: 0.01, n: 7}}]")
    assert told == {"actuator.cogging": {"A": 0.01, "n": 7.0, "phi": 0.0}}


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ("{name: hoop.rust}", "sim.effects[0].name"),
        ("{name: hoop.coulomb_friction, parameters: {Fc: 1}}", "sim.effects[0].parameters.Fc"),
        ("{name: camera.late_frames, parameters: {share: 0.1}}", "sim.effects"),
    ],
)
def test_what_cannot_be_hidden_is_one_line(entry: str, key: str) -> None:
    with pytest.raises(InputError) as raised:
        effects_in(f"sim.effects=[{entry}]")
    assert raised.value.key == key


def test_an_effect_begins_and_goes_at_its_time_and_the_ball_moves_on() -> None:
    config = configuration.load(
        None, sim=True,
        overrides=["sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.02}, at_s: 0.3, for_s: 0.4}]"],
    )  # fmt: skip
    told = parts.plant_arguments(config, FILE) | {"x0": START.tolist(), "held": False}
    assert told["effects"] == {} and [t for t, *_ in told["later"]] == [0.3, 0.7] and told["later"][1][1] == {}
    changing, plain = make_plant(**told), RigPlant(FoundEffects(FILE.structure, FILE.values()), START)
    dissipated = hidden(hoop__coulomb_friction={"Fc": 0.02})
    for t in (0.1, 0.3):
        changing.advance(t, 0.05)
        plain.advance(t, 0.05)
    assert changing.state == pytest.approx(plain.state, abs=1e-9)
    dissipated.restart(np.array(changing.state), t=0.3)
    changing.advance(0.7, 0.05)
    dissipated.advance(0.7, 0.05)
    assert changing.state == pytest.approx(dissipated.state, abs=1e-6)
    plain.restart(np.array(changing.state), t=0.7)
    changing.advance(1.0, 0.05)
    plain.advance(1.0, 0.05)
    assert changing.state == pytest.approx(plain.state, abs=1e-6)


def exchanging(*exchanges: str) -> dict[str, Any]:
    config = configuration.load(None, sim=True, overrides=[f"sim.exchanges=[{', '.join(exchanges)}]"])
    return parts.plant_arguments(config, FILE) | {"x0": START.tolist(), "held": False}


def test_another_ball_is_in_the_hoop_from_its_time_on_and_the_next_one_after_it() -> None:
    """The ball of glass has a third of the steel one's mass; what moves goes on from where it was."""
    told = exchanging("{at_s: 0.6, parameters: {bb: 5.0e-6}}", "{at_s: 0.3, parameters: {mb: 0.0203, Ib: 1.23e-6}}")
    glass = FILE.values() | {"mb": 0.0203, "Ib": 1.23e-6}
    assert told["parameters"] == FILE.values()
    assert [(t, numbers) for t, _, numbers in told["later"]] == [(0.3, glass), (0.6, glass | {"bb": 5.0e-6})]
    changing, plain = make_plant(**told), RigPlant(FoundEffects(FILE.structure, FILE.values()), START)
    for one in (changing, plain):
        one.advance(0.3, 0.05)
    assert changing.state == pytest.approx(plain.state, abs=1e-9)
    light = RigPlant(FoundEffects(FILE.structure, glass), np.array(changing.state), t=0.3)
    for one in (changing, plain, light):
        one.advance(0.6, 0.05)
    assert changing.state == pytest.approx(light.state, abs=1e-6)
    assert abs(changing.state[1] - plain.state[1]) > 0.1


@pytest.mark.parametrize(
    ("exchange", "key"),
    [
        ("{at_s: 1, parameters: {mass: 0.02}}", "sim.exchanges[0].parameters.mass"),
        ("{at_s: 1, parameters: {mb: -0.02}}", "sim.exchanges[0].parameters.mb"),
        ("{at_s: 1, parameters: {Rb: 0.2}}", "sim.exchanges[0].parameters.Rb"),
        ("{at_s: 1, parameters: {}}", "sim.exchanges[0].parameters"),
    ],
)
def test_what_no_hoop_can_be_is_one_line(exchange: str, key: str) -> None:
    with pytest.raises(InputError) as raised:
        exchanging(exchange)
    assert raised.value.key == key


def test_exchanges_add_up_in_the_order_of_their_times() -> None:
    told = exchanging("{at_s: 2, parameters: {Rb: 0.2}}", "{at_s: 1, parameters: {Ro: 0.4}}")
    assert [numbers["Rb"] for _, _, numbers in told["later"]] == [FILE.values()["Rb"], 0.2]


def test_another_ball_where_none_is_expected_is_one_line() -> None:
    sets = ["faults.ball_expected=false", "sim.exchanges=[{at_s: 1, parameters: {Jh: 0.01, mb: 0.02}}]"]
    config = configuration.load(None, sim=True, overrides=sets)
    with pytest.raises(InputError) as raised:
        parts.plant_arguments(config, FILE)
    assert raised.value.key == "sim.exchanges[0].parameters.mb"


def of(*entries: FoundEffect, **numbers: float) -> FoundEffects:
    return FoundEffects(FILE.structure, FILE.values() | numbers, entries)


def test_two_exchanges_while_hands_hold_the_ball_are_the_last_one() -> None:
    later = [(0.2, of(mb=0.02)), (0.4, of(mb=0.08))]
    changing = RigPlant(of(), START, held=True, hold_s=1.0, later=later)
    last = RigPlant(of(mb=0.08), START, held=True, hold_s=1.0)
    for one in (changing, last):
        for t, u in ((0.1, 0.0), (1.1, 0.0), (1.2, 0.05), (1.5, 0.05)):
            one.advance(t, u)
    assert changing.state == last.state != tuple(START)


def test_what_an_effect_remembers_goes_on_through_an_exchange_of_nothing() -> None:
    """A cable wound up half a turn, a lag, a camera that shows the past: nothing in them is of the change."""
    told = (
        FoundEffect("hoop.dahl_of_theta", {"A": 0.03, "xs": 20.0}),
        FoundEffect("actuator.lag", {"T": 0.05}),
        FoundEffect("camera.latency", {"d": 0.03}),
        FoundEffect("camera.angle_offset", {"d": 0.01}),
    )
    changing, plain = RigPlant(of(*told), START, later=[(0.5, of(*told))]), RigPlant(of(*told), START)
    for k in range(1, 100):
        for one in (changing, plain):
            one.advance(0.01 * k, 0.1)
        assert changing.state == pytest.approx(plain.state, abs=1e-12)
        assert changing.shown == pytest.approx(plain.shown, abs=1e-12)


def test_what_was_seen_before_friction_with_a_memory_began_is_still_shown_late() -> None:
    late = FoundEffect("camera.latency", {"d": 0.04})
    begins = of(late, FoundEffect("hoop.dahl_of_theta", {"A": 0.03, "xs": 20.0}))
    changing = RigPlant(of(late), START, later=[(0.2, begins)])
    past = {}
    for k in range(1, 200):
        changing.advance(0.002 * k, 0.05)
        past[k] = changing.state[2]
        if k > 20:
            assert changing.shown[2] == pytest.approx(past[k - 20], abs=1e-5)


def test_a_change_waits_until_a_flying_ball_has_landed() -> None:
    """The ball is on its way at 8 m/s when dry friction begins: it flies on as it would have, and lands."""
    flies = FoundEffect("ball.lift_off", {"grip": 0.3, "restitution": 0.0})
    rough = of(flies, FoundEffect("hoop.coulomb_friction", {"Fc": 0.02}))
    fast = np.array([0.0, 0.0, 1.5, 9.0])
    plain = RigPlant(of(flies), fast)
    flights: list[str] = []
    while plain.ball_mode != "air" and plain.t < 3.0:
        plain.advance(plain.t + 0.002, 0.0)
    begun = plain.t
    changing, plain = RigPlant(of(flies), fast, later=[(begun + 0.004, rough)]), RigPlant(of(flies), fast)
    while plain.t < begun + 1.0:
        for one in (changing, plain):
            one.advance(one.t + 0.002, 0.0)
        flights.append(changing.ball_mode)
        if plain.t > 0.01 + begun and plain.ball_mode == "air" and len(plain.flights) == 1:
            assert changing.distance == plain.distance < 1.0
    assert changing.flights[0] == plain.flights[0] and flights[-1] == "rolling"
    assert changing.state[1] != plain.state[1]


def test_a_camera_that_becomes_late_shows_the_past_from_then_on() -> None:
    found = FoundEffects(FILE.structure, FILE.values(), (FoundEffect("camera.latency", {"d": 0.04}),))
    changing = RigPlant(FoundEffects(FILE.structure, FILE.values()), START, later=[(0.2, found)])
    past = {}
    for k in range(1, 200):
        changing.advance(0.002 * k, 0.05)
        past[k] = changing.state[2]
        assert changing.shown[2] == pytest.approx(past[k] if k <= 100 else past[k - 20], abs=1e-5)
