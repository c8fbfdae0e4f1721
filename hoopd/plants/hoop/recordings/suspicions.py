"""What in a recording of the hoop may not be what it is called, in plain words: printed, never acted upon.

Rules of this file: nothing is changed and nothing refused; a threshold follows from the device (counts of the encoder,
limit of the torque, how the ball swings), never from one file; a doubt names the evidence, and what to do about it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.hoop.parameters import LIMIT_NM
from hoopd.recording.doubts import constant, damaged, finite, gaps, plural, wrapped
from hoopd.recording.recording import MISSED_STEPS, Column, Recording
from hoopd.recording.unwrap import unwrapped

COUNT_RAD = 2 * math.pi / 4096  # one count of the encoder
# The ball swings at 1 to 1.5 Hz. Well above that it moves against the torque and hardly at all; what still follows the
# torque there is no ball. (At a slow sine a real ball follows the torque with a correlation of 0.98.)
ABOVE_BALL_HZ = 3.0
FOLLOWS = 0.8  # correlation above ABOVE_BALL_HZ: a ball gives a negative one
PERIODS_AROUND = 3.0  # of ABOVE_BALL_HZ, until nothing is left of what the filter makes of an end
SHARE_ABOVE = 0.1  # of the torque's spread that must lie above ABOVE_BALL_HZ for that to be told
GAIN_TOLERANCE = 0.1  # dtheta against the slope of theta; scale of a sensor's calibration
SLOPE_CORRELATION = 0.9
# Second differences of ten times noise occur in every recording with steps of torque; twenty times does not.
OUTLIER_SIGMAS = 20.0
# Ten counts, and a twentieth of a radian: smaller jumps harm no fit.
OUTLIER_FLOORS = {"theta": 10 * COUNT_RAD, "dtheta": 0.0, "psi": 0.05}
# What the device can do by itself: the whole torque gives the bare hoop 460 rad/s^2, and a ball about half of that.
# In a step h it moves an angle by a h^2 / 2 off the middle of its neighbours, a speed by a h / 2.
LARGEST = {"theta": (500.0, 2), "dtheta": (500.0, 1), "psi": (250.0, 2)}
REPEAT_COUNTS = 3  # a hoop that moves this many counts in a step cannot give the same row again
MIN_ROWS = 20  # below that there is nothing to compare


def suspicions(recording: Recording, limit_nm: float = LIMIT_NM) -> list[str]:
    """One sentence for each thing in the recording that is worth a doubt; empty when there is none.

    `limit_nm`: what the drive can give.
    """
    checks = (
        damaged,
        gaps,
        partial(_torque, limit_nm=limit_nm),
        _hoop,
        _ball,
        _ball_is_current,
        _speed,
        _repeated,
        _outliers,
    )
    whole = unwrapped(recording)
    return [*wrapped(recording), *(sentence for check in checks for sentence in check(whole))]


def _torque(recording: Recording, limit_nm: float) -> Iterator[str]:
    u = finite(recording.u)
    if not len(u):
        yield "u is missing in every row: nothing says what drove the hoop"
    elif np.abs(u).max() > limit_nm * 1.01:
        yield f"u reaches {np.abs(u).max():.3g}, the drive's limit is {limit_nm:g} N m: another unit?"
    elif constant(u):
        yield f"u never changes ({u[0]:.3g} N m): no torque drives the recording"


def _hoop(recording: Recording) -> Iterator[str]:
    theta = finite(recording.theta)
    if not len(theta):
        yield "theta is missing in every row"
    elif np.ptp(theta) <= 1.5 * COUNT_RAD:
        yield "theta moves one count of the encoder at most: the hoop was held, or stuck"


def _ball(recording: Recording) -> Iterator[str]:
    psi = finite(recording.psi)
    if len(psi) and constant(psi):
        yield f"psi never changes ({psi[0]:.4g} rad): no ball; leave it out with --columns u,theta,dtheta,-"


def ball_is_current(recording: Recording) -> bool:
    """Whether psi follows the torque where no ball can: then it is another signal."""
    return next(_ball_is_current(recording), None) is not None


def _ball_is_current(recording: Recording) -> Iterator[str]:
    u, psi = _filled(recording.t, recording.u), _filled(recording.t, recording.psi)
    if u is None or psi is None:
        return
    fast_u, fast_psi = _fast(u, recording.sample_time_s), _fast(psi, recording.sample_time_s)
    if fast_u is None or fast_psi is None or fast_u.std() <= SHARE_ABOVE * u.std() or constant(psi):
        return
    if (fast := _correlation(fast_u, fast_psi)) > FOLLOWS:
        yield (
            f"psi follows u with correlation {_correlation(u, psi):.2f}, and {fast:.2f} above {ABOVE_BALL_HZ:g} Hz"
            " where a ball cannot: this may be a motor current; then load with --columns u,theta,dtheta,current"
        )


def _speed(recording: Recording) -> Iterator[str]:
    t, theta, dtheta = recording.t, recording.theta, recording.dtheta
    if len(t) < MIN_ROWS:
        return
    slope = (theta[2:] - theta[:-2]) / (t[2:] - t[:-2])
    both = np.isfinite(slope) & np.isfinite(dtheta[1:-1])
    slope, speed = slope[both], dtheta[1:-1][both]
    noise = COUNT_RAD / recording.sample_time_s
    if len(slope) < MIN_ROWS or slope.std() < 10 * noise:
        return
    correlation, gain = _correlation(slope, speed), float(slope @ speed / (slope @ slope))
    if correlation < SLOPE_CORRELATION:
        yield f"dtheta is not the slope of theta (correlation {correlation:.2f}): another signal, unit or sign?"
    elif abs(gain - 1) > GAIN_TOLERANCE:
        yield f"dtheta is {gain:.2f} times the slope of theta (correlation {correlation:.2f}): trust theta, not dtheta"


def repeated_rows(recording: Recording) -> NDArray[np.int64]:
    """Rows whose theta and dtheta are those of the row before although the hoop turns."""
    still = [np.diff(getattr(recording, name)) == 0 for name in ("theta", "dtheta")]
    moves = np.abs(recording.dtheta[1:]) * np.diff(recording.t) > REPEAT_COUNTS * COUNT_RAD
    return np.asarray(np.flatnonzero(still[0] & still[1] & moves) + 1)


def _repeated(recording: Recording) -> Iterator[str]:
    rows = repeated_rows(recording)
    if len(rows):
        first = f"{recording.t[rows[0]]:.6g} s"
        yield f"{len(rows)} row{plural(rows)} the same as the one before while the hoop turns (first at {first})"


def _outliers(recording: Recording) -> Iterator[str]:
    for name, floor in OUTLIER_FLOORS.items():
        acceleration, power = LARGEST[name]
        able = acceleration * recording.sample_time_s**power / 2 if len(recording) > 1 else 0.0
        places = _jumps(recording.t, getattr(recording, name), floor + able)
        if len(places):
            where = ", ".join(f"{recording.t[k]:.6g}" for k in places[:3]) + (", ..." if len(places) > 3 else "")
            yield f"{name} has {len(places)} outlier{plural(places)} (at {where} s): a slip of the sensor, or a hand"


def _jumps(t: Column, column: Column, floor: float) -> NDArray[np.int64]:
    """Rows that lie far from the line between their neighbours, against how far rows lie usually.

    Neighbours are rows next to each other: across missing ones a ball swings on, and nothing is a slip.
    """
    rows = np.flatnonzero(np.isfinite(column))
    if len(rows) < MIN_ROWS:
        return rows[:0]
    x, when = column[rows], t[rows]
    near = when[2:] - when[:-2] < 2.0 * MISSED_STEPS * float(np.median(np.diff(t)))
    share = (when[1:-1] - when[:-2]) / (when[2:] - when[:-2])
    away = np.where(near, np.abs(x[1:-1] - x[:-2] - share * (x[2:] - x[:-2])), 0.0)
    sigma = 1.4826 * float(np.median(away[near])) if near.any() else 0.0  # of a normal distribution with this median
    far = away > max(floor, OUTLIER_SIGMAS * sigma)
    peak = far & (away >= np.maximum(np.r_[0, away[:-1]], np.r_[away[1:], 0]))  # one slip spoils three differences
    places: NDArray[np.int64] = rows[1:-1][peak]
    return places


def _fast(x: Column, step_s: float) -> Column | None:
    """What a column holds above ABOVE_BALL_HZ (a third of it: 1e-4 is left), by a Butterworth filter of fourth order
    there and back; None when its steps do not suit that."""
    if not 1e-3 < ABOVE_BALL_HZ * step_s < 0.4:
        return None
    # by its share at every frequency: filters of scipy take half a second to import. Ends go on point-symmetrically
    around = min(math.ceil(PERIODS_AROUND / (ABOVE_BALL_HZ * step_s)), len(x) - 1)
    wide = np.pad(x, around, mode="reflect", reflect_type="odd")
    wide -= np.linspace(wide[0], wide[-1], len(wide))
    cut = np.tan(np.pi * ABOVE_BALL_HZ * step_s) ** 8
    power = np.tan(np.pi * np.fft.rfftfreq(len(wide))) ** 8
    passed: Column = np.fft.irfft(power / (power + cut) * np.fft.rfft(wide), len(wide))
    return passed[around : around + len(x)]


def _filled(t: Column, column: Column) -> Column | None:
    """The column with its few missing rows bridged; None when more than a tenth is missing."""
    there = np.isfinite(column)
    if len(t) < MIN_ROWS or there.mean() < 0.9:
        return None
    return np.interp(t, t[there], column[there])


def _correlation(a: Column, b: Column) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / max(math.sqrt((a @ a) * (b @ b)), np.finfo(float).tiny))
