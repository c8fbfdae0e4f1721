"""One sensor of a recording judged: its noise, and what each of its samples is.

Rules of this file: a sample is one thing only: it counts, or it is missing, stuck, late, false or within a stretch
that is ignored; what is decided here comes from sample_classes.py and late_frames.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.channel_course import answers, pushes
from hoopd.diagnose.quality.late_frames import NATS, RepeatedFrames, repeated_frames, repeats
from hoopd.diagnose.quality.noise_floor import noise_floor, quantum, resolution
from hoopd.diagnose.quality.outliers import jumping, spread_share
from hoopd.diagnose.quality.population import second_population
from hoopd.diagnose.quality.sample_classes import NotFollowedError, Split, split
from hoopd.diagnose.quality.sensors import Sensor
from hoopd.diagnose.quality.turns import near
from hoopd.ident.normal import Z95
from hoopd.plants.fits.repeated_samples import HELD_COUNTS
from hoopd.plants.likelihood.stretch_scatter import StretchShare, widest
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Fewer samples have no course of their own.
FEWEST = 75
# Of its largest number: what changes by less is constant.
ROUNDED = 1e-12
SURE = 0.5
# Of the shortest stretches whose shares are compared: one in fifty of them is a late frame where that is an effect.
STRETCH_SAMPLES = 100
# The least noise of an angle or its rate, or the same share of another reading's span: what a file's rounding leaves.
LEAST, ANGLES = 1e-6, ("rad", "rad/s")


@dataclass(frozen=True)
class Share:
    """How large a part of the samples is bad in one way; `gain`: nats that saying so brings."""

    value: float
    error: float  # standard error
    gain: float
    samples: int  # of which it is the share
    spread: float  # the same if samples were bad one by one: less than `value` when they come in clusters


NONE = Share(0.0, 0.0, 0.0, 0, 0.0)


@dataclass(frozen=True)
class Errors:
    """Errors of a channel's samples (n,) about its own course."""

    normal: Array  # over what is expected of them; NaN: no sample, or nothing to predict it by
    weight: Array  # probability that a sample is of its own row, good or false


@dataclass(frozen=True)
class JudgedSamples:
    """One sensor's samples (n,), by row of the recording."""

    name: str
    sigma: float  # noise of a sample without any model, in the channel's unit; NaN: too few samples
    quantum: float  # step of a counting sensor; NaN: none
    counts: Mask  # measurements to be used
    missing: Mask
    stuck: Mask  # repeats of a sensor that has nothing new, the first excepted
    late: Mask  # values of the row before
    outliers: Mask  # single false values
    ignored: Mask  # within `segments`
    late_share: Share = NONE
    errors: Errors | None = None
    jitter_s: float = 0.0  # of the instants of sampling, as the scatter of a moving angle shows it
    even_sigma: float = float("nan")  # noise of a sample beside that, as of one that does not move

    def outlier_share(self) -> Share:
        """Of false values that are a population of their own, far from the errors of the others."""
        usable = self.counts | self.late | self.outliers
        if self.errors is None or not usable.any():
            return NONE
        found = second_population(np.where(usable, self.errors.normal, np.nan), self.errors.weight)
        samples = int(usable.sum())
        part = int((usable & np.isfinite(self.errors.normal)).sum()) / samples
        alone = spread_share(self.outliers, self.counts | self.outliers)
        return Share(part * found.share, part * found.error, found.gain, samples, alone)

    @property
    def numbers(self) -> dict[str, int]:
        """Samples by what they are."""
        kinds = ("counts", "missing", "stuck", "late", "outliers", "ignored")
        return {kind: int(getattr(self, kind).sum()) for kind in kinds}


def absent_channel(recording: Recording, name: str, ignored: Mask) -> JudgedSamples:
    """A sensor that saw nothing that moves."""
    n = len(recording)
    none, missing = np.zeros(n, dtype=bool), ~np.isfinite(recording.column(name))
    return JudgedSamples(name, float("nan"), float("nan"), none, missing, ~missing, none, none, ignored)


def _times(recording: Recording, name: str) -> Array:
    """When each row's sample was taken (n,), growing; missing stamps lie as late after t as the others."""
    stamps, t = recording.channels[name].t, recording.t
    late = stamps - t
    usual = float(np.median(late[np.isfinite(late)])) if np.isfinite(late).any() else 0.0
    times = np.where(np.isfinite(stamps), stamps, t + usual)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    return _growing(times, 0.01 * max(step, 1e-6))


def _growing(times: Array, least: float) -> Array:
    ramp = least * np.arange(len(times))
    return np.asarray(np.maximum.accumulate(times - ramp) + ramp)


def _new(recording: Recording, name: str) -> Mask:
    """Samples (n,) that are there and are no second record of the same one."""
    stamps = recording.channels[name].t
    seen = np.isfinite(recording.column(name))
    before = np.maximum.accumulate(np.where(np.isfinite(stamps), stamps, -np.inf))
    again = np.concatenate([[False], stamps[1:] <= before[:-1]])
    return np.asarray(seen & ~again)


def _least(recording: Recording, name: str) -> float:
    """The least noise that a sample can have: what a file's rounding leaves of an angle, or of the span of others."""
    if recording.channels[name].unit in ANGLES:
        return LEAST
    values = recording.column(name)
    known = values[np.isfinite(values)]
    return LEAST * (float(np.ptp(known)) if len(known) else 0.0)


def counted_channel(
    recording: Recording, sensor: Sensor, drives: Array, at_once: Sequence[Array], ignored: Mask, again: Mask
) -> JudgedSamples:
    """A sensor that counts, or reads at once: noise, repeated rows (`again`), single false values.

    drives: (n, k) what is integrated on its way to what is read; at_once: inputs (n,) that it may follow at once.
    """
    name = sensor.name
    values, usable = recording.column(name), _new(recording, name)
    missing, none = ~np.isfinite(values), np.zeros(len(values), dtype=bool)
    stuck = again | (~usable & ~missing)
    usable &= ~stuck & ~ignored
    step = quantum(values[usable])
    whole = JudgedSamples(name, float("nan"), step, usable, missing, stuck, none, none, ignored)
    if usable.sum() < FEWEST or _constant(values[usable]):
        return whole
    t = _times(recording, name)
    paths, readings = pushes(t, drives, sensor.integrals), int(usable.sum())
    followed = answers(at_once, readings) if at_once else np.zeros((len(t), 0))
    paths = np.column_stack([paths, followed])
    floor = step / sqrt(12.0) if np.isfinite(step) else _least(recording, name)
    if not sensor.moves or np.ptp(values[usable]) < HELD_COUNTS * step:
        return replace(whole, sigma=floor)
    path, jitter_s, even_sigma = np.zeros(len(values)), 0.0, float("nan")
    # no course is needed to know a sample that jumps farther than any of this recording's motion does
    false = jumping(usable, values, usable, floor, together=False)
    try:
        found = split(t, np.where(usable, values, np.nan), lambda _: paths, late=False, floor=floor)
        path, jitter_s, even_sigma = found.path, found.jitter_s, found.sigma
        false |= jumping(found.false > SURE, values, usable, found.sigma)
    except NotFollowedError:
        pass
    freedom = sqrt(readings / (readings - followed.shape[1]))  # of what was fitted to these very readings
    sigma = max(freedom * noise_floor(t, np.where(usable & ~false, values - path, np.nan)), floor)
    whole = replace(whole, sigma=sigma, counts=usable & ~false, outliers=false)
    return replace(whole, jitter_s=jitter_s, even_sigma=even_sigma)


def _constant(values: Array) -> bool:
    return float(np.ptp(values)) <= ROUNDED * float(np.abs(values).max(initial=0.0))


def camera_channel(
    recording: Recording, sensor: Sensor, drives: Array, ignored: Mask
) -> tuple[JudgedSamples, Array | None]:
    """What a camera sees: noise, lost and late frames, single false values; and the course of what it sees (n,)."""
    name = sensor.name
    usable = _new(recording, name) & ~ignored
    missing = ~np.isfinite(recording.column(name))
    values = np.where(usable, recording.column(name), np.nan)
    values = near(values) if sensor.turns else values
    same = repeats(values)
    stuck = same.stuck | (~usable & ~missing & ~ignored)
    usable &= ~same.stuck
    none = np.zeros(len(values), dtype=bool)
    whole = JudgedSamples(name, float("nan"), quantum(values), usable, missing, stuck, none, none, ignored)
    fresh = usable & ~same.short
    if fresh.sum() < FEWEST:
        return whole, None
    t, floor = _times(recording, name), _least(recording, name)
    try:
        found = split(t, np.where(fresh, values, np.nan), _paths(t, drives, sensor.turns), late=True, floor=floor)
    except NotFollowedError:
        return whole, None
    return _judged(whole, found, same.short, fresh, t, values), found.course


def _judged(whole: JudgedSamples, found: Split, short: Mask, fresh: Mask, t: Array, values: Array) -> JudgedSamples:
    moved = _moved(found.course, fresh)
    candidates = int(whole.counts.sum())
    again = repeated_frames(short, candidates, moved, found.sigma, resolution(values))
    late, false = (found.late > SURE) | (again.probability > SURE), found.false > SURE
    share = _late_share(found, again, candidates, int(fresh.sum()) / candidates)
    counts = whole.counts & ~late & ~false
    sigma = noise_floor(t, np.where(counts & fresh, values - found.path, np.nan))
    return replace(
        whole,
        sigma=sigma if np.isfinite(sigma) else found.sigma,
        counts=counts,
        late=late,
        outliers=false,
        late_share=replace(share, error=clustered_error(late, whole.counts, share.error)),
        errors=Errors(found.normal, found.fresh + found.false),
    )


def _late_share(found: Split, again: RepeatedFrames, candidates: int, part: float) -> Share:
    """Frames equal to the bit and frames measured anew together; either counts once it is more than chance."""
    share, variance, gain = again.share, again.error**2, again.gain
    if found.gains[0] > NATS:
        share, variance = share + part * float(found.shares[1]), variance + (part * float(found.errors[0])) ** 2
        gain += float(found.gains[0])
    return Share(share, sqrt(variance), gain, candidates, share)


def clustered_error(bad: Mask, counted: Mask, error: float) -> float:
    """Standard error of a share of samples (n,) of which stretches may have more than others: `error`, of samples that
    are bad one by one, or what the stretches scatter by where that is beyond chance."""
    if not error:
        return error
    whole = bad[counted]
    parts = np.array_split(whole, max(1, len(whole) // STRETCH_SAMPLES))
    more = [float(one.sum() - whole.mean() * len(one)) for one in parts]
    pieces = [
        StretchShare(np.array([[float(len(one))]]), np.array([few])) for one, few in zip(parts, more, strict=True)
    ]
    return float(widest(np.array([error]), [pieces], np.zeros((1, 1)), np.zeros(1))[0]) / Z95


def _moved(course: Array, fresh: Mask) -> Array:
    """(n,) how far it went since the row before; after the last new angle, as far as there."""
    moved, last = np.diff(course, prepend=course[0]), int(np.flatnonzero(fresh)[-1])
    moved[last + 1 :] = moved[last]
    return np.asarray(moved)


def weight_of(course: Array) -> Array:
    """Gravity (n, 2) on what hangs or rolls at an angle (n,), its direction unknown."""
    return np.column_stack([np.sin(course), np.cos(course)])


def _paths(t: Array, drives: Array, turns: bool) -> Callable[[Array], Array]:
    """The inputs, and gravity by the angle: what pushes at once."""
    return lambda course: pushes(t, np.column_stack([drives, weight_of(course)]) if turns else drives, 2)
