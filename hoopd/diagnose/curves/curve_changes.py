"""How a curve's hats change the one-step map and the readings along a fit's reference.

A force acts over a step as its mean over the step's parts, through the derivative of the one-step map by a disturbance
on the same coordinate, which is exact to first order; a curve of a reading takes its value from the innovations.

Rules of this file: changes before whitening, added into arrays that are given.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import UnnamedCurve
from hoopd.diagnose.curves.hats import hats
from hoopd.diagnose.search.screen import Column, change_of
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.reference_track import Columns, Track

Array = NDArray[np.float64]


def within(track: Track, fit: HypothesisFit) -> Point:
    """Everything a variable may read, arrays (parts, n-1) in the middle of each part of each step."""
    values = track.local(fit.values)
    torques = track.torques(values)
    parts, h = torques.shape[0], track.stretch.h
    share = (np.arange(parts)[:, None] + 0.5) / parts
    # the step as the model takes it, without a disturbance: from z_k to F(z_k), not to z_k+1
    begin, end = track.filtered[:-1], track.after(fit.values)
    states = {}
    for i, q in enumerate(track.composite.plant.coordinates):
        x, v = (begin[:, 2 * i], end[:, 2 * i]), (begin[:, 2 * i + 1], end[:, 2 * i + 1])
        states[f"d{q}"] = v[0] + share * (v[1] - v[0])
        # cubic through positions and rates at both ends
        states[q] = _hermite(x, v, h, share)
    # of a first-order state the rate at both ends is not known: a straight line
    for i, name in enumerate(track.composite.plant.states):
        if name not in states:
            states[name] = begin[:, i] + share * (end[:, i] - begin[:, i])
    names = track.composite.plant.states
    every = [states.get(name, np.zeros_like(torques)) for name in names]
    return track.stretch.plant.point(every, values, track.acting(values), track.stretch.t[:-1] + share * h)


def _hermite(x: tuple[Array, Array], v: tuple[Array, Array], h: Array, s: Array) -> Array:
    by_position = x[0] * (1 + 2 * s) * (1 - s) ** 2 + x[1] * s**2 * (3 - 2 * s)
    return np.asarray(by_position + h * s * (1 - s) * (v[0] * (1 - s) - v[1] * s))


def add_change(
    curve: UnnamedCurve, track: Track, fit: HypothesisFit, points: tuple[Point, Point], f: Array, eps: Array
) -> None:
    """Changes of the one-step map f (n-1, nz, m) and of the innovations eps (n, nc, m) by a curve's hats."""
    if curve.site.acts == "reading":
        shape = _shape(curve, points[1])
        for channel, weight in curve.site.on.items():
            eps[:, track.composite.channels.index(channel)] -= weight * shape
        return
    if curve.site.acts == "torque" and any(effect.lag for effect in fit.effects):
        _add_exactly(curve.effect, track, fit, f)
        return
    # W: one-step map by a force held on a coordinate
    pushed = sum(
        weight * own_columns(track, fit).model.w[:, :, track.stretch.plant.disturbed.index(q)]
        for q, weight in curve.site.on.items()
        if q in track.stretch.plant.disturbed
    )
    _push(np.asarray(pushed), _shape(curve, points[0]), track, f)


def _push(pushed: Array, shape: Array, track: Track, f: Array) -> None:
    """f (n-1, nz, m) by forces shape (parts, n-1, m) that would push by `pushed` (n-1, nz) if held over the step."""
    f += pushed[:, :, None] * shape.mean(axis=0)[:, None, :]
    # early in the step a force moves the position more than late: dq = sum a_j (h - t_j),  mean of h - t_j = h/2
    parts, h = shape.shape[0], track.stretch.h
    lead = (0.5 - (np.arange(parts) + 0.5) / parts)[:, None, None] * h[:, None]
    sooner = (shape * lead).mean(axis=0)
    for i in range(track.composite.nq):
        f[:, 2 * i] += pushed[:, 2 * i + 1, None] * sooner


def own_columns(track: Track, fit: HypothesisFit) -> Columns:
    """The fit's linear problem of one of its tracks."""
    return next(own for one, own in zip(fit.tracks, fit.columns, strict=True) if one is track)


def _add_exactly(effect: Effect, track: Track, fit: HypothesisFit, f: Array) -> None:
    """By the one-step map itself, where a lag stands between torque and force."""
    for i, parameter in enumerate(effect.parameters):
        values = {**effect.neutral(), parameter.name: parameter.size}
        column = Column(tuple(values.items()))
        f[:, :, i] += change_of(track, fit, effect, column)[0] / parameter.size


def _shape(curve: UnnamedCurve, s: Point) -> Array:
    """(..., m) hats times factor."""
    x = np.asarray(curve.variable.of(s), dtype=float)
    found: Array = hats(x, curve.knots, curve.variable.period)
    return found if curve.factor is None else np.asarray(found * np.asarray(curve.factor.of(s))[..., None])
