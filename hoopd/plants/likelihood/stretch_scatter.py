"""Intervals of a fit that include how far its parameters scatter between stretches, and what was held and may be wrong.

The information of a likelihood is right where the model is. What a wrong model leaves over is small beside the noise in
any one reading and lasts for long, so that it hardly shows in innovations and still draws every stretch its own way.
Each stretch is left out in turn, to first order, and the parameters move by

    d_b = -(H - H_b)^-1 (g - g_b),        V = (B - 1)/B  sum_b d_b d_b'

H and H_b the information of all and of the stretch, g and g_b their slopes (the jackknife of clusters; Bell and
McCaffrey, Survey Methodology 28, 2002; its mean is the sandwich H^-1 (sum g_b g_b') H^-1). V of few stretches is itself
a guess: it counts where it is larger than V of a right model comes out once in twenty, and with Student's quantile.

What lasts longer than a stretch draws its neighbours the same way, and scatters less between them than it is wrong by.
Neighbours are joined, again and again, as long as there are enough; of all lengths the widest interval counts, and the
chance of one in twenty is shared among them.

What a plant holds and believes to a share only (a geometry) moves what is fitted beside it, by S = -H^-1 X'X_h for each
of its units. The recording says what it may be, h ~ N(m, P) about the held value, with the belief as prior, and

    V += S (P + m m') S'.

Rules of this file: a fit in, half widths out; the fit is not changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, stdtrit

from hoopd.ident.normal import Z95
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.level_directions import freed_of_levels
from hoopd.plants.likelihood.priors import inverse, prior
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# The shortest: one and a half swings of the hoop's ball, in its own times, longer than what a missing force remembers.
STRETCH_S = 2.0
# Stretches that are joined to the next longer one.
JOINED = 2
# Of fewer stretches that tell about a parameter nothing is said of its scatter.
FEWEST = 4.0
# Of what tells each parameter alone, what at least tells any direction: none is known by nothing.
LEAST_TOLD = 1e-12
# How often the scatter of a right model is taken for more.
CHANCE = 0.05
LEVEL = 0.95


def _of_held(found: HypothesisFit) -> Array:
    """(m,) standard deviation of what is fitted by what is held and believed to a share."""
    beliefs = {n: share for track in found.tracks for n, share in track.stretch.plant.beliefs.items()}
    names = [name for name in beliefs if name not in found.free and found.values.get(name)]
    if not names or not found.free:
        return np.zeros(len(found.free))
    parts = [
        track.whitened(track.columns(found.values, names), gain)[:, 1:]
        for track, gain in zip(found.tracks, found.gains, strict=True)
    ]
    rows, size = found.stacked(), np.array([abs(beliefs[name] * found.values[name]) for name in names])
    r, x, of_held = rows[:, 0], -rows[:, 1:], -np.concatenate(parts) * size
    if not np.isfinite(of_held).all():
        return np.zeros(len(found.free))
    moves = found.covariance @ (x.T @ of_held)  # of what is fitted by a standard deviation of each
    left = of_held - x @ moves
    spread = np.linalg.inv(left.T @ left + np.eye(len(names)))
    middle = spread @ (left.T @ r)
    second = spread + np.outer(middle, middle)
    return np.asarray(np.sqrt(np.einsum("ih,hk,ik->i", moves, second, moves)))


class StretchShare(NamedTuple):
    """A stretch's share of the normal equations."""

    information: Array  # (m, m)
    slope: Array  # (m,)


def half_widths(found: HypothesisFit) -> dict[str, float]:
    """Half of the 95 % interval of every free parameter.

    Parameters
    ----------
    found
        A fit with its whitened rows.

    Returns
    -------
    dict of str to float
        By name, in the parameter's unit: never below what the information alone says.
    """
    if not found.free:
        return {}
    weight, centre = prior(found.effects, found.tracks, found.free, found.values)
    pieces = [_pieces(track, rows) for track, rows in zip(found.tracks, found.rows, strict=True)]
    widths = widest(_deviations(found, weight), pieces, np.diag(weight), weight * centre)
    return dict(zip(found.free, np.hypot(widths, Z95 * _of_held(found)).tolist(), strict=True))


def _deviations(found: HypothesisFit, weight: Array) -> Array:
    """(m,) standard deviations by the information alone, as the fit has them but for what levels seem to tell."""
    information = freed_of_levels(found)
    if information is None:
        return np.asarray(np.sqrt(np.maximum(np.diag(found.covariance), 0.0)))
    rows, whole = found.stacked()[:, 1:], information + np.diag(weight)
    size = np.sqrt(np.maximum(np.sum(rows**2, axis=0) + weight, 1e-300))
    values, vectors = np.linalg.eigh(whole / np.outer(size, size))
    return np.asarray(np.sqrt(np.sum(vectors**2 / np.maximum(values, LEAST_TOLD), axis=1)) / size)


def widest(plain: Array, tracks: Sequence[Sequence[StretchShare]], ridge: Array, pull: Array) -> Array:
    """(m,) half widths by the length of stretches at which each parameter scatters most; pieces track by track."""
    lengths = _lengths(tracks)
    widths = Z95 * plain
    for pieces in lengths:
        scattered, freedom = scatter(pieces, ridge, pull)
        own = [_width(*each, CHANCE / len(lengths)) for each in zip(plain, scattered, freedom, strict=True)]
        widths = np.maximum(widths, own)
    return widths


def _lengths(tracks: Sequence[Sequence[StretchShare]]) -> list[list[StretchShare]]:
    """All pieces, the shortest first, then joined with their neighbours, as long as there are enough of them."""
    found = []
    while (count := sum(map(len, tracks))) >= FEWEST:
        found.append([piece for track in tracks for piece in track])
        tracks = [_joined(track) for track in tracks]
        if sum(map(len, tracks)) == count:
            break
    return found


def _joined(track: Sequence[StretchShare]) -> list[StretchShare]:
    """Neighbours as one."""
    groups = np.array_split(np.arange(len(track)), max(1, len(track) // JOINED))
    parts = ([track[i] for i in group] for group in groups)
    return [StretchShare(sum(one.information for one in part), sum(one.slope for one in part)) for part in parts]


def _width(plain: float, scattered: float, freedom: float, chance: float = CHANCE) -> float:
    """From the two standard deviations; `freedom`: of the second, `chance`: of being taken for more than the first."""
    if freedom < FEWEST - 1.0 or not np.isfinite(scattered):
        return Z95 * plain
    usual = plain * float(np.sqrt(2.0 * gammaincinv(freedom / 2.0, 1.0 - chance) / freedom))
    if scattered <= usual:
        return Z95 * plain
    return max(student(freedom) * scattered, Z95 * plain)


def student(freedom: float) -> float:
    """Half of a 95 % interval over the standard deviation, which is itself a guess of so many degrees of freedom."""
    return float(stdtrit(freedom, 0.5 + LEVEL / 2.0))


def _pieces(track: Track, rows: Array) -> list[StretchShare]:
    """Of one track; its whitened rows stand node by node."""
    t, channels = track.stretch.t, rows.shape[0] // len(track.stretch.t)
    length = STRETCH_S * motion_scale(track.stretch.plant)
    count = max(1, round(float(t[-1] - t[0]) / length))
    edges = np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[1:-1]) * channels
    return [StretchShare(x.T @ x, x.T @ r) for r, x in ((part[:, 0], -part[:, 1:]) for part in np.split(rows, edges))]


def scatter(pieces: Sequence[StretchShare], ridge: Array, pull: Array) -> tuple[Array, Array]:
    """Standard deviations (m,) by leaving out each piece, and how many pieces tell about each parameter, less one;
    `ridge` (m, m) and `pull` (m,): what a prior adds to the normal equations."""
    whole = sum((one.information for one in pieces), ridge)
    slope = sum((one.slope for one in pieces), pull)
    step, count = inverse(whole) @ slope, len(pieces)
    moves = np.array([inverse(whole - one.information) @ (slope - one.slope) - step for one in pieces])
    shares = np.array([np.diag(one.information) for one in pieces])
    total = np.maximum(shares.sum(axis=0), 1e-300)
    # so many equal pieces tell as much as these, of which some tell more than others
    telling = total**2 / np.maximum(np.sum(shares**2, axis=0), 1e-300)
    return np.sqrt((count - 1) / count * np.sum(moves**2, axis=0)), telling - 1.0


def interval(found: HypothesisFit, name: str) -> tuple[float, float] | None:
    """95 % of a parameter of a fit that has ended; None of one that was not fitted."""
    if name not in found.free:
        return None
    if not found.widths:
        found.widths.update(half_widths(found))
    return found.values[name] - found.widths[name], found.values[name] + found.widths[name]
