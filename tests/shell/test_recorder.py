"""The recorder: what a kill, a full disk, a file limit, a quota and a stuck disk may cost."""

from __future__ import annotations

import itertools
import os
import resource
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from harness.timing import on_the_clock

from hoopd.core.records import Command, DriverSample, Inputs, LinkCounts, TickRecord
from hoopd.recording import mcap
from hoopd.shell import recorder as module
from hoopd.shell.recorder import Recorder
from hoopd.shell.run_files import Limits, make_room, runs

ROOT = Path(__file__).resolve().parents[2]
HEADER = mcap.Header("hoop", "a: 1\n", seed=1)
SMALL = Limits(quota_bytes=10**9, min_free_bytes=0)


def row(k: int) -> tuple[TickRecord, Inputs]:
    """Row k of a made-up run."""
    t = k * 0.02
    driver = DriverSample(t, k % 256, 1, 0, 0.1 * k, 0.3, 0.2, k)
    record = TickRecord(t, k, "RUNNING", 0.1, 0.1 * k, 0.3, 0.2, 0.01, t, t, (t, 0.0, 0.0, 0.0), 0.0, 1, 0, 0.0, 0.0)
    return record, Inputs(k, t, None, driver, LinkCounts(1), (), 0.0, 0.0, False, 0)


def feed(recorder: Recorder, count: int, start: int = 0) -> None:
    """Rows as fast as they are taken."""
    for k in range(start, start + count):
        recorder.put(*row(k))


def wait_until(condition: Any, timeout_s: float = 10.0) -> bool:
    """True as soon as the condition holds."""
    end = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return bool(condition())


class Log:
    """Events that the recorder told."""

    def __init__(self) -> None:
        self.events: list[tuple[str, str, Mapping[str, Any]]] = []

    def __call__(self, event: str, level: str, fields: Mapping[str, Any]) -> None:
        self.events.append((event, level, fields))

    def names(self) -> list[str]:
        """Their names in order."""
        return [event for event, _, _ in self.events]


def test_threaded_and_lock_step_write_the_same_bytes(tmp_path: Path) -> None:
    content = []
    for name, synchronous in (("a", True), ("b", True), ("c", False)):
        (tmp_path / name).mkdir()
        recorder = Recorder(tmp_path / name, HEADER, limits=SMALL, synchronous=synchronous)
        feed(recorder, 300)
        recorder.event(6.0, "stop", reason="end")
        assert recorder.close(10.0)
        assert recorder.counts[:3] == (301, 0, 0)
        content.append((tmp_path / name / "run-0001.mcap").read_bytes())
    assert content[0] == content[1] == content[2]


def test_each_file_asks_the_wall_clock_and_keeps_its_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROOM_ROWS", 50)
    (tmp_path / "size").mkdir()
    clock, size = itertools.count(10**18, 10**9), make_run(tmp_path / "size").stat().st_size
    recorder = Recorder(tmp_path, HEADER, limits=Limits(2 * size, 0), synchronous=True, zero_ns=partial(next, clock))
    feed(recorder, 500)
    assert recorder.close()
    parts = [mcap.read_run(run.path) for run in runs(tmp_path)]
    assert len(parts) > 1
    assert [part.zero_ns for part in parts] == [10**18 + 10**9 * part.header.part for part in parts]


def test_next_free_number(tmp_path: Path) -> None:
    (tmp_path / "run-0041.mcap").write_bytes(b"someone else's")
    recorder = Recorder(tmp_path, HEADER, limits=SMALL, synchronous=True)
    feed(recorder, 3)
    assert recorder.close()
    assert len(mcap.read(tmp_path / "run-0042.mcap")) == 3


def test_full_queue_drops_the_oldest_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, log, add = threading.Event(), Log(), module._Sink.add
    monkeypatch.setattr(module._Sink, "add", lambda *args: (gate.wait(20.0), add(*args))[1])
    recorder = Recorder(tmp_path, HEADER, limits=SMALL, on_event=log, queue_rows=50)
    feed(recorder, 400)
    assert len(recorder._queue) == 50 and recorder.trouble
    assert recorder.counts.dropped >= 349
    gate.set()
    assert recorder.close(20.0)
    ids = mcap.read(tmp_path / "run-0001.mcap").extra["id"]
    assert ids[-1] == 399
    assert recorder.counts.written + recorder.counts.dropped == 400
    assert recorder.counts.written == len(ids)
    assert log.names().count("recorder_dropped") == 1


def test_stuck_disk_does_not_hold_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()
    monkeypatch.setattr(module._Sink, "add", lambda *args: [gate.wait(20.0)][:0])
    recorder = Recorder(tmp_path, HEADER, limits=SMALL)
    feed(recorder, 10)
    assert wait_until(lambda: len(recorder._queue) < 10)
    begin = time.monotonic()
    assert not recorder.close(0.3)
    with on_the_clock():
        assert time.monotonic() - begin < 2.0
    gate.set()


def test_missing_folder_is_trouble_once_and_heals(tmp_path: Path) -> None:
    log, folder = Log(), tmp_path / "later"
    recorder = Recorder(folder, HEADER, limits=SMALL, on_event=log, retry_s=(0.1,))
    feed(recorder, 20)
    assert wait_until(lambda: recorder.trouble and recorder.counts.failures >= 2)
    assert log.names() == ["recorder_trouble"]
    assert log.events[0][2]["reason"] == "no such file or directory"
    folder.mkdir()
    feed(recorder, 20, 20)
    assert wait_until(lambda: not recorder.trouble)
    assert recorder.close(10.0)
    assert log.names() == ["recorder_trouble", "recorder_recovered"]
    assert list(mcap.read(folder / "run-0001.mcap").extra["id"]) == list(range(40))


@pytest.mark.parametrize("deleted", ["folder", "file"])
def test_a_file_that_somebody_deletes_is_trouble_and_its_rows_are_counted(deleted: str, tmp_path: Path) -> None:
    log, folder = Log(), tmp_path / "runs"
    folder.mkdir()
    recorder = Recorder(folder, HEADER, limits=SMALL, on_event=log, synchronous=True)
    feed(recorder, 500)
    (folder / "run-0001.mcap").unlink()
    if deleted == "folder":
        folder.rmdir()
        folder.mkdir()
    feed(recorder, 1000, 500)
    assert recorder.close()
    assert log.names() == ["recorder_trouble", "recorder_recovered"]
    assert log.events[0][2]["reason"] == "the file was deleted while it was written"
    kept = list(mcap.read(folder / "run-0001.mcap").extra["id"])
    assert kept == list(range(1500 - len(kept), 1500)) and len(kept) > 980
    assert recorder.counts[:2] == (len(kept), 1500 - len(kept))


def test_a_file_that_is_gone_at_the_end_is_counted_to_the_row(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, HEADER, limits=SMALL, synchronous=True)
    feed(recorder, 500)
    (tmp_path / "run-0001.mcap").unlink()
    recorder.close()
    assert recorder.counts.written + recorder.counts.dropped == 500


def test_unusable_row_is_counted_and_the_rest_kept(tmp_path: Path) -> None:
    log = Log()
    recorder = Recorder(tmp_path, HEADER, limits=SMALL, on_event=log, synchronous=True)
    feed(recorder, 2)
    record, inputs = row(2)
    recorder.put(record, inputs._replace(commands=(Command("tune", 1.0, "\ud800"),)))
    feed(recorder, 2, 3)
    assert recorder.close()
    assert log.names() == ["recorder_row_unusable"]
    assert list(mcap.read(tmp_path / "run-0001.mcap").extra["id"]) == [0, 1, 3, 4]
    assert recorder.counts[:2] == (4, 1)


def make_run(folder: Path, count: int = 100) -> Path:
    """A closed run of ours in the folder."""
    recorder = Recorder(folder, HEADER, limits=SMALL, synchronous=True)
    feed(recorder, count)
    assert recorder.close()
    return runs(folder)[-1].path


def test_quota_deletes_the_oldest_of_ours_only(tmp_path: Path) -> None:
    paths = [make_run(tmp_path) for _ in range(5)]
    foreign = [tmp_path / "notes.txt", tmp_path / "run-0000.mcap", tmp_path / "run-7.mcap"]
    for path in foreign:
        path.write_bytes(bytes(100_000))
    size = paths[0].stat().st_size
    assert make_room(tmp_path, Limits(int(2.5 * size), 0)) == ["run-0001.mcap", "run-0002.mcap", "run-0003.mcap"]
    assert make_room(tmp_path, Limits(1, 0)) == ["run-0004.mcap"]
    assert [run.path for run in runs(tmp_path)] == [paths[4]]
    assert all(path.exists() for path in foreign)


def test_room_is_not_made_of_what_another_recorder_writes(tmp_path: Path) -> None:
    live = Recorder(tmp_path, HEADER, limits=SMALL, synchronous=True)
    feed(live, 100)
    others = [make_run(tmp_path) for _ in range(3)]
    assert make_room(tmp_path, Limits(1, 0)) == [path.name for path in others[:2]]
    feed(live, 100, 100)
    assert live.close()
    assert list(mcap.read(tmp_path / "run-0001.mcap").extra["id"]) == list(range(200))
    assert make_room(tmp_path, Limits(1, 0)) == ["run-0001.mcap"]


def test_open_run_outlives_the_quota_and_too_little_room_is_trouble(tmp_path: Path) -> None:
    paths = [make_run(tmp_path) for _ in range(2)]
    assert make_room(tmp_path, Limits(1, 0), keep=paths[0]) == []
    assert paths[0].exists()
    with pytest.raises(OSError, match="free"):
        make_room(tmp_path, Limits(10**9, 10**18))
    assert paths[1].exists()


def test_long_run_goes_on_in_parts_inside_the_quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROOM_ROWS", 50)
    size = make_run(tmp_path, 300).stat().st_size
    recorder = Recorder(tmp_path, HEADER, limits=Limits(2 * size, 0), synchronous=True)
    feed(recorder, 2000)
    assert recorder.close()
    kept = runs(tmp_path)
    assert sum(run.size for run in kept) <= 2.6 * size
    parts = [mcap.read_run(run.path) for run in kept]
    assert [part.header.part for part in parts] == sorted(part.header.part for part in parts)
    ids = [tick.id for part in parts for tick in part.ticks]
    assert ids == list(range(ids[0], 2000))


CHILD = """
import sys, time, signal
sys.path.insert(0, {root!r})
from tests_row import row
from pathlib import Path
from hoopd.recording.mcap import Header
from hoopd.shell.recorder import Recorder
from hoopd.shell.run_files import Limits
recorder = Recorder(Path({folder!r}), Header("hoop"), limits=Limits(10**9, 0), retry_s=(0.3,),
                    on_event=lambda event, level, fields: print("EVENT", event, fields.get("reason"), flush=True))
"""


def child(tmp_path: Path, body: str, **options: Any) -> subprocess.Popen[str]:
    """A process of its own with a recorder and `row`."""
    source = Path(__file__).read_text(encoding="utf-8")
    (tmp_path / "tests_row.py").write_text(source, encoding="utf-8")
    folder = tmp_path / "runs"
    folder.mkdir(exist_ok=True)
    code = CHILD.format(root=str(ROOT), folder=str(folder)) + textwrap.dedent(body)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tools", tmp_path)))}
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment, cwd=tmp_path, **options
    )


def test_kill_loses_at_most_one_second(tmp_path: Path) -> None:
    process = child(
        tmp_path,
        """
        begin = time.monotonic()
        for k in range(10**6):
            recorder.put(*row(k))
            print(k, flush=True)
            time.sleep(max(0.0, begin + 0.02 * (k + 1) - time.monotonic()))
        """,
    )
    assert process.stdout is not None
    last = 0
    for line in process.stdout:
        last = int(line)
        if last == 120:
            process.kill()
            break
    last = max([last, *map(int, process.stdout.read().split())])
    assert process.wait(10) == -signal.SIGKILL
    run = mcap.read_run(tmp_path / "runs" / "run-0001.mcap")
    assert "never closed" in run.lost
    assert last - run.ticks[-1].id <= 50
    assert [tick.id for tick in run.ticks] == list(range(len(run.ticks)))


def test_file_limit_is_trouble_and_control_goes_on(tmp_path: Path) -> None:
    def limited() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))

    process = child(
        tmp_path,
        """
        for k in range(1500):
            recorder.put(*row(k))
            time.sleep(0.001)
        print("PUT", k, recorder.counts.failures > 0, flush=True)
        recorder.close(5.0)
        """,
        preexec_fn=limited,
    )
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "EVENT recorder_trouble file too large" in out
    assert "PUT 1499 True" in out
    folder = tmp_path / "runs"
    ids = [tick.id for run in runs(folder) for tick in mcap.read_run(run.path).ticks]
    assert ids == sorted(set(ids)) and len(runs(folder)) > 1
    assert [mcap.read_run(run.path).header.part for run in runs(folder)] == list(range(len(runs(folder))))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_full_disk_is_trouble_and_rows_wait_for_the_next_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, create, full = Log(), module.create, [True]

    def sometimes_full(folder: Path) -> Any:
        path, file = create(folder)
        return (path, Path("/dev/full").open("r+b", buffering=0)) if full[0] else (path, file)

    monkeypatch.setattr(module, "create", sometimes_full)
    recorder = Recorder(tmp_path, HEADER, limits=SMALL, on_event=log, retry_s=(0.1,))
    feed(recorder, 100)
    assert wait_until(lambda: recorder.counts.failures >= 3)
    assert log.events[0][2]["reason"] == "no space left on device"
    assert list(tmp_path.iterdir()) == []
    full[0] = False
    assert recorder.close(10.0)
    assert list(mcap.read(tmp_path / "run-0001.mcap").extra["id"]) == list(range(100))
    assert recorder.counts[:2] == (100, 0)
