"""Whether what a model leaves is what it believes: white, independent of past inputs, with no way back to the input.

Each test holds its level whatever the colour of the input, with missing samples too; a linear model of the noise is
all that is assumed.

Rules of this file: pure numbers; NaN is a sample that was not measured, and counts nowhere; lags never reach from one
experiment into another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal, stats

from hoopd.ident.data import Data, experiments
from hoopd.ident.normal import Z95
from hoopd.ident.prediction import Start, prediction_error
from hoopd.ident.spectral import correlation
from hoopd.ident.whitening import COLOUR, EACH, FEWEST, all_known, colour_of, parts_of, whitened_parts

Array = NDArray[np.float64]

# A test fails below this chance.
SIGNIFICANCE = 0.01
# Lags that are tested, both ways.
MOST_LAGS = 25
# A loop that is closed acts within a few samples; more lags would hide it among chance.
LOOP_LAGS = 10
# Directions of a lagged input below this share of the largest are rounding: a sine has two.
SINGULAR = 1e-7
# A signal that its own past tells to this share of its power (a sine) answers nobody.
FORETOLD = 1e-6


@dataclass(frozen=True)
class Test:
    """Correlations of one pair of signals at their lags, the 95 % band of each, and the chance of all together."""

    name: str
    lags: NDArray[np.int64]
    values: Array
    band: float
    chance: float

    @property
    def passed(self) -> bool:
        """Whether chance gives as much often enough."""
        return self.chance >= SIGNIFICANCE


def whiteness(e: ArrayLike, lags: int = MOST_LAGS, fitted: int = 0, name: str = "e") -> Test:
    """Test whether errors are white: (1 + 2/n) sum m_k r_k^2 over the lags is chi-square.

    r_k is the mean of the m_k products at lag k whose two errors are known. Complete, m_k = n - k, that is the
    statistic of Ljung and Box; with gaps, of Parzen's estimate, whose r_k have the variances 1/m_k.

    Parameters
    ----------
    e : array_like, shape (n,)
        Errors; NaN is a missing one.
    lags : int
        How many are tested, a quarter of the errors at most.
    fitted : int
        Parameters that were estimated on these very data; they take as many degrees of freedom.
    name : str
        What the test is called.

    Returns
    -------
    Test
        `values` at `lags`, the 95 % `band` of each, and the `chance` of all together.

    Raises
    ------
    ValueError
        Fewer than 10 errors.

    Notes
    -----
    Sources: Ljung and Box (1978); Parzen, Sankhya A 25, 1963.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import whiteness
    >>> e = np.random.default_rng(0).standard_normal(500)
    >>> whiteness(e).passed, whiteness(e[1:] + 0.5 * e[:-1]).passed
    (True, False)
    """
    x = _series(e, name)
    n = int(np.isfinite(x).sum())
    r, pairs = _correlations(x, x, min(lags, n // 4))
    reach = len(r) // 2
    k, r, pairs = np.arange(1, reach + 1), r[reach + 1 :], pairs[reach + 1 :]
    used = pairs >= FEWEST
    statistic = (1.0 + 2.0 / n) * float(pairs[used] @ r[used] ** 2)
    chance = float(stats.chi2.sf(statistic, max(int(used.sum()) - fitted, 1)))
    return Test(f"{name}, {name}", k, r, Z95 / np.sqrt(max(float(np.median(pairs)), 1.0)), chance)


def independence(e: ArrayLike, u: ArrayLike, lags: int = MOST_LAGS, *, after: bool = True, name: str = "e, u") -> Test:
    """Test whether errors follow the past input, or the input follows past errors, which tells of a closed loop.

    After the input: an F-test of the input at lags 0 ... lags in a regression of the errors by generalised least
    squares. As it asks for the span of the lagged input, its power does not depend on the input's colour. The errors'
    own colour is an autoregression of what that regression leaves.
    Before it: whether errors 1 ... lags samples ago foretell the input beyond what its own past does, so errors that
    hold earlier inputs are no loop.

    Parameters
    ----------
    e : array_like, shape (n,)
        Errors; NaN is a missing one.
    u : array_like, shape (n,)
        The input; the samples between experiments are NaN.
    lags : int
        How many are tested, a quarter of the errors at most.
    after : bool
        Whether errors after the input are asked for, or errors before it.
    name : str
        What the test is called.

    Returns
    -------
    Test
        `values` at `lags`, the 95 % `band` of each, and the `chance` of all together.

    Raises
    ------
    ValueError
        Fewer than 10 errors.

    Notes
    -----
    Sources: Cochrane and Orcutt, JASA 44, 1949, and Ljung, System Identification, 1999, 16.6; Granger, Econometrica 37,
    1969.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import independence
    >>> rng = np.random.default_rng(0)
    >>> u, e = rng.standard_normal((2, 500))
    >>> independence(e, u).passed, independence(e + 0.3 * np.roll(u, 2), u).passed
    (True, False)
    """
    x, w = _series(e, name), np.asarray(u, dtype=float).reshape(-1)
    w = w - np.nanmean(w)
    lags = max(min(lags, int(np.isfinite(x).sum()) // 4), 1)
    return _after(x - np.nanmean(x), w, lags, name) if after else _before(x - np.nanmean(x), w, lags, name)


def _series(e: ArrayLike, name: str) -> Array:
    x = np.asarray(e, dtype=float).reshape(-1)
    known = int(np.isfinite(x).sum())
    if known < FEWEST:
        raise ValueError(f"{name}: {known} errors are known, {FEWEST} at least are wanted to test them")
    return x


def _correlations(x: Array, y: Array, lags: int) -> tuple[Array, NDArray[np.int_]]:
    """r_xy(k) = mean x(t + k) y(t) over the known pairs, and how many those are; zero where a signal is constant."""
    lag = np.arange(-lags, lags + 1)
    try:
        found = correlation(x, y, lags)
    except ValueError:
        return np.zeros(len(lag)), np.zeros(len(lag), dtype=int)
    return found.values[:, 0, 0] / (1.0 - np.abs(lag) / len(x)), found.pairs[:, 0, 0]


def _after(x: Array, w: Array, lags: int, name: str) -> Test:
    k = np.arange(lags + 1)
    rows, r = np.isfinite(x) & all_known(w, lags), _correlations(x, w, lags)[0][lags:]
    samples, known, complete = int(rows.sum()), np.where(rows, x, 0.0), np.nan_to_num(w)

    def lagged(begin: int, end: int) -> Array:
        return np.where(rows[begin:end, None], _lagged(complete, k, begin, end), 0.0)

    gram = _gram(len(x), lambda begin, end: np.column_stack([known[begin:end], lagged(begin, end)]))
    span = _span(gram[1:, 1:])
    by_input = span @ (span.T @ gram[1:, 0])
    rest = np.concatenate([known[begin:end] - lagged(begin, end) @ by_input for begin, end in parts_of(len(x))])
    rest[~rows] = np.nan
    spare = samples - span.shape[1] - COLOUR
    size = float(np.nansum(rest**2))
    if span.shape[1] == 0 or spare < FEWEST or size <= 0.0:
        return Test(name, k, r, Z95 / np.sqrt(max(samples, 1)), 1.0)
    colour, share = colour_of(rest)
    del rest
    gram, white = _whitened_gram(colour, rows, lambda b, e: np.column_stack([known[b:e], lagged(b, e) @ span]))
    into = _span(gram[1:, 1:])
    told, degrees = float(np.sum((into.T @ gram[1:, 0]) ** 2)), into.shape[1]
    noise = (float(gram[0, 0]) - told) / max(white - degrees - len(colour) + 1, 1)
    chance = float(stats.f.sf(told / degrees / max(noise, np.finfo(float).tiny), degrees, spare))
    # sd of sum_t u(t - k) e(t), as the errors' own colour makes it
    spread = np.mean([_power_behind(colour, rows, complete, lag) for lag in range(lags + 1)])
    deviation = np.sqrt(share * size / (samples - span.shape[1]) * spread)
    band = Z95 * deviation / max(samples * np.std(x[rows]) * np.nanstd(w), np.finfo(float).tiny)
    return Test(name, k, r, float(band), chance)


def _power_behind(colour: Array, rows: NDArray[np.bool_], w: Array, lag: int) -> float:
    """Sum of squares of w(t - lag) at some rows, behind the errors' own colour taken backwards."""
    column = np.where(rows, _lagged(w, np.array([lag]))[:, 0], 0.0)
    spread = signal.lfilter([1.0], colour, column[::-1])
    return float(spread @ spread)


def _before(x: Array, w: Array, lags: int, name: str) -> Test:
    k = np.arange(-lags, 0)
    order = min(MOST_LAGS, len(w) // EACH)
    rows = all_known(w, order)
    rows[:lags] = False
    errors, complete, samples = np.nan_to_num(x), np.nan_to_num(w), int(rows.sum())

    def signals(begin: int, end: int) -> Array:
        """The input's past, the input now, the errors before it."""
        past = _lagged(complete, np.arange(order, -1, -1), begin, end)
        return np.column_stack([past, _lagged(errors, -k, begin, end)])[rows[begin:end]]

    gram = _gram(len(w), signals)
    own = _span(gram[:order, :order])
    by_past = own @ (own.T @ gram[:order, order:])

    def fresh(begin: int, end: int) -> Array:
        both = signals(begin, end)
        return both[:, order:] - both[:, :order] @ by_past

    left = _gram(len(w), fresh)
    power, spare = float(left[0, 0]), samples - own.shape[1] - lags
    if spare < FEWEST or power <= FORETOLD * float(gram[order, order]):
        return Test(name, k, np.zeros(lags), Z95 / np.sqrt(max(samples, 1)), 1.0)
    basis = _span(left[1:, 1:])
    told = float(np.sum((basis.T @ left[1:, 0]) ** 2))
    degrees = max(basis.shape[1], 1)
    chance = float(stats.f.sf(told / degrees / max((power - told) / spare, np.finfo(float).tiny), degrees, spare))
    size = np.sqrt(power * np.maximum(np.diag(left)[1:], np.finfo(float).tiny))
    return Test(name, k, left[1:, 0] / size, Z95 / np.sqrt(samples), chance)


def _lagged(w: Array, lags: NDArray[np.int64], begin: int = 0, end: int | None = None) -> Array:
    """Columns w(t - k) of the rows from `begin` to `end`; zero before the first sample."""
    end = len(w) if end is None else end
    out = np.zeros((end - begin, len(lags)))
    for i, k in enumerate(lags):
        first = min(max(begin, k), end)
        out[first - begin :, i] = w[first - k : end - k] if first < end else 0.0
    return out


def _gram(n: int, columns_of: Callable[[int, int], Array]) -> Array:
    """X'X of n rows, which are made part after part."""
    total = np.zeros(())
    for part in parts_of(n):
        columns = columns_of(*part)
        total = total + columns.T @ columns
    return total


def _whitened_gram(a: Array, known: NDArray[np.bool_], columns_of: Callable[[int, int], Array]) -> tuple[Array, int]:
    """The same of the known rows made white, and how many rows that are."""
    parts = [(white.T @ white, len(white)) for white in whitened_parts(a, known, columns_of)]
    return np.sum([one for one, _ in parts], axis=0), sum(count for _, count in parts)


def _span(gram: Array) -> Array:
    """Vectors (m, rank) by which columns X of this X'X become an orthonormal basis of their span."""
    values, vectors = np.linalg.eigh(gram)
    kept = values > SINGULAR * max(float(values[-1]), np.finfo(float).tiny)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


@dataclass(frozen=True)
class ResidualReport:
    """Tests of one model's one-step errors: white, independent of past inputs, no feedback from them to the input."""

    errors: Array  # (n, ny), experiments under each other
    white: tuple[Test, ...]  # by output
    independent: tuple[Test, ...]  # output by output, input by input
    feedback: tuple[Test, ...]

    @property
    def warnings(self) -> list[str]:
        """What failed, in words."""
        said = [
            f"{one.name}: the residual is not white: the noise model is too simple"
            for one in self.white
            if not one.passed
        ]
        said += [
            f"{one.name}: the residual follows the input: order or delay do not fit"
            for one in self.independent
            if not one.passed
        ]
        return said + [
            f"{one.name}: the input follows past residuals: the data were taken in closed loop" for one in self.feedback
            if not one.passed
        ]  # fmt: skip


def residuals(model: Any, data: Data | Sequence[Data], lags: int = MOST_LAGS, x0: Start = "estimate") -> ResidualReport:
    """Test the one-step errors of a model: white, independent of past inputs, no way from them back to the input.

    Parameters
    ----------
    model : any model
        A result of this package, or a python-control system or FRD; a continuous one is sampled with held inputs.
    data : Data or sequence of Data
        One or several experiments, tested together.
    lags : int
        How many are tested.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state.

    Returns
    -------
    ResidualReport
        The `errors` (n, ny) and the tests `white`, `independent` and `feedback`; its `warnings` say in words what
        failed.

    Raises
    ------
    ValueError
        An output that is missing altogether, and a prediction that diverges.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, iddata, residuals, simulate
    >>> good, bad = (Polynomials(0.1, np.array([1.0, -a]), (np.array([0.0, 1.0]),), variance=0.1) for a in (0.8, 0.7))
    >>> u = np.random.default_rng(0).standard_normal(400)
    >>> data = iddata(simulate(good, iddata(u, u, 0.1), "zero", seed=2), u, 0.1)
    >>> residuals(good, data).white[0].passed, residuals(bad, data).independent[0].passed
    (True, False)
    """
    each = experiments(data)
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [prediction_error(model, one, 1, x0) for one in each]
    if any(not np.isfinite(e[np.isfinite(one.y)]).all() for e, one in zip(errors, each, strict=True)):
        raise ValueError("the prediction one sample ahead diverges: the predictor of the model is unstable")
    e, u = (_apart(parts, max(lags, MOST_LAGS)) for parts in (errors, [one.u for one in each]))
    outputs, inputs = each[0].outputs, each[0].inputs
    pairs = [(i, j) for i in range(len(outputs)) for j in range(len(inputs))]
    return ResidualReport(
        np.concatenate(errors),
        tuple(whiteness(e[:, i], lags, name=f"e({name})") for i, name in enumerate(outputs)),
        tuple(independence(e[:, i], u[:, j], lags, name=f"{inputs[j]} -> e({outputs[i]})") for i, j in pairs),
        tuple(
            independence(e[:, i], u[:, j], min(lags, LOOP_LAGS), after=False, name=f"e({outputs[i]}) -> {inputs[j]}")
            for i, j in pairs
        ),
    )


def _apart(parts: Sequence[Array], rows: int) -> Array:
    """Parts under each other with so many rows of NaN between them: no lag of fewer reaches across."""
    gap = np.full((rows, parts[0].shape[1]), np.nan)
    spaced = [block for one in parts for block in (gap, one)]
    return np.concatenate(spaced[1:])
