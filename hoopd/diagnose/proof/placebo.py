"""The same effect driven by a regressor that was destroyed: what it gains then is chance, or the proof is none.

The change that a named effect makes along the reference is cut into blocks of a second; blocks change places and signs.
What is left has the size and the colour of the effect and nothing of its cause. Fitted beside everything that was
named, it must gain no more than chance gives.

Rules of this file: seeded; the effect itself stays in the fit, so that its own evidence cannot leak into its placebo.
"""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.separation import own_columns, without_effect
from hoopd.diagnose.record import Placebo
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Screen, change_of
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import whitened
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

SHUFFLES = 8
# How often the best of all shuffles of what has no cause may gain more than what is called none.
CHANCE = 0.05
# Long against the motion's own memory of a step, short against a recording.
BLOCK_S = 1.0


def placebos(named: Named, seed: int = 0, threshold: float = THRESHOLD) -> dict[str, Placebo]:
    """Of every named effect; it holds when its best shuffle is no rarer than CHANCE, and below what names effects."""
    return {one.effect.name: _placebo(named, one.effect, seed, threshold) for one in named.accepted}


def _placebo(named: Named, effect: Effect, seed: int, threshold: float) -> Placebo:
    about = without_effect(named.final, effect, named.without[effect.name])
    changes = changes_along(about, effect, named.final.values)
    random = np.random.default_rng(seed)
    gains = [gain_of(named.final, shuffled(about, changes, random)) for _ in range(SHUFFLES)]
    most, limit = float(max(gains)), needed_gain(min(-log(CHANCE), threshold), 1, SHUFFLES)
    mean = float(np.mean(gains))
    return Placebo(log_likelihood_gain=mean, held=most < limit, shuffles=SHUFFLES, most=most, limit=limit)


Changes = list[tuple[Array, Array]]  # by track: of the one-step map (n-1, nz), of the innovations (n, nc)


def changes_along(about: HypothesisFit, effect: Effect, values: dict[str, float]) -> Changes:
    """Of the effect at its fitted values, beside a fit that does not have it."""
    columns = {column.recording: column for column in own_columns(about, effect, values)}
    return [change_of(track, about, effect, columns[track.stretch.recording]) for track in about.tracks]


def shuffled(about: HypothesisFit, changes: Changes, random: np.random.Generator) -> Changes:
    """Blocks of every track in another order and with other signs."""
    out = []
    for track, (f, eps) in zip(about.tracks, changes, strict=True):
        order, sign = _order(track, random)
        out.append((f[order[:-1] % len(f)] * sign[:-1, None], eps[order] * sign[:, None]))
    return out


def _order(track: Track, random: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
    """(n,) node that each node takes its change from, and the sign of it."""
    n, h = len(track.stretch.t), float(np.median(track.stretch.h))
    starts = np.arange(0, n, max(1, round(BLOCK_S * motion_scale(track.stretch.plant) / h)))
    blocks = np.split(np.arange(n), starts[1:])
    blocks = [blocks[k] for k in random.permutation(len(blocks))]
    signs = random.choice((-1.0, 1.0), len(blocks))
    return np.concatenate(blocks), np.repeat(signs, [len(block) for block in blocks])


def gain_of(fit: HypothesisFit, changes: Changes) -> float:
    """Nats that one multiple of these changes gains beside everything in a fit."""
    screen = Screen(fit, ())
    out = []
    for track, columns, gains, (f, eps) in zip(fit.tracks, fit.columns, fit.gains, changes, strict=True):
        wide = np.zeros((len(f), track.composite.nz))
        nx = min(f.shape[1], track.composite.nx)
        wide[:, :nx] = f[:, :nx]
        out.append(whitened(columns.model, gains, wide[:, :, None], eps[:, :, None]).reshape(-1, 1))
    v = screen.projected(-np.concatenate(out))[:, 0]
    size = float(v @ v)
    return float(v @ screen.residual) ** 2 / (2.0 * size) if size > 1e-12 else 0.0
