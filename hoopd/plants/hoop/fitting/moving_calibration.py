"""What a short test signal tells of a device's signs, its torque and the age of its pictures.

Rules of this file: one recording and one model in, judged numbers with 95 % intervals out; nothing is read or written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.plants.effects.image_sensor import latency
from hoopd.plants.fits.plant_fit import PlantFit, fit_plant
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.entries import entries_of
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]
Interval = tuple[float, float, float]  # value, and its 95 % interval

SIDES = 1.96  # standard deviations of a 95 % interval
AHEAD_S = (
    0.04  # a latency is not negative: readings are told later by this, so that a stamp may be late as well as early
)
LATENCY = "camera.latency.d"
# Of the model's own torque, the share by which the device's may be off before a law that was designed on it suffers.
GAIN_TOLERANCE = 0.1
# Half a picture's period at 50 Hz: what the filter is off by at 5 rad/s is then 0.05 rad.
DELAY_TOLERANCE_S = 0.01
ALIKE = 0.75  # correlation from which two signals are the same, or its opposite
LARGEST_DELAY_S = 0.2  # that the configuration takes
LEAST_TORQUE_NM = 0.005  # rms: less moves nothing that could be told from noise
LEAST_ROWS = 150


@dataclass(frozen=True)
class MovingCalibration:
    """What a recording of a test signal tells."""

    torque_to_hoop: Interval  # L1, rad/s^2 per N m; above zero: hoop and torque turn the same way
    torque_to_ball: Interval  # L2, the same for the ball
    angle_to_speed: float  # correlation of the hoop's speed with the slope of its angle
    gain: Interval  # of the torque that acts, in that which the model foretells
    constant_nm_per_a: Interval | None  # torque in the current; None: no current was told
    delay_s: Interval  # by which pictures are older than their times say
    picture_age_s: float  # by their times, when a tick used them
    fit: PlantFit
    told: Recording  # what was fitted: pictures are later by `AHEAD_S`
    held_torque_nm: Array  # (n,) in force when the board sampled


def measure(
    recording: Recording, model: ModelFile, progress: Callable[[str], None] = lambda text: None
) -> MovingCalibration:
    """Fit the torque's effect on hoop and ball and the camera's delay, with a filter's innovations.

    Torque depends on what was measured while a law holds the ball, so that the noise is modelled, too (prediction
    error, Ljung 1999, section 13.4).

    Parameters
    ----------
    recording : Recording
        Of the daemon's tick, with hoop and ball in motion; u in N m, angles in rad, current in A.
    model : ModelFile
        Whose parameters the others keep.
    progress : callable
        Is told a line a step.

    Returns
    -------
    MovingCalibration

    Raises
    ------
    InputError
        Too short, or nothing moved.
    """
    _check(recording)
    plant = hoop_plant("entries", _entries(model))
    camera = latency(plant, "camera", plant.slots["camera"])
    told = recording.replaced(psi_t=recording.psi_t + AHEAD_S)
    fit = fit_plant(
        plant,
        told,
        ("L1", "L2", LATENCY),
        "prediction",
        effects=(camera,),
        values={LATENCY: AHEAD_S},
        progress=progress,
    )
    hoop, nominal = _interval(fit, "L1"), plant.values["L1"]
    delay = _interval(fit, LATENCY)
    return MovingCalibration(
        torque_to_hoop=hoop,
        torque_to_ball=_interval(fit, "L2"),
        angle_to_speed=_angle_to_speed(recording),
        gain=(hoop[0] / nominal, hoop[1] / nominal, hoop[2] / nominal),
        constant_nm_per_a=torque_constant(recording),
        delay_s=(delay[0] - AHEAD_S, delay[1] - AHEAD_S, delay[2] - AHEAD_S),
        picture_age_s=float(np.nanmean(recording.t - recording.psi_t)),
        fit=fit,
        told=told,
        held_torque_nm=_held_torque(recording),
    )


def torque_constant(recording: Recording) -> Interval | None:
    """Torque in the current, N m/A, with its 95 % interval; None where the current says nothing.

    The current follows the torque that was sent before it was sampled, i = u / k + i0 + noise; u is known exactly, so
    that 1 / k is found without bias.

    Parameters
    ----------
    recording : Recording
        Torque u in N m, current in A at `y_t`.

    Returns
    -------
    tuple of float, or None
        Value and both ends of the interval.

    Examples
    --------
    >>> from hoopd.recording.recording import from_columns
    >>> t = 0.02 * np.arange(200)
    >>> u = 0.1 * np.sign(np.sin(3 * t))
    >>> current = np.concatenate([[0.0], u[:-1]]) / 0.4
    >>> run = from_columns({"t": t, "u": u, "theta": 0 * t, "dtheta": 0 * t, "psi": 0 * t, "current": current,
    ...                     "y_t": t - 0.01})
    >>> [round(number, 3) for number in torque_constant(run)]
    [0.4, 0.4, 0.4]
    """
    u, current = _held_torque(recording), np.asarray(recording.current, float)
    known = np.isfinite(u) & np.isfinite(current)
    if np.count_nonzero(known) < LEAST_ROWS or not np.any(current[known]):
        return None
    # i = s u + i0
    columns = np.column_stack([u[known], np.ones(np.count_nonzero(known))])
    (slope, _), residue, *_ = np.linalg.lstsq(columns, current[known], rcond=None)
    variance = float(residue[0]) / (len(columns) - 2) if len(residue) else 0.0
    spread = SIDES * sqrt(variance * np.linalg.inv(columns.T @ columns)[0, 0])
    if not abs(slope) > spread:
        return None
    ends = sorted((1.0 / (slope - spread), 1.0 / (slope + spread)))
    return 1.0 / float(slope), float(ends[0]), float(ends[1])


def judged(
    found: MovingCalibration, constant_nm_per_a: float = 0.0, delay_s: float | None = None
) -> dict[str, dict[str, Any]]:
    """Each step's word: whether it is good, why, and the part of a configuration that would make it so.

    Parameters
    ----------
    found : MovingCalibration
    constant_nm_per_a : float
        `faults.torque_constant_nm_per_a` in force; 0: none is.
    delay_s : float, optional
        `camera.delay_s` in force, which is the age of pictures that carry no time.

    Returns
    -------
    dict
        By step: `good`, `why`, `values` with intervals and `part`.
    """
    return {"signs": _signs(found), "torque": _torque(found, constant_nm_per_a), "delay": _delay(found, delay_s)}


def _signs(found: MovingCalibration) -> dict[str, Any]:
    """Torque, hoop and ball turn the same way (`L1`, `L2` above zero), and the speed is that of the angle."""
    checks: Mapping[str, bool | None] = {
        "the hoop follows the torque": _sign(found.torque_to_hoop),
        "the ball follows the torque": _sign(found.torque_to_ball),
        "the hoop's speed is the slope of its angle": found.angle_to_speed > ALIKE or (
            False if found.angle_to_speed < -ALIKE else None
        ),
    }  # fmt: skip
    wrong = [name for name, good in checks.items() if good is False]
    open_ = [name for name, good in checks.items() if good is None]
    why = (
        f"turned round: {', '.join(wrong)} the other way" if wrong
        else f"cannot be told: {', '.join(open_)}" if open_
        else "torque, hoop and ball turn the same way"
    )  # fmt: skip
    values: dict[str, Any] = {
        "torque_to_hoop": list(found.torque_to_hoop),
        "torque_to_ball": list(found.torque_to_ball),
    }
    values |= {"angle_to_speed": found.angle_to_speed}
    return {"good": not wrong and not open_, "why": why, "values": values, "part": {}}


def _sign(number: Interval) -> bool | None:
    """Above zero, below it, or not known."""
    return True if number[1] > 0.0 else False if number[2] < 0.0 else None


def _torque(found: MovingCalibration, constant: float) -> dict[str, Any]:
    gain, told = found.gain, found.constant_nm_per_a
    half = 0.5 * (gain[2] - gain[1])
    known, near = half < GAIN_TOLERANCE, abs(gain[0] - 1.0) <= max(GAIN_TOLERANCE, half)
    why = f"the drive gives {gain[0]:.4f} ± {half:.4f} of the torque that the model foretells"
    if not known:
        why = f"known to ± {half:.2f} only: play it again"
    elif not near:
        why += ": fit a model to this run and design a controller on it"
    part, values = {}, {"gain": list(gain)}
    if told is not None and told[0] > 0.0:
        values["constant_nm_per_a"] = list(told)
        if not told[1] <= constant <= told[2]:
            part = {"faults": {"torque_constant_nm_per_a": float(f"{told[0]:.4g}")}}
        in_force = f", in force {constant:g}" if constant else ", none in force"
        why += f"; {told[0]:.4f} ± {0.5 * (told[2] - told[1]):.4f} N m/A{in_force}"
    return {"good": known and near, "why": why, "values": values, "part": part}


def _delay(found: MovingCalibration, in_force_s: float | None) -> dict[str, Any]:
    value, low, high = found.delay_s
    half, part = 0.5 * (high - low), {}
    known, near = half < DELAY_TOLERANCE_S, abs(value) <= DELAY_TOLERANCE_S
    why = f"pictures are {1e3 * value:.1f} ± {1e3 * half:.1f} ms older than their times say"
    if not known:
        why += ": too uncertain, play it again"
    elif not near:
        why += ": the stamps are wrong or, where pictures carry none, camera.delay_s is"
        if in_force_s is not None and 0.0 <= in_force_s + value <= LARGEST_DELAY_S:
            part = {"camera": {"delay_s": round(in_force_s + value, 4)}}
    values = {"delay_s": [value, low, high], "picture_age_s": found.picture_age_s}
    return {"good": known and near, "why": why, "values": values, "part": part}


# ---------------------------------------------------------------------------------------------- data


def _check(recording: Recording) -> None:
    u = recording.u[np.isfinite(recording.u)]
    if len(recording) < LEAST_ROWS:
        raise InputError(recording.source, "", f"{len(recording)} rows: {LEAST_ROWS} at least")
    if not sqrt(float(np.mean(u**2))) >= LEAST_TORQUE_NM:
        raise InputError(recording.source, "u", f"less than {LEAST_TORQUE_NM} N m rms: nothing was moved")
    for name in ("theta", "dtheta", "psi"):
        if np.count_nonzero(np.isfinite(recording.column(name))) < LEAST_ROWS // 2:
            raise InputError(recording.source, name, "was not measured")


def _entries(model: ModelFile) -> dict[str, float]:
    """The eight numbers of a model of any structure, and what it knows of the device."""
    values = model.values()
    return values if model.structure == "entries" else {**model.device.values(), **entries_of(model.structure, values)}


def _interval(fit: PlantFit, name: str) -> Interval:
    low, high = fit.intervals[name]
    return fit.values[name], low, high


def _held_torque(recording: Recording) -> Array:
    """The torque that was in force when the board sampled; NaN before the first."""
    times = np.asarray(recording.y_t, float)
    place = np.searchsorted(recording.t, np.where(np.isfinite(times), times, -np.inf), side="right") - 1
    return np.where(place >= 0, recording.u[np.maximum(place, 0)], np.nan)


def _angle_to_speed(recording: Recording) -> float:
    """Correlation of the told speed with the slope of the told angle; 0 where neither changes."""
    known = np.isfinite(recording.theta) & np.isfinite(recording.dtheta)
    slope = np.gradient(recording.theta[known], recording.t[known])
    speed = recording.dtheta[known]
    if not (np.ptp(slope) > 0.0 and np.ptp(speed) > 0.0):
        return 0.0
    found = float(np.corrcoef(slope, speed)[0, 1])
    return found if isfinite(found) else 0.0
