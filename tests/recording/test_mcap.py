"""Runs on disk: bit-exact rows, same bytes for the same content, and every way a file can be broken."""

from __future__ import annotations

import io
import json
import math
import struct
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer as ForeignWriter

from hoopd.core.records import CameraSample, Command, DriverSample, Inputs, LinkCounts, TickRecord
from hoopd.files.reading import InputError
from hoopd.recording import mcap, rows
from hoopd.recording.schemas import DESCRIBED, RECORDS, LogEvent

NAN = float("nan")
HEADER = mcap.Header("hoop", "a: 1\n", "model", "controller", versions={"hoopd": "0.1"}, seed=7)


def tick(k: int, **changes: object) -> TickRecord:
    """Row k of a made-up run, every third one without a picture."""
    t = k * 0.02
    psi = NAN if k % 3 == 0 else math.sin(t)
    row = TickRecord(
        t,
        k,
        "RUNNING",
        0.1 * math.cos(t),
        t,
        0.3,
        0.2,
        psi,
        t - 0.02,
        t - 0.05,
        (t, 0.1, psi, -0.0),
        0.0,
        1,
        0,
        1e-4,
        5e-4,
    )
    return row._replace(**changes)


def inputs(k: int) -> Inputs:
    """What tick k knew."""
    t = k * 0.02
    camera = (
        None
        if k % 3 == 0
        else CameraSample(k, t - 0.05, t - 0.01, math.sin(t), 0.9, 240.5, 400.25, 0, math.sin(t), 1.0)
    )
    driver = DriverSample(t - 0.02, k % 256, 1, 0, t, 0.3, 0.2, k * 20 % 65536)
    return Inputs(
        k, t, camera, driver, LinkCounts(1), (Command("tune", 0.5, "q_psi"),) if k == 5 else (), 1e-4, 5e-4, False, 0
    )


def write(path: Path, count: int = 200) -> bytes:
    """A closed run of `count` ticks and two events."""
    with path.open("wb", buffering=0) as file:
        writer = mcap.Writer(file, HEADER)
        writer.add_event(LogEvent(0.0, "start", "info", {"mode": "DISARMED"}))
        for k in range(count):
            writer.add(tick(k), inputs(k))
        writer.add_event(LogEvent(count * 0.02, "stop"))
        writer.finish()
    return path.read_bytes()


def test_a_recording_tells_whether_it_is_the_rig_s_and_of_which_run(tmp_path: Path) -> None:
    for name, header in (("rig", HEADER), ("device", mcap.Header("hoop", "a: 1\n", "model", session="0123abcd"))):
        path = tmp_path / f"{name}.mcap"
        with path.open("wb") as file:
            writer = mcap.Writer(file, header)
            writer.add(tick(1), inputs(1))
            writer.finish()
        assert mcap.read(path).rig == (name == "rig")
        assert mcap.read_header(path) == mcap.read_run(path, ()).header == header


def test_a_header_is_read_from_the_beginning_of_its_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "a.mcap")
    whole = (tmp_path / "a.mcap").read_bytes()
    read: list[int] = []
    original = mcap.stream
    monkeypatch.setattr(mcap, "stream", lambda data, scan: (read.append(len(data)), original(data, scan))[1])
    monkeypatch.setattr(mcap, "HEADER_BYTES", 8000)
    assert mcap.read_header(tmp_path / "a.mcap") == HEADER and read[0] < 8100 < len(whole)
    (tmp_path / "a.mcap").write_bytes(whole[:6000])  # torn, or being written
    assert mcap.read_header(tmp_path / "a.mcap") == HEADER


@pytest.mark.parametrize("content", [b"no recording", b"", mcap.MCAP0_MAGIC, mcap.MCAP0_MAGIC + b"\x05" * 64])
def test_what_has_no_header_of_ours_is_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(InputError, match=r"^\S*a\.mcap: [^\n]+$"):
        mcap.read_header(tmp_path / "a.mcap")


def test_inputs_of_before_the_pictures_had_checksums_are_read() -> None:
    row = inputs(1)
    old = json.loads(rows.encode_input(row))
    assert old["camera"].pop("corners") == 0
    assert rows.decode_input(json.dumps(old).encode()) == row
    del old["camera"]["direction"], old["camera"]["distance"]
    camera = rows.decode_input(json.dumps(old).encode()).camera
    assert camera is not None and math.isnan(camera.direction) and math.isnan(camera.distance)
    del old["camera"]["x_px"]
    with pytest.raises(msgspec.ValidationError):
        rows.decode_input(json.dumps(old).encode())


def test_read_back(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    run = mcap.read_run(tmp_path / "a.mcap")
    assert run.header == HEADER
    assert run.lost == ""
    assert run.inputs == [inputs(k) for k in range(200)]
    assert repr(run.ticks) == repr([tick(k) for k in range(200)])
    assert [event.event for event in run.events] == ["start", "stop"]
    assert run.events[0].fields == {"mode": "DISARMED"}


def test_recording_columns(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    recording = mcap.read(tmp_path / "a.mcap")
    assert len(recording) == 200
    assert recording.sample_time_s == pytest.approx(0.02)
    assert np.isnan(recording.psi[0::3]).all() and not np.isnan(recording.psi[1::3]).any()
    assert recording.extra["x_hat"].shape == (200, 4)
    assert set(recording.extra["mode"]) == {"RUNNING"}
    assert (recording.source, recording.config) == ("a.mcap", "a: 1\n")
    with pytest.raises(ValueError):
        recording.u[0] = 1.0


def test_same_content_same_bytes(tmp_path: Path) -> None:
    assert write(tmp_path / "a.mcap") == write(tmp_path / "b.mcap")


def test_indexed_reader_of_the_package_agrees(tmp_path: Path) -> None:
    data = write(tmp_path / "a.mcap")
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    assert sum(1 for _ in reader.iter_messages(topics=["/hoopd/tick"])) == 200
    later = reader.iter_messages(topics=["/hoopd/tick"], starting_at=2_000_000_000)
    late = [message.log_time for _, _, message in later]
    assert late[0] == 2_000_000_000 and len(late) == 100
    summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == 402
    assert [item.name for item in reader.iter_metadata()] == [mcap.HEADER]


def test_chunks_close_every_quarter_second(tmp_path: Path) -> None:
    data = write(tmp_path / "a.mcap")
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == 17  # 4 s and the last event at 4.00 s
    assert all(index.message_end_time - index.message_start_time < 250_000_000 for index in summary.chunk_indexes)


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.999])
def test_torn_file_gives_every_whole_chunk(tmp_path: Path, part: float) -> None:
    data = write(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(data[: int(len(data) * part)])
    run = mcap.read_run(tmp_path / "b.mcap")
    assert run.inputs == [inputs(k) for k in range(len(run.inputs))]
    assert "never closed" in run.lost or part >= 0.9  # later only the index is torn
    assert len(run.ticks) >= int(200 * part) - 60


def test_zero_filled_tail(tmp_path: Path) -> None:
    data = write(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(data[: len(data) // 2] + bytes(len(data)))
    run = mcap.read_run(tmp_path / "b.mcap")
    assert len(run.ticks) > 50
    assert "bytes at the end are no record" in run.lost or "damaged chunk" in run.lost


def test_flipped_bit_costs_one_chunk(tmp_path: Path) -> None:
    data = bytearray(write(tmp_path / "a.mcap"))
    summary = make_reader(io.BytesIO(bytes(data))).get_summary()
    assert summary is not None
    index = summary.chunk_indexes[4]
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 1
    (tmp_path / "b.mcap").write_bytes(data)
    run = mcap.read_run(tmp_path / "b.mcap")
    assert run.lost == "1 damaged chunk left out"
    assert 185 <= len(run.ticks) < 200


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damage_never_raises_anything_else(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    folder = tmp_path_factory.mktemp("damage")
    good = bytearray(write(folder / "a.mcap", 30))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    (folder / "b.mcap").write_bytes(good[: data.draw(st.integers(0, len(good)))])
    try:
        mcap.read(folder / "b.mcap")
    except InputError as error:
        assert "\n" not in str(error)


def test_recover_writes_a_whole_file(tmp_path: Path) -> None:
    data = write(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(data[: len(data) // 2])
    torn = mcap.read_run(tmp_path / "b.mcap")
    assert "never closed" in mcap.recover(tmp_path / "b.mcap", tmp_path / "c.mcap")
    whole = mcap.read_run(tmp_path / "c.mcap")
    assert whole.lost == "" and whole.inputs == torn.inputs and whole.header == torn.header
    assert repr(whole.ticks) == repr(torn.ticks)


def foreign() -> bytes:
    """A valid MCAP file of somebody else."""
    buffer = io.BytesIO()
    writer = ForeignWriter(buffer)
    writer.start()
    channel = writer.register_channel("/imu", "json", writer.register_schema("imu", "jsonschema", b"{}"))
    writer.add_message(channel, 0, b"{}", 0)
    writer.finish()
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b"PK\x03\x04 zip", "not an MCAP file"),
        (foreign(), "not a recording of hoopd; its channels: /imu"),
    ],
)
def test_unusable_file_is_one_clear_line(tmp_path: Path, data: bytes, says: str) -> None:
    (tmp_path / "x.mcap").write_bytes(data)
    with pytest.raises(InputError, match=says):
        mcap.read_run(tmp_path / "x.mcap")
    with pytest.raises(InputError, match="no such file"):
        mcap.read(tmp_path / "absent.mcap")


def test_run_without_ticks(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", 0)
    assert mcap.read_run(tmp_path / "a.mcap").ticks == []
    with pytest.raises(InputError, match="holds no ticks"):
        mcap.read(tmp_path / "a.mcap")


def bits(value: float) -> bytes:
    """Bytes of a float; all NaN are one."""
    return b"nan" if math.isnan(value) else struct.pack("<d", value)


@settings(deadline=None)
@given(st.lists(st.floats(), min_size=13, max_size=13))
def test_inputs_come_back_bit_for_bit(x: list[float]) -> None:
    camera, driver = CameraSample(1, *x[:6]), DriverSample(x[6], 1, 2, 3, *x[7:10], 4)
    sent = Inputs(1, x[10], camera, driver, LinkCounts(lost=True), (Command("reference", x[11]),), x[12], 0.0, True, 3)
    back = rows.decode_input(rows.encode_input(sent))
    assert back.camera is not None and back.driver is not None
    got = [*back.camera[1:7], back.driver.t, *back.driver[4:7], back.t, back.commands[0].value, back.lateness_s]
    assert [*map(bits, got)] == [*map(bits, x)]
    assert (back.link, back.camera_stalled, back.trouble) == (sent.link, True, 3)


def test_numpy_numbers_are_plain_in_a_row() -> None:
    row = json.loads(
        rows.encode_tick(tick(1, u=np.float64(0.1), id=np.int64(3), x_hat=np.arange(4.0), psi=np.float64("nan")))
    )
    assert (row["u"], row["id"], row["x_hat"], "psi" in row) == (0.1, 3, [0.0, 1.0, 2.0, 3.0], False)


def test_tables_follow_the_records() -> None:
    for record, table in RECORDS.items():
        assert tuple(table) == record._fields  # type: ignore[attr-defined]


def test_schemas_describe_every_field() -> None:
    for channel in DESCRIBED:
        schema = json.loads(mcap.schema_bytes(channel))
        assert all(item["description"] for item in schema["properties"].values())
    tick_schema = json.loads(mcap.schema_bytes("tick"))
    assert tick_schema["title"] == "hoopd.tick"
    assert tick_schema["properties"]["u"]["unit"] == "N m"


def test_secrets_stay_out(tmp_path: Path) -> None:
    text = "zenoh: {user: me, password: abc}\n  password: 'x y'\n"
    assert mcap.without_secrets(text) == "zenoh: {user: me, password: '***'}\n  password: '***'\n"


@pytest.mark.parametrize("key", ["seed", "part"])
@pytest.mark.parametrize("text", ["x", "9" * 5000])
def test_a_number_of_the_header_that_is_none_is_told_with_its_key(key: str, text: str) -> None:
    with pytest.raises(ValueError, match=f"header: {key}: expected a whole number, got '.{{1,40}}'$"):
        mcap.header_of({key: text})
