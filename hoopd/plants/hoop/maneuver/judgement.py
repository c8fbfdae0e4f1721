"""What became of a maneuver, judged from what was recorded of it.

Rules of this file: arrays in, a record out; nothing is read, nothing is believed that was not recorded.
"""

from __future__ import annotations

from math import inf, isnan, nan, pi, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

Array = NDArray[np.float64]

# A ball at the bottom: 0.1 rad are 9 mm; a hoop that nearly stands.
SETTLED_RAD, SETTLED_HOOP_RAD_S = 0.1, 3.0
SETTLE_WITHIN_S = 2.0
# Of a throw, three ticks: in 0.06 s a ball falls by 18 mm, a fifth of the way across.
LEAST_FLIGHT_S = 0.05
# On the top of the inner hoop: so near to it, at once for so long.
TOP_RAD, LEAST_TOP_S = 0.3, 1.0
# Of the planned angle: a swing that ends short of this is none. Feedback on a drive of seven tenths brings it to more.
LEAST_SWING_SHARE = 0.75
# A ball on the hoop is seen within a fiftieth of its track.
OFF_TRACK = 0.95


class RecordedManeuver(NamedTuple):
    """A stretch of a run: one maneuver and what came after it.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times of the ticks, s, from the maneuver's beginning on.
    torques : ndarray, shape (n,)
        Held from each tick to the next, N m.
    states : ndarray, shape (n, 4)
        Estimated theta, dtheta, psi, dpsi.
    seen_t, seen : ndarray, shape (n,)
        psi as the camera saw it, rad, and when; NaN without a picture.
    ended_t : float
        When the maneuver ended, s.
    distance : ndarray, shape (n,), optional
        Of the ball from the axis in the pictures, in shares of what it is on the hoop; NaN without a ball.
    inner, air : ndarray of bool, shape (n,), optional
        Whether the ball was on the inner hoop, and whether on none, by the estimate.
    """

    t: Array
    torques: Array
    states: Array
    seen_t: Array
    seen: Array
    ended_t: float
    distance: Array | None = None
    inner: NDArray[np.bool_] | None = None
    air: NDArray[np.bool_] | None = None

    @property
    def bottom(self) -> float:
        """The bottom from which it begins, rad."""
        return tau * round(float(self.states[0, 2]) / tau)


class ManeuverOutcome(NamedTuple):
    """Of one maneuver.

    Attributes
    ----------
    turns : int or None
        Whole turns of the ball, as psi counts, to the bottom that the last picture is nearest to; None without any.
    least_contact : float
        Least force between the ball and the hoop that it was on while it was played, in weights of the ball; where the
        estimate told no flight, of the outer one throughout.
    settled_s : float
        After its end, until ball and hoop stay settled; infinite when they do not, NaN where nothing after its end was
        recorded with the law acting: it was stopped.
    range_rad : tuple of float
        Lowest and highest angle that the camera saw, from where it began.
    loose_s : float
        How long the ball moved, for its longest time at once, as none does that a hoop holds.
    least_distance : float
        Of the ball from the axis while it was played, as of the recording; NaN where no picture told it.
    top_s : float
        How long the camera saw the ball near the top, for its longest time at once.
    """

    turns: int | None
    least_contact: float
    settled_s: float
    range_rad: tuple[float, float]
    loose_s: float
    least_distance: float = nan
    top_s: float = 0.0

    @property
    def flew(self) -> bool:
        """A picture showed the ball off the hoop, or it moved as none does that a hoop holds."""
        return self.least_distance < OFF_TRACK or self.loose_s >= LEAST_FLIGHT_S

    @property
    def largest_angle_rad(self) -> float:
        """Furthest from where it began, on either side."""
        return max(-self.range_rad[0], self.range_rad[1])

    def shortfalls(self, kind: str, turn: int, planned_rad: float) -> tuple[str, ...]:
        """What a maneuver of this kind lacks to be one, `planned_rad` the largest angle of its plan; empty: it
        succeeded."""
        if self.turns is None or isnan(self.least_contact):
            return ("too little was recorded of it",)
        wanted = 0 if kind == "swing" else turn
        found = []
        if kind != "up" and self.turns != wanted:
            found.append(f"went round {self.turns:+d} times, not {wanted:+d}")
        swung = self.range_rad[1] if turn > 0 else 0.0 - self.range_rad[0]
        if kind == "swing" and not swung >= LEAST_SWING_SHARE * planned_rad:
            found.append(f"swung by {swung:.2g} rad, not by {planned_rad:.2g}")
        if kind == "throw" and not self.flew:
            found.append("the ball did not leave the hoop")
        if kind == "up" and not (self.flew and self.top_s >= LEAST_TOP_S):
            found.append(f"on the top for {self.top_s:.2f} s, not {LEAST_TOP_S:g}")
        if kind not in ("throw", "up") and not self.least_contact > 0.0:
            found.append(f"the contact was lost ({self.least_contact:.2f} of the ball's weight)")
        if isnan(self.settled_s):
            found.append("stopped, and not seen settling")
        elif not self.settled_s <= SETTLE_WITHIN_S:
            found.append(f"not settled within {SETTLE_WITHIN_S:g} s")
        return tuple(found)


class AngleErrors(NamedTuple):
    """Of the ball while a maneuver was played, by its pictures, rad rms; NaN without any.

    Attributes
    ----------
    plan : float
        How far it was from where it was planned to be.
    estimate : float
        How far from where the filter believed it; what a picture errs by is in it.
    """

    plan: float
    estimate: float


def angle_errors(run: RecordedManeuver, planned: Array, period_s: float) -> AngleErrors:
    """How far the ball's angle was off.

    Parameters
    ----------
    run : RecordedManeuver
        From its first tick on.
    planned : ndarray, shape (m, 4)
        Theta, dtheta, psi, dpsi at the maneuver's ticks.
    period_s : float
        From tick to tick, s.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.judgement import RecordedManeuver, angle_errors
    >>> t = np.arange(0.0, 1.0, 0.02)
    >>> steady = np.column_stack([0 * t, 0 * t, t, 0 * t + 1.0])
    >>> run = RecordedManeuver(t, 0 * t, steady + [0.0, 0.0, 0.01, 0.0], t, t + 0.03, 1.0)
    >>> [round(one, 3) for one in angle_errors(run, steady, 0.02)]
    [0.03, 0.02]
    """
    if len(run.t) < 2:
        return AngleErrors(nan, nan)
    planned_t = run.t[0] + period_s * np.arange(len(planned))
    last = min(run.ended_t, planned_t[-1], run.t[-1])
    at = np.isfinite(run.seen) & (run.seen_t >= run.t[0]) & (run.seen_t <= last)
    # with the speed: in a straight line from tick to tick a ball that goes round is 0.01 rad off
    courses = [CubicHermiteSpline(t, x[:, 2], x[:, 3]) for t, x in ((planned_t, planned), (run.t, run.states))]
    off = [course(run.seen_t[at]) - run.seen[at] for course in courses]
    # the nearest turn: a plan begins at the bottom whichever turn that is
    return AngleErrors(*(_rms(one - tau * np.round(one / tau)) for one in off))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else nan


def judge_maneuver(
    run: RecordedManeuver, track_m: float, gravity_m_s2: float, inner_track_m: float = nan
) -> ManeuverOutcome:
    """Judge one maneuver, of one that was stopped what was played of it.

    Parameters
    ----------
    run : RecordedManeuver
        From its first tick to the last one before the next, or to the one in which it was stopped.
    track_m : float
        Ro - Rb in m.
    gravity_m_s2 : float
        In m/s^2.
    inner_track_m : float
        Ri + Rb in m; NaN without an inner hoop: what presses a ball on it is not judged then.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.judgement import RecordedManeuver, judge_maneuver
    >>> t = np.arange(0.0, 3.0, 0.02)
    >>> rest = RecordedManeuver(t, 0 * t, np.zeros((150, 4)), t, 0 * t, 1.0)
    >>> judge_maneuver(rest, 0.085, 9.81)  # doctest: +NORMALIZE_WHITESPACE
    ManeuverOutcome(turns=0, least_contact=1.0, settled_s=0.0, range_rad=(0.0, 0.0), loose_s=0.0, least_distance=nan,
                    top_s=0.0)
    """
    played, after = run.t <= run.ended_t, run.t > run.ended_t
    ball = run.seen[np.isfinite(run.seen)]
    if not ball.size or not played.any():
        return ManeuverOutcome(None, nan, nan, (nan, nan), nan)
    bottom = tau * round(float(ball[-1]) / tau)
    states, nowhere = run.states[played], np.zeros(len(run.t), bool)
    inner, air = ((nowhere if told is None else told)[played] for told in (run.inner, run.air))
    outer = weights_on(states, track_m, gravity_m_s2)
    contact = np.where(inner, -weights_on(states, inner_track_m, gravity_m_s2), np.where(air, nan, outer))
    turns = round((bottom - float(ball[0])) / tau)
    # a flight is one whatever the estimate calls it
    loose = _longest(run.t[played], ~inner & (outer < 0.0))
    near = nan if run.distance is None else float(np.fmin.reduce(run.distance[played]))
    seen = (float(ball.min() - ball[0]), float(ball.max() - ball[0]))
    least = float(np.fmin.reduce(contact))
    return ManeuverOutcome(turns, least, _settled_s(run, after, bottom), seen, loose, near, _on_top(run, played))


def weights_on(states: Array, track_m: float, gravity_m_s2: float) -> Array:
    """N / (m g) of a ball within a track, (r psi'^2 + g cos psi) / g, along states (n, 4); outside of it this is what
    pulls it off."""
    with np.errstate(over="ignore", invalid="ignore"):  # of what runs away on another model
        return np.asarray((track_m * states[:, 3] ** 2 + gravity_m_s2 * np.cos(states[:, 2])) / gravity_m_s2)


def _settled_s(run: RecordedManeuver, after: NDArray[np.bool_], bottom: float) -> float:
    """From its end until ball and hoop stay at a bottom, s."""
    if not after.any():
        return nan
    off = np.abs(np.where(np.isfinite(run.seen), run.seen, run.states[:, 2]) - bottom) > SETTLED_RAD
    restless = after & (off | (np.abs(run.states[:, 1]) > SETTLED_HOOP_RAD_S))
    last = run.t[restless][-1] if restless.any() else run.ended_t
    return float(last - run.ended_t) if last < run.t[-1] else inf


def _on_top(run: RecordedManeuver, played: NDArray[np.bool_]) -> float:
    """How long at once, by the pictures; a tick without one goes on as the one before."""
    seen = played & np.isfinite(run.seen)
    off = np.abs(np.remainder(run.seen[seen], tau) - pi)
    return _longest(run.t[seen], off < TOP_RAD)


def _longest(t: Array, holds: NDArray[np.bool_]) -> float:
    """The longest time at once, s."""
    if not t.size:
        return 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(int), [0]])))
    after = np.append(t, t[-1])
    return max((float(after[end] - after[begin]) for begin, end in edges.reshape(-1, 2)), default=0.0)
