"""From entries back to positive parameters: recovery, the thesis's numbers, what stays open, and known quantities."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from freeruns import DEVICE

from hoopd.plants.hoop.entries import ENTRIES, combinations_of, constraint_misfit, entries_of
from hoopd.plants.hoop.fitting.entry_constraints import constraint_sd, constraint_words, reproduces
from hoopd.plants.hoop.fitting.physical_parameters import Known, physical_from_entries, quantity, quantity_sd
from hoopd.plants.hoop.thesis import ENTRIES_PRINTED as THESIS, second_step, table_words

START = {**DEVICE, "mb": 0.04, "Ro": 0.12, "Rb": 0.012, "Ib": 2e-6, "Ih": 1e-3, "bb": 1e-6, "bh": 2e-4}
KINDS = ("rolling", "published")


@pytest.mark.parametrize("kind", KINDS)
def test_a_weighed_and_measured_ball_gives_all_parameters_back(kind):
    start = {**START, **{name: DEVICE[name] for name in ("mb", "Ro", "Rb")}}
    found = physical_from_entries(kind, entries_of(kind, DEVICE), start, fixed=("mb", "Ro", "Rb"))
    assert found.parameters == pytest.approx(DEVICE, rel=1e-4)
    assert found.directions == ()
    assert found.agreeing >= 6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", KINDS)
def test_either_kinematics_gives_the_entries_of_the_other_and_one_direction_stays_open(kind, source):
    entries = entries_of(source, DEVICE)
    found = physical_from_entries(kind, entries, START)
    assert found.entries == pytest.approx(entries, rel=1e-4)
    assert found.combinations == pytest.approx(combinations_of(source, DEVICE), rel=1e-3)
    assert len(found.directions) == 1
    assert found.directions[0].relative_sd == inf
    assert "Only six combinations are determined" in found.words[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_one_more_known_value_closes_the_open_direction(kind):
    known = [Known("Rb", DEVICE["Rb"], 0.01)]
    found = physical_from_entries(kind, entries_of(kind, DEVICE), START, known=known)
    assert found.directions == ()
    assert found.parameters == pytest.approx(DEVICE, rel=2e-2)


@pytest.mark.parametrize("kind", KINDS)
def test_no_positive_parameters_give_the_thesis_entries(kind):
    found = physical_from_entries(kind, THESIS, DEVICE)
    assert found.chi2 > 0.1
    assert max(abs(m.relative) for m in found.misfit.values()) > 0.2
    assert "miss" in found.words[0]
    assert all(value > 0 for value in found.parameters.values())
    # it is the entries' fault: both kinematics miss by the same
    other = physical_from_entries("published" if kind == "rolling" else "rolling", THESIS, DEVICE)
    assert found.chi2 == pytest.approx(other.chi2, rel=1e-3)


def test_table_3_1_is_said_not_to_reproduce_the_entries():
    words = " ".join(table_words())
    assert words.startswith("Table 3.1")
    assert "do not reproduce the entries" in words
    assert "J11 -4.56 instead of -0.482" in words
    assert "J22 would be -0.506" in words
    assert "J21 would be 0.358" in words
    assert "give the entries" in reproduces("rolling", DEVICE, entries_of("rolling", DEVICE))[0]


def test_a_covariance_weighs_the_entries():
    entries = entries_of("rolling", DEVICE)
    sd = np.array([0.01 * abs(entries[name]) for name in ENTRIES])
    off = {**entries, "J12": entries["J12"] + 3 * sd[1], "L1": entries["L1"] + 3 * sd[3]}
    sd[3] *= 1e-3
    found = physical_from_entries("rolling", off, DEVICE, covariance=np.diag(sd**2))
    assert abs(found.misfit["L1"].absolute) < 10 * sd[3]
    assert found.misfit["J12"].standard_errors == pytest.approx(found.misfit["J12"].absolute / sd[1])
    assert 0.0 < found.chi2 < 9.5


def test_the_same_seed_gives_the_same_numbers():
    first, second = (physical_from_entries("rolling", THESIS, DEVICE) for _ in range(2))
    assert first == second


def test_derived_quantities():
    assert quantity("rolling", "spin", DEVICE) == pytest.approx((0.0957 - 0.0104) / 0.0104)
    assert quantity("published", "spin", DEVICE) == pytest.approx(0.0957 / 0.0104)
    assert quantity("rolling", "Ro-Rb", DEVICE) == pytest.approx(0.0853)
    with pytest.raises(KeyError):
        quantity("rolling", "colour", DEVICE)


def test_errors_of_the_constraints_by_sampling():
    entries = entries_of("rolling", DEVICE)
    sd = np.array([0.003 * abs(entries[name]) for name in ENTRIES])
    random = np.random.default_rng(0)
    drawn = random.normal(list(entries.values()), sd, (4000, 8))
    misfits = [constraint_misfit(dict(zip(ENTRIES, row, strict=True))) for row in drawn]
    found = constraint_sd(entries, np.diag(sd**2))
    for name, value in found.items():
        assert value == pytest.approx(np.std([m[name] for m in misfits]), rel=0.1)
    assert "keep the two constraints" in constraint_words(entries, np.diag(sd**2))[0]
    broken = {**entries, "J22": entries["J22"] + 5 * found["J22"]}
    assert "a force is missing" in constraint_words(broken, np.diag(sd**2))[0]


def test_the_thesis_second_step_cannot_succeed():
    found = second_step()
    assert found.misfit["L1"].relative < -0.2
    assert "miss" in found.words[0]
    assert (found.parameters["mb"], found.parameters["Ro"]) == (0.0608, 0.0957)


def test_the_error_of_a_derived_quantity():
    known = [Known("Ro-Rb", 0.0853, 0.01), Known("Rb", 0.0104, 0.02)]
    sd = np.array([1e-6 * abs(value) for value in entries_of("rolling", DEVICE).values()])
    found = physical_from_entries(
        "rolling", entries_of("rolling", DEVICE), DEVICE, covariance=np.diag(sd**2), known=known
    )
    # two known lengths and one open direction: the distance is the weighted mean of what both say of it
    assert quantity_sd(found, "Ro-Rb") < 0.01
    assert quantity_sd(found, "Rb") < 0.02
