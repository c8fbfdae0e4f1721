"""A batch of recordings: devices with effects, driven for some seconds, seen by their sensors.

Rules of this file: numpy only, nothing of `hoopd`; the axis of the batch is last. WARM samples run before the first
recorded one, so that lags, delays and the follower have a past. Same columns, same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from concealed import actuators, contacts, control, forces, sensors
from concealed.outside import drive, mechanisms, sensing
from concealed.plant import PIECES, SAMPLE_S, SUBSTEPS, Array, Body, Motion, accelerations

WARM = 25  # samples, 0.5 s


@dataclass(frozen=True)
class Columns:
    """What a batch of B recordings is made from; rows of samples include the WARM ones."""

    device: Body
    effects: Mapping[str, Mapping[str, Array]]  # name -> parameter -> (B,), neutral where a column lacks it
    start: Array  # (4, B)
    feed: Array  # N m (samples, B)
    push: Array  # disturbance torques on theta and psi, N m (samples PIECES, 2, B)
    noise: sensors.Noise
    law: control.Law


@dataclass(frozen=True)
class Trace:
    """What happened, without the warm-up."""

    history: Array  # true state every 2.5 ms (samples PIECES + 1, 4, B)
    torque: Array  # demanded (samples, B)
    clean: Array  # (samples, 3, B): sensors without noise
    rows: Array  # (samples, 3, B): theta, theta', psi as recorded, NaN for missing
    forces: Array | None = None  # (samples, 3, B) on theta, psi and phi' of what is outside the library, means, N m
    memory: Mapping[str, Array] = field(default_factory=dict)  # its states at the samples (samples + 1, B)

    @property
    def states(self) -> Array:
        """True state at the samples (samples + 1, 4, B)."""
        return self.history[::PIECES]

    def cut(self, columns: slice) -> Trace:
        """Some of the batch."""
        return Trace(
            self.history[..., columns],
            self.torque[:, columns],
            self.clean[..., columns],
            self.rows[..., columns],
            None if self.forces is None else self.forces[..., columns],
            {name: states[:, columns] for name, states in self.memory.items()},
        )


class _Run:
    """State of one simulation; `sample` advances it by 20 ms."""

    def __init__(self, columns: Columns, substeps: int, began_s: Array | float = 0.0) -> None:
        self.substeps, self.h = substeps, SAMPLE_S / substeps
        self.c, self.device = columns, columns.device
        size = columns.start.shape[1]
        theta, dtheta, psi, dpsi = columns.start
        self.x = Motion(theta, dtheta, psi, dpsi, (np.zeros(size), np.zeros(size)))
        self.effects = columns.effects
        self.maps = [(actuators.MAPS[n], self.effects[n]) for n in actuators.MAPS if n in self.effects]
        self.outside = any(name.startswith(mechanisms.PREFIX) for name in self.effects)
        self.strange_maps = [(mechanisms.MAPS[n], p) for n, p in self.effects.items() if n in mechanisms.MAPS]
        self.forces = [(forces.FORCES[n], p) for n, p in self.effects.items() if n in forces.FORCES]
        self.strange_forces = [(mechanisms.FORCES[n], p) for n, p in self.effects.items() if n in mechanisms.FORCES]
        self.dry = [
            [(table[n], p) for n, p in self.effects.items() if n in table]
            for table in ({**forces.ON_HOOP, **mechanisms.ON_HOOP}, forces.ON_ROLL)
        ]
        self.rubs = contacts.lines(self.device)
        self.delays = self._delays()
        self.lagged, self.slow = np.zeros(size), dtheta.copy()
        p = self.device.given
        self.spin = (p["Ro"] * dtheta - (p["Ro"] - p["Rb"]) * dpsi) / p["Rb"]
        self.twist = np.zeros(size)  # the last w'
        self.moment = forces.Moment(
            0.0, theta, dtheta, psi, dpsi, np.zeros(size), self.device,
            {"turned": np.zeros(size), "torque": np.zeros(size), "heat": dtheta**2}
            | mechanisms.memory(self.effects, dtheta),
            self.h,
        )  # fmt: skip
        self.began_s, self.share = began_s, np.zeros((3, size))

    def _delays(self) -> list[tuple[Array, Array]] | None:
        if "actuator.delay" not in self.effects:
            return None
        delay_s = self.effects["actuator.delay"]["d"]
        return [actuators.delay_weights(delay_s, j, self.h, SAMPLE_S) for j in range(self.substeps)]

    def sample(self, k: int, demanded: Array, history: Array) -> None:
        """Advances by one sample with `demanded` (samples, B) known up to row k; writes the history's new rows."""
        self.share[...] = 0.0
        for j in range(self.substeps):
            piece = k * PIECES + j * PIECES // self.substeps
            if j % (self.substeps // PIECES) == 0 and j:
                self._store(history[piece])
            self.substep(
                self._wire(k, j, demanded), demanded[k], self.c.push[piece], (k - WARM) * SAMPLE_S + j * self.h
            )
        self._store(history[(k + 1) * PIECES])

    def _store(self, row: Array) -> None:
        row[0], row[1], row[2], row[3] = self.x.theta, self.x.dtheta, self.x.psi, self.x.dpsi

    def _wire(self, k: int, j: int, demanded: Array) -> Array:
        """Torque that has come through the delay, mean over substep j."""
        if self.delays is None:
            return self._opened(k, j, demanded, demanded[k])
        back, weight = self.delays[j]
        column = np.arange(len(weight))
        newer, older = np.maximum(k - back, 0), np.maximum(k - back - 1, 0)
        arrived = weight * demanded[newer, column] + (1 - weight) * demanded[older, column]
        return self._opened(k, j, demanded, arrived)

    def _opened(self, k: int, j: int, demanded: Array, arrived: Array) -> Array:
        """What has arrived, but in columns with a dead time what that lets through."""
        if mechanisms.DEAD_TIME not in self.effects:
            return arrived
        p = self.effects[mechanisms.DEAD_TIME]
        told = drive.dead_time(p, demanded[k], demanded[max(k - 1, 0)], (j + 1) * self.h, self.h)
        self.share[0] += np.where(p["d"] > 0.0, told - demanded[k], 0.0) / self.substeps
        return np.where(p["d"] > 0.0, told, arrived)

    def substep(self, torque: Array, demanded: Array, push: Array, t: float) -> None:
        """Drift, kick, drift."""
        x, h = self.x, self.h
        x.theta, x.psi = x.theta + h / 2 * x.dtheta, x.psi + h / 2 * x.dpsi
        m = self._moment(demanded, t)
        on_theta, on_psi, on_roll = self._all_forces(self._driven(torque, m), push, m)
        limits = [sum(limit(p, m) for limit, p in dry) for dry in self.dry]
        before = x.dtheta
        if "ball.slip" in self.effects:
            self._slide((on_theta, on_psi, on_roll), limits, m)
        else:
            x.kick = accelerations(self.device, on_theta, on_psi, on_roll)
            x.dtheta, x.dpsi = x.dtheta + h * x.kick[0], x.dpsi + h * x.kick[1]
            self._rub(limits)
        x.theta, x.psi = x.theta + h / 2 * x.dtheta, x.psi + h / 2 * x.dpsi
        if "encoder.speed_lag" in self.effects:
            time_s = self.effects["encoder.speed_lag"]["T"]
            self.slow = sensors.low_passed(time_s, self.slow, before, x.dtheta, h)

    def _moment(self, demanded: Array, t: float) -> forces.Moment:
        x, m = self.x, self.moment
        m.t, m.theta, m.psi, m.torque = np.maximum(self.began_s + t + self.h / 2, 0.0), x.theta, x.psi, demanded
        m.dtheta, m.dpsi = x.dtheta + self.h / 2 * x.kick[0], x.dpsi + self.h / 2 * x.kick[1]
        return m

    def _driven(self, torque: Array, m: forces.Moment) -> Array:
        """Torque on the hoop."""
        for apply, p in self.maps:
            torque = apply(p, torque, m.theta, m.dtheta)
        before = torque
        for apply_strange, p in self.strange_maps:
            torque = apply_strange(p, torque, m)
        if self.outside:
            self.share[0] += (torque - before) / self.substeps
        if "actuator.lag" in self.effects:
            torque, self.lagged = actuators.lag(self.effects["actuator.lag"]["T"], torque, self.lagged, self.h)
        if mechanisms.SHAFT in self.effects:
            sensing.wind(self.effects[mechanisms.SHAFT], torque, m)
        return torque

    def _all_forces(self, torque: Array, push: Array, m: forces.Moment) -> tuple[Array, Array, Array]:
        on_theta = torque - self.device.bh * m.dtheta + push[0]
        on_psi = push[1] - self.device.weight * np.sin(m.psi)
        on_roll = -self.device.bb * self._rolling(m)
        for force, p in self.forces:
            hoop, ball, roll = force(p, m)
            on_theta, on_psi, on_roll = on_theta + hoop, on_psi + ball, on_roll + roll
        for force, p in self.strange_forces:
            hoop, ball, roll = force(p, m)
            on_theta, on_psi, on_roll = on_theta + hoop, on_psi + ball, on_roll + roll
            for axis, part in enumerate((hoop, ball, roll)):
                self.share[axis] += part / self.substeps
        return on_theta, on_psi, on_roll

    def _rolling(self, m: forces.Moment) -> Array:
        return self.spin + self.h / 2 * self.twist - m.dpsi if "ball.slip" in self.effects else m.rolling

    def _rub(self, limits: list[Array | float]) -> None:
        """Dry friction: both kinds at once where both are there, else the one."""
        x = self.x
        active = [i for i, dry in enumerate(self.dry) if dry]
        if not active:
            return
        together = len(active) == 2 and bool(np.any((limits[0] > 0) & (limits[1] > 0)))
        for which in (active,) if together else ([i] for i in active):
            rubs, bounds = tuple(self.rubs[i] for i in which), tuple(limits[i] for i in which)
            before = x.dtheta
            x.dtheta, x.dpsi = contacts.rub(rubs, x.dtheta, x.dpsi, bounds, self.h)
            if self.outside and which == [0]:
                # an impulse along theta' gives theta' (M^-1)_11 of it
                self.share[0] += (x.dtheta - before) / (self.device.i11 * self.h * self.substeps)

    def _slide(self, on: tuple[Array, Array, Array], limits: list[Array | float], m: forces.Moment) -> None:
        x = self.x
        grip = self.effects["ball.slip"]["mu"] * m.normal_n
        v = np.stack((x.dtheta, x.dpsi, self.spin))
        hoop, roll = (limit if dry else None for limit, dry in zip(limits, self.dry, strict=True))
        after = contacts.slide(self.device, v, on, grip, (hoop, roll), self.h)
        self.twist = (after[2] - v[2]) / self.h
        x.kick = tuple((after[:2] - v[:2]) / self.h)
        x.dtheta, x.dpsi, self.spin = after

    def seen(self, history: Array, k: int) -> Array:
        """(theta, theta', psi) (3, B) as sensors without noise say them at sample k."""
        slow = self.slow if "encoder.speed_lag" in self.effects else None
        self.moment.t = np.maximum(self.began_s + (k - WARM) * SAMPLE_S, 0.0)
        return sensors.seen(history, k * PIECES, slow, self.effects, self.moment)


def simulate(columns: Columns, substeps: int = SUBSTEPS) -> Trace:
    """Runs the batch; each row: sensors first, then the law, then 20 ms with its torque held.

    substeps: a multiple of PIECES.
    """
    samples, size = columns.feed.shape
    run = _Run(columns, substeps)
    history = np.empty((samples * PIECES + 1, 4, size))
    history[0] = columns.start
    demanded, clean, rows = np.zeros((samples, size)), np.empty((samples, 3, size)), np.empty((samples, 3, size))
    strange = mechanisms.memory(columns.effects, run.x.dtheta)
    remembered = {name: np.empty((samples + 1, size)) for name in strange}
    shares = np.empty((samples, 3, size)) if run.outside else None
    frame = columns.start[2].copy()
    follower = control.Follower(columns.start[2])
    for k in range(samples):
        for name, kept in remembered.items():
            kept[k] = run.moment.memory[name]
        clean[k] = run.seen(history, k)
        rows[k], frame = sensors.recorded(clean[k], frame, columns.noise, k)
        follower.update(rows[k, 2])
        demanded[k] = control.torque(columns.law, columns.feed[k], k, follower, rows[k, 1])
        run.sample(k, demanded, history)
        if shares is not None:
            shares[k] = run.share
    for name, kept in remembered.items():
        kept[samples] = run.moment.memory[name]
    return Trace(
        history[WARM * PIECES :],
        demanded[WARM:],
        clean[WARM:],
        rows[WARM:],
        None if shares is None else shares[WARM:],
        {name: kept[WARM:] for name, kept in remembered.items()},
    )


@dataclass(frozen=True)
class Stretch:
    """Where B free runs begin: rows of samples include the WARM ones before, which are known."""

    began_s: Array  # time of the first row since its recording's (B,)
    past: Array  # history before and at the first row (WARM PIECES + 1, 4, B); its last row is the initial state
    memory: Mapping[str, Array]  # what mechanisms remember there (B,)
    forces: Sequence[tuple[Callable[[Mapping[str, Array], forces.Moment], forces.Force], Mapping[str, Array]]] = ()


def free_run(columns: Columns, stretch: Stretch, substeps: int = SUBSTEPS) -> Array:
    """What sensors without noise say (samples - WARM, 3, B) of devices that are driven by `columns.feed` alone."""
    run = _Run(columns, substeps, stretch.began_s)
    run.moment.memory.update({name: state.copy() for name, state in stretch.memory.items()})
    run.forces.extend(stretch.forces)
    samples = len(columns.feed)
    history = np.empty((samples * PIECES + 1, *stretch.past.shape[1:]))
    history[: WARM * PIECES + 1] = stretch.past
    clean = [run.seen(history, WARM)]
    for k in range(WARM, samples - 1):
        run.sample(k, columns.feed, history)
        clean.append(run.seen(history, k + 1))
    return np.stack(clean)
