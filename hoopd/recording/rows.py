"""Records of the tick <-> JSON rows.

Rules of this file: pure; a row is one JSON object with the record's field names in its order; a recorded tick leaves a
missing number (NaN) out, elsewhere it is null, and both are read; in an input row an infinity is the text "inf" or
"-inf"; every other float comes back with the same bits (msgspec writes the shortest text that does); numpy numbers are
taken for what they are. Row types are derived from the records, never written twice.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Mapping
from math import isfinite, isnan
from operator import itemgetter
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import UNSET

from hoopd.core.records import CameraSample, Command, DriverSample, Inputs, LinkCounts, TickRecord
from hoopd.recording.schemas import OPTIONAL, RECORDS, LogEvent

# Fields that recordings made before them lack, and what they are then.
LATER_FIELDS: Mapping[type, Mapping[str, Any]] = {
    CameraSample: {"corners": 0, "direction": None, "distance": None},
    Command: {"text": ""},
    TickRecord: {"distance": None, "ball_mode": "", "mode_probability": None, "distance_hat": None},
}

# What a counter or a bit field holds anywhere else, too; JSON has no end.
Word = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]

_NAN = float("nan")
_INFINITE = {"inf": float("inf"), "-inf": float("-inf")}
_INFINITIES = frozenset(_INFINITE.values())


def _plain(value: Any) -> Any:
    """Python value of a numpy one, or of a mapping proxy."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, types.MappingProxyType):
        return dict(value)
    return str(value)


_encoder = msgspec.json.Encoder(enc_hook=_plain)
_rows: dict[type, type[msgspec.Struct]] = {}


def row_type(record: type) -> type[msgspec.Struct]:
    """Struct with the fields of a record, as they stand in JSON."""
    if record not in _rows:
        hints = get_type_hints(record)
        later = LATER_FIELDS.get(record, {})
        fields = [(n, _wire(hints[n]), *([later[n]] if n in later else [])) for n in RECORDS[record]]
        _rows[record] = msgspec.defstruct(record.__name__ + "Row", fields, gc=False)
    return _rows[record]


def _sparse_type(record: type) -> type[msgspec.Struct]:
    """The row of a record in which its optional fields may be absent, which is missing."""
    wire = {name: _wire(hint) for name, hint in get_type_hints(record).items()}
    empty = {str: ("",)}
    fields = [
        (n, wire[n] | None, *empty.get(wire[n], (None,))) if n in OPTIONAL[record] else (n, wire[n])
        for n in RECORDS[record]
    ]
    return msgspec.defstruct(record.__name__ + "SparseRow", fields, kw_only=True, gc=False)


def _wire(hint: Any) -> Any:
    if hint is float:
        return float | str | None
    if hint in RECORDS:
        return row_type(hint)
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return Union[row_type(args[0]), None]  # noqa: UP007  (a struct made at run time)
    if origin is tuple:
        return list[_wire(args[0])]  # type: ignore[misc]
    return Word if hint is int else bool if hint is bool else str if hint is str else dict[str, Any]


_TickRow, _InputRow, _EventRow = row_type(TickRecord), row_type(Inputs), row_type(LogEvent)
_CameraRow, _DriverRow = row_type(CameraSample), row_type(DriverSample)
_LinkRow, _CommandRow = row_type(LinkCounts), row_type(Command)


def _out(value: Any) -> Any:
    """A number as JSON can hold it: infinities by name (NaN becomes null by itself)."""
    return str(float(value)) if value in _INFINITIES else value


def _back(value: Any) -> Any:
    if value is None:
        return _NAN
    if type(value) is not str:
        return value
    if value not in _INFINITE:
        raise msgspec.ValidationError(f"expected a number, got {value[:40]!r}")
    return _INFINITE[value]


def _all_finite(values: Iterable[float]) -> bool:
    """No number is NaN or infinite, by a sum that either would spoil; False, too, when the sum overflows."""
    total = sum(values)
    return total - total == 0.0


_X_HAT = TickRecord._fields.index("x_hat")
_UNKNOWN = (_NAN,) * 4
# Those that a ball brings which may leave the hoop come last.
_BALL = TickRecord._fields.index("ball_mode")
_optional_numbers = itemgetter(
    *(k for k, name in enumerate(TickRecord._fields[:_BALL]) if name in OPTIONAL[TickRecord] and k != _X_HAT)
)
_NO_BALL = (UNSET,) * (len(TickRecord._fields) - _BALL)


def encode_tick(record: TickRecord) -> bytes:
    """Row of the `tick` channel: a number that is missing, or is none, is left out."""
    rolls = not record.ball_mode and isnan(record.mode_probability) and isnan(record.distance_hat)
    if rolls and _all_finite(_optional_numbers(record)) and _all_finite(record.x_hat):
        return _encoder.encode(_TickRow(*record[:_BALL], *_NO_BALL))
    values = [UNSET if isinstance(value, float) and not isfinite(value) else value for value in record]
    if not record.ball_mode:
        values[_BALL] = UNSET
    if all(map(isnan, record.x_hat)):
        values[_X_HAT] = UNSET
    return _encoder.encode(_TickRow(*values))


def encode_tick_message(record: TickRecord) -> bytes:
    """Telemetry message of a tick: every field, a missing number is null."""
    return _encoder.encode(_TickRow(*record))


def encode_event(event: LogEvent) -> bytes:
    """Row of the `event` channel, also the telemetry message."""
    return _encoder.encode(_EventRow(*event))


def encode_input(inputs: Inputs) -> bytes:
    """Row of the `input` channel: everything that the tick knew."""
    camera, driver = inputs.camera, inputs.driver
    row = _InputRow(
        inputs.id,
        _out(inputs.t),
        None if camera is None else _CameraRow(*(camera if _all_finite(camera) else map(_out, camera))),
        None if driver is None else _DriverRow(*(driver if _all_finite(driver) else map(_out, driver))),
        _LinkRow(*inputs.link),
        [_CommandRow(name, _out(value), key, text) for name, value, key, text in inputs.commands],
        _out(inputs.lateness_s),
        _out(inputs.execution_s),
        inputs.camera_stalled,
        inputs.trouble,
    )
    return _encoder.encode(row)


def _decoder(row: type[msgspec.Struct]) -> Callable[[bytes], Any]:
    decode = msgspec.json.Decoder(row).decode

    def guarded(data: bytes) -> Any:
        try:
            return decode(data)
        except RecursionError:
            raise msgspec.ValidationError("the row is nested too deeply") from None

    return guarded


_decode_tick, _decode_input, _decode_event = map(_decoder, (_sparse_type(TickRecord), _InputRow, _EventRow))
_FLOATS = {record: frozenset(n for n, h in get_type_hints(record).items() if h is float) for record in RECORDS}


def _record(record: Any, row: Any) -> Any:
    """A flat record from its row."""
    floats = _FLOATS[record]
    return record._make(_back(getattr(row, n)) if n in floats else getattr(row, n) for n in record._fields)


def decode_tick(data: bytes) -> TickRecord:
    """The tick of a row; msgspec.MsgspecError when it is not one."""
    record: TickRecord = _record(TickRecord, _decode_tick(data))
    return record._replace(x_hat=_UNKNOWN if record.x_hat is None else tuple(map(_back, record.x_hat)))


def decode_event(data: bytes) -> LogEvent:
    """The event of a row; msgspec.MsgspecError when it is not one."""
    event: LogEvent = _record(LogEvent, _decode_event(data))
    return event


def decode_input(data: bytes) -> Inputs:
    """The inputs of a row, bit for bit; msgspec.MsgspecError when it is not one."""
    row: Any = _decode_input(data)
    inputs: Inputs = _record(Inputs, row)
    return inputs._replace(
        camera=None if row.camera is None else _record(CameraSample, row.camera),
        driver=None if row.driver is None else _record(DriverSample, row.driver),
        link=_record(LinkCounts, row.link),
        commands=tuple(_record(Command, command) for command in row.commands),
    )
