"""From when on a deadline counts: the fault, the first report that is 5 sigma from the truth, a speed beyond a limit.

Rules of this file: times are on the clock of the torque log; a moment that never came is inf; what is reported is read
from the recording, what is true from the rig's own file.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterator

import numpy as np

from hoopd.sim.board import BoardConfig
from hoopd.sim.truth import Column, Truth

from .kind import Kind
from .trials import Trial

# Standard deviations of what the board reports: an angle by whole counts, a speed with its noise.
CONSTANTS = BoardConfig()
SIGMA_THETA_RAD = 2 * math.pi / CONSTANTS.counts_per_turn / math.sqrt(12)
SIGMA_DTHETA_RAD_S = CONSTANTS.dtheta_noise
SIGMA_PSI_RAD = 1e-4  # at least; the camera's own is measured before the fault
DEPARTED = 5.0  # so many of them are a lie
SAMPLED = ("request", "refused", "cleared", "fault")  # rows at whose time the board took a sample


def begin(kind: Kind, trial: Trial) -> float:
    """The instant from which the deadline counts."""
    if kind.since == "hoop departs":
        return hoop_departs(trial)
    if kind.since == "ball departs":
        return ball_departs(trial)
    if kind.since == "overspeed":
        return overspeed(trial.truth, overspeed_limit(kind), trial.at)
    return trial.at


def overspeed_limit(kind: Kind) -> float:
    """What the board of this kind cuts at, in rad/s."""
    return float(kind.sim.get("board", {}).get("overspeed_rad_s", CONSTANTS.overspeed_rad_s))


def overspeed(true: Truth, limit_rad_s: float, start: float) -> float:
    """When the true speed passes a limit.

    The board cuts between two rows, so that none of them is beyond the limit: the straight line through a row and the
    one before it tells when the hoop would have been there, had the torque stayed."""
    t, speed = true.t, np.abs(true.dtheta)
    slope = np.diff(speed) / np.diff(t)
    for row in np.flatnonzero(t[1:] >= start) + 1:
        rest_s = (limit_rad_s - speed[row]) / slope[row - 1] if slope[row - 1] > 0.0 else math.inf
        if rest_s <= t[row] - t[row - 1]:
            return float(t[row] + rest_s)
    return math.inf


def hoop_departs(trial: Trial) -> float:
    """When the reported angle or speed of the hoop is first 5 sigma away from the true one."""
    before: list[float] = []  # half a count, and whole turns
    for t, theta, dtheta in _hoop_errors(trial):
        if t < trial.at:
            before.append(theta)
        elif before:
            off = abs(theta - np.median(before[-50:])) / SIGMA_THETA_RAD
            if max(off, abs(dtheta) / SIGMA_DTHETA_RAD_S) > DEPARTED:
                return t
    return math.inf


def _hoop_errors(trial: Trial) -> Iterator[tuple[float, float, float]]:
    """Time of each sample, and by how much angle and speed are reported wrong."""
    # The board samples as it takes a request, and tells the time in its log.
    sampled = [row.t for row in trial.run.torque.rows if row.reason in SAMPLED]
    true = trial.truth
    for tick in trial.run.ticks:
        index = bisect_left(sampled, tick.y_t + trial.zero - 1e-3) if math.isfinite(tick.y_t) else len(sampled)
        if index < len(sampled):
            theta, dtheta = motion(true.t, true.theta, true.dtheta, sampled[index])
            yield sampled[index], tick.theta - theta, tick.dtheta - dtheta


def ball_departs(trial: Trial) -> float:
    """When the angle that pictures give is first 5 of the camera's own sigma away from the true one."""
    rows = [(t, error) for t, error in ball_errors(trial) if t >= trial.at - 1.0]
    before = np.array([error for t, error in rows if t < trial.at])
    if not len(before):
        return math.inf
    usual = float(np.median(before))
    # the median of the distances is 0.674 sigma
    sigma = max(float(np.median(np.abs(before - usual))) / 0.674, SIGMA_PSI_RAD)
    return next((t for t, error in rows if t >= trial.at and abs(error - usual) > DEPARTED * sigma), math.inf)


def ball_errors(trial: Trial) -> list[tuple[float, float]]:
    """Time of each picture with a ball, and by how much its angle is wrong, in rad."""
    samples = [row.camera for row in trial.run.inputs if row.camera is not None and math.isfinite(row.camera.psi)]
    true = trial.truth
    return [
        (t, math.remainder(sample.psi - motion(true.t, true.psi, true.dpsi, t)[0], math.tau))
        for sample in samples
        if true.t[0] <= (t := sample.t + trial.zero) <= true.t[-1]
    ]


def motion(times: Column, angle: Column, rate: Column, t: float) -> tuple[float, float]:
    """Angle and its rate at `t`: the cubic through two states and their rates."""
    row = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    h = float(times[row + 1] - times[row])
    s = (t - float(times[row])) / h
    a, b, va, vb = (float(column[row + k]) for column in (angle, rate) for k in (0, 1))
    bend, twist = 3.0 * (b - a) - h * (2.0 * va + vb), h * (va + vb) - 2.0 * (b - a)
    return a + s * (h * va + s * (bend + s * twist)), va + s * (2.0 * bend + 3.0 * s * twist) / h
