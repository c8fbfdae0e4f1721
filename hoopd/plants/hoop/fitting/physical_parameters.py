"""The second step: from identified entries J, K, L to positive physical parameters, and the misfit that remains.

    min over p > 0 of  (e(p) - e)' C^-1 (e(p) - e)  +  sum_i (log q_i(p) - log q_i)^2 / s_i^2

e(p) from the equations of the plant, C the covariance of the entries (or a relative weight where there is none), q_i
quantities that were measured otherwise, with relative standard deviation s_i (minimum distance; Ljung, System
Identification, 2nd ed., ch. 15; Newey and McFadden 1994, ch. 2).

Rules of this file: numbers in, numbers out. Eight entries carry six combinations: a misfit is no failure of the search.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hoopd.plants.fits.undetermined import Direction, simplified
from hoopd.plants.hoop.entries import ENTRIES, combinations_of, entries_jacobian, entries_of, spin_ratio
from hoopd.plants.hoop.fitting.identifiability import direction_words
from hoopd.plants.hoop.parameters import PARAMETER_UNITS

Array = NDArray[np.float64]

FREE = ("mb", "Ro", "Rb", "Ib", "Ih", "bb", "bh")
# Without a covariance: misfits relative to the entry, but never to less than a tenth of the largest of its kind, so
# that a rate near zero does not rule the fit.
SMALLEST_PART = 0.1
KINDS_OF_ENTRY = (("J11", "J12", "J21", "J22"), ("K1", "K2"), ("L1", "L2"))
# Starts are spread by a factor of e^+-1 around the given one.
START_SPREAD = 1.0
# Pull of every logarithm towards the start: too weak to move a determined one (1e-6 of a unit of cost at a factor e),
# it picks the nearest of the parameters that the entries cannot tell apart.
PULL = 1e-3
# Two searches found the same when their costs agree to this part.
SAME_COST = 1e-4
# Singular values below this part of the largest: no combination of the entries (exact derivatives, 8 by 8).
NOTHING = 1e-8
# A misfit worth a word.
LARGE_RELATIVE = 0.02


class Known(NamedTuple):
    """A quantity that was measured otherwise: a parameter, Ro-Rb, Ro/Rb, Ib/mb or spin."""

    name: str
    value: float
    relative_sd: float


class Misfit(NamedTuple):
    """What the parameters give less what was identified."""

    absolute: float
    relative: float
    standard_errors: float | None


@dataclass(frozen=True)
class PhysicalFit:
    """Positive parameters for given entries."""

    kinematics: str
    parameters: dict[str, float]
    free: tuple[str, ...]
    entries: dict[str, float]  # that the parameters give
    misfit: dict[str, Misfit]
    chi2: float  # of entries and known quantities together; without a covariance in units of the relative weight
    combinations: dict[str, float]  # the six that the entries determine
    directions: tuple[Direction, ...]  # what neither entries nor known quantities determine
    agreeing: int  # searches that ended at the same cost
    covariance: Array = field(compare=False)  # (m, m) of the logarithms of `free`; open directions count as known
    words: list[str] = field(default_factory=list)


def quantity(kinematics: str, name: str, p: Mapping[str, float]) -> float:
    """A parameter or a derived quantity by name; KeyError for an unknown one."""
    derived = {
        "Ro-Rb": lambda: p["Ro"] - p["Rb"],
        "Ro/Rb": lambda: p["Ro"] / p["Rb"],
        "Ib/mb": lambda: p["Ib"] / p["mb"],
        "spin": lambda: abs(spin_ratio(kinematics, p)),
    }
    return derived[name]() if name in derived else p[name]


def physical_from_entries(
    kinematics: str,
    entries: Mapping[str, float],
    start: Mapping[str, float],
    *,
    covariance: Array | None = None,
    fixed: Sequence[str] = (),
    known: Sequence[Known] = (),
    starts: int = 8,
    seed: int = 0,
) -> PhysicalFit:
    """Least squares on logarithms from several starts around `start`; `covariance` (8, 8) of `ENTRIES`, SI units."""
    free = tuple(name for name in FREE if name not in fixed)
    whiten = whitening(entries, covariance)
    problem = _Problem(kinematics, np.array([entries[name] for name in ENTRIES]), whiten, dict(start), free, known)
    found = sorted((problem.solve(z) for z in _starts(len(free), starts, seed)), key=lambda one: one[0])
    cost, z = found[0]
    p = problem.parameters(z)
    given, misfit = entries_of(kinematics, p), _misfits(kinematics, p, entries, covariance)
    slope = problem.jacobian(z)
    directions = _directions(free, slope)
    combos = combinations_of(kinematics, p)
    words = [*_misfit_words(kinematics, entries, misfit, covariance), *_direction_words(directions, combos, kinematics)]
    agreeing = sum(one[0] <= cost * (1 + SAME_COST) + 1e-9 for one in found)
    spread = np.asarray(np.linalg.pinv(slope.T @ slope, rcond=NOTHING**2, hermitian=True), float)
    return PhysicalFit(kinematics, p, free, given, misfit, 2 * cost, combos, directions, agreeing, spread, words)


def whitening(entries: Mapping[str, float], covariance: Array | None) -> Array:
    """W (k, 8) so that |W (e(p) - e)|^2 is the misfit; directions without variance are left out."""
    if covariance is None:
        return np.diag([1.0 / entry_weight(name, entries) for name in ENTRIES])
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    good = values > 1e-12 * values[-1]
    return np.asarray((vectors[:, good] / np.sqrt(values[good])).T / sd)


def quantity_slope(kinematics: str, name: str, p: Mapping[str, float], free: Sequence[str]) -> Array:
    """(m,) derivatives of a quantity's logarithm by the logarithms of parameters: central differences of 1e-5."""
    slope = []
    for one in free:
        up, down = (quantity(kinematics, name, {**p, one: p[one] * np.exp(sign * 1e-5)}) for sign in (1, -1))
        slope.append(math.log(up / down) / 2e-5)
    return np.array(slope)


def quantity_sd(fit: PhysicalFit, name: str) -> float:
    """Relative standard deviation of a quantity at the fit's parameters."""
    g = quantity_slope(fit.kinematics, name, fit.parameters, fit.free)
    return math.sqrt(max(float(g @ fit.covariance @ g), 0.0))


# ---------------------------------------------------------------------------------------------- search


@dataclass
class _Problem:
    kinematics: str
    entries: Array
    whiten: Array
    start: dict[str, float]
    free: tuple[str, ...]
    known: Sequence[Known]

    def parameters(self, z: Array) -> dict[str, float]:
        """p = p0 exp(z); Ro stays above Rb because Ro/Rb - 1 is what is scaled."""
        p = dict(self.start)
        change = dict(zip(self.free, np.exp(np.clip(z, -20.0, 20.0)), strict=True))
        for name, factor in change.items():
            p[name] = self.start[name] * float(factor)
        # the search moves Ro-Rb in the place of Ro: both radii stay positive, the ball inside
        distance = self.start["Ro"] - self.start["Rb"]
        if "Ro" in change:
            p["Ro"] = p["Rb"] + distance * float(change["Ro"])
        else:
            p["Rb"] = min(p["Rb"], p["Ro"] * 0.99)
        return {name: float(p[name]) for name in PARAMETER_UNITS[self.kinematics]}

    def residual(self, z: Array) -> Array:
        p = self.parameters(z)
        e = np.array(list(entries_of(self.kinematics, p).values()))
        extra = [math.log(quantity(self.kinematics, k.name, p) / k.value) / k.relative_sd for k in self.known]
        return np.asarray(np.concatenate([self.whiten @ (e - self.entries), extra, PULL * z]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the residual by z, (k, m)."""
        p, chain = self.parameters(z), np.eye(len(self.free))
        if "Ro" in self.free:
            # Ro = Rb + (Ro-Rb): d log Ro = (1 - Rb/Ro) d log(Ro-Rb) + Rb/Ro d log Rb
            row = self.free.index("Ro")
            chain[row, row] = 1.0 - p["Rb"] / p["Ro"]
            if "Rb" in self.free:
                chain[row, self.free.index("Rb")] = p["Rb"] / p["Ro"]
        return np.asarray(np.vstack([self.jacobian(z) @ chain, PULL * np.eye(len(self.free))]))

    def jacobian(self, z: Array) -> Array:
        """Derivatives of entries and known quantities by the logarithms of the parameters, weighted, (k, m)."""
        p = self.parameters(z)
        columns = [list(p).index(name) for name in self.free]
        by_log = entries_jacobian(self.kinematics, p)[:, columns] * np.array([p[name] for name in self.free])
        extra = [quantity_slope(self.kinematics, k.name, p, self.free) / k.relative_sd for k in self.known]
        return np.asarray(np.vstack([self.whiten @ by_log, *extra]))

    def solve(self, z: Array) -> tuple[float, Array]:
        """Cost and place of one search."""
        if len(z) == 0:
            return float(np.sum(self.residual(z) ** 2) / 2), z
        found = least_squares(self.residual, z, self.slope, x_scale="jac", max_nfev=300, ftol=1e-12, xtol=1e-12)
        return float(found.cost), found.x


def _starts(size: int, count: int, seed: int) -> list[Array]:
    random = np.random.default_rng(seed)
    return [np.zeros(size), *(random.uniform(-START_SPREAD, START_SPREAD, size) for _ in range(count - 1))]


def entry_weight(name: str, entries: Mapping[str, float]) -> float:
    """What a misfit is relative to where no covariance is known."""
    kind = next(kind for kind in KINDS_OF_ENTRY if name in kind)
    return max(abs(entries[name]), SMALLEST_PART * max(abs(entries[other]) for other in kind))


def _directions(names: Sequence[str], jacobian: Array) -> tuple[Direction, ...]:
    """Relative changes that neither entries nor known quantities notice."""
    if not names:
        return ()
    _, s, v = np.linalg.svd(jacobian, full_matrices=True)
    rank = int((s > NOTHING * s[0]).sum())
    return tuple(
        Direction({name: float(c) for name, c in zip(names, column, strict=True)}, float("inf"))
        for column in simplified(v[rank:].T).T
    )


def _misfits(
    kinematics: str, p: Mapping[str, float], entries: Mapping[str, float], covariance: Array | None
) -> dict[str, Misfit]:
    found = entries_of(kinematics, p)
    sd = None if covariance is None else np.sqrt(np.diag(covariance))
    out = {}
    for index, name in enumerate(ENTRIES):
        off = found[name] - entries[name]
        errors = None if sd is None else float(off / sd[index])
        out[name] = Misfit(off, off / max(abs(entries[name]), 1e-300), errors)
    return out


# ---------------------------------------------------------------------------------------------- words


def _misfit_words(
    kinematics: str, entries: Mapping[str, float], misfit: Mapping[str, Misfit], covariance: Array | None
) -> list[str]:
    if covariance is not None:
        large = {n: m for n, m in misfit.items() if abs(m.standard_errors or 0.0) > 2.0}
        text = ", ".join(
            f"{n} by {m.standard_errors:+.1f} standard errors ({m.absolute:+.3g})" for n, m in large.items()
        )
    else:
        large = {n: m for n, m in misfit.items() if abs(m.absolute) > LARGE_RELATIVE * entry_weight(n, entries)}
        text = ", ".join(f"{n} by {m.absolute:+.3g} ({100 * m.relative:+.0f} %)" for n, m in large.items())
    if not large:
        return [f"Positive parameters give the entries through the {kinematics} kinematics."]
    return [f"The best positive parameters through the {kinematics} kinematics miss {text}."]


def _direction_words(directions: Sequence[Direction], combos: Mapping[str, float], kinematics: str) -> list[str]:
    words = direction_words(directions, {}, kinematics)
    if directions:
        values = ", ".join(f"{name} = {value:.4g}" for name, value in combos.items())
        words.append(f"Only six combinations are determined: {values} (SI units).")
    return words
