"""What a picture of recordings shows: a panel for each channel, a curve for each recording in it, and the modes.

Rules of this file: from recordings to numbers that are drawn; nothing is computed but gaps, and the time at which a
curve begins; differences are `recording.pairs`'s. A name that no recording has is one `InputError`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from hoopd.files.reading import InputError
from hoopd.recording.pairs import ALIKE, RecordingPair, SignalDifference
from hoopd.recording.recording import PAUSE_STEPS, Column, Recording, Signal
from hoopd.recording.schemas import TICK

# What the daemon's columns are called in a sentence.
WORDS: Final[Mapping[str, str]] = {
    "psi": "ball angle",
    "theta": "hoop angle",
    "dtheta": "hoop speed",
    "u": "torque",
    "current": "motor current",
    "reference": "wanted ball angle",
    "lateness_s": "lateness of the tick",
    "execution_s": "duration of the tick",
    "x_hat_0": "estimated hoop angle",
    "x_hat_1": "estimated hoop speed",
    "x_hat_2": "estimated ball angle",
    "x_hat_3": "estimated ball speed",
}
# Channel whose panel shows what was wanted of it.
WANTED: Final = {"psi": "reference"}
# Of two recordings: what stands below a channel, and the colour's place after both.
DIFFERENCE: Final = "second less first"
NEITHER: Final = 2
BANDS: Final = " Shaded are the daemon's modes: above the first's, below the second's."
NOT_DRAWN: Final = ("id", "mode")


class DrawnCurve(NamedTuple):
    """A channel of one recording; NaN is a gap."""

    recording: int
    t: Column
    values: Column
    held: bool  # from one sample to the next


@dataclass(frozen=True)
class Panel:
    """One channel."""

    name: str
    words: str
    unit: str
    curves: tuple[DrawnCurve, ...]
    wanted: DrawnCurve | None = None

    @property
    def label(self) -> str:
        """What stands at the axis: words, name and unit."""
        what = f"{self.words}, {self.name}" if self.words else self.name
        return f"{what} ({self.unit})" if self.unit else what


class ModeSpan(NamedTuple):
    """The daemon's mode over some time, in one of the recordings."""

    start_s: float
    end_s: float
    mode: str
    recording: int = 0


class DifferenceRow(NamedTuple):
    """How far two recordings of one channel are apart, in its unit."""

    channel: str
    unit: str
    first_rms: float
    second_rms: float
    rms: float
    mean: float
    largest: float


@dataclass(frozen=True)
class RecordingPicture:
    """All that is drawn."""

    recordings: tuple[str, ...]
    panels: tuple[Panel, ...]
    modes: tuple[ModeSpan, ...]
    figures: tuple[DifferenceRow, ...] = ()
    note: str = ""  # how two were laid over each other

    def curve_name(self, index: int) -> str:
        """Of a recording, or of what is neither's."""
        return self.recordings[index] if index < len(self.recordings) else DIFFERENCE


def picture(
    recordings: Mapping[str, Recording], channels: Sequence[str] = (), *, from_zero: bool = False
) -> RecordingPicture:
    """What is drawn of recordings by name: these channels in this order, or all that were measured.

    `from_zero`: every recording begins at zero. Modes of several stand above each other, in the recordings' order.
    """
    starts = [float(one.t[0]) if from_zero and len(one) else 0.0 for one in recordings.values()]
    return _drawn(recordings, channels, starts)


def compared_picture(
    recordings: Mapping[str, Recording], pair: RecordingPair, channels: Sequence[str] = ()
) -> RecordingPicture:
    """Two recordings over each other, the second shifted as the pair says, and below each channel their difference."""
    first, second = recordings.values()
    shown = _drawn(recordings, channels, [float(first.t[0]), float(second.t[0]) + pair.shift_s])
    rows = tuple(
        DifferenceRow(name, one.unit, one.first_rms, one.second_rms, one.rms, one.mean, one.largest)
        for name, one in pair.signals.items()
    )
    panels = [part for panel in shown.panels for part in (panel, *_difference(panel, pair.signals.get(panel.name)))]
    return dataclasses.replace(
        shown, panels=tuple(panels), figures=rows, note=f"{_alignment(pair)}{BANDS if shown.modes else ''}"
    )


def _difference(panel: Panel, one: SignalDifference | None) -> list[Panel]:
    if one is None:
        return []
    curve = DrawnCurve(NEITHER, *_with_gaps(one.t, one.values), held=False)
    return [Panel(panel.name, DIFFERENCE, panel.unit, (curve,))]


def _alignment(pair: RecordingPair) -> str:
    """How the second lies over the first, in words."""
    if math.isnan(pair.correlation):
        return "Both begin at zero: neither has an input that moves."
    if pair.correlation < ALIKE:
        return f"Both begin at zero: their inputs are not alike (correlation {pair.correlation:.2f})."
    if pair.shift_s == 0.0:
        return f"Both begin at zero, where their inputs agree best (correlation {pair.correlation:.2f})."
    when = f"{abs(pair.shift_s):.3g} s {'later' if pair.shift_s >= 0.0 else 'earlier'}"
    return f"Aligned by the input (correlation {pair.correlation:.2f}): the second's came {when}."


def _drawn(recordings: Mapping[str, Recording], channels: Sequence[str], starts: Sequence[float]) -> RecordingPicture:
    there = [_signals(one) for one in recordings.values()]
    names = tuple(channels) or _measured(list(recordings.values()))
    _check(names, there)
    inputs = {name for one in recordings.values() for name in one.inputs}
    panels = tuple(_panel(name, there, inputs, starts) for name in names)
    modes = [_modes(k, one, starts[k]) for k, one in enumerate(recordings.values())]
    return RecordingPicture(tuple(recordings), panels, tuple(span for spans in modes for span in spans))


def _signals(recording: Recording) -> dict[str, Signal]:
    """Everything that can be drawn, by name: inputs, channels, and other columns that are numbers."""
    found = dict(recording.signals)
    for name, column in recording.extra.items():
        if name in NOT_DRAWN or column.dtype.kind not in "bif":
            continue
        unit = TICK[name].unit if recording.is_tick and name in TICK else ""
        if column.ndim == 1:
            found[name] = Signal(np.asarray(column, float), recording.t, unit)
        elif column.ndim == 2:
            units = unit.split(", ") if unit.count(",") + 1 == column.shape[1] else [""] * column.shape[1]
            for k, own in enumerate(units):
                found[f"{name}_{k}"] = Signal(np.asarray(column[:, k], float), recording.t, own)
    return found


def _measured(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Channels and then inputs of which any recording has a value."""
    names = dict.fromkeys(name for one in recordings for name in (*reversed([*one.channels]), *one.inputs))
    there = [name for name in names if any(_has(one.signals.get(name)) for one in recordings)]
    if not there:
        raise InputError(recordings[0].source, "", "has no value of any channel")
    return tuple(there)


def _has(signal: Signal | None) -> bool:
    return signal is not None and bool(np.isfinite(signal.values).any())


def _check(names: Sequence[str], there: Sequence[Mapping[str, Signal]]) -> None:
    known = list(dict.fromkeys(name for one in there for name in one))
    for name in names:
        if name not in known:
            raise InputError("--channels", name, f"no recording has it; known: {', '.join(known)}")
        if not any(_has(one.get(name)) for one in there):
            raise InputError("--channels", name, "every value of it is missing")


def _panel(name: str, there: Sequence[Mapping[str, Signal]], inputs: Collection[str], starts: Sequence[float]) -> Panel:
    has = [k for k, one in enumerate(there) if _has(one.get(name))]
    curves = [_curve(k, there[k][name], starts[k], held=name in inputs and there[k][name].hold == "zero") for k in has]
    unit = there[has[0]][name].unit
    wanted = there[0].get(WANTED.get(name, ""))
    asked = wanted is not None and bool(np.any(np.nan_to_num(wanted.values)))
    drawn = _curve(0, wanted, starts[0], held=True) if wanted is not None and asked else None
    return Panel(name, WORDS.get(name, ""), unit, tuple(curves), drawn)


def _curve(index: int, signal: Signal, start_s: float, *, held: bool) -> DrawnCurve:
    known = np.isfinite(signal.t) & np.isfinite(signal.values)
    t, values = signal.t[known] - start_s, signal.values[known]
    return DrawnCurve(index, *_with_gaps(t, values), held)


def _with_gaps(t: Column, values: Column) -> tuple[Column, Column]:
    """The same with a NaN in the middle of every gap."""
    if len(t) < 3:
        return t, values
    steps = np.diff(t)
    after = np.flatnonzero(steps > PAUSE_STEPS * float(np.median(steps))) + 1
    return np.insert(t, after, 0.5 * (t[after - 1] + t[after])), np.insert(values, after, np.nan)


def _modes(index: int, recording: Recording, start_s: float) -> list[ModeSpan]:
    modes = recording.extra.get("mode")
    if modes is None or not len(modes):
        return []
    t = np.append(recording.t, recording.t[-1]) - start_s
    begins = np.append(0, np.flatnonzero(modes[1:] != modes[:-1]) + 1)
    ends = np.append(begins[1:], len(modes))
    return [ModeSpan(float(t[a]), float(t[b]), str(modes[a]), index) for a, b in zip(begins, ends, strict=True)]
