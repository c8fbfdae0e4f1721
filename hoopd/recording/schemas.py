"""Fields of the recorded and published messages: name, unit, meaning; JSON schemas made from them.

Rules of this file: a table per record of `hoopd.core.records`, in its order (a test compares both and the tables in
docs/); types come from the records themselves, so nothing is written twice; a schema has no unions, which the open
viewers refuse; no file, no clock.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import msgspec

from hoopd.core import records


class FieldDescription(NamedTuple):
    """Unit and meaning of one field."""

    unit: str
    meaning: str


Table = Mapping[str, FieldDescription]

TICK: Table = {
    "t": FieldDescription("s", "run time at which the tick took its inputs"),
    "id": FieldDescription("", "number of the tick: counts timer expirations, so a missed one is a gap"),
    "mode": FieldDescription("", "mode after the tick"),
    "u": FieldDescription("N m", "torque commanded, held from this tick to the next"),
    "theta": FieldDescription("rad", "hoop angle, unwrapped; missing when no answer came"),
    "dtheta": FieldDescription("rad/s", "hoop speed; missing when no answer came"),
    "current": FieldDescription("A", "motor current; missing when no answer came"),
    "psi": FieldDescription("rad", "ball angle, 0 at the bottom, unwrapped; missing when no new ball was seen"),
    "y_t": FieldDescription("s", "run time at which the board sampled theta, dtheta and current"),
    "psi_t": FieldDescription("s", "run time of the middle of the exposure that gave psi"),
    "x_hat": FieldDescription("rad, rad/s, rad, rad/s", "estimate of theta, dtheta, psi, dpsi at t"),
    "reference": FieldDescription("rad", "wanted ball angle"),
    "status": FieldDescription("", "board: bit0 enabled, 1 time-out latched, 2 torque limited, 3 fault"),
    "errors": FieldDescription("", "board: bit0 crc, 1 seq gap, 2 overcurrent, 3 encoder, 4 supply, 5 overspeed"),
    "lateness_s": FieldDescription("s", "start of this tick against its deadline"),
    "execution_s": FieldDescription("s", "duration of the previous tick, slots taken to frame written"),
    "distance": FieldDescription(
        "", "of the ball from the axis at psi_t, in shares of its track's radius; missing when no new ball was seen"
    ),
    "ball_mode": FieldDescription(
        "", "while a ball may leave the hoop what it does, as estimated at t: rolling, air or inner; else empty"
    ),
    "mode_probability": FieldDescription("", "of ball_mode, 0 to 1; else missing"),
    "distance_hat": FieldDescription("", "estimate of the distance at t, while a ball may leave the hoop"),
}

CAMERA: Table = {
    "frame": FieldDescription("", "camera's own picture counter"),
    "t": FieldDescription("s", "run time of the middle of the exposure"),
    "t_arrival": FieldDescription("s", "run time at which the detection was ready"),
    "psi": FieldDescription("rad", "ball angle in (-pi, pi]; null when no ball was found"),
    "confidence": FieldDescription("", "0 to 1"),
    "x_px": FieldDescription("px", "ball centre, to the right; null when no ball was found"),
    "y_px": FieldDescription("px", "ball centre, downwards; null when no ball was found"),
    "corners": FieldDescription(
        "", "checksum of the picture's four corners, by which equal pictures are known; 0 when not told"
    ),
    "direction": FieldDescription("rad", "of the ball from the axis, as psi, wherever it is; null when none was found"),
    "distance": FieldDescription(
        "", "of the ball from the axis, in shares of its track's radius; null when none was found"
    ),
}

DRIVER: Table = {
    "t": FieldDescription("s", "run time at which the board sampled"),
    "seq": FieldDescription("", "echo of the request's sequence number"),
    "status": TICK["status"],
    "errors": TICK["errors"],
    "theta": FieldDescription("rad", "hoop angle, wrapped by the board at +-512 turns"),
    "dtheta": FieldDescription("rad/s", "hoop speed"),
    "current": FieldDescription("A", "motor current"),
    "board_ms": FieldDescription("ms", "board clock modulo 65536"),
}

LINK: Table = {
    "good": FieldDescription("", "valid answers since the last tick"),
    "bad_crc": FieldDescription("", "answers with a wrong checksum"),
    "garbage_bytes": FieldDescription("", "bytes outside of any frame"),
    "unexpected_seq": FieldDescription("", "answers to another request"),
    "implausible": FieldDescription("", "answers with impossible values"),
    "lost": FieldDescription("", "the port itself is gone"),
}

COMMAND: Table = {
    "name": FieldDescription(
        "",
        "arm, disarm, clear, reference, tune, stop, shutdown, controller, trial, accept, revert, alive or experiment",
    ),
    "value": FieldDescription("", "in the unit of what it sets"),
    "key": FieldDescription("", "tune: name of the parameter; controller, trial, experiment: FILE@SHA256"),
    "text": FieldDescription("", "controller, trial, experiment: what was loaded, as JSON; else empty"),
}

INPUT: Table = {
    "id": TICK["id"],
    "t": TICK["t"],
    "camera": FieldDescription("", "newest picture's analysis since the last tick, or null"),
    "driver": FieldDescription("", "newest answer since the last tick, or null"),
    "link": FieldDescription("", "what the serial line brought since the last tick, by kind"),
    "commands": FieldDescription("", "wishes of the operator taken by this tick, in order"),
    "lateness_s": TICK["lateness_s"],
    "execution_s": TICK["execution_s"],
    "camera_stalled": FieldDescription("", "the camera's own watchdog gave up"),
    "trouble": FieldDescription("", "bit0 recorder drops or cannot write, bit1 telemetry drops"),
}

EVENT: Table = {
    "t": FieldDescription("s", "run time of the event"),
    "event": FieldDescription("", "name of the fact"),
    "level": FieldDescription("", "debug, info, warning, error or critical"),
    "fields": FieldDescription("", "particulars by name"),
}


class LogEvent(NamedTuple):
    """One fact worth a line in the log, at its run time."""

    t: float  # s
    event: str
    level: str = "info"
    fields: Mapping[str, Any] = types.MappingProxyType({})


RECORDS: Mapping[type, Table] = {
    records.TickRecord: TICK,
    records.Inputs: INPUT,
    records.CameraSample: CAMERA,
    records.DriverSample: DRIVER,
    records.LinkCounts: LINK,
    records.Command: COMMAND,
    LogEvent: EVENT,
}

# Channel of the file (and last chunk of the telemetry key) -> (schema name, record).
CHANNELS: Mapping[str, tuple[str, type]] = {
    "tick": ("hoopd.tick", records.TickRecord),
    "input": ("hoopd.input", records.Inputs),
    "event": ("hoopd.event", LogEvent),
}
# Channels that are registered with their schema. `input` holds null, and texts for infinities, where a replay needs
# them: no schema without unions says that.
DESCRIBED = ("tick", "event")
TOPIC_PREFIX = "/hoopd/"  # recordings made before it have the channel's bare name as topic
# Fields that a row leaves out when their number is missing, or their text is empty.
OPTIONAL: Mapping[type, frozenset[str]] = {
    records.TickRecord: frozenset(TICK) - {"t", "id", "mode", "status", "errors"},
}


def topic_of(channel: str) -> str:
    """Topic of a channel in the file."""
    return TOPIC_PREFIX + channel


def json_schema(record: type) -> dict[str, Any]:
    """JSON schema (draft 2020-12 subset, no unions) of a record, with unit and description at every field."""
    hints = get_type_hints(record)
    properties = {name: _property(hints[name], item) for name, item in RECORDS[record].items()}
    required = [name for name in properties if name not in OPTIONAL.get(record, frozenset())]
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def schema_bytes(channel: str) -> bytes:
    """The registered schema of a described channel, the same bytes every time."""
    name, record = CHANNELS[channel]
    return msgspec.json.encode({"title": name, **json_schema(record)})


def _property(hint: Any, item: FieldDescription) -> dict[str, Any]:
    unit = {"unit": item.unit} if item.unit else {}
    return {**_type(hint), **unit, "description": f"{item.meaning} [{item.unit}]" if item.unit else item.meaning}


_PLAIN: dict[Any, dict[str, Any]] = {
    float: {"type": "number"},
    int: {"type": "integer"},
    str: {"type": "string"},
    bool: {"type": "boolean"},
}


def _type(hint: Any) -> dict[str, Any]:
    if hint in _PLAIN:
        return dict(_PLAIN[hint])
    if get_origin(hint) is tuple:
        return {"type": "array", "items": _type(get_args(hint)[0])}
    return {"type": "object", "properties": {}}  # of any names; a viewer walks the properties
