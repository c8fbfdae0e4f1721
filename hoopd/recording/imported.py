"""A recording from elsewhere as a run of ours: the channel `tick`, and a header that says where it came from.

Rules of this file: what the source did not have keeps the empty value of its type; no inputs are invented, so such
a run can be looked at, fitted and edited, but not replayed.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import Any

from hoopd.core.records import TickRecord
from hoopd.recording import mcap, sample_rows
from hoopd.recording.recording import UNITS, Recording
from hoopd.recording.tables import in_tick_form

_NAN = float("nan")
_EMPTY = {"mode": "", "x_hat": (_NAN,) * 4, "reference": _NAN, "status": 0, "errors": 0}
_EMPTY_TIMES = {"lateness_s": _NAN, "execution_s": _NAN}
_EMPTY_BALL = {"distance": _NAN, "ball_mode": "", "mode_probability": _NAN, "distance_hat": _NAN}


def encode(recording: Recording, fields: dict[str, Any]) -> bytes:
    """The bytes of an MCAP file with one tick a row; of another plant, with one sample a row."""
    buffer = BytesIO()
    header = mcap.Header(config=recording.config, converted=recording.source or "a recording without a name")
    if not in_tick_form(recording):
        sample_rows.write(buffer, recording, header)
        return buffer.getvalue()
    writer = mcap.Writer(buffer, header, sync=False)
    for record in _ticks(recording):
        writer.add_tick(record)
    writer.finish()
    return buffer.getvalue()


def _ticks(recording: Recording) -> Iterator[TickRecord]:
    """One tick a row, bit for bit."""
    columns = [_column(recording, name) for name in TickRecord._fields]
    return map(TickRecord._make, zip(*columns, strict=True))


def _column(recording: Recording, name: str) -> Any:
    if name in UNITS:
        return recording.column(name).tolist()
    if name in recording.extra:
        return recording.extra[name].tolist()
    if name == "id":
        return range(len(recording))
    return [{**_EMPTY, **_EMPTY_TIMES, **_EMPTY_BALL}[name]] * len(recording)
