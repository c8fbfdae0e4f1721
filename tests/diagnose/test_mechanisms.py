"""Mechanisms beyond the library: what no name explains is found with its formula, and nothing where nothing is hidden.

The plant is a slide; what is recorded comes from a simulator of this file, which shares no code with the grammar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hoopd.diagnose.search import mechanism_search
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
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


def recorded(name: str, seed: int, law: Law, seconds: float = 16.0) -> Stretch:
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
        seen.append(x)
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
        (warming, ("drive.heat_of_f_squared_on_f",), {"A": (-0.016, -0.008), "T": (1.5, 5.0)}),
    ],
    ids=lambda one: getattr(one, "__name__", ""),
)
def test_what_no_name_explains_is_found_with_its_law(
    law: Law, names: tuple[str, ...], sizes: dict[str, tuple[float, float]]
) -> None:
    judge_law(law, names, sizes)


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
    ((stood, behind),) = found.rivals[name]
    assert stood == "slide.coulomb_friction" and behind > 50.0
    assert found.losses.keys() == found.without.keys() == {name}


def test_what_a_mechanism_costs_is_taken_off_what_it_is_worth() -> None:
    train = [recorded("day1", 1, bumper)]
    about = fit(train, (), SLIDE.values)
    screen = MechanismScreen(about, [*mechanisms(SLIDE).values()])
    worth = {one.member.effect.name: mechanism_search._worth(one) for one in mechanism_search._scores(screen, about)}
    dear = [one for one in screen.proposals if one.surprise > 10.0]
    assert screen.cost > 0.5 and len(dear) > 2
    for one in dear:
        left = one.surprise - one.effect.cost_nats - screen.cost
        assert worth[one.effect.name] == pytest.approx(left, abs=0.1), one.effect.name


def test_levels_of_a_screen_come_from_its_own_columns() -> None:
    """The best of all mechanisms on white rows is as surprising as the drawn level says."""
    train = [recorded("day1", 1, nothing)]
    screen = MechanismScreen(fit(train, (), SLIDE.values), [*mechanisms(SLIDE).values()])
    assert 10.0 < screen.null.tries < 1e4
    assert screen.null.threshold(0.01) > screen.null.threshold(0.1)
    best = max((one.surprise for one in screen.proposals), default=0.0)
    assert best < screen.null.threshold(0.001)
