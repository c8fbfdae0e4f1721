"""The engine knows plants and slots, not hoops: dry friction on a slide is found by what finds it on the hoop.

The plant is the one that docs/reference/effects.md declares; what is recorded comes from a simulator of this file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hoopd.diagnose.curves.location_evidence import locate
from hoopd.diagnose.curves.unknown_effects import judge_unknown, survey
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.report.curve_pictures import shown_of
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.ident.normal import Z95
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "reference" / "effects.md"
NAME = "slide.coulomb_friction"
# What the plant is in truth; the declaration's values are some per cent off. Steps of the simulator, s.
MASS_KG, VISCOUS_N_S_M, FRICTION_N = 2.1, 3.2, 0.8
STEP_S, SUBSTEP_S = 0.02, 1e-3
# Disturbance (N, s) and the ruler's noise (m).
PUSH_N, PUSH_S, RULER_M = 0.2, 0.15, 2e-4


def declared() -> tuple[Plant, str]:
    """The slide of the document, and its text."""
    (text,) = [block for block in re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S) if "SLIDE" in block]
    space: dict[str, Any] = {}
    exec(text, space)
    return space["SLIDE"], text


SLIDE, TEXT = declared()
LIBRARY = library(SLIDE)


def pushed(name: str, seed: int, seconds: float, friction_n: float) -> Stretch:
    """A mass under a force of several levels: Euler's steps, friction that stops it and lets it go again."""
    random, n = np.random.default_rng(seed), round(seconds / STEP_S)
    force = np.repeat(random.choice([-5.0, -2.0, 2.0, 5.0], n // 10 + 1), 10)[:n]
    x, v, push, keep, seen = 0.0, 0.0, 0.0, np.exp(-STEP_S / PUSH_S), [0.0]
    for k in range(n):
        push = keep * push + np.sqrt(1.0 - keep**2) * PUSH_N * random.normal()
        for _ in range(round(STEP_S / SUBSTEP_S)):
            free = v + SUBSTEP_S / MASS_KG * (force[k] + push - VISCOUS_N_S_M * v)
            most = SUBSTEP_S / MASS_KG * friction_n
            v = free - np.clip(free, -most, most)
            x += SUBSTEP_S * v
        seen.append(x)
    t, nodes = np.arange(n + 1) * STEP_S, np.arange(n + 1)
    return stretch_of(name, SLIDE, t, force, {"x": (nodes, np.array(seen) + RULER_M * random.normal(size=n + 1))})


def searched(friction_n: float, effects: tuple[Effect, ...] = (), values: dict[str, float] | None = None) -> Named:
    train = [pushed("a", 1, 20.0, friction_n)]
    start = {**SLIDE.values, **(values or {})}
    nominal = fit(train, effects, start, move=False)
    base = fit(train, effects, start, like=nominal, noise=nominal.noise)
    return name_effects(train, LIBRARY, nominal, base)


@pytest.fixture(scope="module")
def rubbing() -> Named:
    return searched(FRICTION_N)


def test_it_is_declared_in_under_40_lines() -> None:
    assert len(TEXT.strip().splitlines()) < 40


def test_its_dry_friction_is_named_with_its_value(rubbing: Named) -> None:
    (found,) = rubbing.accepted
    final = rubbing.final
    assert found.effect.name == NAME
    held = HeldOut([pushed("b", 2, 10.0, FRICTION_N)])
    before, after = held.of(rubbing.base), held.of(final)
    assert before is not None and after is not None and before.criterion - after.criterion > 10.0
    for name, truth in ((f"{NAME}.Fc", FRICTION_N), ("m", MASS_KG), ("b", VISCOUS_N_S_M)):
        assert final.values[name] == pytest.approx(truth, abs=Z95 * final.deviation(name))
        assert final.deviation(name) < 0.2 * truth


def test_it_is_located_and_no_curve_is_asked_for_beside_it(rubbing: Named) -> None:
    effects = list(LIBRARY.values())
    before = survey(rubbing.base, effects)
    evidence = locate(before)
    assert max(evidence, key=lambda slot: evidence[slot]) == "slide"
    assert judge_unknown(before, survey(rubbing.final, effects)) is None


def test_nothing_is_named_without_it() -> None:
    assert searched(0.0).accepted == []


def test_nothing_is_named_beside_a_base_that_has_it() -> None:
    known = searched(FRICTION_N, (LIBRARY[NAME],), {f"{NAME}.Fc": FRICTION_N})
    assert known.accepted == []
    assert known.final.names == (NAME,)


def test_its_missing_force_is_drawn_in_newtons_over_its_rate(rubbing: Named) -> None:
    shown = shown_of(rubbing, {}, None, {})
    (force,) = shown.forces
    (over,) = force.regressors
    assert (force.slot, force.unit, over.name, over.unit) == ("slide", "N", "dx", "m/s")
    assert over.binned is not None
    assert over.law is not None
    known = np.isfinite(over.law.y)
    law = np.interp(over.binned.x, over.law.x[known], over.law.y[known])
    fast = np.abs(over.binned.x) > 0.1
    inside = (over.binned.low <= law) & (law <= over.binned.high)
    assert np.abs(law[fast]) == pytest.approx(FRICTION_N, rel=0.25)
    assert inside[fast].mean() > 0.8
    assert [strip.slot for strip in shown.strips] == ["slide", SLIDE.channels["x"].sensor]
