"""Whether what a model leaves is what it believes: white, independent of past inputs, with no way back to the input.

Each test holds its level whatever the colour of the input, with missing samples too; a linear model of the noise is
all that is assumed.

Rules of this file: pure numbers; NaN is a sample that was not measured, and counts nowhere; lags never reach from one
experiment into another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal, stats

from hoopd.ident.data import Data, experiments
from hoopd.ident.normal import Z95
from hoopd.ident.prediction import Start, prediction_error
from hoopd.ident.spectral import correlation
from hoopd.ident.whitening import COLOUR, EACH, FEWEST, colour_of, whitened

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
    columns = _lagged(w, k)
    rows = np.isfinite(x) & np.isfinite(columns).all(axis=1)
    columns[~rows] = 0.0
    known = np.where(rows, x, 0.0)
    basis, samples = _span(columns), int(rows.sum())
    rest = np.where(rows, x - basis @ (basis.T @ known), np.nan)
    spare = samples - basis.shape[1] - COLOUR
    size = float(np.nansum(rest**2))
    r = _correlations(x, w, lags)[0][lags:]
    if basis.shape[1] == 0 or spare < FEWEST or size <= 0.0:
        return Test(name, k, r, Z95 / np.sqrt(max(samples, 1)), 1.0)
    colour, share = colour_of(rest)
    white = whitened(colour, np.where(rows[:, None], np.column_stack([x, basis]), np.nan))
    into = _span(white[:, 1:])
    told, degrees = float(np.sum((into.T @ white[:, 0]) ** 2)), into.shape[1]
    noise = (float(white[:, 0] @ white[:, 0]) - told) / max(len(white) - degrees - len(colour) + 1, 1)
    chance = float(stats.f.sf(told / degrees / max(noise, np.finfo(float).tiny), degrees, spare))
    # sd of sum_t u(t - k) e(t), as the errors' own colour makes it
    spread = signal.lfilter([1.0], colour, columns[::-1], axis=0)
    deviation = np.sqrt(share * size / (samples - basis.shape[1]) * np.sum(spread**2, axis=0).mean())
    band = Z95 * deviation / max(samples * np.std(x[rows]) * np.nanstd(w), np.finfo(float).tiny)
    return Test(name, k, r, float(band), chance)


def _before(x: Array, w: Array, lags: int, name: str) -> Test:
    k = np.arange(-lags, 0)
    order = min(MOST_LAGS, len(w) // EACH)
    past = _lagged(w, np.arange(order + 1))
    late = _lagged(np.nan_to_num(x), -k)
    rows = np.isfinite(past).all(axis=1) & np.isfinite(late).all(axis=1)
    past, late = past[rows], late[rows]
    own = _span(past[:, 1:])
    fresh = past[:, 0] - own @ (own.T @ past[:, 0])
    power, spare = float(fresh @ fresh), len(fresh) - own.shape[1] - lags
    if spare < FEWEST or power <= FORETOLD * float(past[:, 0] @ past[:, 0]):
        return Test(name, k, np.zeros(lags), Z95 / np.sqrt(max(len(fresh), 1)), 1.0)
    late = late - own @ (own.T @ late)
    basis = _span(late)
    told = float(np.sum((basis.T @ fresh) ** 2))
    degrees = max(basis.shape[1], 1)
    chance = float(stats.f.sf(told / degrees / max((power - told) / spare, np.finfo(float).tiny), degrees, spare))
    size = np.sqrt(power * np.maximum(np.sum(late**2, axis=0), np.finfo(float).tiny))
    return Test(name, k, late.T @ fresh / size, Z95 / np.sqrt(len(fresh)), chance)


def _lagged(w: Array, lags: NDArray[np.int64]) -> Array:
    """Columns w(t - k); NaN before the first sample."""
    out = np.full((len(w), len(lags)), np.nan)
    for i, k in enumerate(lags):
        out[k:, i] = w[: len(w) - k]
    return out


def _span(columns: Array) -> Array:
    """Orthonormal basis (n, rank) of the columns."""
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > SINGULAR * max(float(values[-1]), np.finfo(float).tiny)
    return np.asarray(columns @ (vectors[:, kept] / np.sqrt(values[kept])))


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
