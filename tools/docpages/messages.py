"""The page of recorded and published messages and of the frames to the board, from their tables in the code."""

from __future__ import annotations

from typing import Any, get_type_hints

from docpages.markdown import code, sections, table
from hoopd.core.layout import DEFAULT_LAYOUT, FrameLayout
from hoopd.recording import schemas

INTRODUCTION = """# Messages and frames

The fields of everything that is recorded, published or sent to the board. How a recording is kept:
[recordings](../recording.md); keys and sessions: [telemetry](../telemetry.md); what a board must do: [the driver
board](../board.md)."""
CHANNELS = "## Messages\n\nRecorded on a topic, and published under a key that ends in the channel's name."
PARTS = "## Parts of `input`\n\nWhat a tick was given; a replay computes everything again from it."
FRAMES = "## Frames on the serial line\n\nThe shipped layout; `serial.layout` names a file with another one."
CODES = {"B": "u8", "b": "i8", "H": "u16", "h": "i16", "I": "u32", "i": "i32", "f": "f32", "d": "f64"}
NAMES = {float: "number", int: "whole number", str: "text", bool: "yes or no"}


def page() -> str:
    """The whole page."""
    channels = [_message(f"### {schemas.topic_of(name)}", record) for name, (_, record) in schemas.CHANNELS.items()]
    described = {record for _, record in schemas.CHANNELS.values()}
    parts = [_message(f"### {record.__name__}", record) for record in schemas.RECORDS if record not in described]
    frames = [_frame(DEFAULT_LAYOUT.request), _frame(DEFAULT_LAYOUT.answer)]
    return sections(INTRODUCTION, CHANNELS, *channels, PARTS, *parts, FRAMES, *frames)


def _message(heading: str, record: type) -> str:
    hints, missing = get_type_hints(record), schemas.OPTIONAL.get(record, frozenset())
    rows = [
        [
            code(name),
            _type(hints[name]),
            field.unit,
            field.meaning + (" (left out when missing)" if name in missing else ""),
        ]
        for name, field in schemas.RECORDS[record].items()
    ]
    return sections(heading, table(["field", "type", "unit", "meaning"], rows))


def _type(hint: Any) -> str:
    return NAMES.get(hint, "list" if "tuple" in str(hint) else "section")


def _frame(layout: FrameLayout) -> str:
    rows: list[list[object]] = [] if layout.sync is None else [[0, "sync", "u8", f"{layout.sync:#04x}"]]
    offset = len(rows)
    for field in layout.fields:
        rows.append([offset, field.name, CODES[field.code], "" if field.scale == 1.0 else f"times {field.scale:g}"])
        offset += int(CODES[field.code][1:]) // 8
    if layout.crc != "none":
        rows.append([offset, layout.crc, f"u{layout.crc.removeprefix('crc')}", "over all bytes before it"])
    order = "little-endian" if layout.byte_order == "<" else "big-endian"
    heading = f"### {layout.kind.capitalize()}: {layout.length} bytes, {order}"
    return sections(heading, table(["byte", "field", "type", "value"], rows))
