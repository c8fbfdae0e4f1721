"""The form of a recording: schemas without unions, topics, times, and the older form that is still read."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader

from hoopd.core.records import DriverSample, Inputs, LinkCounts, TickRecord
from hoopd.recording import Recording, container, mcap, rows, save
from hoopd.recording.schemas import CHANNELS, DESCRIBED, OPTIONAL, LogEvent, schema_bytes

NAN = math.nan
WALL_NS = 1_700_000_000_123_456_789
PLAIN = {"number": float, "integer": int, "string": str, "object": dict}
FLOATS = [name for name in TickRecord._fields if name in OPTIONAL[TickRecord] and name not in ("x_hat", "ball_mode")]


def tick(k: int, **changes: object) -> TickRecord:
    """Row k of a made-up run; its estimate and every other picture are missing."""
    t, psi = k * 0.02, NAN if k % 2 else 0.1
    row = TickRecord(t, k, "READY", 0.0, 0.1, 0.2, NAN, psi, t - 0.01, psi, (NAN,) * 4, 0.0, 1, 0, 1e-4, NAN)
    return row._replace(**changes)


def inputs(k: int) -> Inputs:
    """What tick k knew: no picture, and a current that nobody measured."""
    driver = DriverSample(k * 0.02 - 0.01, k, 1, 0, 0.1, 0.2, NAN, k)
    return Inputs(k, k * 0.02, None, driver, LinkCounts(1), (), 1e-4, math.inf, False, 0)


def run_bytes(zero_ns: int = 0) -> bytes:
    """A run of 50 ticks."""
    buffer = io.BytesIO()
    writer = mcap.Writer(buffer, mcap.Header("hoop"), sync=False, zero_ns=zero_ns)
    for k in range(50):
        writer.add(tick(k), inputs(k))
    writer.add_event(LogEvent(0.99, "stop", "info", {"reason": None}))
    writer.finish()
    return buffer.getvalue()


def older_bytes() -> bytes:
    """The same run as it was written before: bare topics, every channel with a schema, null for a missing number."""
    buffer = io.BytesIO()
    file = container.ChunkedFile(buffer, mcap.PROFILE)
    unions = b'{"type":"object","properties":{"psi":{"type":["number","null"]}}}'
    number = {name: file.add_channel(name, schema, unions) for name, (schema, _) in CHANNELS.items()}
    file.add_metadata(mcap.HEADER, mcap.header_texts(mcap.Header("hoop")))
    for k in range(50):
        time_ns = round(tick(k).t * 1e9)
        file.add_message(number["input"], time_ns, 2 * k + 1, rows.encode_input(inputs(k)))
        file.add_message(number["tick"], time_ns, 2 * k + 2, rows.encode_tick_message(tick(k)))
    event = rows.encode_event(LogEvent(0.99, "stop", "info", {"reason": None}))
    file.add_message(number["event"], 990_000_000, 101, event)
    file.finish()
    return buffer.getvalue()


def parts(schema: Any) -> Iterator[dict[str, Any]]:
    """A schema and all within it."""
    yield schema
    for inner in (*schema.get("properties", {}).values(), *([schema["items"]] if "items" in schema else [])):
        yield from parts(inner)


@pytest.mark.parametrize("channel", DESCRIBED)
def test_no_schema_has_a_union(channel: str) -> None:
    for part in parts(json.loads(schema_bytes(channel))):
        assert isinstance(part["type"], str)
        assert not {"oneOf", "anyOf", "allOf", "enum"} & set(part)
        assert part["type"] != "object" or isinstance(part["properties"], dict)  # walked without a look


def test_topics_and_schemas_of_the_channels() -> None:
    reader = make_reader(io.BytesIO(run_bytes()), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    names = {channel.topic: channel.schema_id for channel in summary.channels.values()}
    assert sorted(names) == ["/hoopd/event", "/hoopd/input", "/hoopd/tick"]
    assert names["/hoopd/input"] == 0
    assert [summary.schemas[names[f"/hoopd/{name}"]].name for name in DESCRIBED] == ["hoopd.tick", "hoopd.event"]


def test_every_row_is_what_its_schema_says() -> None:
    for schema, channel, message in make_reader(io.BytesIO(run_bytes()), validate_crcs=True).iter_messages():
        row = json.loads(message.data)
        if schema is None:
            assert channel.topic == "/hoopd/input"
            continue
        described = json.loads(schema.data)
        assert set(described["required"]) <= set(row) <= set(described["properties"])
        for name, value in row.items():
            kind = described["properties"][name]["type"]
            assert isinstance(value, PLAIN[kind]) and type(value) is not bool


def test_a_missing_number_is_left_out_and_comes_back() -> None:
    row = json.loads(rows.encode_tick(tick(1)))
    assert not {"psi", "psi_t", "current", "x_hat", "execution_s"} & set(row)
    assert repr(rows.decode_tick(rows.encode_tick(tick(1)))) == repr(tick(1))


@settings(deadline=None)
@given(st.lists(st.floats(allow_infinity=False), min_size=len(FLOATS), max_size=len(FLOATS)), st.booleans())
def test_ticks_come_back_to_the_bit_in_both_forms(values: list[float], unknown: bool) -> None:
    sent = tick(3, **dict(zip(FLOATS, values, strict=True)), x_hat=(NAN,) * 4 if unknown else (0.1, -0.0, 1e-300, 2.0))
    for encode in (rows.encode_tick, rows.encode_tick_message):
        assert repr(rows.decode_tick(encode(sent))) == repr(sent)


def test_a_row_needs_what_is_never_missing() -> None:
    whole = json.loads(rows.encode_tick(tick(0)))
    for name in ("t", "id", "mode", "status", "errors"):
        with pytest.raises(rows.msgspec.ValidationError, match=name):
            rows.decode_tick(json.dumps({key: value for key, value in whole.items() if key != name}).encode())


def test_the_older_form_is_read_as_the_same_run(tmp_path: Path) -> None:
    (tmp_path / "old.mcap").write_bytes(older_bytes())
    (tmp_path / "new.mcap").write_bytes(run_bytes())
    old, new = mcap.read_run(tmp_path / "old.mcap"), mcap.read_run(tmp_path / "new.mcap")
    assert repr(old) == repr(new)
    assert len(old.ticks) == len(old.inputs) == 50 and len(old.events) == 1
    assert repr(mcap.read(tmp_path / "old.mcap").psi) == repr(mcap.read(tmp_path / "new.mcap").psi)
    mcap.recover(tmp_path / "old.mcap", tmp_path / "recovered.mcap")
    assert (tmp_path / "recovered.mcap").read_bytes() == run_bytes()


def log_times(data: bytes) -> list[int]:
    """Of every tick."""
    return [m.log_time for _, _, m in make_reader(io.BytesIO(data)).iter_messages(topics=["/hoopd/tick"])]


def test_log_time_counts_from_the_wall_clock_at_the_start(tmp_path: Path) -> None:
    data, lockstep = run_bytes(WALL_NS), run_bytes()
    assert log_times(lockstep) == [round(k * 0.02 * 1e9) for k in range(50)]
    assert log_times(data) == [WALL_NS + time_ns for time_ns in log_times(lockstep)]
    (tmp_path / "a.mcap").write_bytes(data)
    run = mcap.read_run(tmp_path / "a.mcap")
    assert run.zero_ns == WALL_NS and run.ticks[10].t == 0.2
    mcap.recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == data


def test_no_date_goes_into_a_copy(tmp_path: Path) -> None:
    copies = []
    for zero_ns in (0, WALL_NS):
        (tmp_path / "run.mcap").write_bytes(run_bytes(zero_ns))
        recording: Recording = mcap.read(tmp_path / "run.mcap")
        save(recording, tmp_path / "copy.mcap")
        copies.append((tmp_path / "copy.mcap").read_bytes())
    assert copies[0] == copies[1]


def test_a_channel_of_somebody_else_is_not_ours(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    file = container.ChunkedFile(buffer, "ros2")
    for topic, schema in (("tick", "their.tick"), ("input", ""), ("/hoopd/tick", "their.tick")):
        file.add_message(file.add_channel(topic, schema, b"{}"), 0, 0, b"{}")
    file.finish()
    (tmp_path / "a.mcap").write_bytes(buffer.getvalue())
    with pytest.raises(mcap.InputError, match="not a recording of hoopd"):
        mcap.read_run(tmp_path / "a.mcap")
