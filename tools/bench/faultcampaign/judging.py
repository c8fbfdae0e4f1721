"""The judge of a trial: the board's own log of torque, the plant's true state, and never the daemon's word.

Rules of this file: a verdict lists what is wrong; nothing here starts a process or knows a kind by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from harness.realrun import gaps_in
from harness.runs import TORQUE_LIMIT_NM

from hoopd.daemon.replay import replay

from .kind import LOOK_S, NOTHING_TO_SAY, Kind
from .onset import ball_errors, begin, overspeed_limit
from .trials import Trial

MARGIN_S = 0.1  # zero torque this long after the deadline that the rule sets
LONGEST_PAUSE_S = 0.06  # without torque while control goes on: a lost request or two
# While the board looks, the largest torque adds this: 0.7 N m give 0.42 rad/s a millisecond.
OVERSHOOT_RAD_S = 450.0 * LOOK_S

Gaps = Callable[[float, float], object]  # whether the machine stood still between two instants


@dataclass
class Verdict:
    """What is known of one trial."""

    kind: str
    outcome: str
    deadline_s: float
    trial: int = 0
    began_s: float = math.nan  # run time from which the deadline counts
    zero_s: float = math.nan  # measured from there; NaN where control went on
    max_torque_nm: float = math.nan
    late_torque_nm: float = math.nan  # the most from the fault on
    max_speed_rad_s: float = math.nan  # true
    ball_off_rad: float = math.nan  # the most by which pictures are wrong from the fault on
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
    verdict.max_torque_nm = run.torque.max_abs()
    verdict.late_torque_nm = run.torque.max_abs(trial.at, math.inf)
    verdict.max_speed_rad_s = float(np.abs(trial.truth.dtheta).max())
    verdict.ball_off_rad = max((abs(error) for t, error in ball_errors(trial) if t >= trial.at), default=math.nan)
    verdict.demand(verdict.max_torque_nm <= TORQUE_LIMIT_NM, f"torque {verdict.max_torque_nm:.3f} N m")
    verdict.controlled = run.torque.max_abs(trial.at - 0.1, trial.at) > 0.0
    verdict.demand(verdict.controlled, f"no torque before the fault, {_first_fault(trial, -math.inf) or 'no reason'}")
    verdict.demand(run.torque.rows[-1].torque_nm == 0.0, "torque at the end")
    verdict.demand(trial.exit_code == kind.exit_code, f"exit code {trial.exit_code}")
    _opens(verdict, trial)
    verdict.message = message(kind, trial)
    _followed(verdict, kind, trial, stood_still)
    return verdict


def _followed(verdict: Verdict, kind: Kind, trial: Trial, stood_still: Gaps) -> None:
    """What came of the fault."""
    since = begin(kind, trial)
    verdict.began_s = since - trial.zero
    if kind.outcome == "untold":
        return
    verdict.demand(bool(verdict.message), f"no message names {' or '.join(kind.causes)}")
    verdict.demand(math.isfinite(since), f"'{kind.since}' was never seen")
    if kind.outcome == "goes on":
        _went_on(verdict, trial, stood_still)
    elif math.isfinite(since):
        _went_off(verdict, kind, trial, since)


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
        limit = overspeed_limit(kind) + OVERSHOOT_RAD_S
        verdict.demand(verdict.max_speed_rad_s <= limit, f"hoop at {verdict.max_speed_rad_s:.1f} rad/s")


def _opens(verdict: Verdict, trial: Trial) -> None:
    results = [replay(path) for path in trial.run.recordings[:1]]
    verdict.opens = bool(results) and all(result["equal"] for result in results)
    verdict.demand(verdict.opens, "; ".join(r["first_difference"] for r in results) or "no recording")


# --- what was said ---------------------------------------------------------------------------------------------------


def message(kind: Kind, trial: Trial) -> str:
    """The words that name the cause, from the fault on; of a lie that nothing tells, whatever was said."""
    if kind.causes == NOTHING_TO_SAY:
        return "-"
    if kind.outcome == "untold":
        return _first_fault(trial, trial.at)
    run, since = trial.run, trial.at - trial.zero - MARGIN_S
    told = [
        (line["t"], f"{line['event']}: {line.get('meaning') or line.get('reason') or line.get('command')}")
        for line in run.log
        if {line.get("fault"), line["event"], line.get("command")} & set(kind.causes)
    ]
    # the recording tells more than the log
    begun = [row for row in run.events if row.event == "fault" and row.fields["fault"] in kind.causes]
    told += [(row.t, f"fault: {row.fields['meaning']}") for row in begun]
    if words := min((row for row in told if row[0] >= since), default=None):
        return f"{words[0]:.2f} s {words[1]}"
    link = run.summary.get("link", {})
    return ", ".join(f"{name} {link[name]}" for name in kind.causes if name in link)


def _first_fault(trial: Trial, since: float) -> str:
    """The first fault from then on that ended control; nothing when there was none."""
    for row in trial.run.events:
        ends = row.fields.get("action") in ("stop", "cut", "pause")
        if row.event == "fault" and ends and row.t >= since - trial.zero:
            return f"{row.t:.2f} s {row.fields['fault']}"
    return ""
