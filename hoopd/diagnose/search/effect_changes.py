"""What an effect would change along a reference: of the one-step map and of the innovations.

A smooth force, or a static map of the torque, is sampled in every part of every step and pushes through the model's own
derivatives, which is exact to first order; whatever else an effect does (friction, lags, delays, readings) is evaluated
by a composite that has it.

Rules of this file: nothing is refitted or judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.likelihood.batch_calls import mapped
from hoopd.plants.likelihood.composites import composite_of, derivatives_of, fitting_effects, key_of
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.plant_with_effects import SMOOTH_SUBSTEPS

Array = NDArray[np.float64]
Values = tuple[tuple[str, float], ...]

# A force is sampled at two points of every part of a step (Gauss): the mean of a harmonic that runs by 1.4 rad in a
# part is then right to 0.1 %.
GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
# As a share of a limit, what is not at it.
INSIDE = 1e-9
# Changes whose forces are held at once: some ten megabytes.
AT_ONCE = 12


class Inside(NamedTuple):
    """Where the model without the change is within its steps, m points in each, and what a force there does."""

    x: Array  # (n-1, m, states)
    u: Array  # (inputs, n-1, m) demanded
    t: Array  # (n-1, m) s
    push: Array  # (n-1, nz, coordinates, m): one-step map by a force on a coordinate at each point
    pull: Array  # (n-1, nz, m): and by the first input there


class Changes:
    """Of one track about one fit; what all effects need is evaluated once."""

    def __init__(self, track: Track, values: Mapping[str, float]) -> None:
        self.track, self.z, self.values = track, track.filtered, values
        self._local = track.local(values)
        self._after: dict[int, Array] = {}
        self._inside: dict[int, Inside] = {}

    def of(self, effect: Effect, columns: Sequence[Values]) -> tuple[Array, Array]:
        """Changes of the one-step map (n-1, nz, m) and of the innovations (n, nc, m) at m choices of parameters."""
        own, n = self.track.composite, len(self.z)
        f, eps = np.zeros((n - 1, own.nz, len(columns))), np.zeros((n, len(own.channels), len(columns)))
        fits = fitting_effects(self.track.stretch.plant, (effect,))
        if not fits or not columns:
            return f, eps
        sampled = self._is_sampled(fits[0])
        if sampled:
            f[:] = self._pushes(fits[0], columns)
        whole = bool(own.latencies) or _reads(effect)
        for i, column in enumerate(columns if whole or not sampled else ()):
            found = self._whole(fits[0], column, step=not sampled, reading=whole)
            f[:, : own.nx, i] += found[0]
            eps[:, :, i] = found[1]
        return f, eps

    def _is_sampled(self, effect: Effect) -> bool:
        """A force, or a map of the torque that stands alone and acts at once; small, or whatever the state does."""
        if any((effect.delay, effect.lag, effect.friction, effect.shift, effect.plant, effect.sensor_lag)):
            return False
        if effect.torque is not None and any(one.torque or one.lag for one in self.track.composite.effects):
            return False
        if effect.torque is not None and self.track.composite.plant.driven is None:
            return False  # no force: the equations have the input where they like
        if effect.torque is None and effect.force is None:
            return False
        small = any(one.role == "amplitude" for one in effect.parameters)
        function = _force_function(self.track.composite.plant, effect, 2)
        return function is not None and (small or not function.jac_sparsity(0, 0).nnz())

    # ------------------------------------------------------------------------------------------ a sampled force

    def inside(self, parts: int) -> Inside:
        """The model without the change inside its steps; evaluated once."""
        if parts not in self._inside:
            self._inside[parts] = self._sampled_points(parts)
        return self._inside[parts]

    def _sampled_points(self, parts: int) -> Inside:
        c, track, n = self.track.composite, self.track, len(self.z) - 1
        call, d = mapped(derivatives_of(c, ())[0], n, (5,)), track.stretch.h / parts
        inputs, nothing = _within(track.held.inputs(parts, c.delay_s(self._local)), c.plant.limit), np.zeros((n, c.nw))
        starts, p = track.stretch.t[:-1] + np.arange(parts)[:, None] * d, c.vector(self._local)
        states, by = [self.z[:-1]], []
        for j in range(parts):
            after, derivatives = call(states[-1], inputs[j], nothing, d, starts[j], p)
            states.append(after[:, :, 0])
            by.append(derivatives)
        nq, points, onward = track.w.shape[1], len(GAUSS), np.broadcast_to(np.eye(c.nz), (n, c.nz, c.nz))
        push = np.empty((n, c.nz, nq + 1, parts, points))
        acting = [*(c.nz + i for i in track.disturbed), c.nz + c.nw]
        for j in range(parts - 1, -1, -1):
            for k, early in enumerate(0.5 - GAUSS):
                held = by[j][:, :, acting]
                # early in its part a force moves a position more than late: dq = dq' (d - s)
                held[:, : 2 * c.nq : 2] += early * d[:, None, None] * held[:, 1 : 2 * c.nq : 2]
                push[:, :, :, j, k] = onward @ held / points
            onward = onward @ by[j][:, :, : c.nz]
        x = np.stack([_between(a[:, : c.nx], b[:, : c.nx], d, c.nq) for a, b in pairwise(states)], axis=1)
        times = starts.T[:, :, None] + GAUSS * d[:, None, None]
        every = push.reshape(n, c.nz, nq + 1, parts * points)
        return Inside(
            x.reshape(n, -1, c.nx), np.repeat(inputs.transpose(2, 1, 0), points, axis=2), times.reshape(n, -1),
            every[:, :, :nq], every[:, :, nq],
        )  # fmt: skip

    def _pushes(self, effect: Effect, columns: Sequence[Values]) -> Array:
        """(n-1, nz, m) by the effect's forces at the points inside the steps."""
        parts = [self._pushes_at_once(effect, columns[i : i + AT_ONCE]) for i in range(0, len(columns), AT_ONCE)]
        return np.concatenate(parts, axis=2)

    def _pushes_at_once(self, effect: Effect, columns: Sequence[Values]) -> Array:
        inside = self.inside(effect.substeps or SMOOTH_SUBSTEPS)
        n, points = inside.t.shape
        function = _force_function(self.track.composite.plant, effect, n * points)
        assert function is not None
        names = _names(self.track.composite.plant, effect)
        forces, call = np.empty((len(inside.push[0, 0]), len(columns), n, points)), mapped(function, 1)
        states = np.ascontiguousarray(inside.x.reshape(n * points, -1).T)
        u, t = inside.u.reshape(1, -1), inside.t.reshape(1, -1)
        for i, column in enumerate(columns):
            values = {**self._local, **{effect.key(name): value for name, value in column}}
            found = call(states, u, t, np.array([[values[name] for name in names]]))[0]
            forces[:, i] = found[0].T[self.track.disturbed].reshape(-1, n, points)
        pushed = [inside.push[:, :, q] @ one.transpose(1, 2, 0) for q, one in enumerate(forces) if np.any(one)]
        return np.sum(pushed, axis=0) if pushed else np.zeros((n, inside.push.shape[1], len(columns)))

    # ------------------------------------------------------------------------------------------ all of an effect

    def _whole(self, effect: Effect, column: Values, *, step: bool, reading: bool) -> tuple[Any, Any]:
        """Changes (n-1, nx), (n, nc) by composites with and without the effect; 0 of what is not asked for."""
        own, track = self.track.composite, self.track
        composite = composite_of(track.stretch.plant, (*own.effects, effect))
        new = Track.of(track.stretch, track.held, composite)
        values = {**self._local, **{effect.key(name): value for name, value in column}}
        z, seen = self.z, track.predicted
        if composite.nz > own.nz:
            # what the effect adds to the state follows the reference
            z = new.carried(values, self.z[:, : own.nx])
            seen = np.hstack([track.predicted[:, : own.nx], z[:, own.nx :]])
        f: Any = 0.0
        if step and _moves(effect):
            after = new.after(values, z, np.zeros_like(track.w))
            f = after[:, : own.nx] - self._without(composite.substeps)
        # innovations lose what the readings gain
        return f, (self._readings - new.readings(values, seen, np.zeros_like(track.w)) if reading else 0.0)

    def _without(self, substeps: int) -> Array:
        """One-step map (n-1, nx) without the change, with as many substeps as the change has."""
        if substeps not in self._after:
            self._after[substeps] = self.track.after(self.values, substeps=substeps)[:, : self.track.composite.nx]
        return self._after[substeps]

    @cached_property
    def _readings(self) -> Array:
        return self.track.readings(self.values)


def _within(inputs: Array, limit: float) -> Array:
    """Inputs (..., inputs) with the first one just inside of its limit: laws of the drive act behind it, where its
    derivative by the demand is none."""
    found = inputs.copy()
    found[..., 0] = np.clip(found[..., 0], -limit * (1.0 - INSIDE), limit * (1.0 - INSIDE))
    return found


def changes_of(track: Track, fit: HypothesisFit) -> Changes:
    """The same object as long as neither the fit's values nor the reference change."""
    kept = track.__dict__.get("_changes")
    if not isinstance(kept, Changes) or kept.z is not track.filtered or kept.values is not fit.values:
        kept = track.__dict__["_changes"] = Changes(track, fit.values)
    return kept


def at_nodes(track: Track, fit: HypothesisFit) -> Point:
    """Everything a variable may read, arrays (n,) at the nodes, as the filter predicts them."""
    u = track.acting(track.local(fit.values)).mean(axis=-2)
    held = np.concatenate([u, u[..., -1:]], axis=-1)
    return track.stretch.plant.point(track.predicted.T, track.local(fit.values), held, track.stretch.t)


def _reads(effect: Effect) -> bool:
    return bool(effect.sensor or effect.latency or effect.sensor_lag)


def _moves(effect: Effect) -> bool:
    """It changes how the plant moves, not only what is read of it."""
    return any((effect.delay, effect.torque, effect.lag, effect.force, effect.friction, effect.shift, effect.plant))


def _between(begin: Array, end: Array, d: Array, coordinates: int) -> Array:
    """States (n, points, nx) at the points of GAUSS between two that are d (n,) seconds apart."""
    s, d = GAUSS[:, None], d[:, None, None]
    begin, end = begin[:, None], end[:, None]
    x = np.asarray(begin + s * (end - begin))
    # cubic through positions and rates at both ends; first-order states stand behind them
    q, v = slice(0, 2 * coordinates, 2), slice(1, 2 * coordinates, 2)
    v0, v1 = begin[:, :, v], end[:, :, v]
    by_position = begin[:, :, q] * (1 + 2 * s) * (1 - s) ** 2 + end[:, :, q] * s**2 * (3 - 2 * s)
    x[:, :, q] = by_position + d * s * (1 - s) * (v0 * (1 - s) - v1 * s)
    return x


def _names(plant: Plant, effect: Effect) -> tuple[str, ...]:
    return (*plant.values, *(effect.key(one.name) for one in effect.parameters))


def _force_function(plant: Plant, effect: Effect, n: int = 1) -> ca.Function | None:
    """(x (n, states), u (n, inputs), t (n,), p by `_names`) -> what an effect adds to forces and rates (n, nw).

    None for an effect whose functions do not take a whole column of points.
    """
    key = (key_of(plant), key_of(effect), n)
    if key not in _forces:
        try:
            _forces[key] = _made_force_function(plant, effect, n)
        except (TypeError, NotImplementedError, RuntimeError):
            _forces[key] = None
    return _forces[key]


def _made_force_function(plant: Plant, effect: Effect, n: int) -> ca.Function:
    names = _names(plant, effect)
    sizes = {"x": (n, len(plant.states)), "u": (n, max(1, len(plant.inputs))), "t": (n, 1), "p": (len(names), 1)}
    # matrices take a function element by element, which is five times as fast as scalars point by point
    x, u, t, p = (ca.MX.sym(name, *size) for name, size in sizes.items())
    values = {name: p[i] for i, name in enumerate(names)}
    first, *others = ca.horzsplit(u)
    demand = ca.fmin(ca.fmax(first, -plant.limit), plant.limit)
    every = [demand, *others] if others else demand
    point, force = plant.point(ca.horzsplit(x), values, every, t), dict.fromkeys(plant.disturbed, ca.MX.zeros(n))
    if effect.torque is not None and plant.driven is not None:
        force[plant.driven] += effect.torque(point, effect.values(values)) - demand
    for q, more in (effect.force(point, effect.values(values)) if effect.force else {}).items():
        if q in force:
            force[q] += more
    return ca.Function("force", [x, u, t, p], [ca.densify(ca.horzcat(*force.values()))])


# As many as effects of a library, for each plant and length.
_forces: dict[tuple[int, int, int], ca.Function | None] = {}
