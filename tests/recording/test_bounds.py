"""Small files that would become large, and files that are none: one line, before the memory or the time is spent."""

from __future__ import annotations

import io
import os
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from hoopd.commands.calibrate import read_picture, read_positions
from hoopd.files.reading import InputError, read_text, unpacked_limit
from hoopd.recording import container, load, mcap, rows
from hoopd.recording.schemas import CHANNELS

FEW_BYTES = 60 * 2**20  # three times what a small file may unpack to


def refused(path: Path, read: Callable[[Path], object] = load) -> str:
    """The one line; the memory that it took is bounded."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as error:
            read(path)
        assert tracemalloc.get_traced_memory()[1] < FEW_BYTES
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value) and str(error.value).count(path.name) == 1
    return str(error.value)


def mcap_of(message: bytes, chunk_bytes: int, chunks: int) -> bytes:
    """A run of ours with the same message again and again."""
    out = RecordBuilder()
    out.write(MCAP0_MAGIC)
    records.Header(profile=mcap.PROFILE, library="x").write(out)
    for number, (topic, (schema, *_)) in enumerate(CHANNELS.items(), 1):
        records.Schema(id=number, name=schema, encoding="jsonschema", data=b"{}").write(out)
        records.Channel(id=number, topic=topic, message_encoding="json", schema_id=number, metadata={}).write(out)
    plain = message * (chunk_bytes // len(message))
    for _ in range(chunks):
        records.Chunk(
            compression="zstd",
            data=zstandard.compress(plain),
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=zlib.crc32(plain),
            uncompressed_size=len(plain),
        ).write(out)
    return bytes(out.end())  # type: ignore[no-untyped-call]


@pytest.mark.proof
def test_many_chunks_that_are_much_together(tmp_path: Path) -> None:
    message = container._MESSAGE.pack(5, container._MESSAGE.size - 9, 9, 0, 0, 0)  # of a channel that nobody reads
    path = tmp_path / "small.mcap"
    path.write_bytes(mcap_of(message, 2**20, 100))
    assert path.stat().st_size < 100_000
    assert "unpacks to more than" in refused(path)


def test_a_chunk_as_long_as_its_file_is_not_even_copied() -> None:
    length, scan = 40 * 2**20, container.Scan()
    data = MCAP0_MAGIC + bytes([Opcode.CHUNK]) + length.to_bytes(8, "little") + bytes(length)
    tracemalloc.start()
    try:
        assert list(container.stream(data, scan)) == []
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
    assert scan.bad_chunks == 1


def test_a_chunk_larger_than_any_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "small.mcap"
    path.write_bytes(mcap_of(b"\0", 60 * 2**20, 1))
    assert "damaged chunk" in refused(path)


@pytest.mark.parametrize("field", [b'"id"', b'"status"', b'"errors"'])
def test_an_integer_without_end_in_a_row(field: bytes) -> None:
    _, fields = rows.RECORDS, rows.row_type(rows.TickRecord).__struct_fields__
    assert field.strip(b'"').decode() in fields
    values = dict.fromkeys(fields, b"0.0") | {"id": b"0", "mode": b'""', "x_hat": b"[]", "status": b"0"}
    values |= {"errors": b"0", field.strip(b'"').decode(): b"9" * 400}
    text = b"{" + b",".join(b'"%s":%s' % (name.encode(), value) for name, value in values.items()) + b"}"
    with pytest.raises((ValueError, rows.msgspec.MsgspecError)):
        rows.decode_tick(text)


def mat_of(name: str, count: int, path: Path) -> None:
    sound = {"meas_pos": {"Time": np.arange(5.0)[:, None] * 0.02, "Data": np.zeros((5, 4))}}
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, sound | {name: {"Time": np.zeros((count, 1))}}, do_compression=True)
    path.write_bytes(buffer.getvalue())


def test_a_packed_variable_larger_than_any(tmp_path: Path) -> None:
    path = tmp_path / "small.mat"
    mat_of("meas_pos", 10**7, path)
    assert path.stat().st_size < 100_000
    assert "a packed element of more than" in refused(path)


def test_what_nobody_asks_for_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "large.mat"
    mat_of("other", 10**7, path)
    tracemalloc.start()
    assert len(load(path)) == 5
    assert tracemalloc.get_traced_memory()[1] < FEW_BYTES
    tracemalloc.stop()


def h5_of(path: Path, make: Callable[[h5py.Group], object]) -> Path:
    with h5py.File(path, "w") as file:
        group = file.create_group("Exp1")
        group["Timestamps"], group["Input"] = np.arange(60) * 0.02, np.zeros(60)
        make(group)
    return path


def test_an_array_that_takes_no_room_in_its_file(tmp_path: Path) -> None:
    def make(group: h5py.Group) -> None:
        group.create_dataset("States", (3, 10**7), "f8", chunks=True, compression="gzip")

    assert "no recording" in refused(h5_of(tmp_path / "small.h5", make))


OUTSIDE: dict[str, Callable[[h5py.Group], object]] = {
    "values": lambda group: group.create_dataset("States", (3, 60), "f8", external=[("pipe", 0, h5py.h5f.UNLIMITED)]),
    "link": lambda group: group.__setitem__("States", h5py.ExternalLink("pipe", "/x")),
    "link to a link": lambda group: (
        group.__setitem__("x", h5py.ExternalLink("pipe", "/x")),
        group.__setitem__("States", h5py.SoftLink("/Exp1/x")),
    ),
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", OUTSIDE)
def test_hdf5_that_leads_into_a_pipe(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    refused(h5_of(tmp_path / "small.h5", OUTSIDE[name]))


def test_virtual_hdf5(tmp_path: Path) -> None:
    def make(group: h5py.Group) -> None:
        layout = h5py.VirtualLayout((3, 60), "f8")
        layout[:] = h5py.VirtualSource("elsewhere.h5", "x", (3, 60))
        group.create_virtual_dataset("States", layout)

    assert "another file" in refused(h5_of(tmp_path / "small.h5", make))


READERS: dict[str, Callable[[Path], object]] = {
    "text": read_text,
    "run.mcap": load,
    "run.mat": load,
    "run.h5": load,
    "run.csv": load,
    "points.csv": read_positions,
    "points.npy": read_positions,
    "picture.png": read_picture,
}


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_not_waited_for(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    assert "not a file" in refused(path, READERS[name])
    path.unlink()
    path.mkdir()
    assert "is a directory" in refused(path, READERS[name])
    path.rmdir()
    path.symlink_to("/dev/zero")
    assert "not a file" in refused(path, READERS[name])
    path.unlink()
    os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_CLOEXEC), 2**40)
    assert "larger than" in refused(path, READERS[name])


def test_a_sound_file_is_far_below_the_limit() -> None:
    assert unpacked_limit(28_000) < 10 * 2**20
    assert unpacked_limit(10**8) > 10**9
