"""What `hoopd identify` is asked for, and its data: stretches of recordings, a part of them held out.

Rules of this file: whatever cannot be used is an InputError that names file, column and reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.inputs import read_recording
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.design.arx_law import arriving
from hoopd.design.laws import Spec
from hoopd.files.reading import InputError
from hoopd.ident.checks import CONSTANT
from hoopd.ident.data import Data, iddata
from hoopd.plants.declaration import Plant
from hoopd.recording.recording import MISSED_STEPS, Recording, rounded_step_s
from hoopd.recording.spans import spans

Array = NDArray[np.float64]

OUTPUTS = ("dtheta", "psi")
# What the hoop's input is called in an identified model.
INPUT = "torque"
ANY_COLUMNS = "columns of any other file are named by --input COLUMN,... --output COLUMN,..."
# Of a recording without another one to compare with, the last part is held out.
LAST_SHARE = 1.0 / 3.0
# The part that is compared must be longer than the slowest mode of the device once or twice.
SHORTEST = 50
# Readings of an output that a fit in percent and the tests of residuals ask for.
FEWEST_READINGS = 20
# Steps that differ by less are rounding of the time stamps.
SAME_STEP = 1e-6
# Rows are evenly apart when no step differs by more.
EVEN = 0.02


def read(names: Sequence[str], options: IdentifyOptions, plant: Plant | None) -> tuple[list[Data], list[str]]:
    """The stretches of recordings of a plant (the hoop without one), and what has to be said of them."""
    found, said = [], []
    for name in names:
        try:
            recording = read_recording(name, options.columns, plant=plant, hold=options.hold)
        except InputError as error:
            if plant is None and options.columns is None and str(name).endswith(".csv") and " header" in error.reason:
                raise InputError(error.path, error.key, f"{error.reason}; {ANY_COLUMNS}") from None
            raise
        parts, notes = stretches(recording, name, options)
        found += parts
        said += notes
    return found, said


def stretches(recording: Recording, name: str, options: IdentifyOptions) -> tuple[list[Data], list[str]]:
    """Inputs and outputs of a recording, row by row, cut where an input is not known; what was cut, in words.

    An output that was not read is missing. A stretch begins where every output was read, and has 50 rows at least.
    """
    names = [*recording.inputs] if recording.is_tick else [*options.inputs]
    y, u = _outputs(recording, options), np.stack([recording.inputs[one].values for one in names], axis=1)
    inputs = [INPUT] if recording.is_tick else names
    known = np.asarray(np.isfinite(u).all(axis=1))
    whole = np.asarray(np.isfinite(y).all(axis=1))
    if not whole.any():
        raise InputError(name, "", "no row holds all of the outputs that are asked for")
    found, step = [], rounded_step_s(recording)
    # the daemon's own ticks come when they can, a little late or early
    kept = [(0, len(known))] if recording.is_tick else in_step(recording, step, name, "hoopd convert --step")
    parts = [(first + a, first + b) for first, last in kept for a, b in spans(known[first:last])]
    for start, end in parts:
        first = start + int(np.argmax(whole[start:end]))
        if whole[first] and end - first >= (SHORTEST if len(parts) > 1 else 1):
            found.append(_data(y[first:end], u[first:end], step, (name, inputs), options))
    if not found:
        reason = f"no {SHORTEST} rows follow each other of which {_words(inputs)} known"
        raise InputError(name, names[0], reason)
    return found, _cut(known, found, name, _words(inputs, missing=True), len(kept) > 1)


def in_step(recording: Recording, step_s: float, name: str, even: str) -> list[tuple[int, int]]:
    """First row and the row after the last of what has no missing rows in it; InputError for rows that are not evenly
    apart, with what brings them to a step (`even`)."""
    if len(recording) < 2:
        raise InputError(name, "t", "one row has no step: two at least are needed")
    apart = np.diff(recording.t)
    skipped = apart > MISSED_STEPS * step_s
    if ((np.abs(apart - step_s) > EVEN * step_s) & ~skipped).any() or not np.isfinite(step_s):
        low, high = float(apart.min()), float(apart.max())
        raise InputError(name, "t", f"rows are {low:.4g} to {high:.4g} s apart: {even} brings them to an even step")
    return list(pairwise([0, *(np.flatnonzero(skipped) + 1).tolist(), len(recording)]))


def _words(inputs: Sequence[str], *, missing: bool = False) -> str:
    """The inputs in a sentence."""
    names = "the torque" if inputs == [INPUT] else " and ".join(inputs)
    return names if missing else f"{names} {'is' if len(inputs) == 1 else 'are'}"


def _cut(known: NDArray[np.bool_], found: Sequence[Data], name: str, inputs: str, skipped: bool) -> list[str]:
    missing = int((~known).sum())
    why = [f"{inputs} of {missing} rows is not known"] * (missing > 0) + ["rows are missing"] * skipped
    if not why:
        return []
    rows = sum(one.n for one in found)
    return [f"{name}: {', '.join(why)}: {rows} of {len(known)} rows used, in {len(found)} parts"]


def _outputs(recording: Recording, options: IdentifyOptions) -> Array:
    columns = {one: recording.column(one) for one in options.outputs}
    if options.delay_s is not None:
        try:
            spec = Spec(delay_s=options.delay_s, sample_time_s=recording.sample_time_s)
            columns |= dict(zip(OUTPUTS, arriving(recording, spec)[1].T, strict=True))
        except ValueError as error:
            raise InputError("--delay", "", getattr(error, "reason", str(error))) from None
    return np.stack([columns[one] for one in options.outputs], axis=1)


def _data(y: Array, u: Array, step: float, of: tuple[str, list[str]], options: IdentifyOptions) -> Data:
    name, inputs = of
    try:
        made = iddata(y, u, step, outputs=options.outputs, inputs=inputs)
    except ValueError as error:
        raise InputError(name, "", str(error)) from None
    return _without_mean(made) if options.detrend else made


def _without_mean(data: Data) -> Data:
    return replace(data, y=data.y - np.nanmean(data.y, axis=0), u=data.u - data.u.mean(axis=0))


def split(train: Sequence[Data]) -> tuple[list[Data], list[Data]]:
    """Every stretch up to its last third, and the last thirds that are long enough."""
    cuts = [round(one.n * (1.0 - LAST_SHARE)) for one in train]
    held = [one[cut:] for one, cut in zip(train, cuts, strict=True)]
    kept = [one for one in held if one.n >= SHORTEST]
    if not kept:
        raise InputError("REC", "", f"a recording of {3 * SHORTEST} samples at least, or --holdout, is needed")
    return [one[:cut] for one, cut in zip(train, cuts, strict=True)], kept


def check_held(train: Sequence[Data], held: Sequence[Data], name: str) -> None:
    """InputError unless the data can show how good a model of the others is."""
    for one in held:
        if abs(one.dt / train[0].dt - 1.0) > SAME_STEP:
            reason = f"rows are {one.dt:g} s apart, those of the fit {train[0].dt:g} s: hoopd convert --step"
            raise InputError(name, "", reason)
        if one.n < SHORTEST:
            raise InputError(name, "", f"{one.n} rows tell nothing about a model, {SHORTEST} at least do")
    y = np.concatenate([one.y for one in held])
    for output, column in zip(held[0].outputs, y.T, strict=True):
        known = column[np.isfinite(column)]
        if len(known) < FEWEST_READINGS:
            raise InputError(name, output, f"{len(known)} readings to compare with, {FEWEST_READINGS} are wanted")
        if np.ptp(known) <= CONSTANT * np.abs(known).max():
            raise InputError(name, output, "is constant: it does not show how good a model is, take another --holdout")
