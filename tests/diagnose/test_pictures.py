"""The curves of a report show the effect that made the data, in its own unit, over what it follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with
from scipy.signal import lfilter

from hoopd.diagnose.curves.effect_force import MissingForceSamples, Variable, follows, rate_name
from hoopd.diagnose.curves.missing_force import binned
from hoopd.diagnose.findings import parameters_of
from hoopd.diagnose.proof.fit_tables import played
from hoopd.diagnose.report.curve_pictures import harmonics_of, law_over, shown_of
from hoopd.diagnose.report_curves import MissingForce, Shown
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Array, Stretch

PLANT = shipped_plant()
LIBRARY = library(PLANT)
IMBALANCE, LATENCY = LIBRARY["hoop.imbalance"], LIBRARY["camera.latency"]
SIZE_NM, LATE_S = 0.01, 0.03


def fitted(
    stretch: Stretch, effects: tuple = (), values: dict[str, float] | None = None, like: HypothesisFit | None = None
) -> HypothesisFit:
    start = {**PLANT.values, **(values or {})}
    return fit([stretch], effects, start, noise={stretch.recording: NOISE}, like=like, tune_noise=False)


def named(stretch: Stretch, effect: object, values: dict[str, float]) -> Named:
    base = fitted(stretch)
    final = fitted(stretch, (effect,), {**base.values, **values}, base)
    # as if tuned: the base's disturbance has to hold the effect
    noise = {stretch.recording: NOISE._replace(force=NOISE.force * 4.0)}
    return Named(base, base, final, without={final.names[0]: replace(base, noise=noise)})


@pytest.fixture(scope="module")
def swinging() -> tuple[Named, Shown]:
    """Two pieces of one recording with a mass on the hoop's rim; held out is the second one."""
    size = {"hoop.imbalance.A": SIZE_NM, "hoop.imbalance.phi": 0.7}
    made = stretch_with(PLANT, "a", 1, 9.0, [IMBALANCE], size)
    found = named(made.seconds(0.0, 6.0), IMBALANCE, {"hoop.imbalance.A": SIZE_NM, "hoop.imbalance.phi@a": 0.5})
    rest = replace(made.seconds(6.0, 9.0), recording="b")
    own = {**found.final.values, "hoop.imbalance.phi@b": 0.7}
    held = {"base": fitted(rest, (), found.base.values), "final": fitted(rest, (IMBALANCE,), own)}
    return found, shown_of(found, played(held), None, {"a": [(1.0, 2.0, "a hand")]})


@pytest.fixture(scope="module")
def late() -> MissingForce:
    made = stretch_with(PLANT, "a", 2, 6.0)
    y = made.y.copy()
    y[:, 2] = np.interp(made.t - LATE_S, made.t, y[:, 2])
    found = named(replace(made, y=y), LATENCY, {"camera.latency.d": LATE_S})
    (force,) = shown_of(found, {}, None, {}).forces
    return force


def _law(force: MissingForce, x: Array) -> Array:
    law = force.regressors[0].law
    assert law is not None
    return np.interp(x, law.x[np.isfinite(law.y)], law.y[np.isfinite(law.y)])


def test_a_force_of_the_angle_is_drawn_in_one_turn_with_its_law(swinging: tuple[Named, Shown]) -> None:
    (force,) = swinging[1].forces
    (over,) = force.regressors
    assert (force.slot, force.unit, over.name, over.unit) == ("hoop", "N m", "theta", "rad")
    assert over.value.min() >= 0.0
    assert over.value.max() <= 2.0 * np.pi
    assert over.binned is not None
    truth = -SIZE_NM * np.sin(over.binned.x + 0.7)
    assert _law(force, over.binned.x) == pytest.approx(truth, abs=0.2 * SIZE_NM)
    # the dots know nothing of the law, and follow it
    assert np.corrcoef(over.binned.mean, truth)[0, 1] > 0.95
    assert np.std(over.binned.mean - truth) < 0.35 * SIZE_NM


def test_its_harmonics_stand_out_at_the_first_order_alone(swinging: tuple[Named, Shown]) -> None:
    (spectrum,) = swinging[1].harmonics
    assert spectrum.threshold is not None
    assert spectrum.amplitude[0] == pytest.approx(SIZE_NM, rel=0.25)
    assert spectrum.amplitude[0] > 3.0 * spectrum.threshold[0]
    assert (spectrum.amplitude[1:] < 1.5 * spectrum.threshold[1:]).all()


def test_held_out_windows_are_lifted_apart_and_nearer_with_the_effect(swinging: tuple[Named, Shown]) -> None:
    (comparison,) = swinging[1].comparisons
    traces = {trace.name: trace for trace in comparison.traces}
    assert list(traces) == ["theta_rate", "dtheta", "psi"]
    assert [one.unit for one in traces.values()] == ["rad/s", "rad/s", "rad"]
    for name, trace in traces.items():
        assert trace.after is not None
        assert np.isfinite(trace.t_s).all()
        assert (np.diff(trace.t_s) >= 0.0).all()
        assert np.isnan(trace.before).sum() == 1  # two windows in 3 s
        worse, better = (float(np.nanstd(trace.measured - one)) for one in (trace.before, trace.after))
        assert better < (0.95 if name == "psi" else 0.7) * worse  # the ball feels the hoop's rim at second hand


def test_strips_are_multiples_of_what_is_left_with_the_effect(swinging: tuple[Named, Shown]) -> None:
    strips = {strip.slot: strip for strip in swinging[1].strips}
    # bodies by the disturbance that they need, sensors by what is left of their readings
    assert list(strips) == ["hoop", "ball", "encoder", "camera"]
    assert 0.5 < np.nanmedian(strips["encoder"].strength) < 10.0
    assert np.median(strips["hoop"].strength) > 1.5 * np.median(strips["ball"].strength)
    assert strips["hoop"].ignored == [(1.0, 2.0, "a hand")]


def test_the_error_of_a_late_reading_is_drawn_over_the_rate(late: MissingForce) -> None:
    (over,) = late.regressors
    assert (late.slot, late.unit, over.name, over.unit) == ("camera", "rad", "dpsi", "rad/s")
    assert over.binned is not None
    slope = np.polyfit(over.binned.x, over.binned.mean, 1)[0]
    assert slope == pytest.approx(-LATE_S, rel=0.15)
    assert np.polyfit(over.binned.x, _law(late, over.binned.x), 1)[0] == pytest.approx(-LATE_S, rel=0.15)


def test_a_law_that_jumps_at_rest_is_lifted_there() -> None:
    x = np.random.default_rng(1).normal(size=2000)
    law = law_over("dry", Variable("dx", "m/s", x), -np.sign(x))
    assert law is not None
    (gap,) = np.flatnonzero(np.isnan(law.y))
    assert law.x[gap] == 0.0
    assert set(law.y[:gap]) == {1.0}
    assert set(law.y[gap + 1 :]) == {-1.0}
    smooth = law_over("drag", Variable("dx", "m/s", x), -x)
    assert smooth is not None
    assert np.isfinite(smooth.y).all()


def test_a_periodic_law_is_a_smooth_line_over_the_turn_that_was_seen() -> None:
    theta = np.random.default_rng(2).uniform(0.5, 5.5, 1500)
    law = law_over("wave", Variable("theta", "rad", theta, turning=True), np.sin(7.0 * theta))
    assert law is not None and law.is_curve and len(law.x) > 500
    seen = np.isfinite(law.y)
    np.testing.assert_allclose(law.y[seen], np.sin(7.0 * law.x[seen]), atol=0.02)
    assert not seen[law.x < 0.3].any() and seen[(law.x > 0.6) & (law.x < 5.4)].all()


def test_a_law_of_two_variables_is_no_line_over_one_of_them() -> None:
    random = np.random.default_rng(3)
    theta, u = random.uniform(0.0, 2 * np.pi, 1500), random.normal(size=1500)
    law = law_over("ripple", Variable("theta", "rad", theta, turning=True), u * np.sin(2.0 * theta))
    assert law is not None and not law.is_curve and len(law.x) > 1000


def test_a_push_is_drawn_where_somebody_pushed() -> None:
    """Of two recordings the longer one was drawn, in which nobody did."""
    push = LIBRARY["external.disturbance"]
    own = {f"{push.name}.t0": 1.0, f"{push.name}.t1": 1.5, f"{push.name}.A": 0.01}
    each = [stretch_with(PLANT, "long", 3, 6.0), stretch_with(PLANT, "pushed", 4, 4.0, [push], own)]
    noise = {one.recording: NOISE for one in each}
    base = fit(each, (), {**PLANT.values}, noise=noise, tune_noise=False)
    at = {push.key("A"): 0.01, push.key("t0@pushed"): 1.0, push.key("t1@pushed"): 1.5}
    final = fit(each, (push,), {**base.values, **at}, noise=noise, like=base, tune_noise=False)
    (force,) = shown_of(Named(base, base, final, without={push.name: base}), {}, None, {}).forces
    assert force.recording == "pushed"


def test_what_is_late_follows_the_rate_that_it_is_drawn_against() -> None:
    plant = shipped_plant()
    assert follows(LIBRARY["camera.latency"], plant, "psi") == (rate_name(plant, "psi"),) == ("dpsi",)
    assert follows(LIBRARY["encoder.latency"], plant, "dtheta") == ("ddtheta",)
    assert follows(LIBRARY["encoder.speed_lag"], plant, "psi") == ("ddtheta",)
    assert follows(LIBRARY["hoop.imbalance"], plant, "theta") == ("theta",)


def test_what_follows_no_angle_has_no_harmonics() -> None:
    t = np.arange(100.0)
    assert harmonics_of("hoop", MissingForceSamples("a", "N m", t, t, t, (Variable("dtheta", "rad/s", t),))) is None


def test_a_neutral_value_that_stands_for_infinity_is_no_number_of_a_report() -> None:
    final = HypothesisFit((), {}, (), [], {})
    limits = ("actuator.saturation", "actuator.back_emf_limit", "ball.slip")
    assert [one.nominal for name in limits for one in parameters_of(LIBRARY[name], final).values()] == [None] * 3
    assert parameters_of(IMBALANCE, final)["A"].nominal == 0.0


def test_bands_of_means_hold_the_truth_however_soon_a_variable_comes_back() -> None:
    """Noise that lasts; a variable that is everywhere all the time tells more than one that is in a place once."""
    t, held, widths = np.arange(3000), dict[str, list[bool]](), dict[str, float]()
    for seed in range(20):
        random = np.random.default_rng(seed)
        noise = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], random.normal(size=len(t)))
        for name, x in {"fast": random.uniform(-1.0, 1.0, len(t)), "slow": np.linspace(-1.0, 1.0, len(t))}.items():
            found = binned(x, np.sign(x) + noise)
            off = np.abs(found.x) > 0.1  # the bin about zero holds both signs
            inside = (found.low < np.sign(found.x)) & (np.sign(found.x) < found.high)
            held.setdefault(name, []).extend(inside[off].tolist())
            widths[name] = float(np.median(found.high - found.low))
    assert widths["fast"] < 0.5 < widths["slow"]
    assert all(0.85 < np.mean(one) <= 1.0 for one in held.values()), {n: np.mean(o) for n, o in held.items()}
