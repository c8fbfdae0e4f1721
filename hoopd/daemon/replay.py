"""`hoopd replay`: the recorded inputs through the same tick again, compared bit for bit.

Rules of this file: everything comes out of the recording (configuration, model, controller, inputs); equal means
the same bits, a missing number equals a missing number.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from math import isnan
from pathlib import Path
from typing import Any

import msgspec

from hoopd.core.records import TickRecord
from hoopd.core.tick import Tick
from hoopd.daemon.build import Texts, build_tick
from hoopd.files.reading import InputError, parse_yaml, to_struct
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.shell.config import Config

# Measured after the decision, so that no decision depends on it.
NOT_DECIDED = ("execution_s",)
DROPS = ("recorder_dropped", "recorder_trouble")


def replay(path: Path, *, run_law: bool = False) -> dict[str, Any]:
    """Repeat a run; `equal` and, when not, the first row and field that differ.

    `run_law`: the code of a user's own law in the recording may run here.
    """
    run = read_run(path)
    _check(path, run)
    if run.header.law and not run_law:
        raise InputError(path, "law", "holds a law of a user's own, which is code: read it, then add --run-law")
    header = run.header
    config = recorded_config(path, header.config)
    tick = _built(path, config, Texts(header.config, header.model, header.controller, header.law))
    different, first = 0, ""
    for inputs, recorded in zip(run.inputs, run.ticks, strict=False):
        fields = list(differences(tick.step(inputs).record, recorded))
        different += bool(fields)
        if fields and not first:
            first = f"row {recorded.id} at {recorded.t:.4f} s: {', '.join(fields)}"
    gaps = [event.event for event in run.events if event.event in DROPS]
    return {
        "recording": path.name,
        "ticks": min(len(run.inputs), len(run.ticks)),
        "equal": different == 0,
        "different": different,
        "first_difference": first,
        "lost": run.lost or (f"the recorder reported {', '.join(sorted(set(gaps)))}" if gaps else ""),
    }


def recorded_config(path: object, text: str) -> Config:
    """The configuration of a recording; before `faults.accepted_off` every row that was off was accepted."""
    told = parse_yaml(text, path)
    config = to_struct(told, Config, path)
    faults = told.get("faults")
    if isinstance(faults, dict) and "accepted_off" in faults:
        return config
    accepted = replace(config.faults, accepted_off=tuple(config.faults.off_rows()))
    return msgspec.structs.replace(config, faults=accepted)


def _built(path: Path, config: Config, texts: Texts) -> Tick:
    """The tick of a recording; what its header lacks is the recording's fault."""
    try:
        return build_tick(config, texts)
    except InputError as error:
        raise InputError(path, f"header: {error.path}", f"{error.key}: {error.reason}".lstrip(": ")) from None


def differences(new: TickRecord, old: TickRecord) -> Iterator[str]:
    """Names of the decided fields whose bits differ."""
    for name, a, b in zip(TickRecord._fields, new, old, strict=True):
        if name not in NOT_DECIDED and _bits(a) != _bits(b):
            yield name


def _bits(value: Any) -> Any:
    """A number as its bits, so that NaN equals NaN and -0 differs from 0."""
    if isinstance(value, float):
        return "nan" if isnan(value) else struct.pack("<d", value)
    if isinstance(value, tuple | list):
        return tuple(_bits(item) for item in value)
    return value


def _check(path: Path, run: RecordedRun) -> None:
    if not run.inputs:
        raise InputError(path, "input", "holds no inputs, nothing to replay")
    if not (run.header.model and run.header.controller):
        raise InputError(path, "header", "model and controller are not in it: damaged, nothing to replay")
    if run.header.part:
        raise InputError(path, "part", f"is part {run.header.part} of a run: the state at its beginning is not in it")
