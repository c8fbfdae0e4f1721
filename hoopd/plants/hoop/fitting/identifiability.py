"""What a fit of the hoop does not determine, in words: through which products its parameters enter, what was held.

Rules of this file: the directions come from `fits.undetermined`; the combinations from the hoop's entries.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hoopd.plants.fits.output_error import Solution
from hoopd.plants.fits.uncertainty import Uncertainty
from hoopd.plants.fits.undetermined import (
    UNDETERMINED,
    DataCovariance,
    Direction,
    assumed_only,
    assumed_sentences,
    close_pairs,
    data_covariance,
    direction_sentence,
    listed,
    pair_sentences,
    pairs_worth_a_word,
)
from hoopd.plants.hoop.entries import COMBINATIONS, FORMULAS, combinations_jacobian, combinations_of
from hoopd.plants.hoop.parameters import KINEMATICS, PARAMETER_UNITS


@dataclass(frozen=True)
class Determined:
    """What the data say nothing about, and what they do say."""

    directions: tuple[Direction, ...]
    pairs: tuple[tuple[str, str, float], ...]  # |correlation| > CLOSE, all information used
    assumed: dict[str, float]  # posterior over prior standard deviation where the data hardly moved it
    combinations: dict[str, tuple[float, float]]  # value and relative standard deviation (inf: unknown), physical only
    fixed: dict[str, float]
    words: list[str]


def determined(
    solution: Solution, found: Uncertainty, structure: str, fixed: Sequence[str] = ("g", "mb", "Ro", "Rb")
) -> Determined:
    """Judgement of a fit of `structure`; `fixed`: parameters to name as assumed when they were not fitted."""
    names = solution.names
    data = data_covariance(solution, found)
    directions = tuple(data.directions(names))
    pairs, assumed = close_pairs(names, found.correlation), assumed_only(solution, found)
    combos = _combinations(structure, solution, data) if structure in KINEMATICS else {}
    held = {name: solution.values[name] for name in fixed if name not in names and name in solution.values}
    words = [
        *direction_words(directions, combos, structure),
        *(
            [] if directions else pair_sentences(pairs_worth_a_word(pairs, solution, found))
        ),  # a direction says why its parameters go together
        *assumed_sentences(assumed),
        *_fixed_words(held, structure),
    ]
    return Determined(directions, pairs, assumed, combos, held, words)


def direction_words(
    directions: Sequence[Direction], combos: Mapping[str, tuple[float, float]], structure: str
) -> list[str]:
    """One sentence a direction, and for physical structures the products that are determined instead."""
    words = [direction_sentence(direction) for direction in directions]
    if directions and combos:
        words.append(_through(directions, combos, structure))
    return words


def _through(directions: Sequence[Direction], combos: Mapping[str, tuple[float, float]], structure: str) -> str:
    """Ib, mb and Rb only through M12 = ... and so on: the known combinations that hold an affected parameter."""
    affected = {name for direction in directions for name in direction.shown}
    order = [name for name in PARAMETER_UNITS[structure] if name in affected]
    known = [_combination(name, *combos[name], structure) for name in combos if combos[name][1] <= UNDETERMINED]
    known = [text for text in known if any(name in text for name in order)]
    if not known:
        return f"No combination of {listed(order)} is determined either."
    return f"{listed(order)} enter the data only through {'; '.join(known)}."


def _combination(name: str, value: float, sd: float, structure: str) -> str:
    formula = FORMULAS[structure][name]
    left = name if formula.replace(" ", "") == name.replace(" ", "") else f"{name} = {formula}"
    return f"{left} = {value:.4g} {COMBINATIONS[name]} (+-{100 * sd:.2g} %)"


def _fixed_words(held: Mapping[str, float], structure: str) -> list[str]:
    if structure not in KINEMATICS or not held:
        return []
    units = PARAMETER_UNITS[structure]
    values = listed([f"{name} = {value:.6g} {units[name]}" for name, value in held.items()])
    return [f"Held, not estimated: {values}; the other values and their intervals are as good as that."]


def _combinations(structure: str, solution: Solution, data: DataCovariance) -> dict[str, tuple[float, float]]:
    """Value and relative standard deviation by the data alone of the six combinations."""
    p = {name: solution.values[name] for name in PARAMETER_UNITS[structure]}
    value = combinations_of(structure, p)
    columns = [list(p).index(name) for name in solution.names]
    by_log = combinations_jacobian(structure, p)[:, columns] * np.array([p[name] for name in solution.names])
    out = {}
    for row, (name, number) in zip(by_log, value.items(), strict=True):
        out[name] = (number, float(np.sqrt(max(data.variance(row / number), 0.0))))
    return out
