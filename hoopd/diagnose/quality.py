"""A recording judged by itself before any model: what its samples are worth, and which of them count.

Rules of this file: no model and no knowledge of one file; nothing is changed or filled in, masks say what counts;
everything set aside is counted and has a reason. The parts are motion.py and mixture.py (each sample against the
others), lateframes.py, outliers.py, stops.py and speed.py; here they are put together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.lateframes import repeated_frames, repeats, slow_stretches
from hoopd.diagnose.mixture import Split, split
from hoopd.diagnose.motion import lagged, pushes
from hoopd.diagnose.noisefloor import noise_floor, quantum, resolution
from hoopd.diagnose.outliers import bursts, inside, spread_share, stretches
from hoopd.diagnose.speed import Speed, speed
from hoopd.diagnose.stops import Clock, clock, saturated_share, unanswered
from hoopd.ident.experiments import HELD_COUNTS, moving_of
from hoopd.recording.recording import Recording
from hoopd.recording.suspicions import ball_is_current, repeated_rows, suspicions
from hoopd.recording.timeline import TIMES
from hoopd.recording.unwrap import unwrapped

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANNELS = ("theta", "dtheta", "psi")
# Above this share a fault of the camera is an effect (EFFECTS.md); a gain that chance does not reach.
EFFECT_SHARE, EFFECT_NATS = 0.02, 25.0
# Fewer samples have no course of their own.
FEWEST = 30
SURE = 0.5
# A shorter stretch of equal angles is counted, and not worth a line of its own.
STUCK_S = 0.2
# Unevenness of sampling that is worth a line: at 20 rad/s more than an encoder's count.
JITTER_S = 1e-4


@dataclass(frozen=True)
class Share:
    """How large a part of the samples is bad in one way; `gain`: nats that saying so brings."""

    value: float
    ci95: tuple[float, float]
    gain: float
    count: int
    spread: float  # the same if samples were bad one by one: less than `value` when they come in clusters


NONE = Share(0.0, (0.0, 0.0), 0.0, 0, 0.0)


@dataclass(frozen=True)
class Channel:
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
    outlier_share: Share = NONE
    jitter_s: float = 0.0  # of the instants of sampling, as the scatter of a moving angle shows it

    @property
    def numbers(self) -> dict[str, int]:
        """Samples by what they are."""
        kinds = ("counts", "missing", "stuck", "late", "outliers", "ignored")
        return {kind: int(getattr(self, kind).sum()) for kind in kinds}


@dataclass(frozen=True)
class Quality:
    """What a recording is worth."""

    recording: str
    channels: Mapping[str, Channel]
    segments: list[tuple[float, float, str]]  # s, s, reason
    clock: Clock
    speed: Speed
    saturated: float  # share of rows at the largest torque
    moving: str  # both, hoop or ball
    notes: list[str] = field(default_factory=list)  # doubts in words

    @property
    def speed_channel(self) -> str:
        """dtheta or theta_rate: the one to be believed."""
        return self.speed.channel

    def masks(self) -> dict[str, Mask]:
        """Samples that count, by channel; theta_rate: its two neighbours and the sample itself count."""
        found = {name: channel.counts for name, channel in self.channels.items()}
        theta = np.concatenate([[False], found["theta"], [False]])
        return {**found, "theta_rate": theta[:-2] & theta[1:-1] & theta[2:]}

    def data_quality(self) -> dict[str, Any]:
        """The part of the diagnosis's JSON: samples missing, late and false over all channels, segments."""
        total = {kind: sum(one.numbers[kind] for one in self.channels.values()) for kind in ("missing", "outliers")}
        return {
            "missing": total["missing"],
            "late_frames": self.channels["psi"].numbers["late"],
            "outliers": total["outliers"],
            "segments_ignored": [list(one) for one in self.segments],
        }


def assess(recording: Recording, encoder_counts: int = 4096) -> Quality:
    """Judge a recording by itself."""
    whole = unwrapped(recording)
    moving = moving_of(whole, encoder_counts)
    silent = [] if moving == "ball" else unanswered(whole, encoder_counts)
    current = moving == "both" and ball_is_current(whole)
    moving = "hoop" if current else moving
    segments = [(*_span(whole, a, b), "the hoop does not answer the torque") for a, b in silent]
    ignored = inside(len(whole), silent)
    drives = lagged(whole.u)
    psi, course = _ball(whole, drives, ignored) if moving != "hoop" else (_absent(whole, "psi", ignored), None)
    if course is not None:  # the ball's weight turns the hoop too
        drives = np.column_stack([drives, np.sin(course), np.cos(course)])
    hoop = {name: _hoop(whole, name, drives, ignored, moving, encoder_counts) for name in ("theta", "dtheta")}
    found = {**hoop, "psi": psi}
    channels = {name: _without_bursts(whole, channel, segments) for name, channel in found.items()}
    segments += _stuck(whole, channels["psi"])
    kept = cleaned_channels(whole, channels)
    theta_sigma = channels["theta"].sigma
    return Quality(
        recording.source,
        channels,
        sorted(segments),
        clock(recording),
        speed(kept, theta_sigma),
        saturated_share(recording.u),
        moving,
        [*suspicions(recording), *_slow_camera(whole, channels["psi"]), *_uneven(channels["theta"])],
    )


def cleaned(recording: Recording, quality: Quality) -> Recording:
    """The recording with every sample that does not count as NaN, angles unwrapped through what is left."""
    return unwrapped(cleaned_channels(recording, quality.channels))


def cleaned_channels(recording: Recording, channels: Mapping[str, Channel]) -> Recording:
    """The recording with NaN where a channel does not count."""
    changes = {name: np.where(one.counts, getattr(recording, name), np.nan) for name, one in channels.items()}
    return replace(recording, **changes)


def corruption_findings(quality: Quality) -> list[tuple[str, float, tuple[float, float], float]]:
    """Faults of the camera that are effects: name, share, 95 % interval, gain in nats; the largest gain first."""
    psi = quality.channels["psi"]
    both = (("camera.late_frames", psi.late_share), ("camera.outliers", psi.outlier_share))
    found = [(name, one.value, one.ci95, one.gain) for name, one in both if _is_effect(one)]
    return sorted(found, key=lambda one: -one[3])


def _is_effect(share: Share) -> bool:
    """An effect is there all the time: a hand or a burst makes a large share in a few places."""
    return min(share.value, share.spread) > EFFECT_SHARE and share.gain > EFFECT_NATS


# ---------------------------------------------------------------------------------------------- channels


def _absent(recording: Recording, name: str, ignored: Mask) -> Channel:
    """A sensor that saw nothing that moves."""
    n = len(recording)
    none, missing = np.zeros(n, dtype=bool), ~np.isfinite(getattr(recording, name))
    return Channel(name, float("nan"), float("nan"), none, missing, ~missing, none, none, ignored)


def _times(recording: Recording, name: str) -> Array:
    """When each row's sample was taken (n,), growing; missing stamps lie as late after t as the others."""
    stamps, t = getattr(recording, TIMES[name]), recording.t
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
    stamps = getattr(recording, TIMES[name])
    seen = np.isfinite(getattr(recording, name))
    before = np.maximum.accumulate(np.where(np.isfinite(stamps), stamps, -np.inf))
    again = np.concatenate([[False], stamps[1:] <= before[:-1]])
    return seen & ~again


def _hoop(recording: Recording, name: str, drives: Array, ignored: Mask, moving: str, encoder_counts: int) -> Channel:
    """theta or dtheta: noise, repeated rows, single false values."""
    values, usable = getattr(recording, name), _new(recording, name)
    missing, none = ~np.isfinite(values), np.zeros(len(values), dtype=bool)
    stuck = none.copy()
    stuck[repeated_rows(recording)] = True
    stuck |= ~usable & ~missing
    usable &= ~stuck & ~ignored
    step = quantum(values[usable])
    whole = Channel(name, float("nan"), step, usable, missing, stuck, none, none, ignored)
    if usable.sum() < FEWEST or _constant(values[usable]):
        return whole
    t, integrals = _times(recording, name), 2 if name == "theta" else 1
    floor = step / sqrt(12.0) if np.isfinite(step) else 1e-9
    if moving == "ball" or np.ptp(values[usable]) < HELD_COUNTS * step:
        return replace(whole, sigma=floor)
    found = split(t, np.where(usable, values, np.nan), lambda _: pushes(t, drives, integrals), late=False, floor=floor)
    false = found.false > SURE
    sigma = max(noise_floor(t, np.where(usable & ~false, values - found.path, np.nan)), floor)
    return replace(
        whole, sigma=sigma, counts=usable & ~false, outliers=false, outlier_share=_false_share(found, usable)
    )


def _constant(values: Array) -> bool:
    return float(np.ptp(values)) <= 1e-12


def _ball(recording: Recording, drives: Array, ignored: Mask) -> tuple[Channel, Array | None]:
    """psi: noise, lost and late frames, single false values; and the course of the ball (n,)."""
    usable = _new(recording, "psi") & ~ignored
    missing = ~np.isfinite(recording.psi)
    values = _near(np.where(usable, recording.psi, np.nan))
    same = repeats(values)
    stuck = same.stuck | (~usable & ~missing & ~ignored)
    usable &= ~same.stuck
    none = np.zeros(len(values), dtype=bool)
    whole = Channel("psi", float("nan"), quantum(values), usable, missing, stuck, none, none, ignored)
    fresh = usable & ~same.short
    if fresh.sum() < FEWEST:
        return whole, None
    t = _times(recording, "psi")
    found = split(t, np.where(fresh, values, np.nan), _ball_paths(t, drives), late=True, floor=1e-6)
    return _judged(whole, found, same.short, fresh, t, values), found.course


def _judged(whole: Channel, found: Split, short: Mask, fresh: Mask, t: Array, values: Array) -> Channel:
    moved = np.diff(found.course, prepend=found.course[0])
    candidates = int(whole.counts.sum())
    again = repeated_frames(short, candidates, moved, found.sigma, resolution(values))
    late, false = (found.late > SURE) | (again.probability > SURE), found.false > SURE
    counts = whole.counts & ~late & ~false
    sigma = noise_floor(t, np.where(counts & fresh, values - found.path, np.nan))
    part = int(fresh.sum()) / candidates
    share = again.share + part * float(found.shares[1])
    error = sqrt(again.error**2 * (again.share > 0.0) + (part * float(found.errors[0])) ** 2 * (found.shares[1] > 0.0))
    late_share = Share(share, _interval(share, error), again.gain + float(found.gains[0]), int(late.sum()), share)
    return replace(
        whole,
        sigma=sigma if np.isfinite(sigma) else found.sigma,
        counts=counts,
        late=late,
        outliers=false,
        late_share=late_share,
        outlier_share=_false_share(found, whole.counts),
    )


def _ball_paths(t: Array, drives: Array) -> Callable[[Array], Array]:
    """The torque, and gravity by the angle: what pushes a ball at once."""
    return lambda course: pushes(t, np.column_stack([drives, np.sin(course), np.cos(course)]), 2)


def _false_share(found: Split, usable: Mask) -> Share:
    part = float((found.fresh + found.late + found.false).sum()) / max(int(usable.sum()), 1)
    share, error = part * float(found.shares[2]), part * float(found.errors[1])
    false = found.false > SURE
    return Share(share, _interval(share, error), float(found.gains[1]), int(false.sum()), spread_share(false, usable))


def _interval(share: float, error: float) -> tuple[float, float]:
    return max(share - 1.96 * error, 0.0), min(share + 1.96 * error, 1.0)


def _near(psi: Array) -> Array:
    """The angle (n,) within half a turn of the median of its neighbours: a false value is no turn of the ball."""
    rows = np.flatnonzero(np.isfinite(psi))
    result = psi.copy()
    if len(rows) < 5:
        return result
    padded = np.pad(psi[rows], 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    result[rows] = middle + np.remainder(psi[rows] - middle + pi, 2.0 * pi) - pi
    return result


# ---------------------------------------------------------------------------------------------- segments


def _span(recording: Recording, first: int, last: int) -> tuple[float, float]:
    return float(recording.t[first]), float(recording.t[last])


def _without_bursts(recording: Recording, channel: Channel, segments: list[tuple[float, float, str]]) -> Channel:
    """Bursts of false values become segments and leave the share."""
    found = bursts(channel.outliers, channel.counts | channel.outliers)
    if not found:
        return channel
    segments += [(*_span(recording, a, b), f"{channel.name}: a burst of false values") for a, b in found]
    inner = inside(len(recording), found)
    outside = channel.outliers & ~inner
    share, moved = channel.outlier_share, channel.outlier_share.count - int(outside.sum())
    left = max(share.value - moved / max(int(channel.counts.sum()) + share.count, 1), 0.0)
    gain = share.gain * left / share.value if share.value else 0.0
    width = (share.ci95[1] - share.ci95[0]) / 2
    alone = spread_share(outside, channel.counts & ~inner)
    smaller = Share(left, (max(left - width, 0.0), left + width), gain, int(outside.sum()), alone)
    return replace(
        channel,
        counts=channel.counts & ~inner,
        outliers=outside,
        ignored=channel.ignored | inner,
        outlier_share=smaller,
    )


def _stuck(recording: Recording, psi: Channel) -> list[tuple[float, float, str]]:
    """Stretches in which the camera gives one and the same angle."""
    if not psi.counts.any():
        return []
    spans = [_span(recording, max(a - 1, 0), b) for a, b in stretches(psi.stuck)]
    return [(*span, "psi: the camera repeats itself") for span in spans if span[1] - span[0] >= STUCK_S]


def _uneven(theta: Channel) -> list[str]:
    """Samples whose scatter grows with the speed were not taken when their stamps say."""
    if theta.jitter_s < JITTER_S:
        return []
    return [f"theta scatters with its speed, as if taken {1e3 * theta.jitter_s:.2g} ms too early or too late"]


def _slow_camera(recording: Recording, psi: Channel) -> list[str]:
    """A camera that for a while takes fewer frames than there are rows."""
    rate, sentences = 1.0 / recording.sample_time_s if len(recording) > 1 else 0.0, []
    for first, last, period in slow_stretches(psi.late):
        span = f"{recording.t[first]:.6g} to {recording.t[last]:.6g} s"
        frames = f"{rate * (period - 1) / period:.3g} frames a second"
        sentences.append(f"psi: from {span} one of {period} values is the one before: a camera of {frames}")
    return sentences
