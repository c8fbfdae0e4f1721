"""Recordings, tables and pictures spoiled from within: sound outside, with contents that nobody means.

Rules of this file: written with the libraries that write the sound ones, so that checksums and lengths are right.
"""

from __future__ import annotations

import io
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.writer import MCAP0_MAGIC

from fuzzing import plants
from fuzzing.damage import row_of_json
from hoopd.recording import container, mcap, rows
from hoopd.recording.schemas import CHANNELS, DESCRIBED, topic_of

MEGABYTE = 2**20
SIZES = (0, 1, 10**3, 10**6, 3 * 10**7)


def mcap_of(sound: Path, rng: random.Random) -> bytes:
    """A recording of ours with other rows, another header or other chunks."""
    return rng.choice((_rows, _rows, _rows, _header, _chunks, _messages))(sound, rng)


def _texts(run: mcap.RecordedRun) -> dict[str, list[bytes]]:
    return {
        "input": [rows.encode_input(row) for row in run.inputs],
        "tick": [rows.encode_tick(row) for row in run.ticks],
        "event": [rows.encode_event(row) for row in run.events],
    }


def _written(header: dict[str, str], texts: dict[str, list[bytes]]) -> bytes:
    buffer = io.BytesIO()
    out = container.ChunkedFile(buffer, mcap.PROFILE)
    channels = mcap.add_channels(out)
    out.add_metadata(mcap.HEADER, header)
    for key, values in texts.items():
        for number, text in enumerate(values):
            out.add_message(channels[key], number, number, text)
    out.finish()
    return buffer.getvalue()


def _rows(sound: Path, rng: random.Random) -> bytes:
    run = mcap.read_run(sound)
    texts = _texts(run)
    for _ in range(rng.choice((1, 1, 5))):
        row = rng.choice(texts[rng.choice(("input", "tick", "event"))] or texts["tick"])
        channel = next(name for name, values in texts.items() if row in values)
        texts[channel][texts[channel].index(row)] = row_of_json(row, rng)
    return _written(mcap.header_texts(run.header), texts)


def _header(sound: Path, rng: random.Random) -> bytes:
    run = mcap.read_run(sound)
    texts = mcap.header_texts(run.header)
    name = rng.choice(sorted(texts))
    wrong = ("", "9" * 5000, "{", "[]", "\0", "\u2028", "x" * MEGABYTE, "[" * 9000, "- " * 9000, "{a: 1}", "law", "-1")
    lines = texts[name].split("\n")
    lines[rng.randrange(len(lines))] = rng.choice(wrong)
    return _written(texts | {name: rng.choice((*wrong, "\n".join(lines), "\n".join(lines)))}, _texts(run))


def _chunks(sound: Path, rng: random.Random) -> bytes:
    """Chunks that are much once they are unpacked."""
    out = RecordBuilder()
    out.write(MCAP0_MAGIC)
    records.Header(profile=mcap.PROFILE, library="x").write(out)
    for number, name in enumerate(CHANNELS, 1):
        schema, topic = number if name in DESCRIBED else 0, topic_of(name)
        if schema:
            records.Schema(id=number, name=CHANNELS[name][0], encoding="jsonschema", data=b"{}").write(out)
        records.Channel(id=number, topic=topic, message_encoding="json", schema_id=schema, metadata={}).write(out)
    plain = rng.choice((_noughts, _tiny, _same_row))(sound, rng.choice((MEGABYTE, 8 * MEGABYTE, 60 * MEGABYTE)))
    claimed = rng.choice((len(plain), len(plain), 10, 2**62))
    packing, packed = rng.choice((("zstd", zstandard.ZstdCompressor().compress(plain)), ("", plain), ("lz4", b"x")))
    for _ in range(rng.choice((1, 3, 40)) if packing == "zstd" else 1):
        records.Chunk(
            compression=packing,
            data=packed,
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=rng.choice((0, zlib.crc32(plain))),
            uncompressed_size=claimed,
        ).write(out)
    return bytes(out.end())  # type: ignore[no-untyped-call]


def _noughts(sound: Path, size: int) -> bytes:
    return b"\0" * size


def _tiny(sound: Path, size: int) -> bytes:
    """Messages without content."""
    message = container._MESSAGE.pack(5, container._MESSAGE.size - 9, 9, 0, 0, 0)
    return message * (size // len(message))


def _same_row(sound: Path, size: int) -> bytes:
    """One tick again and again."""
    row = rows.encode_tick(mcap.read_run(sound).ticks[-1])
    message = container._MESSAGE.pack(5, container._MESSAGE.size - 9 + len(row), 1, 0, 0, 0) + row
    return message * (size // len(message))


def _messages(sound: Path, rng: random.Random) -> bytes:
    """Rows in another order, twice, or only some."""
    run = mcap.read_run(sound)
    texts = _texts(run)
    for values in texts.values():
        if rng.random() < 0.5:
            rng.shuffle(values)
        elif rng.random() < 0.5:
            del values[rng.randrange(len(values) + 1) :]
        else:
            values.extend(values * rng.choice((0, 1, 19)))
    return _written(mcap.header_texts(run.header), texts)


def mat_of(sound: Path, rng: random.Random) -> bytes:
    """A MATLAB file whose packed elements hold something else."""
    data, out, position = sound.read_bytes(), bytearray(), 128
    out += data[:128]
    while position + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, position)
        body = data[position + 8 : position + 8 + size]
        if kind == 15:
            body = zlib.compress(_other_element(zlib.decompress(body), rng))
        out += struct.pack("<II", kind, rng.choice((len(body),) * 8 + (2**31, 0))) + body
        position += 8 + size
    return bytes(out)


def _other_element(plain: bytes, rng: random.Random) -> bytes:
    way = rng.randrange(4)
    if way == 0:  # an array of noughts
        count = rng.choice((10, 10**6, 2 * 10**7))
        return _matrix(rng.choice((b"meas_pos", b"x")), count)
    if way == 1:
        return plain + b"\0" * rng.choice((8, 1000, 50 * MEGABYTE))
    changed = bytearray(plain)
    for _ in range(rng.choice((1, 1, 4))):
        start = rng.randrange(min(400, len(changed) - 4))
        changed[start : start + 4] = struct.pack("<I", rng.choice((0, 1, 2, 6, 14, 100, 2**20, 2**31 - 1, 2**32 - 1)))
    return bytes(changed)


def _matrix(name: bytes, count: int) -> bytes:
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    flags = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", count, 1)) + element(1, name)
    return element(14, flags + element(9, b"\0" * (8 * count)))


def hdf5_of(sound: Path, rng: random.Random) -> bytes:
    """An HDF5 file with other groups, shapes, types, packings and links."""
    buffer = io.BytesIO(sound.read_bytes())
    with h5py.File(buffer, "r+") as file:
        for _ in range(rng.choice((1, 2))):
            name = rng.choice(("Timestamps", "States", "Input", "Current", "y_t"))
            if f"Exp1/{name}" in file:
                del file["Exp1"][name]
            rng.choice(_H5)(file["Exp1"], name, rng)
    return buffer.getvalue()


def _h5_sized(group: Any, name: str, rng: random.Random) -> None:
    count = rng.choice(SIZES)
    shape = rng.choice(((count,), (3, count), (count, 3), (1, count), (2, 2, count), ()))
    kind = rng.choice(("f8", "f4", "i8", "u1", "f2", "S4", "c16", "?"))
    packed = rng.choice(({}, {"chunks": True, "compression": "gzip"}, {"chunks": True})) if shape else {}
    group.create_dataset(name, shape, kind, **packed)  # what is not written takes no room in the file


def _h5_strange(group: Any, name: str, rng: random.Random) -> None:
    made = (
        lambda: group.create_dataset(name, (5,), h5py.string_dtype()),
        lambda: group.create_dataset(name, (5,), h5py.vlen_dtype(np.float64)),
        lambda: group.create_dataset(name, (5,), h5py.ref_dtype),
        lambda: group.create_dataset(name, dtype="f8", data=h5py.Empty("f8")),
        lambda: group.create_dataset(name, (4,), np.dtype([("a", "f8"), ("b", "i4")])),
        lambda: group.create_group(name),
        lambda: group.create_dataset(name, data=np.array([np.nan, np.inf, -1.0])),
    )
    rng.choice(made)()


def _h5_link(group: Any, name: str, rng: random.Random) -> None:
    group[name] = rng.choice(
        (
            h5py.SoftLink("/Exp1"),
            h5py.SoftLink(f"/Exp1/{name}"),
            h5py.SoftLink("/no/where"),
            h5py.ExternalLink("fifo", "/Exp1"),
            h5py.ExternalLink("/dev/zero", "/Exp1"),
            h5py.ExternalLink("fifo.h5", "/x"),
        )
    )


def _h5_outside(group: Any, name: str, rng: random.Random) -> None:
    """Values that stand in another file, which may be none."""
    if rng.random() < 0.5:
        where = rng.choice(("fifo", "/dev/zero", "nowhere", "folder"))
        group.create_dataset(name, (60,), "f8", external=[(where, 0, h5py.h5f.UNLIMITED)])
        return
    layout = h5py.VirtualLayout((60,), "f8")
    layout[:] = h5py.VirtualSource(rng.choice(("fifo", "/dev/zero", ".", "nowhere.h5")), "x", (60,))
    group.create_virtual_dataset(name, layout)


def _h5_attributes(group: Any, name: str, rng: random.Random) -> None:
    group[name] = np.arange(60.0)
    item = rng.choice((group, group[name]))
    wrong = ("x" * 30_000, np.bytes_(b"\xff" * 100), np.arange(9), h5py.Empty("S5"), np.array([b"a", b"b"]), 5)
    item.attrs[rng.choice(("config", "layout"))] = rng.choice(wrong)


_H5 = (_h5_sized, _h5_sized, _h5_strange, _h5_link, _h5_outside, _h5_attributes)


def npy_of(sound: Path, rng: random.Random) -> bytes:
    """A numpy file whose head says something else."""
    heads = (
        f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({rng.choice((2, 10**7, 10**12, 10**400))}, 2), }}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (3, 2), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 2), }",
        "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (3,), }",
        "{'descr': '<U99999999', 'fortran_order': False, 'shape': (3, 2), }",
        "(" * 3000 + ")" * 3000,
        "{'descr': '<c16', 'fortran_order': True, 'shape': (), }",
        "",
    )
    if rng.random() < 0.2:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, a=np.zeros(rng.choice((10, 10**6))))
        return buffer.getvalue()
    head = rng.choice(heads).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(rng.choice((0, 48, 10**6)))


def picture_of(sound: Path, rng: random.Random) -> bytes:
    """A picture that claims to be of another size or kind."""
    data = bytearray(sound.read_bytes())
    sides = (0, 1, 3, 480, 4097, 20_000, 65_535, 2**31 - 1, 2**32 - 1)
    if rng.random() < 0.5:
        data[16:24] = struct.pack(">II", rng.choice(sides), rng.choice(sides))
        data[24:26] = bytes((rng.choice((1, 8, 16)), rng.choice((0, 2, 3, 6))))
        data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
        return bytes(data)
    width, height = rng.choice(sides) & 0xFFFF, rng.choice(sides) & 0xFFFF
    return rng.choice(
        (
            f"P6\n{width} {height}\n255\n".encode() + bytes(1000),
            f"P5 {'9' * 400} 2 255\n".encode(),
            b"BM" + struct.pack("<IIIIiiHHIIiiII", 100, 0, 54, 40, width, -height, 1, 24, 0, 0, 0, 0, 0, 0) + bytes(99),
            b"GIF89a" + struct.pack("<HH", width, height) + bytes(50),
            b"II*\0" + bytes((8, 0, 0, 0)) + rng.randbytes(200),
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + bytes(100),
            b"\xff\xd8\xff\xe0" + rng.randbytes(300),
        )
    )


def csv_of(sound: Path, rng: random.Random) -> bytes:
    """A table with another head, wide rows, long fields or many lines."""
    lines = sound.read_bytes().split(b"\n")
    wide = rng.choice((1, 100, 5000))
    return rng.choice(
        (
            b"t" + b",u" * wide + b"\n" + b"0" + b",1" * wide,
            b"t,u\n0," + b"9" * rng.choice((400, 20_000, 500_000)),
            b't,u\n0,"' + b"x\n" * rng.choice((10, 200_000)),
            b"t,u\n" + b"".join(b"%d,1\n" % k for k in range(rng.choice((10, 100_000)))) + b"x,1\n",
            b"t;u;psi\n0,1;2;3\n",
            lines[0] + b"\n" * rng.choice((10, 10**6)),
            b"\n".join([lines[0], *reversed(lines[1:])]),
            b"\r".join(lines),
            lines[0].upper() + b"\n" + b"\n".join(lines[1:]),
            sound.read_bytes().decode().encode("utf-16"),
            b"t,u\n" + b"," * 100_000,
            b"t,u,u\n1,2,3",
            b"t,u\n" + b"1e400,1\n.nan,inf\n",
        )
    )


INSIDE = {
    "mcap": mcap_of,
    "mat": mat_of,
    "hdf5": hdf5_of,
    "csv": csv_of,
    "plant run": csv_of,
    "struct mat": mat_of,
    "table mat": mat_of,
    "plant file": plants.file_of,
    "other model": plants.model_of,
    "positions npy": npy_of,
    "positions csv": csv_of,
    "picture": picture_of,
}
