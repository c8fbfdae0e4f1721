"""How many coefficients: ARX and AR models of many orders side by side, by information criteria and on other data.

All candidates are fitted to the same equations, from one Gram matrix of the longest lags, so their errors compare.

Rules of this file: the criteria are those of `hoopd.ident.information_criteria`, of the mean squared error and the
number of equations; smaller is better.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import check
from hoopd.ident.damped_least_squares import solved
from hoopd.ident.data import Data, experiments
from hoopd.ident.information_criteria import aic, aicc, bic, fpe
from hoopd.ident.polynomial.regression import gram_of
from hoopd.ident.polynomial.structure import Counts, Structure, single, structure

Array = NDArray[np.float64]
Criterion = Literal["aic", "aicc", "bic", "fpe", "validation"]

# Errors below this share of the output's square are rounding of the Gram matrix: all such models fit alike.
EXACT = 1e-12
# Rows of a scan that are printed.
SHOWN = 10


@dataclass(frozen=True)
class OrderCandidate:
    """One choice of orders: its mean squared one-step error and what the criteria make of it.

    `validation`: mean squared one-step error on data that were not fitted.
    """

    na: int
    nb: tuple[int, ...]
    delay: tuple[int, ...]
    parameters: int
    samples: int
    variance: float
    validation: float | None = None

    def criterion(self, name: Criterion) -> float:
        """The value by name; ValueError for "validation" where there was none."""
        if name == "validation":
            if self.validation is None:
                raise ValueError("no validation: give data or folds to the scan")
            return self.validation
        if name not in CRITERIA:
            raise ValueError(f"the criteria are {', '.join(CRITERIA)} and validation, not {name!r}")
        return CRITERIA[name](self.variance, self.samples, self.parameters)


CRITERIA = {"aic": aic, "aicc": aicc, "bic": bic, "fpe": fpe}


@dataclass(frozen=True, repr=False)
class OrderScan:
    """All candidates of a scan, in the order na, nb, delay; it prints as the best by BIC."""

    candidates: tuple[OrderCandidate, ...]

    def __repr__(self) -> str:
        """The best, the best first, a row each."""
        order = sorted(self.candidates, key=lambda one: (one.criterion("bic"), one.parameters))
        rows = [["na", "nb", "delay", "parameters", "variance", "validation"]]
        for one in order[:SHOWN]:
            nb, late = (",".join(map(str, counts)) for counts in (one.nb, one.delay))
            held = "" if one.validation is None else f"{one.validation:.4g}"
            rows.append([str(one.na), nb, late, str(one.parameters), f"{one.variance:.4g}", held])
        head = rows[0] if order[0].validation is not None else rows[0][:-1]
        width = [max(len(row[i]) for row in rows) for i in range(len(head))]
        lines = ["  ".join(cell.rjust(w) for cell, w in zip(row, width, strict=False)) for row in rows]
        more = len(order) - SHOWN
        return "\n".join(lines + ([f"and {more} more, all by BIC; best(criterion) gives one"] if more > 0 else []))

    def best(self, name: Criterion = "bic") -> OrderCandidate:
        """The candidate with the least value; of equal ones that with fewer parameters."""
        return min(self.candidates, key=lambda one: (one.criterion(name), one.parameters))

    def values(self, name: Criterion = "bic") -> Array:
        """One value a candidate."""
        return np.array([one.criterion(name) for one in self.candidates])


def scan(
    data: Data | Sequence[Data], na: int | Iterable[int], nb: Counts | Iterable[Counts] = (),
    delay: Counts | Iterable[Counts] = 1, *, validation: Data | Sequence[Data] | None = None, folds: int = 0,
) -> OrderScan:  # fmt: skip
    """Fit ARX models (AR without inputs) of every combination of orders, side by side on the same equations.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; equations with a missing output at the longest lags are dropped for all.
    na : int or iterable of int
        Candidates of the coefficients of A after the leading 1.
    nb : int, tuple of int, or iterable of them
        Candidates of the coefficients of B; one is a number for all inputs or a tuple with one for each.
    delay : int, tuple of int, or iterable of them
        Candidates of the delay in samples.
    validation : Data or sequence of Data, optional
        Other data, on which the errors are measured too.
    folds : int
        2 or more: consecutive parts of the data, each predicted by a model of the others.

    Returns
    -------
    Scan
        All `candidates`; `best("bic")` is the one with the least criterion, of "aic", "aicc", "bic", "fpe",
        "validation".

    Raises
    ------
    ValueError
        No candidate, or too few samples for the largest.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, scan
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 0.0, 2.0], [1.0, -1.5, 0.7], u) + lfilter([1.0], [1.0, -1.5, 0.7], e)
    >>> best = scan(iddata(y, u, 0.1), na=range(1, 5), nb=range(1, 4), delay=range(1, 4)).best("bic")
    >>> best.na, best.nb, best.delay
    (2, (1,), (2,))
    """
    each = experiments(data)
    single(each)
    choices = list(_choices(each[0].nu, na, nb, delay))
    if not choices:
        raise ValueError("no orders to choose from")
    widest = _widest(choices)
    check(each, orders=replace(widest.asked, parameters=max(one.size for one in choices)))
    gram, rows = gram_of(each, widest)
    if rows <= max(one.size for one in choices):
        raise ValueError(f"too few samples: {rows} equations for {max(one.size for one in choices)} parameters")
    pairs = _pairs(each, gram, widest, validation, folds)
    return OrderScan(tuple(_candidate(one, widest, gram, rows, pairs) for one in choices))


# ------------------------------------------------------------------------------------------------- one Gram matrix


Pairs = list[tuple[Array, Array, int]]


def _choices(
    nu: int, na: int | Iterable[int], nb: Counts | Iterable[Counts], delay: Counts | Iterable[Counts]
) -> Iterator[Structure]:
    first = [na] if isinstance(na, int | np.integer) else list(na)
    if nu == 0:
        yield from (structure(0, n, (), delay=()) for n in first if n)
        return
    second, third = ([one] if isinstance(one, int | np.integer) else list(one) for one in (nb, delay))
    yield from (structure(nu, n, b, delay=d) for n, b, d in product(first, second, third))


def _widest(choices: Sequence[Structure]) -> Structure:
    """The structure that holds the regressors of all."""
    lags = list(zip(*(one.lags for one in choices), strict=True))
    start = tuple(min(lag.start for lag in own) for own in lags)
    stop = tuple(max(lag.stop for lag in own) for own in lags)
    return Structure(
        max(one.na for one in choices), tuple(b - a for a, b in zip(start, stop, strict=True)),
        nf=(0,) * len(start), delay=start,
    )  # fmt: skip


def _pairs(
    each: Sequence[Data], gram: Array, widest: Structure, validation: Data | Sequence[Data] | None, folds: int
) -> Pairs:
    """Gram matrices to fit on and to predict, with the equations of the latter."""
    if validation is not None:
        other = experiments(validation)
        experiments([each[0], other[0]])
        return [(gram, *gram_of(other, widest))]
    if folds == 0:
        return []
    if folds < 2:
        raise ValueError("folds are at least 2")
    parts = [gram_of([_part(one, k, folds, widest.lost) for one in each], widest) for k in range(folds)]
    whole = np.sum([part for part, _ in parts], axis=0)
    return [(whole - part, part, rows) for part, rows in parts]


def _part(data: Data, k: int, folds: int, lost: int) -> Data:
    """Part k of an experiment; its first equations reach back into the part before, so none is lost."""
    return data[max(data.n * k // folds - (lost if k else 0), 0) : data.n * (k + 1) // folds]


def _candidate(own: Structure, widest: Structure, gram: Array, rows: int, pairs: Pairs) -> OrderCandidate:
    at = _columns(own, widest)
    total = _error(gram, at, _fit(gram, at))
    predicted = [_error(other, at, _fit(fitted, at)) for fitted, other, _ in pairs]
    checked = sum(predicted) / sum(n for _, _, n in pairs) if pairs else None
    return OrderCandidate(own.na, own.nb, own.delay, own.size, rows, total / rows, checked)


def _columns(own: Structure, widest: Structure) -> NDArray[np.intp]:
    """Columns of the widest regression that one structure uses, the target's 0 not among them."""
    found, start = list(range(1, own.na + 1)), 1 + widest.na
    for lag, span in zip(own.lags, widest.lags, strict=True):
        found += [start + k - span.start for k in lag]
        start += len(span)
    return np.array(found, dtype=np.intp)


def _fit(gram: Array, at: NDArray[np.intp]) -> Array:
    m, right = gram[np.ix_(at, at)], gram[at, 0]
    scale = np.sqrt(np.maximum(np.diag(m), 1e-300))
    return solved(m / np.outer(scale, scale), right / scale) / scale


def _error(gram: Array, at: NDArray[np.intp], x: Array) -> float:
    total = float(gram[0, 0] - 2.0 * x @ gram[at, 0] + x @ gram[np.ix_(at, at)] @ x)
    return max(total, EXACT * float(gram[0, 0]))
