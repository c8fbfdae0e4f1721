"""What a fit of any plant does not determine: directions, close pairs, values that are only assumed, and how to say it.

A direction is a set of relative changes of the parameters. It counts as undetermined when the data alone, priors left
out, leave it a relative standard deviation above UNDETERMINED.

Rules of this file: it reads a solution and its uncertainty; relative changes throughout (logarithms of positive ones).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from hoopd.plants.fits.output_error import Solution
from hoopd.plants.fits.uncertainty import Uncertainty, intervals, prior_information

Array = NDArray[np.float64]

UNDETERMINED = 0.5
# Eigenvalues below this part of the largest are rounding: twice the digits that J'J keeps of J.
NOTHING = 1e-12
CLOSE = 0.95
# Pairs go together in every fit: worth a word where half the 95 % interval of either is above this part of its value.
WIDE = 0.02
# Changes below this part of the largest one of a direction are left out of its words.
SHOWN = 0.1
# A posterior this near to its prior was not moved by the data.
ASSUMED = 0.9


@dataclass(frozen=True)
class Direction:
    """Relative changes that the data hardly notice when made together; the largest is 1."""

    changes: dict[str, float]
    relative_sd: float  # of the largest change by the data alone; inf: no trace of it

    @property
    def shown(self) -> dict[str, float]:
        """The changes worth a word."""
        return {name: c for name, c in self.changes.items() if abs(c) >= SHOWN}


@dataclass(frozen=True)
class DataCovariance:
    """Of relative changes by the data alone: `covariance` (r, r) within `seen` (m, r), infinite along `unseen`."""

    seen: Array
    covariance: Array
    unseen: Array  # (m, m - r)

    def variance(self, c: Array) -> float:
        """Of the relative change c' r."""
        if self.unseen.shape[1] and np.linalg.norm(self.unseen.T @ c) > 1e-3 * np.linalg.norm(c):
            return inf
        inside = self.seen.T @ c
        return float(inside @ self.covariance @ inside)

    def directions(self, names: Sequence[str]) -> list[Direction]:
        """Undetermined ones, each with as few parameters as can be."""
        values, vectors = np.linalg.eigh(self.covariance)
        weak = values > UNDETERMINED**2
        basis = np.hstack([self.unseen, self.seen @ vectors[:, weak]])
        sd = np.concatenate([np.full(self.unseen.shape[1], inf), np.sqrt(values[weak])])
        return [_direction(names, column, basis, sd) for column in simplified(basis).T]


def data_covariance(solution: Solution, found: Uncertainty) -> DataCovariance:
    """The sandwich covariance without the priors, on relative changes."""
    size = _size(solution)
    prior = prior_information(solution)
    # C = (A + P)^-1 (B + P) (A + P)^-1: back to B, the coloured information
    whole = found.information + prior
    coloured = whole @ found.covariance @ whole - prior
    # r = size z
    a, b = found.information / np.outer(size, size), coloured / np.outer(size, size)
    values, vectors = np.linalg.eigh(a)
    good = values > NOTHING * max(float(values[-1]), 1e-300)
    seen, weight = vectors[:, good], values[good]
    covariance = (seen.T @ b @ seen) / np.outer(weight, weight)
    return DataCovariance(seen, (covariance + covariance.T) / 2, vectors[:, ~good])


def simplified(basis: Array) -> Array:
    """The same space (m, k), each column with a 1 at a parameter of its own where the others have 0, largest then 1."""
    if basis.shape[1] == 0:
        return basis
    _, _, order = qr(basis.T, pivoting=True, mode="economic")
    own = basis @ np.linalg.inv(basis[order[: basis.shape[1]]])
    largest = own[np.abs(own).argmax(axis=0), np.arange(own.shape[1])]
    return np.asarray(own / largest)


def close_pairs(names: Sequence[str], correlation: Array) -> tuple[tuple[str, str, float], ...]:
    """Pairs with |rho| > CLOSE, closest first."""
    found = [
        (names[i], names[j], float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > CLOSE
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair[2])))


def assumed_only(solution: Solution, found: Uncertainty) -> dict[str, float]:
    """Posterior over prior standard deviation of parameters whose interval is (nearly) the prior's."""
    prior = np.diag(prior_information(solution))
    ratio = np.sqrt(np.diag(found.covariance) * prior)
    return {name: float(r) for name, r in zip(solution.names, ratio, strict=True) if r > ASSUMED}


def pairs_worth_a_word(
    pairs: Sequence[tuple[str, str, float]], solution: Solution, found: Uncertainty
) -> list[tuple[str, str, float]]:
    """Pairs of which either is known to less than WIDE: half of its 95 % interval, against its value."""
    ends = intervals(solution, found)
    wide = {name for name, (low, high) in ends.items() if (high - low) / 2 > WIDE * abs(solution.values[name])}
    return [pair for pair in pairs if wide & {*pair[:2]}]


# ---------------------------------------------------------------------------------------------- words


def direction_sentence(direction: Direction) -> str:
    """What a direction means for the parameters in it."""
    shown = sorted(direction.shown.items(), key=lambda item: -abs(item[1]))
    if len(shown) == 1:
        return f"{shown[0][0]} is not determined by these data: {_sd_words(direction.relative_sd)}."
    names = listed([name for name, _ in shown])
    if len(shown) == 2:
        return f"{names} are determined only through {_product(*shown)}: {_sd_words(direction.relative_sd)}."
    together = ", ".join(f"{name} {10 * change:+.2g} %" for name, change in shown)
    rest = ", the rest by less than 1 %," if any(0.0 < abs(c) < SHOWN for c in direction.changes.values()) else ""
    return f"{names} are not determined one by one: {together}{rest} together {_trace(direction.relative_sd)}."


def pair_sentences(pairs: Sequence[tuple[str, str, float]]) -> list[str]:
    """What is known of parameters that go together."""
    kind = {True: "their ratio is known better than either", False: "their product is known better than either"}
    return [f"{a} and {b} go together (correlation {rho:+.3f}): {kind[rho > 0]}." for a, b, rho in pairs]


def assumed_sentences(assumed: Mapping[str, float]) -> list[str]:
    """Which values are the prior's."""
    if not assumed:
        return []
    verb = "is" if len(assumed) == 1 else "are"
    return [f"{listed(list(assumed))} {verb} what was assumed before the fit: the data added nothing to the prior."]


def listed(names: Sequence[str]) -> str:
    """Names as a sentence has them: a, b and c."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _sd_words(sd: float) -> str:
    return "the data hold no trace of it" if sd == inf else f"relative standard deviation {100 * sd:.0f} %"


def _trace(sd: float) -> str:
    if sd == inf:
        return "changes nothing that the data show"
    return f"is within the noise (relative standard deviation {100 * sd:.0f} % of the first)"


def _product(first: tuple[str, float], second: tuple[str, float]) -> str:
    """What stays when both change: a, b relative changes, so first^b second^-a."""
    power = -first[1] / second[1]
    if abs(power - 1.0) < 0.05:
        return f"{first[0]} {second[0]}"
    if abs(power + 1.0) < 0.05:
        return f"{first[0]}/{second[0]}"
    return f"{first[0]} {second[0]}^{power:.2g}"


# ---------------------------------------------------------------------------------------------- helpers


def _direction(names: Sequence[str], column: Array, basis: Array, sd: Array) -> Direction:
    """Its standard deviation along the weakest of the parts it is made of."""
    parts = np.abs(np.linalg.lstsq(basis, column, rcond=None)[0])
    relevant = parts > 1e-3 * parts.max()
    largest = float(np.linalg.norm((parts * np.where(np.isinf(sd), 0.0, sd))[relevant]))
    spread = inf if np.isinf(sd[relevant]).any() else largest / float(np.linalg.norm(parts))
    return Direction({name: float(c) for name, c in zip(names, column, strict=True)}, spread)


def _size(solution: Solution) -> Array:
    """Relative change per unit of the search's coordinate (m,)."""
    values = np.array([solution.values[name] for name in solution.names])
    nominal = np.abs(solution.scale.nominal)
    # an entry that came out near zero is judged by the size it was expected to have
    entry = np.where(nominal > 0.0, nominal, 1.0) / np.maximum(np.maximum(np.abs(values), nominal), 1e-300)
    return np.asarray(np.where(solution.scale.positive, 1.0, entry))
