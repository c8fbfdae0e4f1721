"""A diagnosis does not depend on what a second, a metre or a newton is called, nor on how large everything is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from harness.scaled_plants import CART, Scale, plant_in, recorded, recording_in
from msgspec.structs import astuple

import hoopd.lab as lab
from hoopd.diagnose.record import Diagnosis, Quantity
from hoopd.ident.normal import Z95

SECONDS, FRICTION_N = 10.0, 0.5
SMALL, LARGE = Scale(1e3, 1e-3, 1e3), Scale(1e-3, 1e-3, 1e-3)  # milliseconds and kilometres; kiloseconds


@cache
def diagnosed(friction_n: float, scale: Scale, *, declared: bool = True) -> Diagnosis:
    truth = CART._replace(friction=friction_n)
    recording = recording_in(truth, scale, recorded(truth, SECONDS))
    return lab.diagnose(recording, plant=plant_in(truth, scale, declared=declared), free_run=False).diagnosis


def assert_same(here: Quantity, there: Quantity, unit: float) -> None:
    """Within a third of a standard error: along a law that jumps the last bits of a number lead a fit another way."""
    assert here.value is not None and here.ci95 is not None and there.ci95 is not None
    error = (here.ci95[1] - here.ci95[0]) / (2.0 * Z95)
    assert there.value == pytest.approx(here.value * unit, abs=error * unit / 3.0)
    np.testing.assert_allclose(there.ci95, np.array(here.ci95) * unit, atol=error * unit / 2.0)


def judge_friction(scale: Scale) -> None:
    usual, other = diagnosed(FRICTION_N, Scale()), diagnosed(FRICTION_N, scale)
    assert usual.verdict == other.verdict == "missing_physics"
    assert [one.name for one in usual.effects] == [one.name for one in other.effects] == ["body.coulomb_friction"]
    (here,), (there,) = usual.effects, other.effects
    assert there.evidence.log_likelihood_gain == pytest.approx(here.evidence.log_likelihood_gain, abs=3.0)
    assert_same(here.parameters["Fc"], there.parameters["Fc"], scale.force)
    usual_base, other_base = usual.base.parameters, other.base.parameters
    assert_same(usual_base["J"], other_base["J"], scale.force * scale.time**2 / scale.length)
    assert_same(usual_base["c"], other_base["c"], scale.force * scale.time / scale.length)
    assert usual.fit.heldout.keys() == other.fit.heldout.keys() and usual.fit.heldout
    (this,), (that,) = usual.fit.heldout.values(), other.fit.heldout.values()
    assert astuple(that["q"]) == pytest.approx(astuple(this["q"]), abs=0.1)


def judge_nothing(scale: Scale) -> None:
    usual, other = diagnosed(0.0, Scale()), diagnosed(0.0, scale)
    assert usual.verdict == other.verdict == "parameters"
    assert not usual.effects and not other.effects


@pytest.mark.proof
def test_the_same_is_found_in_milliseconds() -> None:
    judge_friction(SMALL)


def test_nothing_is_found_in_kiloseconds_where_nothing_is() -> None:
    judge_nothing(LARGE)


@pytest.mark.proof
def test_the_same_is_found_in_kiloseconds_and_nothing_in_milliseconds() -> None:
    judge_friction(LARGE)
    judge_nothing(SMALL)


def test_sizes_that_nobody_declared_are_those_of_the_data() -> None:
    judge_undeclared(0.0)


@pytest.mark.proof
def test_a_friction_is_found_by_sizes_that_nobody_declared() -> None:
    judge_undeclared(FRICTION_N)


def judge_undeclared(friction_n: float) -> None:
    """A thousand times as large: without a word in the file, nothing but the numbers is another.

    The pushes on the cart are large beside what a slow recording shows of it, which is no finding of unknown physics.
    """
    usual, other = (diagnosed(friction_n, one, declared=False) for one in (Scale(), Scale(1.0, 1e3, 1e3)))
    assert [one.name for one in usual.effects] == [one.name for one in other.effects]
    assert [one.slot for one in usual.effects] == ["body"] * (friction_n > 0.0)
    assert_same(usual.base.parameters["J"], other.base.parameters["J"], 1.0)
