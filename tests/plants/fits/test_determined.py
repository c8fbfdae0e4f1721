"""What a fit does not determine: exact null directions, with and without priors, and the words for them."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from freeruns import DEVICE, runs_of

from hoopd.plants.fits.uncertainty import intervals, uncertainty
from hoopd.plants.fits.undetermined import Direction, close_pairs, simplified
from hoopd.plants.hoop.entries import entries_jacobian, entries_of
from hoopd.plants.hoop.fitting.free_parameters import PHYSICAL, default_priors
from hoopd.plants.hoop.fitting.hoop_output_error import fit_output_error
from hoopd.plants.hoop.fitting.identifiability import determined, direction_words
from hoopd.plants.hoop.parameters import PARAMETER_UNITS

ALL = PHYSICAL["both"]


def null_space(structure: str, p: dict[str, float], names: tuple[str, ...]) -> np.ndarray:
    """Relative changes (m, k) of the named parameters that leave all entries as they are."""
    order = [list(PARAMETER_UNITS[structure]).index(name) for name in names]
    by_log = entries_jacobian(structure, p)[:, order] * np.array([p[name] for name in names])
    by_log /= np.abs(list(entries_of(structure, p).values()))[:, None]
    _, s, v = np.linalg.svd(by_log)
    return v[int((s > 1e-9 * s[0]).sum()) :].T


@pytest.mark.parametrize("kind", ["rolling", "published"])
@pytest.mark.parametrize("with_priors", [True, False])
def test_the_direction_that_no_free_run_shows_is_found_exactly(kind, with_priors):
    runs = runs_of(kind, DEVICE, 1)
    priors = default_priors(kind, ALL, DEVICE) if with_priors else {}
    solution = fit_output_error(kind, DEVICE, ALL, runs, priors=priors)
    found = determined(solution, uncertainty(solution), kind)
    hidden = null_space(kind, solution.values, ALL)
    assert hidden.shape == (7, 1)
    assert len(found.directions) == 1
    direction = found.directions[0]
    assert direction.relative_sd == inf
    change = np.array([direction.changes[name] for name in ALL])
    cosine = abs(change @ hidden[:, 0]) / np.linalg.norm(change)
    assert cosine > 1 - 1e-6
    assert all(sd < 0.1 for _, sd in found.combinations.values())
    text = " ".join(found.words)
    assert "changes nothing that the data show" in text
    assert "M11 = Ih + Ib" in text
    assert "g = 9.81 m/s^2" in text
    assert bool(found.assumed) <= with_priors


def test_known_geometry_leaves_nothing_undetermined():
    runs = runs_of("rolling", DEVICE, 2)
    names = ("Ib", "Ih", "bb", "bh")
    solution = fit_output_error("rolling", DEVICE, names, runs)
    found = determined(solution, uncertainty(solution), "rolling")
    assert found.directions == ()
    assert found.fixed == {name: DEVICE[name] for name in ("g", "mb", "Ro", "Rb")}
    assert all(word.startswith(("Held", "Ib and", "Ih and", "bb and")) for word in found.words)


def test_a_gravity_left_free_adds_a_second_direction():
    names = (*ALL, "g")
    runs = runs_of("rolling", DEVICE, 3)
    solution = fit_output_error("rolling", DEVICE, names, runs, priors=default_priors("rolling", names, DEVICE))
    found = determined(solution, uncertainty(solution), "rolling")
    hidden = null_space("rolling", solution.values, names)
    assert hidden.shape[1] == len(found.directions) == 2
    changes = np.array([[d.changes[name] for name in names] for d in found.directions]).T
    outside = changes - hidden @ (hidden.T @ changes)
    assert np.abs(outside).max() < 1e-5


def test_entries_of_a_rich_recording_are_all_determined():
    values = {**{n: DEVICE[n] for n in ("mb", "Ro", "Rb", "g")}, **entries_of("rolling", DEVICE)}
    names = tuple(entries_of("rolling", DEVICE))
    solution = fit_output_error("entries", values, names, runs_of("rolling", DEVICE, 4))
    found = determined(solution, uncertainty(solution), "entries")
    assert found.directions == ()
    assert found.combinations == {}


def test_a_close_pair_is_worth_a_word_where_an_interval_is_wide():
    values = {**{n: DEVICE[n] for n in ("mb", "Ro", "Rb", "g")}, **entries_of("rolling", DEVICE)}
    solution = fit_output_error("entries", values, tuple(entries_of("rolling", DEVICE)), runs_of("rolling", DEVICE, 4))
    sure = uncertainty(solution)
    close = sure.covariance.copy()
    close[4, :] = close[:, 4] = 0.0  # J21 and K2 alone go together
    close[4, 4] = sure.covariance[4, 4]
    close[4, 6] = close[6, 4] = 0.99 * np.sqrt(sure.covariance[4, 4] * sure.covariance[6, 6])
    for half, told in ((0.005, False), (0.05, True)):  # of J21, whose interval is the wider one
        now = intervals(solution, sure)["J21"]
        scale = (half * abs(solution.values["J21"]) / ((now[1] - now[0]) / 2)) ** 2
        found = determined(solution, sure._replace(covariance=close * scale), "entries")
        assert ("J21", "K2") in [pair[:2] for pair in found.pairs]
        assert any(word.startswith("J21 and K2 go together") for word in found.words) is told


@pytest.mark.parametrize(
    ("changes", "sd", "expected"),
    [
        ({"mb": 1.0, "g": -1.0}, inf, "mb and g are determined only through mb g: the data hold no trace"),
        ({"Ro": 1.0, "Rb": 1.0}, 0.8, "Ro and Rb are determined only through Ro/Rb: relative standard deviation 80 %"),
        ({"bb": 1.0, "Rb": 0.5}, inf, "bb and Rb are determined only through bb Rb^-2"),
        ({"J12": 1.0, "J11": 0.02}, 1.1, "J12 is not determined by these data: relative standard deviation 110 %"),
        ({"a": 1.0, "b": 0.5, "c": -0.4}, inf, "a +10 %, b +5 %, c -4 % together changes nothing"),
    ],
)
def test_words_of_a_direction(changes, sd, expected):
    assert expected in direction_words([Direction(changes, sd)], {}, "entries")[0]


def test_a_space_is_written_with_few_parameters():
    a, b = np.array([1.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 2.0])
    turned = np.column_stack([a + b, a - 0.3 * b])
    found = simplified(turned)
    assert sorted((np.abs(found) > 1e-9).sum(axis=0)) == [2, 2]
    assert np.abs(found).max(axis=0) == pytest.approx([1.0, 1.0])


def test_close_pairs_are_named_closest_first():
    rho = np.array([[1.0, 0.96, 0.2], [0.96, 1.0, -0.99], [0.2, -0.99, 1.0]])
    assert close_pairs(("a", "b", "c"), rho) == (("b", "c", -0.99), ("a", "b", 0.96))
