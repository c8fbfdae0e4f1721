"""A recording as a simulation sees it: nodes of time, the inputs between them, the node of every measurement.

Rules of this file: a measurement belongs to the instant at which it was taken, not to the row that brought it; a row
without an input, rows that are missing, a drive that is switched off, and a ball that leaves its hoop end a run. An
input that goes straight from
row to row is its mean between two nodes: with a step h the speed at the nodes is exact, and the position lags by
h^2/12 of the change in acceleration, which does not add up. No model here.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.input_curve import SAME_S, InputCurve, deaveraged
from hoopd.recording.recording import PAUSE_STEPS, Column, Recording
from hoopd.recording.spans import spans
from hoopd.recording.tick_columns import BOARD_TIMES, TIMES
from hoopd.recording.unwrap import unwrapped

__all__ = [
    "SAME_S",
    "TIMES",
    "ChannelNodes",
    "Timeline",
    "driven",
    "off_the_hoop",
    "off_the_hoop_words",
    "switch_times",
    "timelines",
    "usual_steps",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Steps to each side that say what is usual: fewer than a part of a recording has, more than a pause.
NEIGHBOURS = 10
# The daemon's modes in which its drive turns the hoop; in the others a hand may hold hoop or ball.
DRIVEN = ("RUNNING", "STOPPING")
# What a daemon's ball does while no outer hoop carries it, by the column `ball_mode`; after that, until it has been
# caught and pictures have shown it, as long as the fault table waits.
OFF_THE_HOOP, CAUGHT_S = ("air", "inner"), 0.16
# Column of `extra`: when each row's torque began to act, where the sample times of the readings do not tell it.
TORQUE_TIMES = "u_t"


# Rows at least so far apart, s, are no one instant.
CLOSEST_S = 2.0 * SAME_S


class ChannelNodes(NamedTuple):
    """What one sensor saw."""

    nodes: Index  # (k,) node of each value
    values: Array  # (k,) never missing


class Timeline(NamedTuple):
    """Nodes, held inputs, and the channels' measurements on them."""

    t: Array  # (n,) s
    u: Array  # (n-1,) in the unit of the one input; (n-1, m) of several or none
    channels: dict[str, ChannelNodes]
    unresolved: Array  # (n-1, m, 2) what the rows leave open of each input (`input_curve`)

    def between(self, first: int, last: int) -> Timeline:
        """Nodes first ... last (included) with what was measured on them."""
        cut = {}
        for name, (nodes, values) in self.channels.items():
            inside = (nodes >= first) & (nodes <= last)
            cut[name] = ChannelNodes(nodes[inside] - first, values[inside])
        return Timeline(self.t[first : last + 1], self.u[first:last], cut, self.unresolved[first:last])

    def windows(self, length_s: float) -> list[Timeline]:
        """Cut into equal pieces of about this length."""
        count = max(1, round((self.t[-1] - self.t[0]) / length_s))
        edges = np.searchsorted(self.t, np.linspace(self.t[0], self.t[-1], count + 1) - SAME_S)
        return [self.between(int(a), int(b)) for a, b in pairwise(edges)]


def timelines(recording: Recording) -> list[Timeline]:
    """One timeline for each stretch of two rows or more with all inputs, angles unwrapped; ValueError without any."""
    recording = unwrapped(recording)
    off = off_the_hoop(recording)
    whole = np.isfinite(recording.t) & driven(recording) & ~off
    for signal in recording.inputs.values():
        whole &= np.isfinite(signal.values)
    cuts = np.flatnonzero(np.diff(recording.t) > PAUSE_STEPS * usual_steps(recording.t)) + 1
    stretches = [
        (int(c), int(d))
        for a, b in spans(whole)
        for c, d in pairwise([a, *cuts[(cuts > a) & (cuts < b)], b])
        if d - c >= 2
    ]
    if stretches and float(np.nanmedian(np.diff(recording.t))) < CLOSEST_S - 1e-3 * SAME_S:
        step = float(np.nanmedian(np.diff(recording.t)))
        raise ValueError(
            f"rows are {step:.3g} s apart, at least {CLOSEST_S:g} s are needed: {SAME_S:g} s are one instant"
        )
    if not stretches and off.any():
        raise ValueError("no two rows in a row with time, torque, and the ball on the outer hoop")
    if not stretches:
        raise ValueError("no two rows in a row with time and torque" if recording.is_tick else _nothing(recording))
    return [_timeline(recording, slice(a, b)) for a, b in stretches]


def begin_of(recording: Recording) -> float:
    """Time of the first row, s: the `t` of equations and of effects counts from there."""
    known = recording.t[np.isfinite(recording.t)]
    return float(known[0]) if len(known) else 0.0


def usual_steps(t: Array) -> Array:
    """The usual step (n-1,) about each step: the median of its neighbourhood, so that joined parts keep their own."""
    steps = np.diff(t)
    if len(steps) == 0:
        return steps
    padded = np.pad(steps, NEIGHBOURS, mode="reflect" if len(steps) > NEIGHBOURS else "edge")
    return np.asarray(np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1), axis=1))


def driven(recording: Recording) -> NDArray[np.bool_]:
    """Rows in which the drive turned the hoop; all, where the recording has no modes or was never driven."""
    modes = recording.extra.get("mode")
    rows = np.ones(len(recording), dtype=bool) if modes is None else np.isin(modes, DRIVEN)
    return rows if rows.any() else np.ones(len(recording), dtype=bool)


def off_the_hoop(recording: Recording) -> NDArray[np.bool_]:
    """Rows in which a ball was in the air or on the inner hoop, as the daemon believed, or had just come back."""
    modes = recording.extra.get("ball_mode")
    if modes is None or not (off := np.isin(modes, OFF_THE_HOOP)).any():
        return np.zeros(len(recording), dtype=bool)
    last = np.fmax.accumulate(np.where(off, recording.t, -np.inf))
    return np.asarray(off | (recording.t - last <= CAUGHT_S + SAME_S))


def off_the_hoop_words(recording: Recording) -> list[str]:
    """Of such rows, a sentence, where there are some."""
    count = int(off_the_hoop(recording).sum())
    where = "off the outer hoop (in the air, on the inner hoop, just back)"
    return [f"{count} rows were taken with the ball {where} and do not count"] if count else []


def _timeline(recording: Recording, rows: slice) -> Timeline:
    switches = {name: switch_times(recording, name)[rows] for name in recording.inputs} or {"": recording.t[rows]}
    measured = {name: _measured(recording, name, rows) for name in recording.channels}
    curves = {
        name: InputCurve(switches[name], signal.values[rows], signal.hold) for name, signal in recording.inputs.items()
    }
    times = np.concatenate(
        [*switches.values(), *(one.corners for one in curves.values()), *(t for t, _ in measured.values())]
    )
    # what was seen before the first known input acted says nothing about this run, nor what comes long after its rows
    first = max(switch[0] for switch in switches.values()) - SAME_S
    last = recording.t[rows][-1] + PAUSE_STEPS * float(np.median(np.diff(recording.t[rows])))
    t = _distinct(np.sort(times[(times >= first) & (times <= last)]))
    inputs = [one.between(t) for one in curves.values()]
    held = inputs[0] if len(inputs) == 1 else np.reshape(inputs, (len(inputs), len(t) - 1)).T
    channels = {}
    for name, (when, values) in measured.items():
        inside = (when >= t[0] - SAME_S) & (when <= last)
        # a node is the first of the instants that count as one with it, so it is the last that is not later
        nodes = np.searchsorted(t, when[inside], side="right") - 1
        channels[name] = ChannelNodes(np.maximum(nodes, 0).astype(np.int64), values[inside])
    unresolved = np.reshape([one.unresolved(t) for one in curves.values()], (len(inputs), len(t) - 1, 2))
    return Timeline(t, held, channels, np.swapaxes(unresolved, 0, 1))


def _nothing(recording: Recording) -> str:
    needed = " and ".join(["a time", *recording.inputs])
    return f"no two rows in a row with {needed}"


def switch_times(recording: Recording, name: str | None = None) -> Array:
    """When each row's input (the first, without a name) began to act.

    Of the daemon's own: the board samples as it takes a request over, so the next row's `y_t` tells; without one, the
    usual time after the tick.
    """
    if not recording.is_tick:
        return _known(recording.inputs[name or next(iter(recording.inputs))].t, recording.t)
    t, y_t = recording.t, recording.column(BOARD_TIMES)
    if TORQUE_TIMES in recording.extra:
        return _known(recording.extra[TORQUE_TIMES], t)
    after = np.append(y_t[1:], np.nan)
    # a row's torque acts after its tick and before the next one, by more than the rounding of a text file
    good = (after >= t) & (after < np.append(t[1:], np.inf) - SAME_S)
    if np.array_equal(t, y_t) or not good.any():
        return t
    return np.asarray(np.where(good, after, t + np.median((after - t)[good])))


def _known(times: Array, t: Column) -> Array:
    """The times, and the row's where there is none."""
    return np.asarray(np.where(np.isfinite(times), times, t))


def _measured(recording: Recording, name: str, rows: slice) -> tuple[Array, Array]:
    t, values = recording.channels[name].t[rows], recording.channels[name].values[rows]
    seen = np.isfinite(t) & np.isfinite(values)
    t, values = t[seen], values[seen]
    # a board or camera that has nothing new is recorded twice: once is enough
    new = np.diff(t, prepend=-np.inf) > SAME_S
    t, values = t[new], values[new]
    return t, deaveraged(t, values) if recording.channels[name].hold == "mean" else values


def _distinct(times: Array) -> Array:
    return times[np.diff(times, prepend=-np.inf) > SAME_S]
