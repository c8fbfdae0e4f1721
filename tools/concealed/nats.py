"""How visible an effect is: the expected gain in log-likelihood of the true structure over the re-fitted plain one.

Rules of this file: numpy only, own code. Along the true trajectory the effect changes the one-sample step by dF_k (4)
and the sensors by dy_k (3); a Kalman filter with the true noise and an Ornstein-Uhlenbeck torque on each coordinate
whitens these changes and those of the eight entries J, K, L; nats = |P W d|^2/2, where P projects the entries out.
The initial state is projected out by a filter that starts knowing nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from concealed.disturbances import Colour
from concealed.plant import PIECES, SAMPLE_S, SUBSTEPS, Array, Body, coast
from concealed.sensors import COUNT_RAD
from concealed.simulate import WARM, Columns, Trace

COARSE = 8  # substeps of the linearisation
ENTRIES = 8
KNOWS_NOTHING = (3.0, 100.0, 3.0, 100.0)  # rad, rad/s: standard deviation of the initial state
STEP = 1e-5  # of the finite differences
BLIND = 1e6  # factor on the camera's noise where a frame is missing
CHUNK = 24  # columns that are linearised at once: memory


@dataclass(frozen=True)
class Linear:
    """One-sample steps of the plain devices along a trajectory: A (N, B, 4, 4), G (N, B, 4, 2) by acceleration."""

    a: Array
    g: Array


@dataclass(frozen=True)
class Change:
    """What differs from the plain device: of the step (N, 4, B), of the sensors (N, 3, B)."""

    step: Array
    sensors: Array


def change(trace: Trace, columns: Columns, disturbed: bool = True, substeps: int = SUBSTEPS) -> Change:
    """The effects' share in the steps and sensors of a trace; not `disturbed`: the disturbance's share as well.

    substeps: those of the trace.
    """
    states = trace.states
    x, torque = states[:-1].transpose(1, 0, 2), trace.torque
    push = columns.push[WARM * PIECES :].reshape(len(torque), PIECES, 2, -1).transpose(1, 2, 0, 3)
    plain = coast(columns.device, x, torque, push if disturbed else None, substeps=substeps)
    return Change(states[1:] - plain.transpose(1, 0, 2), trace.clean - states[:-1, :3])


def linear(trace: Trace, device: Body) -> Linear:
    """Finite differences of the plain step at each sample."""
    x, torque = trace.states[:-1].transpose(1, 0, 2), trace.torque
    nominal = coast(device, x, torque, substeps=COARSE)
    zero = np.zeros(torque.shape)
    shifts = STEP * np.eye(4)
    a = [coast(device, x + shifts[i][:, None, None], torque, substeps=COARSE) for i in range(4)]
    pushes = (np.stack((zero + 1, zero)), np.stack((zero, zero + 1)))
    g = [coast(device, x, torque, extra=push, substeps=COARSE) for push in pushes]
    return Linear((np.stack(a) - nominal).transpose(2, 3, 1, 0) / STEP, (np.stack(g) - nominal).transpose(2, 3, 1, 0))


def tangent(trace: Trace, steps: Linear) -> Array:
    """Change of the one-sample step by each entry J, K, L, (N, B, 4, 8)."""
    rows = len(trace.torque)
    pieces = trace.history[: rows * PIECES].reshape(rows, PIECES, 4, -1)
    after = trace.history[1 : rows * PIECES + 1].reshape(rows, PIECES, 4, -1)
    middle = (pieces + after) / 2
    regressors = np.stack(
        (middle[:, :, 1].mean(1), middle[:, :, 3].mean(1), np.sin(middle[:, :, 2]).mean(1), trace.torque), axis=-1
    )
    # theta'' and psi'' have the same four regressors
    return np.concatenate([steps.g[..., i : i + 1] * regressors[:, :, None, :] for i in (0, 1)], axis=-1)


def gram(trace: Trace, columns: Columns, colours: Sequence[Colour], sigmas: Array, changes: Sequence[Change]) -> Array:
    """Gram matrices (B, 8 + C, 8 + C) of the whitened entries and C changes; sigmas (3, B) of the sensors."""
    size = trace.torque.shape[1]
    parts = []
    for first in range(0, size, CHUNK):
        cut = slice(first, min(first + CHUNK, size))
        part = trace.cut(cut)
        device = _cut(columns.device, cut)
        steps = linear(part, device)
        by_step = np.stack([c.step[..., cut].transpose(0, 2, 1) for c in changes], axis=-1)
        by_sensor = np.stack([c.sensors[..., cut].transpose(0, 2, 1) for c in changes], axis=-1)
        step = np.concatenate((tangent(part, steps), by_step), axis=-1)
        sensor = np.concatenate((np.zeros((*by_sensor.shape[:3], ENTRIES)), by_sensor), axis=-1)
        model = _Filter(steps, device, colours[cut], sigmas[:, cut], np.isnan(part.rows[:, 2]))
        parts.append(model.gram(step, sensor))
    return np.concatenate(parts)


def sigmas_of(dtheta: Array, psi: Array) -> Array:
    """(3, B) standard deviations of theta (one count, uniform), theta' and psi."""
    return np.stack((np.full_like(dtheta, COUNT_RAD / np.sqrt(12.0)), dtheta, psi))


def gain(grams: Array, column: int = 0) -> float:
    """Nats of one change, from the summed Gram matrix (8 + C, 8 + C) of all training recordings."""
    keep, one = slice(0, ENTRIES), ENTRIES + column
    # columns in units of their own length: the entries differ by orders of magnitude
    scale = np.sqrt(np.maximum(np.diag(grams)[keep], 1e-300))
    normal = grams[keep, keep] / np.outer(scale, scale)
    seen = grams[keep, one] / scale
    left = grams[one, one] - seen @ np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ seen
    return float(max(left, 0.0) / 2)


def _cut(device: Body, cut: slice) -> Body:
    own = (getattr(device, one.name) for one in fields(device) if one.name != "given")
    return Body(*(x[cut] for x in own), given={k: v[cut] for k, v in device.given.items()})


class _Filter:
    """Kalman filter over a batch: six states, theta, theta', psi, psi' and the two disturbance torques."""

    def __init__(self, steps: Linear, device: Body, colours: Sequence[Colour], sigmas: Array, missing: Array) -> None:
        self.steps = steps
        inverse = np.stack((np.stack((device.i11, device.i12)), np.stack((device.i12, device.i22)))).transpose(2, 0, 1)
        self.by_torque = steps.g @ inverse  # (N, B, 4, 2)
        rms = np.array([c.rms_nm for c in colours])
        r = SAMPLE_S / np.array([c.time_s for c in colours])  # (B, 2)
        self.keep, self.mean = np.exp(-r), (1 - np.exp(-r)) / r
        # mean over the sample and value at its end, given the value at its start: x' = -x/T + noise, variance rms^2
        self.var_mean = rms**2 * (2 * r - 3 + 4 * np.exp(-r) - np.exp(-2 * r)) / r**2
        self.var_end = rms**2 * (1 - np.exp(-2 * r))
        self.cov = rms**2 * (1 - np.exp(-r)) ** 2 / r
        self.r = np.broadcast_to(np.square(sigmas).T, (len(missing), *sigmas.T.shape)).copy()  # (N, B, 3)
        self.missing = missing
        self.r[..., 2][missing] *= BLIND
        self.start = np.concatenate((np.broadcast_to(np.square(KNOWS_NOTHING), (len(rms), 4)), rms**2), axis=1)

    def gram(self, step: Array, sensor: Array) -> Array:
        """Sum of e e' (B, C, C) over all samples, e the whitened columns; step (N, B, 4, C), sensor (N, B, 3, C)."""
        size, count = step.shape[1], step.shape[3]
        sensor = np.where(self.missing[..., None, None] & (np.arange(3) == 2)[:, None], 0.0, sensor)
        total, bias = np.zeros((size, count, count)), np.zeros((size, 6, count))
        p = self.start[..., None] * np.eye(6)
        for k in range(len(step)):
            s = p[:, :3, :3] + self.r[k][..., None] * np.eye(3)
            lower = np.linalg.cholesky(s)
            seen = bias[:, :3] + sensor[k]
            e = np.linalg.solve(lower, seen)
            total += e.transpose(0, 2, 1) @ e
            gain_t = np.linalg.solve(s, p[:, :3])
            bias = bias - gain_t.transpose(0, 2, 1) @ seen
            p = p - gain_t.transpose(0, 2, 1) @ p[:, :3]
            f, q = self._transition(k)
            bias = f @ bias
            bias[:, :4] += step[k]
            p = f @ p @ f.transpose(0, 2, 1) + q
            p = (p + p.transpose(0, 2, 1)) / 2
        return total

    def _transition(self, k: int) -> tuple[Array, Array]:
        """F and Q (B, 6, 6) of sample k."""
        g = self.by_torque[k]
        f = np.zeros((len(g), 6, 6))
        f[:, :4, :4] = self.steps.a[k]
        f[:, :4, 4:] = g * self.mean[:, None, :]
        f[:, (4, 5), (4, 5)] = self.keep
        q = np.zeros_like(f)
        q[:, :4, :4] = (g * self.var_mean[:, None, :]) @ g.transpose(0, 2, 1)
        q[:, :4, 4:] = g * self.cov[:, None, :]
        q[:, 4:, :4] = q[:, :4, 4:].transpose(0, 2, 1)
        q[:, (4, 5), (4, 5)] = self.var_end
        return f, q
