"""The judge of a trial: the board's own log of torque, the plant's true state, and never the daemon's word.

Rules of this file: a verdict lists what is wrong; nothing here starts a process or knows a kind by its name.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from system.realrun import gaps_in
from system.runs import TORQUE_LIMIT_NM

from hoopd.replay import replay
from hoopd.sim.board import BoardConfig
from hoopd.sim.truth import Truth

from .kinds import LOOK_S, NOTHING_TO_SAY, Kind
from .trials import Trial

MARGIN_S = 0.1  # zero torque this long after the deadline that the rule sets
LONGEST_PAUSE_S = 0.06  # without torque while control goes on: a lost request or two
# Standard deviations of what the board reports: an angle by whole counts, a speed with its noise.
CONSTANTS = BoardConfig()
SIGMA_THETA_RAD = 2 * math.pi / CONSTANTS.counts_per_turn / math.sqrt(12)
SIGMA_DTHETA_RAD_S = CONSTANTS.dtheta_noise
DEPARTED = 5.0  # so many of them are a lie
# While the board looks, the largest torque adds this: 0.7 N m give 0.42 rad/s a millisecond.
OVERSHOOT_RAD_S = 450.0 * LOOK_S

Gaps = Callable[[float, float], object]  # whether the machine stood still between two instants


@dataclass
class Verdict:
    """One row of the table."""

    kind: str
    outcome: str
    deadline_s: float
    began_s: float = math.nan  # run time from which the deadline counts
    zero_s: float = math.nan  # measured from there; NaN where control went on
    max_torque_nm: float = math.nan
    max_speed_rad_s: float = math.nan  # true
    controlled: bool = True  # when the fault came
    opens: bool = False
    message: str = ""
    wrong: list[str] = field(default_factory=list)
    attempts: int = 1

    def demand(self, fine: bool, what: str) -> None:
        """Note what is wrong."""
        if not fine:
            self.wrong.append(what)


def judge(name: str, kind: Kind, trial: Trial, stood_still: Gaps) -> Verdict:
    """What a trial says of one kind."""
    verdict, run = Verdict(name, kind.outcome, kind.deadline_s), trial.run
    since = begin(kind, trial)
    verdict.began_s = since - trial.zero
    verdict.max_torque_nm = run.torque.max_abs()
    verdict.max_speed_rad_s = float(np.abs(trial.truth.dtheta).max())
    verdict.demand(verdict.max_torque_nm <= TORQUE_LIMIT_NM, f"torque {verdict.max_torque_nm:.3f} N m")
    verdict.controlled = run.torque.max_abs(trial.at - 0.1, trial.at) > 0.0
    verdict.demand(verdict.controlled, "no torque before the fault")
    verdict.demand(run.torque.rows[-1].torque_nm == 0.0, "torque at the end")
    verdict.demand(trial.exit_code == kind.exit_code, f"exit code {trial.exit_code}")
    verdict.demand(math.isfinite(since), f"no {kind.since} was seen")
    if kind.outcome == "goes on":
        _went_on(verdict, trial, stood_still)
    elif math.isfinite(since):
        _went_off(verdict, kind, trial, since)
    _opens(verdict, trial)
    verdict.message = message(kind, trial)
    verdict.demand(bool(verdict.message), f"no message names {' or '.join(kind.causes)}")
    return verdict


# --- from when on ----------------------------------------------------------------------------------------------------


def begin(kind: Kind, trial: Trial) -> float:
    """The instant from which the deadline counts; inf when it never came."""
    if kind.since == "departure":
        return departure(trial)
    if kind.since == "overspeed":
        limit = kind.sim.get("board", {}).get("overspeed_rad_s", CONSTANTS.overspeed_rad_s)
        return overspeed(trial.truth, limit, trial.at)
    return trial.at


def overspeed(true: Truth, limit_rad_s: float, start: float) -> float:
    """When the true speed passes a limit; inf when it never does.

    The board cuts between two rows, so that none of them is beyond the limit: the straight line through a row and the
    one before it tells when the hoop would have been there, had the torque stayed."""
    t, speed = true.t, np.abs(true.dtheta)
    slope = np.diff(speed) / np.diff(t)
    for row in np.flatnonzero(t[1:] >= start) + 1:
        rest_s = (limit_rad_s - speed[row]) / slope[row - 1] if slope[row - 1] > 0.0 else math.inf
        if rest_s <= t[row] - t[row - 1]:
            return float(t[row] + rest_s)
    return math.inf


def departure(trial: Trial) -> float:
    """When the reported angle or speed of the hoop is first 5 sigma away from the true one; inf when it never is."""
    sampled = [row.t for row in trial.run.torque.rows if row.reason in ("request", "refused", "cleared", "fault")]
    offsets: list[float] = []
    for tick in trial.run.ticks:
        # The board samples as it takes a request, and tells the time in its log.
        index = bisect_left(sampled, tick.y_t + trial.zero - 1e-3) if math.isfinite(tick.y_t) else len(sampled)
        if index == len(sampled):
            continue
        theta, dtheta = motion(trial.truth, sampled[index])
        if sampled[index] < trial.at:
            offsets.append(tick.theta - theta)  # half a count, and whole turns
        elif offsets:
            off = abs(tick.theta - theta - np.median(offsets[-50:])) / SIGMA_THETA_RAD
            if max(off, abs(tick.dtheta - dtheta) / SIGMA_DTHETA_RAD_S) > DEPARTED:
                return sampled[index]
    return math.inf


def motion(true: Truth, t: float) -> tuple[float, float]:
    """True angle and speed of the hoop: the cubic through two states and their rates."""
    row = int(np.clip(np.searchsorted(true.t, t, side="right") - 1, 0, len(true.t) - 2))
    h = float(true.t[row + 1] - true.t[row])
    s = (t - float(true.t[row])) / h
    a, b, va, vb = (float(column[row + k]) for column in (true.theta, true.dtheta) for k in (0, 1))
    bend, twist = 3.0 * (b - a) - h * (2.0 * va + vb), h * (va + vb) - 2.0 * (b - a)
    return a + s * (h * va + s * (bend + s * twist)), va + s * (2.0 * bend + 3.0 * s * twist) / h


# --- what followed ---------------------------------------------------------------------------------------------------


def _went_on(verdict: Verdict, trial: Trial, stood_still: Gaps) -> None:
    run, at, zero = trial.run, trial.at, trial.zero
    stop = at + 1.5
    rows = [row for row in run.torque.rows if at <= row.t <= stop]
    pauses = [b.t - a.t for a, b in pairwise(rows) if a.torque_nm == 0.0]
    verdict.demand(max(pauses, default=0.0) <= LONGEST_PAUSE_S, f"no torque for {max(pauses, default=0.0):.3f} s")
    verdict.demand(run.torque.torque_at(stop) != 0.0, "control did not go on")
    missed = [(t, n) for t, n in gaps_in(run, at - zero, stop - zero) if not stood_still(zero + t - 0.2, zero + t)]
    verdict.demand(not missed, f"missed ticks {missed}")


def _went_off(verdict: Verdict, kind: Kind, trial: Trial, since: float) -> None:
    run, at = trial.run, trial.at
    # A pause ends with the ball; the others only with the operator, who never comes here.
    stop = at + 1.0 if kind.outcome == "pause" else math.inf
    spans = [row for row in run.torque.rows if row.torque_nm != 0.0 and row.t < stop]
    after = [row.t for row in run.torque.rows if row.t > spans[-1].t] if spans else []
    verdict.zero_s = max(after[0] - since, 0.0) if after else math.inf
    verdict.demand(verdict.zero_s <= kind.deadline_s + MARGIN_S, f"torque until {verdict.zero_s:.3f} s")
    if kind.outcome == "pause":
        verdict.demand(run.torque.max_abs(stop + 0.5, stop + 1.0) > 0.0, "control did not come back with the ball")
    if kind.outcome == "bounded" or kind.since == "overspeed":
        limit = kind.sim.get("board", {}).get("overspeed_rad_s", CONSTANTS.overspeed_rad_s) + OVERSHOOT_RAD_S
        verdict.demand(verdict.max_speed_rad_s <= limit, f"hoop at {verdict.max_speed_rad_s:.1f} rad/s")


def _opens(verdict: Verdict, trial: Trial) -> None:
    results = [replay(path) for path in trial.run.recordings[:1]]
    verdict.opens = bool(results) and all(result["equal"] for result in results)
    verdict.demand(verdict.opens, "; ".join(r["first_difference"] for r in results) or "no recording")


def message(kind: Kind, trial: Trial) -> str:
    """The words that name the cause, from the fault on."""
    if kind.causes == NOTHING_TO_SAY:
        return "-"
    run, since = trial.run, trial.at - trial.zero - MARGIN_S
    for cause in kind.causes:
        for line in run.log:
            if cause in (line.get("fault"), line["event"], line.get("command")) and line["t"] >= since:
                return f"{line['t']:.2f} s {line['event']}: {line.get('meaning') or line.get('reason') or cause}"
        for row in run.events:  # the recording tells more than the log
            if row.event == "fault" and row.fields["fault"] == cause and row.t >= since:
                return f"{row.t:.2f} s {row.event}: {row.fields['meaning']}"
    link = run.summary.get("link", {})
    return ", ".join(f"{name} {link[name]}" for name in kind.causes if name in link)
