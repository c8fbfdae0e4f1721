"""How a fit's log-likelihood answers to a force at every step: one pass back through the filter, for any force at once.

The derivative of the log-likelihood by an addition to the one-step map is the filter's adjoint (Bryson and Frazier's
smoother; `kalman_filter.adjoint`). With it the score of any force is one inner product. The same pass over rows of
white noise shows what the model itself expects of such scores, and so how large the best of many becomes by chance.

Rules of this file: numbers in, numbers out; what is made of the answers stands in `tones` and `pushes`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.screen import Screen
from hoopd.diagnose.search.surprise import log_chance
from hoopd.plants.effects.base import Effect, Values
from hoopd.plants.likelihood.kalman_filter import adjoint
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]

# Draws of white rows: the median of their maxima is known to 0.3 nats, a level of a smoothed score to a few percent.
DRAWS = 32
DRAW_SEED = 1


@dataclass(frozen=True)
class AdjointAnswer:
    """Of one recording to a force of unit size, or to an effect's: columns the data first, then DRAWS of white rows."""

    recording: str
    t: Array  # (n,) s, start of each step
    h: Array  # (n,) s
    slope: Array  # (n, 1+DRAWS) nats per multiple of the force over that step

    @property
    def length_s(self) -> float:
        """From the first step to the end of the last."""
        return float(self.t[-1] + self.h[-1] - self.t[0])


class Adjoint:
    """Derivatives by a force on every coordinate over every step, by track."""

    def __init__(self, screen: Screen, residual: Array | None = None) -> None:
        """`residual`: rows in place of the screen's own."""
        self.screen, fit = screen, screen.fit
        rows = np.column_stack([screen.residual if residual is None else residual, _white(screen)])
        ends = np.cumsum([len(one) for one in fit.rows])[:-1]
        self.by_force: list[Array] = []  # (n-1, nq, 1+DRAWS)
        for columns, gains, part in zip(fit.columns, fit.gains, np.split(rows, ends), strict=True):
            n, nc, nz = columns.model.c.shape
            # what is added to the model is taken from the residual
            fall = adjoint(columns.model, gains, part.reshape(n, nc, -1))[1:, :nz]
            self.by_force.append(np.einsum("nzq,nzm->nqm", columns.model.w, fall))

    def to_effect(self, effect: Effect, values: Mapping[str, float]) -> list[AdjointAnswer]:
        """By recording, to an effect's force at these values of its own parameters; none where its slot is not."""
        parts: dict[str, list[tuple[Track, Array]]] = {}
        for track, slopes in zip(self.screen.fit.tracks, self.by_force, strict=True):
            if effect.slot in track.stretch.plant.slots:
                force = force_along(track, self.screen.fit.values, effect, values)
                parts.setdefault(track.stretch.recording, []).append((track, np.einsum("nq,nqm->nm", force, slopes)))
        return [_joined(recording, pieces) for recording, pieces in parts.items()]


def force_along(track: Track, fitted: Mapping[str, float], effect: Effect, values: Mapping[str, float]) -> Array:
    """(n-1, nq) an effect's generalised forces in the middle of every step of a reference."""
    assert effect.force is not None
    plant, n = track.composite.plant, len(track.z) - 1
    inputs = track.stretch.inputs
    z, u, t = ca.SX.sym("z", track.composite.nz), ca.SX.sym("u", inputs.shape[1]), ca.SX.sym("t")
    force = effect.force(plant.point(z, track.local(fitted), u, t), Values(**{**effect.neutral(), **values}))
    # disturbances act on what the plant as declared has
    expression = ca.vertcat(*(ca.SX(force.get(q, 0.0)) for q in track.stretch.plant.disturbed))
    middle, stretch = (track.z[1:] + track.z[:-1]) / 2, track.stretch
    function = ca.Function("force", [z, u, t], [ca.densify(expression)])
    found = function.map(n)(middle.T, inputs.T, (stretch.t[:-1] + stretch.h / 2)[None])
    return np.asarray(found.full()).T


def _white(screen: Screen) -> Array:
    """(rows, DRAWS) white rows without the directions of the free parameters."""
    draws = np.random.default_rng(DRAW_SEED).standard_normal((len(screen.residual), DRAWS))
    return screen.projected(draws)


def _joined(recording: str, pieces: Sequence[tuple[Track, Array]]) -> AdjointAnswer:
    t = np.concatenate([track.stretch.t[:-1] for track, _ in pieces])
    h = np.concatenate([track.stretch.h for track, _ in pieces])
    return AdjointAnswer(recording, t, h, np.concatenate([slope for _, slope in pieces]))


# ---------------------------------------------------------------------------------------------- chance


def independent(largest: Array, freedom: int) -> float:
    """How many independent candidates have a largest gain like these (draws,): by the median, N chance = log 2."""
    return max(float(np.log(2.0) / np.exp(log_chance(float(np.median(largest)), freedom))), 1.0)
