"""A track's linear model against finite differences of its own one-step map and readings; calls on plain arrays."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.batch_calls import CHUNK, Mapped, Recursion, flat
from hoopd.plants.likelihood.composites import fitting_effects, key_of
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Array

PLANT = shipped_plant()
LIBRARY = library(PLANT)
VALUES = {
    "actuator.lag.T": 0.03,
    "actuator.delay.d": 0.013,
    "camera.latency.d": 0.021,
    "encoder.speed_lag.T": 0.02,
    "hoop.quadratic_drag.c": 1e-4,
    "frame.tilt.d": 0.1,
}
SETS = [
    (),
    ("actuator.lag", "camera.latency"),
    ("actuator.delay", "encoder.speed_lag", "frame.tilt"),
    ("hoop.quadratic_drag", "camera.latency"),
]


def track_with(names: tuple[str, ...], seconds: float = 1.0) -> Track:
    track = Track(stretch_with(PLANT, "a", 3, seconds), [LIBRARY[name] for name in names])
    random = np.random.default_rng(1)
    z, filtered, predicted = (track.z + 0.01 * random.normal(size=track.z.shape) for _ in range(3))
    track.moved(z, track.w, filtered, predicted)
    return track


def moved(track: Track, values: dict[str, float], name: str, step: float) -> tuple[Array, Array]:
    """Slopes of one-step map and readings by a parameter."""
    both = [{**values, name: values[name] + sign * step} for sign in (1, -1)]
    after = [track.after(one) for one in both]
    readings = [track.readings(one) for one in both]
    return (after[0] - after[1]) / (2 * step), (readings[0] - readings[1]) / (2 * step)


@pytest.mark.parametrize("names", SETS)
def test_columns_are_derivatives_by_the_parameters(names: tuple[str, ...]) -> None:
    track = track_with(names)
    values = {**track.composite.values, **{k: v for k, v in VALUES.items() if k in track.composite.names}}
    free = (*PLANT.free, *(name for name in VALUES if name in track.composite.names))
    found = track.columns(values, free)
    # the residual is that of the reference, to first order from the filter's states
    step = np.einsum("nij,nj->ni", found.model.a, (track.z - track.filtered)[:-1])
    reading = np.einsum("nij,nj->ni", found.model.c, track.z - track.predicted)
    assert np.allclose(found.f[:, :, 0], track.after(values) + step - track.z[1:], rtol=0, atol=1e-12)
    assert np.allclose(found.eps[:, :, 0], track.stretch.y - track.readings(values) - reading, rtol=0, atol=1e-12)
    for i, name in enumerate(free, start=1):
        f, y = moved(track, values, name, 1e-6 * max(abs(values[name]), 0.1))
        assert np.abs(found.f[:, :, i] - f).max() < 1e-5 * np.abs(f).max() + 1e-8
        # the torques on a late reading's way back are held while its latency moves: some percent at their edges
        share = 0.03 if name in track.composite.latencies.values() else 1e-5
        assert np.abs(found.eps[:, :, i] + y).max() < share * np.abs(y).max() + 1e-8


@pytest.mark.parametrize("names", SETS)
def test_matrices_are_derivatives_by_state_and_disturbance(names: tuple[str, ...]) -> None:
    track = track_with(names)
    values = {**track.composite.values, **{k: v for k, v in VALUES.items() if k in track.composite.names}}
    model = track.columns(values, ()).model
    for i in range(track.composite.nz):
        step = np.zeros_like(track.z)
        step[:, i] = 1e-6
        f = (track.after(values, track.filtered + step) - track.after(values, track.filtered - step)) / 2e-6
        y = (track.readings(values, track.predicted + step) - track.readings(values, track.predicted - step)) / 2e-6
        assert np.allclose(model.a[:, :, i], f, atol=1e-6) and np.allclose(model.c[:, :, i], y, atol=1e-6)
    for i in range(track.w.shape[1]):
        w = np.zeros_like(track.w)
        w[:, i] = 1e-6
        f = (track.after(values, w=w) - track.after(values, w=-w)) / 2e-6
        assert np.allclose(model.w[:, :, i], f, atol=1e-6 * np.abs(f).max())


def test_neutral_effects_change_nothing() -> None:
    base = track_with(())
    names = ("hoop.quadratic_drag", "camera.center_offset", "frame.tilt", "actuator.cogging")
    other = track_with(names).like(base)
    assert np.array_equal(other.readings({}), base.readings({}))
    assert np.allclose(other.after({}), base.after({}, substeps=other.composite.substeps), rtol=0, atol=1e-12)


def test_a_reference_is_taken_over_state_by_state() -> None:
    """Whatever was there before: of two hidden bodies the second one's states are not the first one's."""
    swing, loose = (mechanisms(PLANT)[f"hoop.{name}_of_dtheta"].effect for name in ("swing", "loose"))
    stretch = stretch_with(PLANT, "a", 3, 1.0)
    both, one = Track(stretch, [loose, swing]), Track(stretch, [swing])
    z = both.z + np.arange(both.z.shape[1])
    both.moved(z, both.w, z, z)
    taken = one.like(both)
    assert np.array_equal(taken.z, z[:, [0, 1, 2, 3, 6, 7]])
    # a body that nobody has seen yet begins to move along
    alone = Track(stretch, [swing])
    alone.lead_added({swing.key("A"): 0.0, swing.key("w"): 20.0, swing.key("zeta"): 0.1}, PLANT.states)
    assert alone.z[0, 5] == pytest.approx(alone.z[0, 1])
    assert np.ptp(alone.z[:, 4]) > 0.0


def test_a_value_of_a_recording_goes_before_that_of_all() -> None:
    track = track_with(("actuator.cogging",))
    name = "actuator.cogging.phi"
    assert track.local({name: 1.0, f"{name}@a": 2.0, f"{name}@b": 3.0})[name] == 2.0
    free = (f"{name}@a", f"{name}@b")
    found = track.columns({"actuator.cogging.A": 0.01, f"{name}@a": 2.0, f"{name}@b": 3.0}, free)
    assert found.f[:, :, 1].any() and not found.f[:, :, 2].any()


@pytest.mark.parametrize("name", ["actuator.lag", "encoder.speed_lag"])
def test_what_an_effect_adds_to_the_state_is_carried_along_given_states(name: str) -> None:
    track = track_with((name,))
    values = {f"{name}.T": 0.05}
    z = track.carried(values, track.z[:, :4])
    assert np.array_equal(z[:, :4], track.z[:, :4])
    assert np.ptp(z[:, 4]) > 0.0
    assert np.allclose(z[1:, 4], track.after(values, z)[:, 4], rtol=0, atol=1e-12)


def test_mobility_is_that_of_the_one_step_map() -> None:
    track = track_with(())
    model = track.columns(PLANT.values, ()).model
    expected = [abs(model.w[0, 1, 0]) / model.h[0], abs(model.w[0, 3, 1]) / model.h[0]]
    assert np.allclose(track.mobility(PLANT.values), expected, rtol=0.1)


def test_an_effect_of_a_slot_that_a_plant_lacks_is_none_of_its() -> None:
    tilt, bare = LIBRARY["frame.tilt"], replace(PLANT, name="bare", slots={"hoop": PLANT.slots["hoop"]})
    assert [one.name for one in fitting_effects(PLANT, [tilt])] == ["frame.tilt"] and not fitting_effects(bare, [tilt])


@pytest.mark.parametrize("n", [1, CHUNK, 2 * CHUNK + 7])
def test_calls_are_the_function_at_every_node(n: int) -> None:
    random = np.random.default_rng(n)
    x, y, p = ca.SX.sym("x", 2), ca.SX.sym("y", 2, 3), ca.SX.sym("p")
    function = ca.Function("f", [x, y, p], [ca.densify(ca.mtimes(x.T, y)) * p, y.T])
    a, b = random.normal(size=(n, 2)), random.normal(size=(n, 2, 3))
    product, turned = Mapped(function, n, (2,))(a, flat(b), np.array([3.0]))
    assert np.allclose(product[:, 0], 3 * np.einsum("ni,nij->nj", a, b)) and np.array_equal(
        turned, b.transpose(0, 2, 1)
    )
    total = Recursion(ca.Function("sum", [x, p], [x + p, 2 * x]))
    after, twice = total(np.array([1.0, 2.0]), a[:, :1])
    expected = np.cumsum(a[:, 0])[:, None] + [1.0, 2.0]
    assert np.allclose(after[:, :, 0], expected) and np.allclose(twice[1:, :, 0], 2 * expected[:-1])


def test_a_call_refuses_arguments_of_another_length() -> None:
    x = ca.SX.sym("x", 2)
    with pytest.raises(ValueError, match="expected"):
        Mapped(ca.Function("f", [x], [x]), 3)(np.zeros((4, 2)))


def test_a_plant_to_which_an_effect_adds_a_state_is_another_one() -> None:
    slip = LIBRARY["ball.slip"]
    assert slip.plant is not None
    assert key_of(slip.plant(PLANT)) != key_of(PLANT)
    assert key_of(shipped_plant()) == key_of(PLANT)
