"""A recording judged by itself before any model: what its samples are worth, and which of them count.

Rules of this file: no model and no knowledge of one file; nothing is changed or filled in, masks say what counts;
everything set aside is counted and has a reason. The parts are motion.py and mixture.py (each sample against the
others), lateframes.py, outliers.py, stops.py and speed.py; here they are put together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.channel_course import lagged
from hoopd.diagnose.quality.late_frames import slow_stretches
from hoopd.diagnose.quality.outliers import bursts, inside, stretches
from hoopd.diagnose.quality.rate_choice import Speed, speed
from hoopd.diagnose.quality.sensor_samples import Channel, absent_channel, ball_channel, hoop_channel
from hoopd.diagnose.quality.standstill import Clock, clock, saturated_share, unanswered
from hoopd.diagnose.quality.turns import turned
from hoopd.plants.fits.fit_data import HELD_COUNTS, moving_of
from hoopd.plants.hoop.suspicions import ball_is_current, suspicions
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANNELS = ("theta", "dtheta", "psi")
# A shorter stretch of equal angles is counted, and not worth a line of its own.
STUCK_S = 0.2
# Unevenness of sampling that is worth a line: at 20 rad/s more than an encoder's count.
JITTER_S = 1e-4
# A ball that was at rest is seen, when it begins to move, within this of where it was.
RESTED_SIGMAS = 8.0


@dataclass(frozen=True)
class Quality:
    """What a recording is worth."""

    recording: str
    channels: Mapping[str, Channel]
    segments: list[tuple[float, float, str]]  # s, s, reason
    speed: Speed
    moving: str  # both, hoop or ball
    notes: list[str] = field(default_factory=list)  # doubts in words

    def data_quality(self) -> dict[str, Any]:
        """The part of the diagnosis's JSON: numbers of samples, of sensors that are there at all."""
        there = [one for one in self.channels.values() if not one.missing.all()]
        total = {kind: sum(one.numbers[kind] for one in there) for kind in ("missing", "outliers")}
        return {
            "missing": total["missing"],
            "late_frames": self.channels["psi"].numbers["late"],
            "outliers": total["outliers"],
            "segments_ignored": [list(one) for one in self.segments],
            "samples": sum(len(one.missing) for one in there),
            "frames": sum(len(one.missing) for one in there if one.name == "psi"),
        }


def assess(recording: Recording, encoder_counts: int = 4096) -> Quality:
    """Judge a recording by itself; encoder_counts: a turn of theta's sensor."""
    whole = turned(recording)
    moving = _moving(whole, encoder_counts)
    silent = [] if moving == "ball" else unanswered(whole, encoder_counts)
    segments = [(*_span(whole, a, b), "the hoop does not answer the torque") for a, b in silent]
    judged = _judged(whole, moving, inside(len(whole), silent), encoder_counts)
    channels = {name: _without_bursts(whole, channel, segments) for name, channel in judged.items()}
    channels["psi"] = _rested(whole, channels["psi"], moving, encoder_counts)
    segments += _stuck(whole, channels["psi"])
    return Quality(
        recording.source,
        channels,
        sorted(segments),
        speed(cleaned_channels(whole, channels), channels["theta"].sigma),
        moving,
        [
            *suspicions(recording),
            *_told(clock(recording)),
            *_limited(recording.u),
            *_slow_camera(whole, channels["psi"]),
            *_uneven(channels["theta"]),
        ],
    )


def _moving(recording: Recording, encoder_counts: int) -> str:
    """both, hoop or ball; a psi that is another signal is no ball."""
    moving = moving_of(recording, encoder_counts)
    return "hoop" if moving == "both" and ball_is_current(recording) else moving


def _judged(recording: Recording, moving: str, ignored: Mask, encoder_counts: int) -> dict[str, Channel]:
    """Every sensor by itself; only what drives the hoop comes from another one."""
    drives = lagged(recording.u)
    if moving == "hoop":
        psi = absent_channel(recording, "psi", ignored)
    else:
        psi, course = ball_channel(recording, drives, ignored)
        if course is not None:  # the ball's weight turns the hoop too
            drives = np.column_stack([drives, np.sin(course), np.cos(course)])
    hoop = {name: hoop_channel(recording, name, drives, ignored, moving, encoder_counts) for name in CHANNELS[:2]}
    return {**hoop, "psi": psi}


def cleaned(recording: Recording, quality: Quality) -> Recording:
    """The recording with every sample that does not count as NaN, angles unwrapped."""
    return cleaned_channels(turned(recording), quality.channels)


def cleaned_channels(recording: Recording, channels: Mapping[str, Channel]) -> Recording:
    """The recording with NaN where a channel does not count."""
    changes: dict[str, Any] = {
        name: np.where(one.counts, getattr(recording, name), np.nan) for name, one in channels.items()
    }
    return replace(recording, **changes)


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
    return replace(channel, counts=channel.counts & ~inner, outliers=outside, ignored=channel.ignored | inner)


def _stuck(recording: Recording, psi: Channel) -> list[tuple[float, float, str]]:
    """Stretches in which the camera gives one and the same angle."""
    if not psi.counts.any():
        return []
    spans = [_span(recording, max(a - 1, 0), b) for a, b in stretches(psi.stuck)]
    return [(*span, "psi: the camera repeats itself") for span in spans if span[1] - span[0] >= STUCK_S]


def _rested(recording: Recording, psi: Channel, moving: str, encoder_counts: int) -> Channel:
    """The last of equal angles counts where the hoop is still too and the ball goes on from there: it was at rest."""
    counts, stuck = psi.counts.copy(), psi.stuck.copy()
    for first, last in stretches(psi.stuck) if moving == "both" and psi.counts.any() else []:
        after = recording.psi[last + 1 : last + 2]
        near = len(after) > 0 and abs(float(after[0]) - float(recording.psi[last])) < RESTED_SIGMAS * psi.sigma
        moved = np.abs(recording.theta[first : last + 1] - recording.theta[first])
        still = int(np.argmin(np.append(moved < HELD_COUNTS * 2.0 * np.pi / encoder_counts, False)))
        if near and still > 1:
            counts[first + still - 1], stuck[first + still - 1] = True, False
    return replace(psi, counts=counts, stuck=stuck)


def _told(found: Clock) -> list[str]:
    """What is wrong with the clock of the rows."""
    sentences = []
    if found.gaps:
        longest = max(b - a for a, b in found.gaps)
        sentences.append(f"rows are missing in {len(found.gaps)} places, for {longest:.3g} s at most")
    if found.not_increasing:
        sentences.append(f"{found.not_increasing} rows have a time that is not later than the row's before")
    if found.steps:
        sentences.append(f"the sensors' clock was set at {', '.join(f'{t:.6g} s' for t in found.steps)}")
    return sentences


def _limited(u: Array) -> list[str]:
    """A torque that stays at its largest value says nothing of what was asked for."""
    share = saturated_share(u)
    return [f"the torque stays at its limit in {share:.0%} of the rows"] if share > 0.0 else []


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
