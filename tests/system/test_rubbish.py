"""Rubbish from every side: one line and exit code 2, or a fault; never a traceback, never all the memory."""

from __future__ import annotations

import asyncio
import contextlib
import copy
import io
import json
import os
import signal
import struct
import subprocess
import sys
import time
import tty
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.writer import MCAP0_MAGIC

from hoopd.commands import calibrate
from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import layout_from_table, layout_to_table
from hoopd.daemon.app import Options, run_daemon
from hoopd.daemon.replay import replay
from hoopd.files.reading import InputError, load_yaml, read_text
from hoopd.recording import container, mcap, rows
from hoopd.recording.schemas import CHANNELS
from hoopd.shell import config as configuration
from hoopd.shell.link import FLOOD_BYTES, Codec, SerialDrive
from hoopd.shell.metadata import MetadataStream

ROOT = Path(__file__).resolve().parents[2]


# ---------------------------------------------------------------------------------------------- YAML

TEXTS = {
    "deep list": "a: " + "[" * 5000 + "]" * 5000,
    "deep mapping": "a: " + "{a: " * 3000 + "1" + "}" * 3000,
    "tagged word": "a: !!int word",
    "tagged truth": "a: !!bool word",
    "tagged time": "a: !!timestamp word",
    "merge key": "a: &x {b: 1}\nc: {<<: *x}",
    "two documents": "a: 1\n---\nb: 2",
    "too many digits": "a: " + "9" * 5000,
    "key twice": "a: 1\na: 2",
    "holds itself": "a: &x [*x]",
    "laughs": "a: &a [x,x,x,x,x,x,x,x,x]\n"
    + "".join(f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdef", "bcdefg", strict=True)),
}


@pytest.mark.parametrize("name", TEXTS)
def test_rubbish_yaml(name: str) -> None:
    with pytest.raises(InputError) as error:
        load_yaml(TEXTS[name], "some.yaml")
    assert "\n" not in str(error.value) and len(str(error.value)) < 1000


OVERRIDES = (
    "serial.baud=1.2.3", "camera.fps=..", "camera.fps=" + "9" * 400, "recording.quota_bytes=1e308 GB",
    "faults.hoop_speed_rad_s=.nan", "loop.wire_s=.inf", "sim.psi_noise_rad=1e999 rad", "vision.weights=[.nan, 0, 1]",
    "vision.weights=[0, 0, 0]", "vision.circle_px.radius=4000", "vision.circle_px={centre: [-50, 9], radius: 5}",
    "camera.width_px=481", "camera.stride_px=100", "camera.exposure_s=0.05", "camera.awb_gains=[-1, 0]",
    "a\nb=1", 'device.name="x\\n"', "=", ".=1", "device..name=x",
    "telemetry.zenoh." + "a." * 2000 + "b=1",
)  # fmt: skip


@pytest.mark.parametrize("text", OVERRIDES)
def test_rubbish_override(text: str) -> None:
    with pytest.raises(InputError) as error:
        configuration.load(None, sim=True, overrides=[text])
    assert "\n" not in str(error.value) and len(str(error.value)) < 1500


def test_two_overrides_that_only_fit_together() -> None:
    config = configuration.load(None, sim=True, overrides=["faults.lost_periods=9", "faults.late_periods=6"])
    assert (config.faults.late_periods, config.faults.lost_periods) == (6.0, 9.0)


@pytest.mark.parametrize("path", ["/dev/zero", "/proc/self/mem", "/", "/dev/null/x", "nul\0"])
def test_files_that_are_none(path: str) -> None:
    with pytest.raises(InputError):
        read_text(Path(path))


@pytest.mark.parametrize("sync", [1.5, True, "x", 256])
def test_layout_with_a_sync_that_is_no_byte(sync: Any) -> None:
    table = layout_to_table(DEFAULT_LAYOUT)
    table["request"]["sync"] = sync
    with pytest.raises(ValueError):
        layout_from_table(table)


# ---------------------------------------------------------------------------------------------- recordings


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        run_daemon(Options(sim=True, duration_s=0.3, speed="max", direct=True, record=folder))
    return folder / "run-0001.mcap"


def outcome(path: Path) -> str:
    """One line for a file that cannot be used, empty for a result."""
    try:
        replay(path)
    except InputError as error:
        assert "\n" not in str(error) and str(error).count(path.name) == 1, str(error)
        return str(error)
    return ""


def test_torn_and_flipped_recordings(run: Path, tmp_path: Path) -> None:
    whole, some, rng = run.read_bytes(), tmp_path / "some.mcap", np.random.default_rng(1)
    for size in range(0, len(whole), 2500):
        some.write_bytes(whole[:size])
        outcome(some)
    for _ in range(15):
        flipped = bytearray(whole)
        flipped[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        some.write_bytes(flipped)
        outcome(some)


def write(path: Path, run: mcap.RecordedRun, name: str, row: bytes) -> None:
    """A recording in which the last row of a channel is another one."""
    texts = {"input": [rows.encode_input(i) for i in run.inputs], "tick": [rows.encode_tick(t) for t in run.ticks]}
    texts.setdefault(name, [b""])[-1] = row
    with path.open("wb") as file:
        out = container.ChunkedFile(file, mcap.PROFILE)
        channels = mcap.add_channels(out)
        out.add_metadata(mcap.HEADER, mcap.header_texts(run.header))
        for key, values in texts.items():
            for value in values:
                out.add_message(channels[key], 1, 1, value)
        out.finish()


VALUES: tuple[Any, ...] = (None, "abc", 1e308, 10**30, [])


def test_rows_of_rubbish(run: Path, tmp_path: Path) -> None:
    whole, some = mcap.read_run(run), tmp_path / "some.mcap"
    for name, row in (("input", rows.encode_input(whole.inputs[-1])), ("tick", rows.encode_tick(whole.ticks[-1]))):
        for index, key in enumerate(json.loads(row)):
            for value in (VALUES[index % 5], VALUES[(index + 2) % 5]):  # tools/bench/fuzz.py tries all of all
                changed = copy.copy(json.loads(row))
                changed[key] = value
                write(some, whole, name, json.dumps(changed).encode())
                outcome(some)
    for text in (b"", b"null", b"{", b"\xff", b"[" * 100_000, b'{"a":' * 100_000):
        for name in CHANNELS:
            write(some, whole, name, text)
            assert outcome(some)


def chunk(packing: str, data: bytes, claimed: int) -> bytes:
    """A file with one chunk."""
    out = RecordBuilder()
    out.write(MCAP0_MAGIC)
    records.Header(profile=mcap.PROFILE, library="x").write(out)
    records.Chunk(
        compression=packing, data=data, message_start_time=0, message_end_time=0,
        uncompressed_crc=0, uncompressed_size=claimed,
    ).write(out)  # fmt: skip
    return bytes(out.end())  # type: ignore[no-untyped-call]


def test_chunks_that_would_fill_the_memory(tmp_path: Path) -> None:
    some, bomb = tmp_path / "some.mcap", zstandard.ZstdCompressor().compress(b"\0" * (65 << 20))
    inner = b"\x05" + struct.pack("<Q", 2**62) + b"x"
    cases = (("zstd", bomb, 65 << 20), ("zstd", bomb, 10), ("zstd", b"x", 2**62), ("lz4", b"x", 1), ("", inner, 10))
    for case in cases:
        some.write_bytes(chunk(*case))
        assert outcome(some)
    with some.open("wb") as file:
        file.truncate(64 << 30)
    assert "larger than" in outcome(some)
    for path in ("/dev/zero", "/"):
        with pytest.raises(InputError):
            replay(Path(path))


def test_a_header_without_a_model_is_the_recordings_fault(run: Path, tmp_path: Path) -> None:
    whole, some = mcap.read_run(run), tmp_path / "some.mcap"
    for text in ("", "schema: hoopd.model/9"):
        header = type(whole.header)(
            **{**{n: getattr(whole.header, n) for n in whole.header.__struct_fields__}, "model": text}
        )
        write(some, whole._replace(header=header), "event", b'{"t": 0.0, "event": "x", "level": "info", "fields": {}}')
        assert "some.mcap: header" in outcome(some)


# ---------------------------------------------------------------------------------------------- line and camera


def test_a_flood_on_the_line_costs_a_tick_little() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    port = os.ttyname(slave)

    async def listen() -> tuple[int, int]:
        drive = SerialDrive(port, 115200, Codec(DEFAULT_LAYOUT, 115200), time.monotonic, 0.5)
        drive.open()
        sent = 0
        end = time.monotonic() + 0.1
        while time.monotonic() < end:
            with contextlib.suppress(BlockingIOError):
                sent += os.write(master, b"\x5a" * 4096)
            await asyncio.sleep(0)
        bad = drive.take()[1].bad_crc
        os.set_blocking(slave, False)
        await asyncio.sleep(0.01)
        assert drive.take()[1].lost is False
        drive.close()
        return sent, bad

    sent, bad = asyncio.run(listen())
    os.close(master)
    os.close(slave)
    assert sent > FLOOD_BYTES  # there was a flood
    assert bad <= 2 * FLOOD_BYTES / DEFAULT_LAYOUT.answer.length + 1  # and most of it was not decoded


def test_numbers_of_metadata_that_are_none() -> None:
    stream = MetadataStream()
    stream.feed(
        '{"SensorTimestamp": 1.2.3, "ExposureTime": 1e999}\n{"SensorTimestamp": 1000000000, "ExposureTime": 5}\n'
    )
    first, second = stream.take(0), stream.take(1)
    assert first is not None and (first.t, first.exposure_s) == (None, None)
    assert second is not None and second.t == pytest.approx(1.0)


# ---------------------------------------------------------------------------------------------- calibrate


TABLES = {
    "field.csv": b"x_px,y_px\n" + b"9" * 200_000 + b",1\n",
    "far.csv": b"x_px,y_px\n" + b"1e300,2e300\n" * 40,
    "zip.npy": b"PK\x03\x04" + b"x" * 50,
    "claim.npy": b"\x93NUMPY\x01\x00\x76\x00"
    + b"{'descr': '<f8', 'fortran_order': False, 'shape': (900000000000, 2), }".ljust(117) + b"\n",
    "half.npy": b"\x93NUMPY\x01\x00v\x00{",
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_positions_of_rubbish(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(TABLES[name])
    with pytest.raises(InputError):
        calibrate.run(None, tmp_path / name)


def test_complex_positions(tmp_path: Path) -> None:
    np.save(tmp_path / "complex.npy", np.ones((40, 2), complex))
    with pytest.raises(InputError):
        calibrate.run(None, tmp_path / "complex.npy")


def test_a_table_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "bom.csv").write_bytes(b"\xef\xbb\xbfx_px,y_px\n1,2\n")
    assert calibrate.read_csv(tmp_path / "bom.csv").tolist() == [[1.0, 2.0]]


def test_a_torn_picture_is_one_line(tmp_path: Path) -> None:
    import cv2

    whole = cv2.imencode(".png", np.zeros((64, 64, 3), np.uint8))[1].tobytes()
    (tmp_path / "torn.png").write_bytes(whole[: len(whole) // 2])
    done = start("calibrate", str(tmp_path / "torn.png"), cwd=tmp_path)
    _, errors = done.communicate(timeout=20)
    assert done.returncode == 2 and errors.count(b"\n") == 1, errors


# ---------------------------------------------------------------------------------------------- the process


def start(*arguments: str, cwd: Path, **more: Any) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "hoopd", *arguments],
        cwd=cwd, env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(cwd)}, stdin=subprocess.DEVNULL,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **more},
    )  # fmt: skip


LOCKSTEP = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "0.1")


def test_a_full_disk_behind_the_output(run: Path, tmp_path: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        done = start("replay", str(run), cwd=tmp_path, stdout=full)
        _, errors = done.communicate(timeout=20)
    assert done.returncode == 1 and b"Traceback" not in errors
    assert errors.endswith(b"hoopd: standard output: no space left on device\n")


def test_without_any_stream(tmp_path: Path) -> None:
    line = f"exec {sys.executable} -m hoopd {' '.join(LOCKSTEP)} --json done.json <&- >&- 2>&-"
    done = subprocess.run(
        ["sh", "-c", line], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=20, check=False
    )
    assert done.returncode == 0
    assert json.loads((tmp_path / "done.json").read_text())["ticks"] > 0


@pytest.mark.parametrize(
    ("arguments", "code"), [(f"experiment prbs {' '.join(LOCKSTEP[:-1])} 1 --out a.mcap", 0), ("--arm", 2)]
)
def test_without_a_standard_input(arguments: str, code: int, tmp_path: Path) -> None:
    line = f"exec {sys.executable} -m hoopd {arguments} <&-"
    done = subprocess.run(
        ["sh", "-c", line], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=60, check=False,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == code and "Traceback" not in done.stderr and "mistake" not in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("delay_s", [0.1, 0.6, 1.1])
def test_stopped_during_start_up(number: signal.Signals, delay_s: float, tmp_path: Path) -> None:
    daemon = start("--sim", "--set", "telemetry.enabled=false", cwd=tmp_path)
    time.sleep(delay_s)
    daemon.send_signal(number)
    _, errors = daemon.communicate(timeout=10)
    # Python's own start, until our first line has run, is not ours.
    assert b"Traceback" not in errors or not any(
        name in errors for name in (b"hoopd/commands/cli", b"hoopd/daemon/app")
    ), errors
    time.sleep(0.2)
    assert not list(tmp_path.iterdir())
