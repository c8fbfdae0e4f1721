"""What is told apart, what is not and is said to be not, and whether the proposed experiment keeps its promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import typer
from diagnose.madeup import NOISE, STEP_S, shipped_plant, stretch_with

from hoopd.commands.cli import app
from hoopd.diagnose.proof.confirmation import doubted
from hoopd.diagnose.proof.experiment_menu import command, entries
from hoopd.diagnose.proof.next_experiment import (
    Expected,
    Pair,
    expectations,
    expected_to_show,
    next_experiment,
    rows_of_recordings,
    why_by_hand,
)
from hoopd.diagnose.proof.not_excluded import late_together, parameter_notes, separations
from hoopd.diagnose.proof.placebo import BLOCK_S, _order, changes_along, gain_of, placebos, shuffled
from hoopd.diagnose.proof.power import of_effect, visible
from hoopd.diagnose.proof.separation import Rows, condensed, linear, nats_apart, nats_seen, rows_beside
from hoopd.diagnose.record import Placebo
from hoopd.diagnose.search.candidates import Tried
from hoopd.diagnose.search.naming import NOT_EXCLUDED_NATS, Named
from hoopd.diagnose.search.scan_score import scanned
from hoopd.diagnose.search.screen import Column, Member, Screen
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain, surprise
from hoopd.plants import free_run as freerun
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Array, Held, Stretch
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.registry import plant_named

PLANT = shipped_plant()
LIBRARY = library(PLANT)
DRY, ROLLING = LIBRARY["ball.coulomb_friction"], LIBRARY["ball.rolling_resistance"]
DEADZONE, LIMIT = LIBRARY["actuator.deadzone"], LIBRARY["actuator.saturation"]
HOOP, TILT = LIBRARY["hoop.coulomb_friction"], LIBRARY["frame.tilt"]


def fitted(
    stretches: list[Stretch], effects: tuple[Effect, ...] = (), like: HypothesisFit | None = None, **values: float
) -> HypothesisFit:
    """With the noise that the data were made with; values by parameter."""
    start = {**PLANT.values, **{e.key(k): v for e in effects for k, v in values.items()}}
    noise = {one.recording: NOISE for one in stretches}
    return fit(stretches, effects, start, like=like, noise=noise, tune_noise=False)


def named(effect: Effect, base: HypothesisFit, final: HypothesisFit, **rivals: float) -> Named:
    """A search that ended with one effect."""
    gain = base.criterion - final.criterion
    score = Screen(base, [effect]).scores()[0]
    found = Named(base, base, final, [Tried(effect, final, gain, gain, score)])
    found.losses, found.without = {effect.name: gain}, {effect.name: base}
    found.rivals = {effect.name: [(name.replace("__", "."), behind) for name, behind in rivals.items()]}
    found.scores = [score]
    return found


@pytest.fixture(scope="module")
def leaning() -> Named:
    stretches = [stretch_with(PLANT, "a", 3, 8.0, [TILT], {"frame.tilt.d": 0.05})]
    base = fitted(stretches)
    final = fitted(stretches, (TILT,), base, d=0.05)
    return named(TILT, base, final, camera__center_offset=1.2, hoop__imbalance=40.0)


# ---------------------------------------------------------------------------------------------- geometry


def rows(effect: Array, rival: Array, *, signed: bool = False) -> Rows:
    """Beside one free parameter, the first direction."""
    member = Member(HOOP, {}, (Column((("Fc", 0.003),), signed=signed),))
    base = np.eye(len(effect))[:, :1]
    return Rows(base, effect, ((member, rival[:, None]),))


@pytest.mark.parametrize("degrees", [0.0, 10.0, 60.0, 90.0])
def test_the_distance_is_the_part_across_the_rival(degrees: float) -> None:
    angle = np.radians(degrees)
    v, z = np.array([5.0, 8.0, 0.0, 0.0]), np.array([-3.0, np.cos(angle), np.sin(angle), 0.0])
    # what lies along the free parameter counts for neither
    assert nats_apart([rows(v, 7.0 * z)])[HOOP.name] == pytest.approx(32.0 * np.sin(angle) ** 2, abs=1e-6)


def test_a_rival_of_the_wrong_sign_explains_nothing() -> None:
    v = np.array([0.0, 8.0, 0.0])
    assert nats_apart([rows(v, -v, signed=True)])[HOOP.name] == pytest.approx(32.0)
    assert nats_apart([rows(v, -v)])[HOOP.name] == pytest.approx(0.0, abs=1e-6)


def test_a_second_recording_tells_apart_what_the_first_could_not() -> None:
    v, same, other = np.array([0.0, 8.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    assert nats_apart([rows(v, same)])[HOOP.name] == pytest.approx(0.0, abs=1e-6)
    # one weight for both: 64 explained of 128, at most
    assert nats_apart([rows(v, same), rows(v, other)])[HOOP.name] == pytest.approx(48.0)


def swing(start_rad: float) -> float:
    """Nats between dry friction and rolling resistance over a free swing."""
    t = np.arange(600) * STEP_S
    u, composite = np.zeros(len(t) - 1), Composite(PLANT, [DRY])
    values = {**composite.values, DRY.key("Fc"): 1e-4}
    z = freerun.run(composite, values, [0.0, 0.0, start_rad, 0.0], t, u)
    track = Track.of(Stretch("a", PLANT, t, u, np.zeros((len(t), 3))), Held(t, u), Composite(PLANT))
    track.moved(z[:, :4], np.zeros((len(t), 2)), z[:, :4], z[:, :4])
    about = linear([track], (), PLANT.values, PLANT.free, {"a": NOISE})
    return nats_apart([rows_beside(about, DRY, values, [ROLLING], ["a"])])[ROLLING.name]


def test_large_angles_tell_dry_friction_from_rolling_resistance() -> None:
    assert swing(0.4) < 1.0 < NOT_EXCLUDED_NATS < swing(1.5)


# ---------------------------------------------------------------------------------------------- not excluded


def test_what_no_sensor_tells_apart_and_what_is_hardly_behind_is_not_excluded(leaning: Named) -> None:
    found = separations(leaning, LIBRARY)["frame.tilt"]
    assert found.not_excluded[:2] == ["camera.angle_offset", "camera.center_offset"]
    assert found.never == ("camera.angle_offset",)
    assert "hoop.imbalance" not in found.not_excluded
    assert all(one.reason for one in found.alternatives)


def test_a_rival_that_held_out_data_refused_is_excluded(leaning: Named) -> None:
    """It explained more of what it was fitted to, and lost on the rest."""
    ahead = replace(leaning, rivals={"frame.tilt": [("hoop.imbalance", -20.0)]})
    assert "hoop.imbalance" in separations(ahead, LIBRARY)["frame.tilt"].not_excluded
    refused = separations(replace(ahead, refused={"frame.tilt": ("hoop.imbalance",)}), LIBRARY)["frame.tilt"]
    assert "hoop.imbalance" not in refused.not_excluded and "hoop.imbalance" not in refused.nats


def test_of_two_that_no_sensor_tells_apart_the_hardware_has_to_change(leaning: Named) -> None:
    leaning = replace(leaning, rivals={})
    proposed = next_experiment(leaning, separations(leaning, LIBRARY), LIBRARY)
    assert proposed is not None and proposed.expected_nats is None
    assert proposed.tells_apart == ("frame.tilt", "camera.angle_offset")
    assert "half a turn" in proposed.signal and not proposed.command


def test_all_sensors_late_are_a_late_torque() -> None:
    delay, encoder, camera = (LIBRARY[f"{slot}"] for slot in ("actuator.delay", "encoder.latency", "camera.latency"))
    track = Track(stretch_with(PLANT, "a", 1, 1.0))

    def final(effects: tuple[Effect, ...], *late_s: float) -> HypothesisFit:
        values = {e.key("d"): d for e, d in zip(effects, late_s, strict=True)}
        return HypothesisFit(effects, values, tuple(values), [track], {}, covariance=np.eye(len(values)) * 1e-6)

    both = [one.name for one in late_together(final((delay,), 0.01), delay, LIBRARY)]
    assert both == ["camera.latency", "encoder.latency"] or both == ["encoder.latency", "camera.latency"]
    same = final((encoder, camera), 0.010, 0.011)
    assert [one.name for one in late_together(same, camera, LIBRARY)] == ["actuator.delay"]
    assert late_together(final((encoder, camera), 0.010, 0.020), camera, LIBRARY) == []
    assert late_together(final((camera,), 0.010), camera, LIBRARY) == []


def test_a_gain_of_the_torque_is_a_matter_of_parameters() -> None:
    (note,) = parameter_notes(LIBRARY, {})
    assert "actuator.torque_gain" in note


# ---------------------------------------------------------------------------------------------- next experiment


def driven(name: str, seed: int, u: Array, effect: Effect, **values: float) -> Stretch:
    """A recording under any torque."""
    return stretch_with(PLANT, name, seed, 0.0, [effect], {effect.key(k): v for k, v in values.items()}, u=u)


@pytest.fixture(scope="module")
def pair() -> Pair:
    """A dead zone under a torque of two levels: a limit, or a gain of the torque, do the same."""
    u = 0.05 * np.repeat(np.random.default_rng(2).choice([-1.0, 1.0], 80), 5)
    # until the first change of sign less
    u[:50] *= 0.9
    stretches = [driven("a", 5, u, DEADZONE, d=0.006)]
    base = fitted(stretches)
    return Pair(fitted(stretches, (DEADZONE,), base, d=0.006), DEADZONE, LIMIT, base)


@pytest.fixture(scope="module")
def menu(pair: Pair) -> list[Expected]:
    return sorted(expectations(pair), key=lambda one: one.nats)


def behind(pair: Pair, one: Expected) -> float:
    """Nats by which the rival is behind with a recording of an experiment added."""
    d = pair.final.values[DEADZONE.key("d")]
    made = [pair.final.tracks[0].stretch, driven("b", 1, one.entry.u, DEADZONE, d=d)]
    true = fitted(made, (DEADZONE,), d=d)
    rival = fitted(made, (LIMIT,), true, s=float(np.abs(one.entry.u).max()) - d)
    return rival.criterion - true.criterion


def test_several_sizes_of_torque_tell_a_dead_zone_from_a_limit(pair: Pair, menu: list[Expected]) -> None:
    assert nats_apart([rows_of_recordings(pair)])[LIMIT.name] < NOT_EXCLUDED_NATS
    best, worst, middle = behind(pair, menu[-1]), behind(pair, menu[0]), behind(pair, menu[len(menu) // 2])
    assert best > 2.0 * middle > 4.0 * worst
    # promised from a model linear about the fitted parameters, kept by fits of recordings with noise
    assert best == pytest.approx(menu[-1].nats, rel=0.5)


@pytest.mark.parametrize("in_parts", [False, True])
def test_whether_it_is_more_than_the_simpler_effect_is_asked_of_the_larger_one(rubbing: Named, in_parts: bool) -> None:
    """Also where it was tried without seconds that have come back since."""
    more, whole = LIBRARY["hoop.stribeck_friction"], rubbing.base.tracks[0].stretch
    begin, middle, end = float(whole.t[0]), float(whole.t[len(whole.t) // 2]), float(whole.t[-1])
    tried_on = [whole.seconds(begin, middle), whole.seconds(middle + 0.3, end)] if in_parts else [whole]
    larger = fitted(tried_on, (more,), None if in_parts else rubbing.base, Fc=0.003, Fs=0.002, vs=1.0)
    tried = Tried(more, larger, rubbing.base.criterion - larger.criterion, 30.0, rubbing.scores[0])
    asked = replace(rubbing, tried=[tried], rivals={HOOP.name: [(more.name, -1.0)]})
    proposed = next_experiment(asked, separations(asked, LIBRARY), LIBRARY)
    assert proposed is not None and proposed.tells_apart == (more.name, HOOP.name)
    assert proposed.command.startswith("hoopd experiment ") and "-1" not in proposed.reason
    assert proposed.expected_nats is not None and proposed.expected_nats > 1.0


@pytest.fixture(scope="module")
def faint() -> Pair:
    """A friction of which the recording says too little to name it."""
    u = 0.03 * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], 60), 5)
    stretches = [driven("a", 5, u, HOOP, Fc=0.002)]
    base = fitted(stretches)
    return Pair(fitted(stretches, (HOOP,), base, Fc=0.002), HOOP, HOOP, base)


def quiet(faint: Pair, surprise_nats: float) -> Named:
    """Nothing was named, and the friction is the likeliest candidate."""
    tried = Tried(HOOP, faint.final, faint.ablated.criterion - faint.final.criterion, surprise_nats, None)  # type: ignore[arg-type]
    return replace(Named(faint.ablated, faint.ablated, faint.ablated), tried=[tried])


def test_where_nothing_was_named_the_likeliest_candidate_is_to_be_shown(faint: Pair) -> None:
    proposed = next_experiment(quiet(faint, 6.0), {}, LIBRARY)
    assert proposed is not None and proposed.tells_apart == (HOOP.name, "parameters")
    assert proposed.command.startswith("hoopd experiment ") and "too few to name it" in proposed.reason
    assert next_experiment(quiet(faint, 3.0), {}, LIBRARY) is None


def test_what_is_expected_to_show_a_candidate_is_kept_by_fits_with_and_without_it(faint: Pair) -> None:
    """Of a run that comes to rest the linear model promises too little: those are left out."""
    menu = sorted((one for one in expected_to_show(faint) if one.entry.plan.kind != "decay"), key=lambda one: one.nats)
    fc = faint.final.values[HOOP.key("Fc")]

    def shown(one: Expected) -> float:
        both = [faint.final.tracks[0].stretch, driven("b", 1, one.entry.u, HOOP, Fc=fc)]
        true = fitted(both, (HOOP,), Fc=fc)
        known = faint.ablated.criterion - faint.final.criterion
        return fitted(both).criterion - true.criterion - known

    assert menu[-1].nats > 3.0 * max(menu[0].nats, 1.0)
    assert shown(menu[-1]) == pytest.approx(menu[-1].nats, rel=0.5)
    assert shown(menu[-1]) > shown(menu[0])


@pytest.mark.parametrize(
    ("plant", "reason"),
    [
        (plant_named("pendulum"), "Nothing drives this plant"),
        (hoop_plant("entries", PLANT.values, "ball"), "does not move what was recorded"),
        (plant_named("tanks"), "this plant has none"),
        (plant_named("axis"), "No signal of the menu is safe"),
    ],
    ids=["pendulum", "ball", "tanks", "axis"],
)
def test_where_no_signal_is_proposed_the_reason_is_true(plant: Plant, reason: str) -> None:
    assert reason in why_by_hand([plant])


def test_every_entry_keeps_the_limits_and_is_a_command(menu: list[Expected]) -> None:
    experiment = typer.main.get_command(app).commands["experiment"]  # type: ignore[attr-defined]
    for one in menu:
        plan, z = one.entry.plan, one.entry.z
        assert np.abs(one.entry.u).max() <= plan.torque_limit_nm
        assert np.abs(z[:, 1]).max() <= plan.speed_limit_rad_s and np.abs(z[:, 2]).max() <= plan.angle_limit_rad
        words = command(plan).split()
        asked = experiment.make_context("experiment", words[2:]).params
        assert words[:2] == ["hoopd", "experiment"] and asked["kind"] == plan.kind
        for name in ("amplitude_nm", "clock_ticks", "low_hz", "hold_s", "kick_s"):
            told = type(plan)._field_defaults[name] if asked[name] is None else asked[name]
            assert told == getattr(plan, name)


def test_a_plant_without_a_drive_has_no_menu() -> None:
    idle = replace(PLANT, inputs=())
    assert list(entries(Composite(idle), PLANT.values, STEP_S)) == []


@pytest.mark.parametrize(
    ("plant", "word", "other"),
    [(plant_named("axis"), "force", "torque"), (PLANT, "torque", "force")],
    ids=["axis", "hoop"],
)
def test_the_menu_calls_the_input_what_it_is(plant: Plant, word: str, other: str) -> None:
    words = {one.words for one in entries(Composite(plant), plant.values, plant.time_scale_s)}
    assert any(f"a slow random two-level {word}" in one for one in words)
    assert not any(other in one for one in words)


# ---------------------------------------------------------------------------------------------- placebo, power


@pytest.fixture(scope="module")
def rubbing() -> Named:
    stretches = [stretch_with(PLANT, "a", 9, 10.0, [HOOP], {HOOP.key("Fc"): 0.003})]
    base = fitted(stretches)
    return named(HOOP, base, fitted(stretches, (HOOP,), base, Fc=0.003))


def test_a_shuffled_regressor_gains_nothing_and_the_real_one_does(rubbing: Named) -> None:
    found = placebos(rubbing)[HOOP.name]
    assert found.held and found.shuffles >= 8
    assert found.log_likelihood_gain is not None and found.log_likelihood_gain < 3.0
    real = changes_along(rubbing.base, HOOP, rubbing.final.values)
    assert surprise(gain_of(rubbing.base, real), 1, 8) > THRESHOLD
    assert (
        gain_of(rubbing.base, shuffled(rubbing.base, real, np.random.default_rng(0))) < 0.2 * rubbing.losses[HOOP.name]
    )


def test_a_placebo_does_not_hold_where_its_own_cause_is_left(rubbing: Named) -> None:
    """Blocks as long as the recording keep their place: the regressor is the effect's own, up to its sign."""
    real = changes_along(rubbing.base, HOOP, rubbing.final.values)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hoopd.diagnose.proof.placebo.BLOCK_S", 1e3)
        own = shuffled(rubbing.base, real, np.random.default_rng(0))
    assert gain_of(rubbing.base, own) == pytest.approx(gain_of(rubbing.base, real))


@pytest.mark.parametrize(("nats", "held"), [(3.0, True), (4.5, False), (13.0, False)])
def test_a_placebo_that_gains_what_chance_seldom_gives_does_not_hold(
    nats: float, held: bool, rubbing: Named, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best of eight chance gains of one number exceeds 3.7 nats once in twenty times."""
    monkeypatch.setattr("hoopd.diagnose.proof.placebo.gain_of", lambda fit, changes: nats)
    assert placebos(rubbing)[HOOP.name].held is held


def test_a_block_keeps_one_sign_wherever_the_short_one_comes() -> None:
    track = Track(stretch_with(PLANT, "a", 1, 4.6))
    for seed in range(6):
        order, sign = _order(track, np.random.default_rng(seed))
        assert sorted(order) == list(range(len(track.stretch.t)))
        blocks = order // round(BLOCK_S / STEP_S)
        assert all(len(np.unique(sign[blocks == k])) == 1 for k in np.unique(blocks))


def test_the_same_seed_gives_the_same_placebo(rubbing: Named) -> None:
    assert placebos(rubbing, seed=4) == placebos(rubbing, seed=4) != placebos(rubbing, seed=5)


def test_power_agrees_with_what_is_detected() -> None:
    null = Screen(fitted([stretch_with(PLANT, "a", 30, 8.0)]), ())
    smallest = of_effect(null, HOOP).smallest
    assert smallest is not None
    for seed in (31, 32, 33):
        gains = []
        for size in (0.5 * smallest, 2.0 * smallest):
            made = [stretch_with(PLANT, "a", seed, 8.0, [HOOP], {HOOP.key("Fc"): size})]
            gains.append(Screen(fitted(made), [HOOP]).scores()[0].gain)
        assert surprise(gains[0], 1) < THRESHOLD < surprise(gains[1], 1)


def test_what_cannot_be_seen_has_no_size() -> None:
    held = replace(stretch_with(PLANT, "a", 34, 4.0, torque=1e-6), y=np.full((201, 3), np.nan))
    y = held.y.copy()
    y[:, 1] = 0.0
    at_rest = fit([replace(held, y=y)], (), PLANT.values, noise={"a": NOISE}, tune_noise=False, free=())
    assert of_effect(Screen(at_rest, ()), LIBRARY["actuator.back_emf_limit"]).smallest is None


def test_power_is_silent_about_what_is_the_same_as_a_named_effect(leaning: Named) -> None:
    few = {name: LIBRARY[name] for name in ("frame.tilt", "camera.angle_offset")}
    assert list(visible(leaning, few)) == ["frame.tilt"]


def test_power_of_the_whole_library(rubbing: Named) -> None:
    few = {name: LIBRARY[name] for name in ("actuator.delay", "hoop.coulomb_friction", "external.disturbance")}
    found = visible(rubbing, few)
    assert set(found) == set(few)
    seen = {name: one.smallest for name, one in found.items()}
    assert all(value is not None and value > 0.0 for value in seen.values())
    assert seen["hoop.coulomb_friction"] < rubbing.final.values[HOOP.key("Fc")]


def test_what_a_scan_named_has_to_show_more_than_what_was_looked_at_once(rubbing: Named) -> None:
    """The best of 1000 places with two numbers each needs a larger gain, and so a larger size."""
    once = visible(rubbing, {HOOP.name: HOOP})[HOOP.name].smallest
    score = scanned(rubbing.scores[0], 2, 1000.0)
    found = replace(rubbing, accepted=[replace(rubbing.accepted[0], score=score)])
    scan = visible(found, {HOOP.name: HOOP})[HOOP.name].smallest
    assert once is not None and scan is not None
    assert scan / once == pytest.approx(np.sqrt(needed_gain(THRESHOLD, 2, 1000.0) / needed_gain(THRESHOLD, 1)))


@pytest.mark.parametrize(
    ("gain", "most", "status"), [(19.0, 3.0, "confirmed"), (19.0, 8.0, "weak"), (50.0, 8.0, "confirmed")]
)
def test_a_name_whose_placebo_gains_needs_as_much_more(gain: float, most: float, status: str) -> None:
    placebo = Placebo(log_likelihood_gain=1.0, held=most < 4.0, shuffles=8, most=most, limit=4.0)
    assert doubted("confirmed", gain, 15.0, placebo) == status
    assert doubted("untested", gain, 15.0, placebo) == "untested"


def test_condensed_rows_tell_the_same_of_what_is_stacked_on_them() -> None:
    random = np.random.default_rng(3)

    def rows(count: int) -> Rows:
        rivals = tuple((member, random.normal(size=(count, len(member.columns)))) for member in members)
        return Rows(random.normal(size=(count, 4)), random.normal(size=count), rivals)

    members = [Member(effect, {}, (Column((("Fc", 0.01),), signed=True),)) for effect in (DRY, HOOP)]
    known, more = rows(500), rows(60)
    few = condensed(known)
    assert len(few.effect) == 7 and condensed(few) is few
    assert nats_apart([few, more]) == pytest.approx(nats_apart([known, more]))
    assert nats_seen([few, more]) == pytest.approx(nats_seen([known, more]))
