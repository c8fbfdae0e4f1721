"""Are there two populations of errors, or one with heavy tails? A mixture against its own core, by likelihood.

    H0: f(r) = t_nu(r / c) / c
    H1: f(r) = (1 - o) t_nu(r / c) / c + o h(r)
        h(r) = exp(-(|r| - g c)^2 / 2 s^2) / (s sqrt(2 pi)) for |r| > g c, else 0

r are errors over what is expected of them. A camera whose noise has heavy tails is H0 with a small nu; false
detections are far from everything else: beyond a gap of g c, with a spread s of their own. Both by EM on grids of nu
and g.
Rules of this file: numbers in, numbers out; core and false values have free parameters under both hypotheses.
"""

from __future__ import annotations

from math import log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

Array = NDArray[np.float64]

# Degrees of freedom of the core: from Cauchy's law, below which a noise has no width, to the normal one.
FREEDOMS = (1.0, 1.5, 2.2, 3.0, 4.5, 8.0, 20.0, 1e6)
# Where the second population begins, over the core's c: nearer ones are noise by any measure.
GAPS = (4.0, 5.0, 7.0, 12.0, 30.0)
# What is estimated beside the core: share and spread; gaps overlap, so that they count as one choice each at most.
COLUMNS, LOOKED_AT = 2, len(GAPS)
STEPS = 40
# Fewer errors have no tails, and fewer far ones are no population.
FEWEST, FEWEST_FAR = 75, 3
FIRST_SHARE = 0.05
STEP = 1e-3  # of a logarithm, for derivatives
MIDDLE = 1.4826  # sigma of normal errors over the median of their sizes


class Population(NamedTuple):
    """The second population of errors."""

    share: float
    error: float  # standard error of the share
    gain: float  # nats, H1 over H0


NOBODY = Population(0.0, 0.0, 0.0)


class _Law(NamedTuple):
    """Parameters by row of a grid: (m, 1)."""

    nu: Array
    c: Array
    share: Array
    gap: Array  # over c
    spread: Array


def second_population(errors: Array, weights: Array) -> Population:
    """Share of errors (n,) that are far from the others; weights (n,): 0 to 1, how surely one counts."""
    used = np.isfinite(errors) & (weights > 0.0)
    if used.sum() < FEWEST:
        return NOBODY
    r, w = np.abs(errors[used]), weights[used]
    if np.sum(r > GAPS[0] * MIDDLE * np.median(r)) < FEWEST_FAR:
        return NOBODY
    alone = _fitted(r, w, _start(r, w, (np.inf,), 0.0))
    mixed = _fitted(r, w, _start(r, w, GAPS, FIRST_SHARE))
    best, gain = _best(r, w, mixed), _likelihoods(r, w, mixed).max() - _likelihoods(r, w, alone).max()
    if gain <= 0.0:
        return NOBODY
    return Population(float(best.share[0, 0]), _error(r, w, best), float(gain))


def _start(r: Array, w: Array, gaps: tuple[float, ...], share: float) -> _Law:
    """Every nu with every gap."""
    nu, gap = (one.reshape(-1, 1) for one in np.meshgrid(FREEDOMS, gaps, indexing="ij"))
    middle = MIDDLE * float(np.median(r))
    far = np.maximum(3.0 * middle, _rms(r, w)) + 0.0 * nu
    return _Law(nu, middle + 0.0 * nu, share + 0.0 * nu, gap, far)


def _rms(r: Array, w: Array) -> float:
    return sqrt(float(w @ r**2) / float(w.sum()))


def _fitted(r: Array, w: Array, law: _Law) -> _Law:
    """EM; the t law as a normal one of random width (Lange, Little and Taylor 1989)."""
    for _ in range(STEPS):
        far = _far_share(r, law) * w
        near = w - far
        # c^2 = sum w u r^2 / sum w,  u = (nu + 1) / (nu + r^2 / c^2)
        u = (law.nu + 1.0) / (law.nu + (r / law.c) ** 2)
        c = np.sqrt((near * u) @ r**2 / np.maximum(near.sum(axis=1), 1e-12))[:, None]
        count = far.sum(axis=1)[:, None]
        with np.errstate(invalid="ignore"):
            apart = np.where(far > 0.0, (r - law.gap * law.c) ** 2, 0.0)
        spread = np.sqrt((far * apart).sum(axis=1)[:, None] / np.maximum(count, 1e-12))
        # false values spread at least as good ones do
        law = law._replace(c=c, share=count / w.sum(), spread=np.maximum(spread, c))
    return law


def _far_share(r: Array, law: _Law) -> Array:
    """Probability (m, n) that an error is of the second population."""
    far = law.share * _second(r, law)
    return np.asarray(far / np.maximum(far + (1.0 - law.share) * _core(r, law), 1e-300))


def _core(r: Array, law: _Law) -> Array:
    half = law.nu / 2.0
    constant = gammaln(half + 0.5) - gammaln(half) - 0.5 * np.log(law.nu * pi) - np.log(law.c)
    return np.asarray(np.exp(constant - (half + 0.5) * np.log1p((r / law.c) ** 2 / law.nu)))


def _second(r: Array, law: _Law) -> Array:
    begin = law.gap * law.c
    with np.errstate(over="ignore"):
        density = np.exp(-(((r - begin) / law.spread) ** 2) / 2.0) / (sqrt(2.0 * pi) * law.spread)
    return np.where(r > begin, density, 0.0)


def _each(r: Array, law: _Law) -> Array:
    """Log-density of each error (m, n)."""
    mixed = (1.0 - law.share) * _core(r, law) + law.share * _second(r, law)
    return np.asarray(np.log(np.maximum(mixed, 1e-300)))


def _likelihoods(r: Array, w: Array, law: _Law) -> Array:
    return np.asarray(_each(r, law) @ w)


def _best(r: Array, w: Array, law: _Law) -> _Law:
    place = int(_likelihoods(r, w, law).argmax())
    return _Law(*(part[place : place + 1] for part in law))


def _error(r: Array, w: Array, law: _Law) -> float:
    """Standard error of the share, beside nu, c and s: of log o, times o (outer products of the scores)."""
    names = ("share", "c", "spread") + (("nu",) if law.nu[0, 0] < FREEDOMS[-1] else ())
    here = _each(r, law)[0]
    scores = np.array(
        [_each(r, law._replace(**{name: getattr(law, name) * (1.0 + STEP)}))[0] - here for name in names]
    ) / log(1.0 + STEP)
    covariance = np.linalg.pinv((scores * w) @ scores.T)
    return float(law.share[0, 0] * sqrt(max(float(covariance[0, 0]), 0.0)))
