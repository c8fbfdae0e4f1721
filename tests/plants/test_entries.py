"""Entries of the equations against a second derivation, the thesis's numbers and what ties eight entries to six."""

from __future__ import annotations

import re

import numpy as np
import pytest
from freeruns import DEVICE
from hypothesis import given, settings, strategies as st

from hoopd.plants.hoop.entries import (
    ENTRIES,
    FORMULAS,
    combinations_from,
    combinations_jacobian,
    combinations_of,
    constraint_misfit,
    entries_jacobian,
    entries_of,
    equivalent,
    implied,
    spin_ratio,
)
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.thesis import ENTRIES_PRINTED as THESIS, TABLE_3_1 as TABLE

KINDS = ("rolling", "published")


def by_hand(kinematics: str, p: dict[str, float]) -> dict[str, float]:
    """The same from M, B and G written down directly."""
    k, r = p["Ro"] / p["Rb"], p["Ro"] - p["Rb"]
    a, c = (k, 1 - k) if kinematics == "rolling" else (k + 1, -k)
    mass = np.array([[p["Ih"] + p["Ib"] * a**2, p["Ib"] * a * c], [p["Ib"] * a * c, p["mb"] * r**2 + p["Ib"] * c**2]])
    d = p["bb"] * k**2
    inverse = np.linalg.inv(mass)
    j = -inverse @ np.array([[d + p["bh"], -d], [-d, d]])
    gravity = -inverse @ np.array([0.0, p["mb"] * p["g"] * r])
    values = (j[0, 0], j[0, 1], gravity[0], inverse[0, 0], j[1, 0], j[1, 1], gravity[1], inverse[1, 0])
    return dict(zip(ENTRIES, values, strict=True))


def varied(exponents: list[float]) -> dict[str, float]:
    return {name: value * np.exp(e) for (name, value), e in zip(DEVICE.items(), exponents, strict=True)}


parameters = st.lists(st.floats(-0.7, 0.7), min_size=8, max_size=8).map(varied)


@given(parameters, st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_entries_and_combinations_equal_a_derivation_by_hand(p, kind):
    found = entries_of(kind, p)
    assert found == pytest.approx(by_hand(kind, p), rel=1e-9)
    assert combinations_from(found) == pytest.approx(combinations_of(kind, p), rel=1e-7)


@given(parameters, st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_entries_of_any_parameters_keep_the_two_constraints(p, kind):
    entries = entries_of(kind, p)
    for name, misfit in constraint_misfit(entries).items():
        assert abs(misfit) < 1e-9 * (1 + abs(entries[name]))


@given(parameters, st.sampled_from(KINDS))
@settings(max_examples=60, deadline=None)
def test_the_other_kinematics_gives_the_same_entries_with_another_ratio(p, kind):
    other = "published" if kind == "rolling" else "rolling"
    same = equivalent(kind, p)
    assert entries_of(other, same) == pytest.approx(entries_of(kind, p), rel=1e-8)
    assert all(same[name] == p[name] for name in ("mb", "Ib", "Ih", "bh", "g"))
    assert spin_ratio(other, same) == pytest.approx(spin_ratio(kind, p))


def test_entries_are_the_plants_linearisation():
    a, b = HoopPlant("rolling", DEVICE).linearize()
    e = entries_of("rolling", DEVICE)
    assert [a[1, 1], a[1, 3], a[1, 2], b[1, 0]] == pytest.approx([e["J11"], e["J12"], e["K1"], e["L1"]])
    assert [a[3, 1], a[3, 3], a[3, 2], b[3, 0]] == pytest.approx([e["J21"], e["J22"], e["K2"], e["L2"]])


def test_the_thesis_entries_break_both_constraints():
    assert implied(THESIS) == pytest.approx({"J22": -0.506, "J21": 0.358}, abs=5e-4)
    misfit = constraint_misfit(THESIS)
    assert misfit == pytest.approx({"J22": 0.171, "J21": -0.361}, abs=1e-3)


def test_table_3_1_does_not_reproduce_the_thesis_entries():
    found = entries_of("published", TABLE)
    printed = {"J11": -4.56, "J21": -1.30, "K1": -10.9, "K2": -81.7, "L1": 597, "L2": 214}
    assert {name: found[name] for name in printed} == pytest.approx(printed, rel=5e-3)
    assert abs(found["J11"] / THESIS["J11"]) > 9.0
    assert abs(found["K1"] / THESIS["K1"]) > 2.0


@pytest.mark.parametrize("kind", KINDS)
def test_jacobians_equal_differences_and_leave_one_direction_of_seven_free(kind):
    names = list(PARAMETER_UNITS[kind])
    exact, step = entries_jacobian(kind, DEVICE), 1e-6
    for column, name in enumerate(names):
        up, down = ({**DEVICE, name: DEVICE[name] * (1 + sign * step)} for sign in (1, -1))
        slope = [(entries_of(kind, up)[e] - entries_of(kind, down)[e]) / (2 * step * DEVICE[name]) for e in ENTRIES]
        assert exact[:, column] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(slope).max())
    free = [i for i, name in enumerate(names) if name != "g"]
    scale = np.array([DEVICE[names[i]] for i in free])
    by_log = exact[:, free] * scale / np.abs(list(entries_of(kind, DEVICE).values()))[:, None]
    combined = combinations_jacobian(kind, DEVICE)[:, free] * scale
    combined /= np.abs(list(combinations_of(kind, DEVICE).values()))[:, None]
    assert np.linalg.matrix_rank(by_log, 1e-9) == np.linalg.matrix_rank(combined, 1e-9) == 6
    assert np.linalg.matrix_rank(np.vstack([by_log, combined]), 1e-9) == 6


def test_a_resting_hoops_ball_turns_once_less_than_the_papers_say():
    assert spin_ratio("rolling", DEVICE) == pytest.approx(-(0.0957 - 0.0104) / 0.0104)
    assert spin_ratio("published", DEVICE) == pytest.approx(-0.0957 / 0.0104)
    with pytest.raises(ValueError, match="no equivalent"):
        equivalent("rolling", {**DEVICE, "Rb": 0.06})


@pytest.mark.parametrize("kind", KINDS)
def test_the_formulas_in_words_are_the_equations(kind):
    found = combinations_of(kind, DEVICE)
    for name, text in FORMULAS[kind].items():
        python = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", text).replace("^", "**")
        assert eval(python, dict(DEVICE)) == pytest.approx(found[name])
