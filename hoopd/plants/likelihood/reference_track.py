"""One stretch of data with a model along it: the reference trajectory, and the model linear about it.

Rules of this file: the reference comes from the smoother, so that what is left out of the model does not lead it away
from the data; one-step maps and readings are those of `plants.plant_with_effects`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.batch_calls import mapped
from hoopd.plants.likelihood.composites import (
    carrying,
    composite_of,
    derivatives_of,
    dry_frictions_of,
    fitting_effects,
    rates_of,
)
from hoopd.plants.likelihood.kalman_filter import (
    Gains,
    Lagged,
    LinearReference,
    Noise,
    SmoothedDeviation,
    gains,
    smoothed,
    whitened,
)
from hoopd.plants.likelihood.recording_parameters import names_of, values_of
from hoopd.plants.likelihood.stretches import Held, Stretch, first_states
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.scales import state_scales

Array = NDArray[np.float64]

# Passes of the smoother until the reference stays: the second changes it by far less than the noise.
SMOOTHING_PASSES = 2
# So many of its unseen swings from zero a rate may have passed it; below the least there is none.
SWINGS, LEAST = 2.0, 1e-300
# What displaces a place for good by a swing's one phase displaces it meanwhile, as a mean, by its other: a h^2/(4 pi^2)
# beside a h^2/(2 pi).
MEAN_SHARE = 1.0 / (2.0 * pi)


@dataclass(frozen=True)
class Columns:
    """The linear problem of a stretch: residual first, then one column for each free parameter."""

    model: LinearReference
    f: Array  # (n-1, nz, 1+m)
    eps: Array  # (n, nc, 1+m)


class Track:
    """A stretch, a composite model and the reference along it."""

    def __init__(self, stretch: Stretch, effects: Sequence[Effect] = ()) -> None:
        self.stretch, self.held = stretch, Held.of(stretch)
        self.composite = composite_of(stretch.plant, fitting_effects(stretch.plant, effects))
        x = first_states(stretch)
        self.z = np.zeros((len(stretch.t), self.composite.nz))
        # disturbances act on what the plant as declared has, not on what an effect adds
        self.w = np.zeros((len(stretch.t), len(stretch.plant.disturbed)))
        self.z[:, : x.shape[1]] = x
        plant = self.composite.plant
        for k, state in enumerate(plant.states[x.shape[1] :], start=x.shape[1]):
            other = plant.remembered.get(state)
            self.z[:, k] = self.z[:, plant.states.index(other)] if other else plant.held.get(state, 0.0)
        self.z = self._lagged(self.z)
        # before a filter has run, its states are the reference's
        self.filtered, self.predicted = self.z, self.z

    def _lagged(self, z: Array) -> Array:
        """States (n, nz) with what lags behind the plant's settled at every node: at the first one about this the
        filter spreads it."""
        c, z, u = self.composite, z.copy(), np.append(self.stretch.u, self.stretch.u[-1])
        for column, state in enumerate(c.settled, start=c.nx):
            z[:, column] = u if state is None else z[:, state]
        return z

    def moved(self, z: Array, w: Array, filtered: Array, predicted: Array) -> None:
        """To another reference, and the filter's own states there."""
        self.z, self.w, self.filtered, self.predicted = z, w, filtered, predicted

    @classmethod
    def of(cls, stretch: Stretch, held: Held, composite: Composite) -> Track:
        """With a composite of its own and no reference yet."""
        found = cls.__new__(cls)
        found.stretch, found.held, found.composite = stretch, held, composite
        return found

    def like(self, other: Track) -> Track:
        """Takes over the reference of a track of the same stretch with other effects, state by state."""
        mine, its = self.composite.plant.states, other.composite.plant.states
        both = [name for name in mine if name in its]
        to, of = [mine.index(name) for name in both], [its.index(name) for name in both]
        known = other.z, other.filtered, other.predicted
        self.z, self.filtered, self.predicted = (self._lagged(_with_columns(self.z, to, z[:, of])) for z in known)
        self.w[:, : min(self.w.shape[1], other.w.shape[1])] = other.w[:, : self.w.shape[1]]
        return self

    def lead_added(self, values: Mapping[str, float], known: Sequence[str]) -> None:
        """Leads the states that are not among those `known` along the reference: at rest, what they remember would have
        no derivative by its constants."""
        mine = self.composite.plant.states
        given = next((i for i, name in enumerate(mine) if name not in known), len(mine))
        if given < len(mine):
            self._lead(values, range(given, len(mine)))

    def _lead(self, values: Mapping[str, float], columns: Sequence[int]) -> None:
        """Makes some states follow the filter's, from the first of these columns on."""
        led = self.carried(values, self.filtered[:, : columns[0]])[:, columns]
        if np.isfinite(led).all():
            known = self.z, self.filtered, self.predicted
            self.z, self.filtered, self.predicted = (_with_columns(z, columns, led) for z in known)

    # ------------------------------------------------------------------------------------------ the model

    def local(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of this stretch, those of the composite where none are given."""
        return {**self.composite.values, **values_of(self.stretch.recording, values)}

    def torques(self, values: Mapping[str, float]) -> Array:
        """(substeps, n-1) of the first input."""
        return self.held.substeps(self.composite.substeps, self.composite.delay_s(values))

    def inputs(self, values: Mapping[str, float]) -> Array:
        """(substeps, n-1, inputs)"""
        return self.held.inputs(self.composite.substeps, self.composite.delay_s(values))

    def acting(self, values: Mapping[str, float]) -> Array:
        """(substeps, n-1), or (inputs, substeps, n-1) of several: as a plant's point takes them."""
        return np.moveaxis(self.inputs(values), 2, 0) if self.stretch.others.shape[1] else self.torques(values)

    def _flat_inputs(self, values: Mapping[str, float]) -> Array:
        """(n-1, substeps inputs) as a compiled step takes them, one input after the other."""
        return self.inputs(values).transpose(1, 2, 0).reshape(len(self.stretch.u), -1)

    def _back(self, values: Mapping[str, float]) -> Array:
        """(n, BACK_STEPS * channels)"""
        c = self.composite
        late = [max(float(values.get(c.latencies.get(name, ""), 0.0)), 0.0) for name in c.channels]
        back = self.held.inputs_back(late, c.delay_s(values))
        return back.reshape(-1, back.shape[2]).T

    def _wide(self, w: Array) -> Array:
        """Disturbances with a column for all that the composite has, whatever effects add."""
        found = np.zeros((len(w), self.composite.nw))
        found[:, self.disturbed[: w.shape[1]]] = w
        return found

    @property
    def disturbed(self) -> list[int]:
        """Places of the declared plant's disturbances among the composite's."""
        every = self.composite.plant.disturbed
        return [every.index(name) for name in self.stretch.plant.disturbed]

    def _output_inputs(self, values: Mapping[str, float], z: Array, w: Array) -> list[Array]:
        return [z, self._back(values), self._wide(w), self.stretch.t, self.composite.vector(values)]

    def after(
        self, values: Mapping[str, float], z: Array | None = None, w: Array | None = None, substeps: int = 0
    ) -> Array:
        """(n-1, nz) one-step map from the filter's state at every node."""
        values = self.local(values)
        z, w = (self.filtered if z is None else z), (np.zeros((len(self.stretch.t), 0)) if w is None else w)
        c = self.composite
        if substeps not in (0, c.substeps):
            finer = Track.of(self.stretch, self.held, composite_of(c.declared, c.effects, substeps))
            return finer.after(values, z, w)
        call = mapped(c.step_function, len(z) - 1, (5,))
        inputs = self._flat_inputs(values), self._wide(w)[:-1], self.stretch.h, self.stretch.t[:-1], c.vector(values)
        return call(z[:-1], *inputs)[0][:, :, 0]

    def carried(self, values: Mapping[str, float], x: Array) -> Array:
        """States (n, nz) with what this composite adds to given ones (n, nx), from its beginning.

        The given states are those of `x` at every node, the added ones follow their own steps; no disturbance.
        """
        values, c, n = self.local(values), self.composite, len(x)
        begin = c.beginning(x[0], float(self.stretch.u[0]))[x.shape[1] :]
        run, p = carrying(c, x.shape[1]), c.vector(values)
        data = x[:-1], self._flat_inputs(values), self.stretch.h, self.stretch.t[:-1]
        known = mapped(run.known, n - 1, (4,))(*data, p)[0][:, :, 0]
        own = run.added(begin, *data, np.broadcast_to(p, (n - 1, len(p))), known)[0]
        return np.hstack([x, np.vstack([begin, own[:, :, 0]])])

    def readings(self, values: Mapping[str, float], z: Array | None = None, w: Array | None = None) -> Array:
        """(n, nc) what the sensors would show of the filter's prediction at every node."""
        values = self.local(values)
        z, w = (self.predicted if z is None else z), (np.zeros((len(self.stretch.t), 0)) if w is None else w)
        call = mapped(self.composite.output_function, len(z), (4,))
        return call(*self._output_inputs(values, z, w))[0][:, :, 0]

    def mobility(self, values: Mapping[str, float]) -> Array:
        """(coordinates,) acceleration of each by a force on it at the first node; effects hold nothing."""
        plant, values = self.stretch.plant, self.local(values)
        force = ca.SX.sym("force", len(plant.coordinates))
        first = [float(self.stretch.u[0]), *map(float, self.stretch.others[0])]
        held = first if len(first) > 1 else first[0]
        point = plant.point(ca.SX(self.z[0]), values, held, float(self.stretch.t[0]))
        by_force = ca.jacobian(ca.densify(plant.accelerations(point, force)), force)
        here = ca.Function("mobility", [force], [ca.densify(by_force)])(0.0)
        return np.abs(np.diag(here.full()))

    def balanced(self, values: Mapping[str, float]) -> Array:
        """(coordinates,) acceleration of each, RMS along the reference, that inputs hold against everything else: the
        lesser of what they add and of what is there without them."""
        plant = self.stretch.plant
        if not plant.inputs or not plant.coordinates:
            return np.zeros(len(plant.coordinates))
        alone = composite_of(plant, ())
        x, inputs = self.z[:-1, : len(plant.states)].T, np.vstack([self.stretch.u, self.stretch.others.T])
        rest = self.stretch.t[None, :-1], alone.vector(self.local(values))
        whole, free = (
            rates_of(alone)(x, u, *rest).full()[1 : 2 * len(plant.coordinates) : 2]
            for u in (inputs, np.zeros_like(inputs))
        )
        held = (np.nan_to_num(one, posinf=0.0, neginf=0.0) for one in (whole - free, free))
        return np.asarray(np.minimum(*(np.sqrt(np.mean(one**2, axis=1)) for one in held)))

    # ------------------------------------------------------------------------------------------ linear

    def columns(self, values: Mapping[str, float], free: Sequence[str]) -> Columns:
        """The model linear about the filter's states; `free` parameters it does not have get columns of zeros.

        Not about the smoothed reference: what is multiplied with a state that knows the reading, or the disturbance,
        that it helps to explain is correlated with it, and everything that resembles a scale would be named.
        """
        c, n = self.composite, len(self.stretch.t)
        values, mine = self.local(values), names_of(self.stretch.recording, free)
        led = [c.plant.states.index(name) for name in c.plant.led]
        if led:
            self._lead(values, led)
        mine = {name: local for name, local in mine.items() if local in c.names}
        after, by_z, by_w, by_u, by_p = self._step_derivatives(values, tuple(mine.values()))
        y, of_z, of_p = self._reading_derivatives(values, tuple(mine.values()))
        f, eps = np.zeros((n - 1, c.nz, 1 + len(free))), np.zeros((n, len(c.channels), 1 + len(free)))
        # f = F(z_f, 0) + A (z - z_f) - z_next: the disturbance is a state of the filter
        step = (by_z @ (self.z - self.filtered)[:-1, :, None])[:, :, 0]
        reading = (of_z @ (self.z - self.predicted)[:, :, None])[:, :, 0]
        f[:, :, 0], eps[:, :, 0] = after + step - self.z[1:], np.nan_to_num(self.stretch.y) - y - reading
        where = [1 + list(free).index(name) for name in mine]
        f[:, :, where], eps[:, :, where] = by_p, -of_p
        # what is led has no deviation
        f[:, led], by_z[:, led], by_w[:, led] = 0.0, 0.0, 0.0
        seen = np.isfinite(self.stretch.y)
        model = LinearReference(
            by_z,
            by_w,
            of_z,
            self.stretch.h,
            seen,
            c.nx,
            self.stretch.scatter,
            self._behind(values),
            tuple(state_scales(c.plant).tolist()),
            tuple(c.plant.states.index(name) for name in self.stretch.plant.first_order),
            *self._unresolved(values, by_u, by_w, of_z),
        )
        return Columns(model, f, eps)

    @property
    def _is_resolved(self) -> bool:
        """Whether all inputs are known between their rows."""
        return not self.stretch.unresolved.any()

    def _unresolved(
        self, values: Mapping[str, float], by_u: Array, by_w: Array, of_z: Array
    ) -> tuple[Array | None, Array | None]:
        """Deviations by what is not known of the inputs, told what an input does to a step: (n, nc) of the readings,
        and (n-1, nz) of the states, which stay displaced."""
        if self._is_resolved:
            return None, None
        # of an input u that swings unseen a rate swings as its integral, and is back when its time is over; a place is
        # then where the integral of that has brought it, and was aside by a part of that on its way
        once, twice = np.moveaxis(self.stretch.unresolved, 2, 0)[:, :, None, :]
        answer, places = by_u / self.stretch.h[:, None, None], range(0, 2 * self.composite.nq, 2)
        moved, displaced = answer * once, np.zeros(answer.shape)
        displaced[:, places] = (answer * twice)[:, [place + 1 for place in places]]
        moved[:, places] = MEAN_SHARE * displaced[:, places]
        turned = self._turned_unseen(values, moved, by_w)
        seen = of_z @ np.concatenate([moved, moved[-1:]])
        return np.sqrt(np.sum(seen**2, axis=2)), np.sqrt(np.sum(displaced**2, axis=2) + turned**2)

    def _turned_unseen(self, values: Mapping[str, float], moved: Array, by_w: Array) -> Array:
        """(n-1, nz) deviation of the states because nobody knows when a dry friction turned round.

        A rate that swings by sigma unseen, and is near zero, passes it sigma/|rate'| earlier or later: for so long the
        whole friction, twice its level, may have been on the other side.
        """
        c, n = self.composite, len(self.z) - 1
        call, rates, total = dry_frictions_of(c), range(1, 2 * c.nq, 2), np.zeros((n, c.nz))
        if call is None:
            return total
        told = call(self.z[:-1, : c.nx].T, self.inputs(values)[0].T, self.stretch.t[None, :-1], c.vector(values)).full()
        forces = [self.stretch.plant.disturbed.index(q) for q in self.stretch.plant.coordinates]
        for one in np.split(told.T, len(told) // (1 + c.nq), axis=1):
            level, along = one[:, 0], one[:, 1:]
            before, after = (np.sum(along * self.z[nodes][:, rates], axis=1) for nodes in (slice(n), slice(1, n + 1)))
            swing = np.linalg.norm(np.einsum("kq,kqu->ku", along, moved[:, rates]), axis=1)
            least, most = np.sort(np.abs([before, after]), axis=0)
            turns = ((before * after <= 0.0) | (least < SWINGS * swing)) & (most > swing)
            share = np.where(turns, swing / np.maximum(np.abs(after - before) + swing, LEAST), 0.0)
            answer = np.einsum("kzq,kq->kz", by_w[:, :, forces], along)
            total += (2.0 * level * share)[:, None] ** 2 * answer**2
        return np.asarray(np.sqrt(total))

    def _behind(self, values: Mapping[str, float]) -> tuple[Lagged, ...]:
        """What lags where the stretch begins: a torque that was another one before, a reading by time times rate.

        At no time either is worth nothing: the torque that was is forgotten at once.
        """
        c, found = self.composite, []
        for state, lag in zip(c.settled, c.lags, strict=True):
            if state is None:
                found.append(Lagged(None, float(np.sqrt(np.mean(self.stretch.u**2)))))
            else:
                rate = np.diff(self.z[:, state]) / self.stretch.h
                found.append(Lagged(state, values[lag] * float(np.sqrt(np.mean(rate**2)))))
        return tuple(found)

    def _step_derivatives(self, values: Mapping[str, float], free: tuple[str, ...]) -> tuple[Array, ...]:
        """One-step map (n-1, nz), and its derivatives (n-1, nz, ...) by z, w, inputs and parameters, at no disturbance;
        by inputs none where all of them are known."""
        # a parameter that scales the disturbance would otherwise be fitted to what the smoother thinks of it
        c, n, z = self.composite, len(self.stretch.t) - 1, self.filtered[:-1]
        call, d = mapped(derivatives_of(c, free)[0], n, (5,)), self.stretch.h / c.substeps
        inputs, slope = self.inputs(values), self.held.substeps_by_delay(c.substeps, c.delay_s(values))
        nothing, p, nu = np.zeros((n, c.nw)), c.vector(values), c.nz + c.nw
        end = nu if self._is_resolved else nu + c.nu  # of the derivatives that stand before those by parameters
        late = [end + free.index(name) for name in c.delays if name in free]
        total = np.zeros((n, c.nz, end + len(free)))
        total[:, range(c.nz), range(c.nz)] = 1.0
        for j in range(c.substeps):
            z, by = call(z, inputs[j], nothing, d, self.stretch.t[:-1] + j * d, p)
            z = z[:, :, 0]
            # the chain rule through the substeps: S+ = F_z S + [0, F_w, F_u, F_p]
            total = by[:, :, : c.nz] @ total
            total[:, :, c.nz : end] += by[:, :, c.nz : end]
            total[:, :, end:] += by[:, :, nu + c.nu :]
            total[:, :, late] += by[:, :, nu, None] * slope[j][:, None, None]
        pushed = total[:, :, [c.nz + i for i in self.disturbed]]
        return z, total[:, :, : c.nz], pushed, total[:, :, nu:end], total[:, :, end:]

    def _reading_derivatives(self, values: Mapping[str, float], free: tuple[str, ...]) -> list[Array]:
        """Readings (n, nc) and their derivatives (n, nc, ...) by z and parameters."""
        call = mapped(derivatives_of(self.composite, free)[1], len(self.z), (4,))
        y, by_z, by_p = call(*self._output_inputs(values, self.predicted, np.zeros_like(self.w)))
        return [y[:, :, 0], by_z, by_p]

    def smooth(self, values: Mapping[str, float], noise: Noise, passes: int = SMOOTHING_PASSES) -> SmoothedDeviation:
        """Moves the reference to the smoothed trajectory."""
        for _ in range(passes):
            columns = self.columns(values, ())
            found = gains(columns.model, noise)
            last = smoothed(columns.model, found, columns.f[:, :, 0], columns.eps[:, :, 0])
            self.follow(last)
        return last

    def follow(self, found: SmoothedDeviation) -> None:
        """Moves the reference, and the filter's states, by what a smoother found about it."""
        nz = self.composite.nz
        states = [self.z + part[:, :nz] for part in (found.d, found.filtered, found.predicted)]
        self.moved(states[0], found.d[:, nz:], states[1], states[2])

    def whitened(self, columns: Columns, found: Gains) -> Array:
        """(n * nc, 1+m) rows of the least-squares problem."""
        out = whitened(columns.model, found, columns.f, columns.eps)
        return out.reshape(-1, out.shape[2])


def _with_columns(z: Array, columns: Sequence[int], values: Array) -> Array:
    """A copy of states (n, nz) with other values (n, k) in some columns."""
    found = z.copy()
    found[:, columns] = values
    return found
