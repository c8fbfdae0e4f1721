"""Mechanisms beyond the library: what no name explains is found with its formula, and nothing where nothing is hidden.

The plant is a slide; what is recorded comes from a simulator of this file, which shares no code with the grammar.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.search import mechanism_search
from hoopd.diagnose.search.candidates import Judge, Settings, Tried
from hoopd.diagnose.search.fits_side_by_side import tried_all
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.diagnose.search.scan_score import Scanned
from hoopd.diagnose.search.screen import Score, Screen
from hoopd.diagnose.search.surprise import surprise
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.grammar.mechanism import NATS_A_CONSTANT, TEXTBOOK_COST_NATS, Mechanism
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of

STEP_S, SUBSTEP_S = 0.02, 1e-3
PUSH_N, PUSH_S, RULER_M = 0.2, 0.15, 2e-4
SLIDE = Plant(
    name="slide",
    coordinates=("x",),
    accelerations=lambda s, force: (force - s.p["c"] * s.dx) / s.p["m"],
    inputs=(Input("F", "N", 10.0, "x"),),
    values={"m": 2.0, "c": 3.0},
    free=("m", "c"),
    bounds={"m": (0.1, 10.0), "c": (0.0, 100.0)},
    channels={"x": Channel("x", "m", "ruler")},
    slots={
        "drive": Slot("actuator", "x"),
        "slide": Slot("body", "x", speed=1.0, viscous=lambda s: s.p["c"]),
        "ruler": Slot("sensor", "x", ("x",)),
    },
    units={"m": "kg", "c": "N s/m", "x": "m"},
)
Law = Callable[[float, float, float, dict[str, float]], float]
Reading = Callable[[float, float, float], float]  # of a time, a place and a speed


def exactly(t: float, x: float, v: float) -> float:
    return x


def nothing(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    return 0.0


def bumper(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A spring that begins at 0.35 m."""
    return -8.0 * max(x - 0.35, 0.0)


def bristles(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Dahl's friction, 0.9 N after some 60 mm."""
    memory["z"] = memory.get("z", 0.0) + SUBSTEP_S * (v - abs(v) * memory.get("z", 0.0)) / 0.06
    return -0.9 * memory["z"]


def warming(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A drive whose force fades with the heat of the last 3 s."""
    memory["T"] = memory.get("T", 0.0) + SUBSTEP_S * (u**2 - memory.get("T", 0.0)) / 3.0
    return -0.012 * memory["T"] * u


def hanging(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A part of 0.12 kg that hangs on a spring and swings with 14 rad/s."""
    r, rate = memory.get("r", 0.0), memory.get("rate", 0.0)
    pull = -(14.0**2) * r - 2.0 * 0.06 * 14.0 * (rate - v)
    memory["rate"] = rate + SUBSTEP_S * pull
    memory["r"] = r + SUBSTEP_S * (memory["rate"] - v)
    return -0.12 * pull


def rattling(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A part of 0.25 kg with a play of 30 mm to each side, whose stops give little back."""
    r, rate = memory.get("r", 0.0), memory.get("rate", 0.0)
    into = r - min(max(r, -0.03), 0.03)
    pull = -np.sign(into) * max(abs(into) * 120.0**2 + 90.0 * (rate - v) * np.sign(into), 0.0)
    memory["rate"] = rate + SUBSTEP_S * pull
    memory["r"] = r + SUBSTEP_S * (memory["rate"] - v)
    return float(-0.25 * pull)


def pawl(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """It rubs about 0.1 m, and against forward motion alone."""
    return -2.0 * float(np.exp(-(((x - 0.1) / 0.12) ** 2) / 2.0)) if v > 0.0 else 0.0


def recorded(name: str, seed: int, law: Law, seconds: float = 16.0, read: Reading = exactly) -> Stretch:
    """A mass of 2.1 kg on 3.2 N s/m under a force of several levels that takes it back to the middle."""
    random, n = np.random.default_rng(seed), round(seconds / STEP_S)
    levels = np.repeat(random.choice([-5.0, -2.0, 2.0, 5.0], n // 15 + 1), 15)[:n]
    force, x, v, push, seen = np.zeros(n), 0.0, 0.0, 0.0, [0.0]
    keep, memory = np.exp(-STEP_S / PUSH_S), dict[str, float]()
    for k in range(n):
        force[k] = np.clip(levels[k] - 4.0 * x, -9.0, 9.0)
        push = keep * push + np.sqrt(1.0 - keep**2) * PUSH_N * random.normal()
        for _ in range(round(STEP_S / SUBSTEP_S)):
            v += SUBSTEP_S / 2.1 * (force[k] + push - 3.2 * v + law(x, v, force[k], memory))
            x += SUBSTEP_S * v
        seen.append(read((k + 1) * STEP_S, x, v))
    y = np.array(seen) + RULER_M * random.normal(size=n + 1)
    return stretch_of(name, SLIDE, np.arange(n + 1) * STEP_S, force, {"x": (np.arange(n + 1), y)})


def searched(law: Law, only: tuple[str, ...] = ()) -> Named:
    """Library first (or `only` some of it), then the grammar."""
    train = [recorded("day1", 1, law), recorded("day2", 2, law)]
    known = {
        name: one for name, one in library(SLIDE).items() if one.found_by == "screen" and (name in only or not only)
    }
    settings = Settings()
    nominal = fit(train, (), SLIDE.values, move=False)
    base = fit(train, (), SLIDE.values, like=nominal, noise=nominal.noise)
    found = name_effects(train, known, nominal, base, settings)
    name_mechanisms(found, Judge(train, known, settings), [*mechanisms(SLIDE).values()])
    return found


@pytest.mark.parametrize(
    ("law", "names", "sizes"),
    [
        (bristles, ("slide.dahl_of_x",), {"A": (0.7, 1.1), "xs": (0.04, 0.08)}),
        pytest.param(
            warming,
            ("drive.heat_of_f_squared_on_f",),
            {"A": (-0.016, -0.008), "T": (1.5, 5.0)},
            marks=pytest.mark.proof,
        ),
    ],
    ids=lambda one: getattr(one, "__name__", ""),
)
def test_what_no_name_explains_is_found_with_its_law(
    law: Law, names: tuple[str, ...], sizes: dict[str, tuple[float, float]]
) -> None:
    judge_law(law, names, sizes)


@pytest.mark.proof
def test_a_pawl_is_found_with_its_place() -> None:
    judge_law(pawl, ("slide.well_of_x_on_forward_dx",), {"A": (1.5, 2.5), "v0": (0.06, 0.14)})


@pytest.mark.proof
def test_a_bumper_is_found_with_its_place() -> None:
    judge_law(bumper, ("slide.above_of_x",), {"A": (-10.0, -6.0), "v0": (0.31, 0.38)})


def judge_law(law: Law, names: tuple[str, ...], sizes: dict[str, tuple[float, float]]) -> None:
    found = searched(law)
    assert found.final.names == names, found.losses
    assert found.losses[names[0]] > 20.0
    for name, (low, high) in sizes.items():
        assert low < found.final.values[f"{names[0]}.{name}"] < high, name


def test_where_nothing_is_hidden_nothing_is_found() -> None:
    assert searched(nothing).final.names == ()


def test_a_part_that_hangs_is_found_with_what_it_weighs() -> None:
    train = [recorded("day1", 1, hanging), recorded("day2", 2, hanging)]
    base, judge = fit(train, (), SLIDE.values), Judge(train, {}, Settings())
    screen = MechanismScreen(base, [mechanisms(SLIDE)["slide.swing_of_dx"]], level=False)
    (score,) = mechanism_search._scores(screen, base)
    found = judge.tried(base, score)
    a, w = (found.fit.values[f"slide.swing_of_dx.{name}"] for name in ("A", "w"))
    assert (w, a / w) == pytest.approx((14.0, 0.12), rel=0.1)
    assert found.fit.values["slide.swing_of_dx.zeta"] == pytest.approx(0.06, rel=0.3)


def test_a_fit_that_begins_at_the_law_of_a_hidden_body_moves_from_there() -> None:
    """What the body does is led along the recording before the first step: at rest no constant of it would count."""
    train = [recorded("day1", 1, hanging), recorded("day2", 2, hanging)]
    base, effect = fit(train, (), SLIDE.values), mechanisms(SLIDE)["slide.swing_of_dx"].effect
    law = {effect.key("A"): 0.12 * 14.0, effect.key("w"): 14.0, effect.key("zeta"): 0.06}
    begun = fit(train, (effect,), {**base.values, **law}, like=base, noise=base.noise)
    nearby = {**law, effect.key("w"): 13.5, effect.key("zeta"): 0.1}
    other = fit(train, (effect,), {**base.values, **nearby}, like=base, noise=base.noise)
    assert begun.steps > 1
    assert begun.criterion == pytest.approx(other.criterion, abs=0.5)
    assert begun.criterion < base.criterion - 20.0
    # it moved along when the recording began, as far as anybody knows
    assert abs(begun.tracks[0].z[0, -1] - begun.tracks[0].z[0, 1]) < 1.0


def test_a_part_with_play_is_found_with_what_it_weighs() -> None:
    """Its blows are led along the recording: what an estimator would make of each is lost after a few."""
    train = [recorded("day1", 1, rattling), recorded("day2", 2, rattling)]
    base, judge = fit(train, (), SLIDE.values), Judge(train, {}, Settings())
    screen = MechanismScreen(base, [mechanisms(SLIDE)["slide.loose_of_dx"]], level=False)
    (score,) = mechanism_search._scores(screen, base)
    found = judge.tried(base, score)
    a, w, b = (found.fit.values[f"slide.loose_of_dx.{name}"] for name in ("A", "w", "b"))
    assert found.gain > 30.0
    assert a / w == pytest.approx(0.25, rel=0.25)
    assert b == pytest.approx(0.03, rel=0.35)
    # another fit of the same data knows it by its states' names, and loses nothing
    again = fit(train, found.fit.effects, found.fit.values, like=found.fit, noise=found.fit.noise)
    assert again.criterion < found.fit.criterion + 1.0


def ageing(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Dry friction whose contact strengthens while it rests: its age is renewed by a way of 30 mm."""
    memory["age"] = memory.get("age", 0.0) + SUBSTEP_S * (1.0 - abs(v) * memory.get("age", 0.0) / 0.03)
    return float(-0.4 * np.tanh(v / 0.005) * np.log1p(memory["age"] / STEP_S))


def test_a_constant_is_found_although_the_amplitude_begins_far_too_small() -> None:
    train = [recorded("day1", 1, ageing), recorded("day2", 2, ageing)]
    judge, base = Judge(train, {}, Settings()), fit(train, (), SLIDE.values)
    screen = MechanismScreen(base, [mechanisms(SLIDE)["slide.age_of_x_on_sign_dx"]], level=False)
    (score,) = mechanism_search._scores(screen, base)
    name = score.member.effect.name
    small = replace(score, start={**score.start, f"{name}.A": 0.02})
    found = judge.tried(base, small)
    assert found.fit.values[f"{name}.A"] == pytest.approx(0.4, rel=0.4)
    assert 0.01 < found.fit.values[f"{name}.L"] < 0.09


def growing(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Dry friction that grows along the way."""
    return float(-1.5 * np.sign(v) * max(0.0, 1.0 + 2.0 * x))


def test_a_mechanism_takes_the_place_of_a_name_that_stood_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be put beside the name: only in its place can the law be found."""
    monkeypatch.setattr(mechanism_search, "MOST_MECHANISMS", 0)
    found = searched(growing, ("slide.coulomb_friction",))
    (name,) = found.final.names
    assert name.endswith("_of_x_on_sign_dx")
    (stood, behind), *_ = found.rivals[name]
    assert stood == "slide.coulomb_friction" and behind > 50.0
    assert found.losses.keys() == found.without.keys() == {name}


def test_beside_one_fit_mechanisms_are_screened_once_and_each_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    about: list[HypothesisFit] = []
    fitted: list[tuple[HypothesisFit, str]] = []

    class Noted(MechanismScreen):
        def __init__(self, found: HypothesisFit, wanted: Sequence[Mechanism], **more: Any) -> None:
            about.extend([found] if len(wanted) > 1 else [])
            super().__init__(found, wanted, **more)

    def noted(judge: Judge, before: HypothesisFit, scores: Sequence[Score]) -> list[Tried]:
        fitted.extend((before, one.member.effect.name) for one in scores)
        return tried_all(judge, before, scores)

    monkeypatch.setattr(mechanism_search, "MechanismScreen", Noted)
    monkeypatch.setattr(mechanism_search, "tried_all", noted)
    found = searched(bristles, ("none",))
    assert found.final.names == ("slide.dahl_of_x",) and found.in_place
    assert found.base in about and len(about) == len({id(one) for one in about})
    assert len(fitted) == len({(id(before), name) for before, name in fitted}) > 1


def rubbing(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Coulomb's friction of 0.8 N."""
    return float(-0.8 * np.tanh(v / 0.005))


def test_a_law_at_its_limit_is_the_name_and_no_rival_of_it() -> None:
    """Friction that wears off over a way that nobody goes is Coulomb's: it takes no share of its probability."""
    train = [recorded("day1", 1, rubbing), recorded("day2", 2, rubbing)]
    base, judge = fit(train, (), SLIDE.values), Judge(train, {}, Settings())
    screen = MechanismScreen(base, [mechanisms(SLIDE)["slide.fading_of_x_on_sign_dx"]], level=False)
    (score,) = mechanism_search._scores(screen, base)
    found = judge.tried(base, score)
    (low, high) = screen.tried(found.effect.name)["W"]
    assert 0.0 < low < high
    key = "slide.fading_of_x_on_sign_dx.W"
    for value, itself in ((high, True), (5.0 * high, False), (low / 5.0, False)):
        other = replace(found, fit=replace(found.fit, values={**found.fit.values, key: value}))
        assert mechanism_search._is_itself(screen, other) is itself


def test_what_a_mechanism_costs_is_taken_off_what_it_is_worth() -> None:
    """A textbook's law costs what it is rarer than a name, any other one more."""
    train = [recorded("day1", 1, bumper)]
    about = fit(train, (), SLIDE.values)
    screen = MechanismScreen(about, [*mechanisms(SLIDE).values()])
    worth = {one.member.effect.name: mechanism_search._worth(one) for one in mechanism_search._scores(screen, about)}
    dear = [one for one in screen.proposals if one.surprise > 10.0]
    assert len({one.mechanism.textbook for one in dear}) == 2
    for one in dear:
        constants = len(one.mechanism.constants)
        least = 0.5 + NATS_A_CONSTANT * constants
        assert one.cost == TEXTBOOK_COST_NATS if one.mechanism.textbook else one.cost > least
        assert worth[one.effect.name] == pytest.approx(one.surprise - one.cost, abs=0.1), one.effect.name


def test_of_choices_that_explain_as_much_it_does_not_matter_which() -> None:
    train = [recorded("day1", 1, bristles)]
    laws = [mechanisms(SLIDE)[name] for name in ("slide.dahl_of_x", "slide.well_of_x", "slide.linear_of_x")]
    screen = MechanismScreen(fit(train, (), SLIDE.values), laws)
    for one in screen.proposals:
        tried = len(screen._constants[one.mechanism.name])
        assert 1.0 <= one.looked_at <= tried
        # sums of what all of them would gain, over the best
        gains = [gain for gain, c in zip(screen._gains, screen._choices, strict=True) if c.mechanism is one.mechanism]
        assert one.looked_at == pytest.approx(tried / np.sum(np.exp(np.array(gains) - max(gains))))


def beating(phase: float) -> Reading:
    """Readings that get older for 2.3 s and young again; each recording begins anywhere."""
    return lambda t, x, v: x - 0.012 * ((t / 2.3 + phase) % 1.0) * v


def test_a_beat_of_two_clocks_has_a_phase_in_each_recording() -> None:
    train = [recorded("day1", 1, nothing, read=beating(0.1)), recorded("day2", 2, nothing, read=beating(0.7))]
    name, about = "ruler.beat_of_t_on_dx_in_x", fit(train, (), SLIDE.values)
    (score,) = mechanism_search._scores(MechanismScreen(about, [mechanisms(SLIDE)[name]], level=False), about)
    assert 2.0 * np.pi / score.start[f"{name}.n"] == pytest.approx(2.3, rel=0.05)
    apart = (score.start[f"{name}.phi@day2"] - score.start[f"{name}.phi@day1"]) / (2.0 * np.pi)
    assert (apart - 0.6 + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.06)
    assert score.start[f"{name}.A"] < 0.0
    # a sine and a cosine in each, and the mean that all share
    assert score.gain > 20.0 and isinstance(score, Scanned) and score.freedom == 5


def test_a_beat_is_seen_with_the_latency_that_is_its_mean() -> None:
    """Three quarters of what a saw-tooth explains are its mean: without it no beat is near a latency."""
    hoop = shipped_plant()
    late = library(hoop)["camera.latency"]
    stretch = stretch_with(hoop, "a", 3, 16.0)
    y = stretch.y.copy()
    y[1:, 2] = stretch.y[:-1, 2]
    about = fit([replace(stretch, y=y)], (), hoop.values)
    (latency,) = Screen(about, [late]).scores()
    (seen,) = MechanismScreen(about, [mechanisms(hoop)["camera.beat_of_t_on_dpsi_in_psi"]], level=False).proposals
    assert latency.gain > 20.0
    assert seen.gain > 0.8 * latency.gain


def test_levels_of_a_screen_come_from_its_own_columns() -> None:
    """The best of all mechanisms on white rows is as surprising as the drawn level says."""
    train = [recorded("day1", 1, nothing)]
    screen = MechanismScreen(fit(train, (), SLIDE.values), [*mechanisms(SLIDE).values()])
    assert 10.0 < screen.null.tries < 1e4
    assert screen.null.threshold(0.01) > screen.null.threshold(0.1)
    best = max((one.surprise for one in screen.proposals), default=0.0)
    assert best < screen.null.threshold(0.001)


def test_what_it_costs_to_say_a_mechanism_is_paid_by_a_fitted_one_too() -> None:
    proposed = SimpleNamespace(effect=SimpleNamespace(name="a.b"), columns=1, looked_at=1.0, cost=5.0)
    screen: Any = SimpleNamespace(proposals=[proposed])
    assert mechanism_search._worth_of(screen, "a.b", 50.0, 7.0) == pytest.approx(surprise(50.0, 1) - 5.0)
    # what this screen does not propose was proposed along usual disturbances, and is worth what it was there
    assert mechanism_search._worth_of(screen, "c.d", 50.0, 7.0) == 7.0


def test_a_textbook_s_law_takes_a_place_for_less_than_any_other() -> None:
    plain, known = (SimpleNamespace(textbook=one) for one in (False, True))
    needed = [mechanism_search.swap_nats(one) for one in (plain, known)]  # type: ignore[arg-type]
    assert needed == [mechanism_search.OCCAM_NATS, mechanism_search.TEXTBOOK_NATS] and needed[1] < needed[0]


@pytest.mark.parametrize(("value", "is_itself"), [(0.06, True), (1.9, True), (0.04, False), (2.1, False)])
def test_a_law_far_beyond_the_constants_that_were_tried_is_another_one(value: float, is_itself: bool) -> None:
    screen: Any = SimpleNamespace(tried=lambda name: {"T": (0.1, 1.0)})
    effect = SimpleNamespace(name="a.b", key=lambda name: f"a.b.{name}")
    one: Any = SimpleNamespace(effect=effect, fit=SimpleNamespace(values={"a.b.T": value}))
    assert mechanism_search._is_itself(screen, one) is is_itself


def test_a_beat_is_fitted_from_several_frequencies_and_the_best_fit_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of 1.6 s; what other laws are does not depend on a frequency that they do not have."""

    def aged(t: float, x: float, v: float) -> float:
        return x - 0.004 * ((t / 1.6) % 1.0) * v

    train = [recorded("day1", 1, nothing, read=aged)]
    about = fit(train, (), SLIDE.values)
    every = mechanisms(SLIDE)
    beat, other = every["ruler.beat_of_t_on_dx_in_x"], every["slide.above_of_x"]
    screen = MechanismScreen(about, [beat, other], level=False)
    proposed = {one.effect.name: one for one in screen.proposals}
    assert screen.other_starts(proposed[other.name]) == []
    starts = [proposed[beat.name], *screen.other_starts(proposed[beat.name])]
    frequencies = [one.constants["n"] for one in starts]
    step = 2.0 * np.pi * 0.5 / np.ptp(train[0].t)
    assert len(starts) == 3 and min(abs(np.diff(sorted(frequencies)))) > 1.5 * step
    assert [one.gain for one in starts] == sorted((one.gain for one in starts), reverse=True)

    def told(judge: Judge, before: HypothesisFit, scores: Sequence[Score]) -> list[Any]:
        return [SimpleNamespace(gain=gain, score=score) for gain, score in zip((3.0, 9.0, 5.0), scores, strict=True)]

    monkeypatch.setattr(mechanism_search, "tried_all", told)
    judge: Any = None
    (best,) = mechanism_search._best_fits(judge, screen, [mechanism_search.score_of_proposal(starts[0], about)])
    assert best.score.start[beat.effect.key("n")] == frequencies[1]


@pytest.mark.parametrize(("level", "found"), [(14.0, True), (16.0, False)])
def test_a_mechanism_has_to_be_beyond_what_the_best_of_all_reaches_by_chance(
    level: float, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = SimpleNamespace(null=SimpleNamespace(threshold=lambda chance: level))
    one = SimpleNamespace(surprise=15.0, gain=20.0, fit=None, effect=SimpleNamespace(name="a.b"))
    monkeypatch.setattr(mechanism_search, "MechanismScreen", lambda *_: screen)
    monkeypatch.setattr(mechanism_search, "_scores", lambda *_: [object()])
    monkeypatch.setattr(mechanism_search, "_held_scores", lambda *_: [])
    monkeypatch.setattr(mechanism_search, "_worth", lambda score: 30.0)
    monkeypatch.setattr(mechanism_search, "_fitted_worth", lambda *_: 10.0)
    monkeypatch.setattr(mechanism_search, "_best_fits", lambda *_: [one])
    judge: Any = SimpleNamespace(settings=Settings(), fold_loss=lambda *_: None)
    named: Any = SimpleNamespace(final=None, grammar=None, rivals={}, refusals={}, trials=[])
    assert (mechanism_search._next(named, judge, []) is one) is found
