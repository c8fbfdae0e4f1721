"""The delay of an input, with an interval: how well a low-order model fits for each delay.

A long ARX model whitens the noise; then, for every delay d, the output-error model with n coefficients from q^-d on
and n poles is fitted, all on the same samples. N ln(S_d / S_min) is a likelihood ratio of one integer parameter
(Ljung, System Identification, 1999, 7.4; Bjorklund & Ljung, 42nd CDC, 2003, on the methods): the interval holds the
delays that it does not refuse.

Rules of this file: one output; the delay is the power of q^-1 of the first coefficient of B, so a sampled system
without direct term and without dead time has 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from hoopd.ident.checks import Orders, check, check_channels
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.doubts import warn
from hoopd.ident.loopchecks import check_record
from hoopd.ident.polynomial.gaussnewton import PolynomialExperiment, errors, search
from hoopd.ident.polynomial.regression import solve_arx
from hoopd.ident.polynomial.starts import LongModel, starts
from hoopd.ident.polynomial.structure import Structure, structure

Array = NDArray[np.float64]

# Lags of the noise model, and of the response after the longest delay.
LONG = 20
# Orders among which BIC chooses, and the longest delay looked at, where they are not given.
ORDERS = (1, 2, 3, 4)
LONGEST = 50
# A long model that is better beyond this level of chance has seen more than the low-order one.
UNEXPLAINED = 1.0 - 1e-5
# Samples for each parameter of the long model.
SHARE = 4
# Of the output's squares: a sum of squared errors below this share is rounding, whose size says nothing of a delay.
RESOLVED = 1e-20


@dataclass(frozen=True)
class Delay:
    """Delay in samples, `interval` (first, last) of the delays that the data allow at `level`, and the profile.

    `ratio` (candidates,): N ln(S_d / S_min) of the delays `candidates`; `order` the n of the models; `total` S_min.
    """

    samples: int
    interval: tuple[int, int]
    level: float
    dt: float
    order: int
    candidates: NDArray[np.intp]
    ratio: Array
    total: float

    @property
    def seconds(self) -> float:
        """The delay times the step: the dead time of a system sampled without direct term is one step less."""
        return self.samples * self.dt

    def __str__(self) -> str:
        count = f"{self.samples} sample{'' if self.samples == 1 else 's'}"
        first, last = self.interval
        return f"{count} ({self.seconds:g} s), {self.level:.0%}: {first} to {last}; models of order {self.order}"

    __repr__ = __str__


def delay(
    data: Data | Sequence[Data], *, channel: int | str = 0, longest: int | None = None, order: int | None = None,
    level: float = 0.95,
) -> Delay:  # fmt: skip
    """Estimate the delay of one input, with an interval.

    A long ARX model whitens the noise; then, for every delay d, the output-error model with n coefficients from q^-d on
    and n poles is fitted, all on the same samples. N ln(S_d / S_min) is a likelihood ratio of one integer parameter:
    the interval holds the delays that it does not refuse.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments of one output; missing outputs cut them.
    channel : int or str
        The input; what a long model says of the others is taken off first.
    longest : int, optional
        Samples that are looked at; 50, an eighth of few data.
    order : int, optional
        n of the models; 1 to 4 by BIC unless given.
    level : float
        Probability of the interval.

    Returns
    -------
    Delay
        The delay in `samples` (the power of q^-1 of the first coefficient of B) and `seconds`, its `interval` (first,
        last) and the profile.

    Raises
    ------
    ValueError
        No stretch is long enough, several outputs, options that are none.

    Notes
    -----
    Sources: Ljung, System Identification, 1999, 7.4; Bjorklund & Ljung, 42nd CDC, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import delay, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0] * 7 + [1.0], [1.0, -0.8], u) + 0.2 * e
    >>> found = delay(iddata(y, u, 0.01), longest=15)
    >>> found.samples, found.interval, round(found.seconds, 2)
    (7, (7, 7), 0.07)
    """
    each = experiments(data)
    if each[0].ny != 1:
        raise ValueError(f"one output wanted, there are {each[0].ny}: take one with data.channels")
    if not 0.0 < level < 1.0:
        raise ValueError(f"level is between 0 and 1, not {level}")
    if (order is not None and order < 1) or (longest is not None and longest < 0):
        raise ValueError(f"order is from 1 on and longest not negative, not {order} and {longest}")
    check_channels(each)
    chosen = each[0].channels([0], [channel]).inputs[0]
    span = min(LONGEST, max(one.n for one in each) // 8) if longest is None else longest
    pieces = [part for one in each for part in runs(one) if part.n > 2 * (span + LONG)]
    wide = Structure(LONG, (span + LONG,) * each[0].nu, nf=(0,) * each[0].nu, delay=(0,) * each[0].nu)
    if sum(part.n - wide.lost for part in pieces) < SHARE * wide.size:
        raise ValueError(
            f"too few samples: delays up to {span} want {SHARE * wide.size + wide.lost} in stretches without a missing "
            "output; give a smaller `longest`"
        )  # fmt: skip
    check(each, orders=Orders(wide.size, min(span, LONG), wide.lost))
    check_record(each)
    white = _whitened(pieces, wide, each[0].inputs.index(chosen))
    found = _profile(white, span, order, level, each[0].dt)
    if found.interval[1] == span or not _explained(white, found, span, wide.size):
        warn(f"the delay may be longer than the {span} samples looked at (`longest`), or the order above {found.order}")
    return found


@dataclass(frozen=True)
class _White:
    """A stretch filtered by the noise model: output without the other inputs' part, input, noise-free output."""

    y: Array
    u: Array
    s: Array


def _whitened(pieces: Sequence[Data], wide: Structure, channel: int) -> list[_White]:
    x = solve_arx(pieces, wide)[0]
    parts = list(wide.split(x))
    a, b = parts[0], parts[1 : 1 + wide.nu]
    out = []
    for one in pieces:
        said = [np.convolve(one.u[:, i], b[i])[: one.n] for i in range(wide.nu)]
        y, u = (np.convolve(signal, a)[: one.n] for signal in (one.y[:, 0], one.u[:, channel]))
        others = np.sum([part for i, part in enumerate(said) if i != channel], axis=0) if wide.nu > 1 else 0.0
        out.append(_White(y - others, u, said[channel]))
    return out


def _profile(white: Sequence[_White], span: int, order: int | None, level: float, dt: float) -> Delay:
    candidates = np.arange(span + 1)
    n = _order(white, span) if order is None else order
    own = structure(1, 0, n, 0, 0, n, 0)
    totals = np.array([_least(own, white, span, int(d)) for d in candidates])
    count = sum(len(one.y) - span - LONG for one in white)
    ratio = count * np.log(totals / totals.min())
    allowed = candidates[ratio <= threshold(level, n)]
    # where several leave nothing, those before the last begin with coefficients of 0
    best = int(candidates[ratio == ratio.min()][-1])
    return Delay(best, (int(allowed[0]), int(allowed[-1])), level, dt, n, candidates, ratio, float(totals.min()))


def _explained(white: Sequence[_White], found: Delay, span: int, size: int) -> bool:
    """Whether the low-order model leaves as little as the long one, which holds any delay and order."""
    first = span + LONG
    long = _resolved(sum(float(np.square(one.y[first:] - one.s[first:]).sum()) for one in white), white, span)
    count = sum(len(one.y) - first for one in white)
    return long <= 0.0 or count * np.log(found.total / long) <= quantile(UNEXPLAINED, size - 2 * found.order)


def threshold(level: float, order: int) -> float:
    """Quantile of chi-square with `order` degrees of freedom.

    The model of another delay that also holds the system differs from it by so many coefficients of B at most.
    """
    return quantile(level, order)


def quantile(level: float, degrees: int) -> float:
    """Of chi-square."""
    return 2.0 * float(gammaincinv(0.5 * degrees, level))


def _order(white: Sequence[_White], span: int) -> int:
    """The order that BIC takes, each at the delay that is best by its linear starts."""
    count = sum(len(one.y) - span - LONG for one in white)
    values = {}
    for n in ORDERS:
        best = _best_start(structure(1, 0, n, 0, 0, n, 0), white, span)
        values[n] = count * np.log(_least(structure(1, 0, n, 0, 0, n, 0), white, span, best)) + 2 * n * np.log(count)
    return min(values, key=lambda n: values[n])


def _best_start(own: Structure, white: Sequence[_White], span: int) -> int:
    return min(range(span + 1), key=lambda d: _begun(own, *_shifted(white, span, d))[1])


def _least(own: Structure, white: Sequence[_White], span: int, d: int) -> float:
    stretches, whole = _shifted(white, span, d)
    return _resolved(search(own, stretches, _begun(own, stretches, whole)[0], free_start=True).total, white, span)


def _resolved(total: float, white: Sequence[_White], span: int) -> float:
    """A sum of squared errors, not below what rounding leaves of the output's."""
    return max(total, RESOLVED * sum(float(np.square(one.y[span + LONG :]).sum()) for one in white))


def _begun(own: Structure, stretches: list[PolynomialExperiment], whole: LongModel) -> tuple[Array, float]:
    """Coefficients of the linear start and the squared errors that they leave."""
    x = starts(own, stretches, whole)[0]
    return x, sum(float(np.square(errors(own, x, np.zeros(0), one).e[LONG:]).sum()) for one in stretches)


def _shifted(white: Sequence[_White], span: int, d: int) -> tuple[list[PolynomialExperiment], LongModel]:
    """The same samples of y for every d, the input d samples earlier."""
    first = span + LONG
    stretches = [PolynomialExperiment(one.y[first:], one.u[None, first - d : len(one.u) - d]) for one in white]
    clean = [[one.s[first:]] for one in white]
    return stretches, LongModel([np.zeros(len(one.y)) for one in stretches], clean, 0.0)
