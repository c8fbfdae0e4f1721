"""What every test shares.

Command sockets lie in a folder of this run, not among those of a daemon that runs beside it. Tests of whole daemons on
the real clock (marker `realtime`) are named here by their place, or at the test itself: they run one after the other,
while `tools/suite.py` runs the others side by side. Linear algebra has one thread, as in the program itself: of two
beside another process, each waits for the other, and a small matrix takes fifty times as long.
"""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path

import pytest
from disturbance import ROOT, Taken, excuse, put_off, taken

from hoopd.linear_algebra import settle

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # before numpy is imported
    os.environ[threads] = "1"
settle()

HERE = Path(__file__).parent
# Whole daemons on the clock, or as tight as these.
ON_THE_CLOCK = (
    "shell/test_clock.py",
    "shell/test_loop.py",
    "shell/test_service.py",
    "system/test_rig_priority.py",
)
# Bounds of tenths of a second and more, with much waiting: side by side, but excused like those above (disturbance.py).
TIMED = (
    "docs",
    "shell",
    "sim/test_boardprocess.py",
    "sim/test_camera.py",
    "system/test_check_device.py",
    "system/test_experiment_command.py",
    "system/test_operators.py",
    "system/test_races_realtime.py",
    "system/test_unit.py",
    "tools/test_benches.py",
    "tools/test_soak.py",
)
BEGUN = pytest.StashKey[Taken]()


def pytest_configure(config: pytest.Config) -> None:
    folder = tempfile.mkdtemp(prefix="hoopd-test-")  # short: a socket's path has 107 bytes at most
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    os.environ["XDG_RUNTIME_DIR"] = folder
    os.environ.setdefault(ROOT, str(os.getpid()))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """The pass of tests on the clock alone reads no file that has none: importing all takes ten seconds."""
    if not str(config.option.markexpr).startswith("realtime") or collection_path.suffix != ".py":
        return None
    place = collection_path.relative_to(HERE).as_posix() if collection_path.is_relative_to(HERE) else ""
    return None if place in ON_THE_CLOCK or "mark.realtime" in collection_path.read_text(encoding="utf-8") else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if lies_in(item.path, ON_THE_CLOCK):
            item.add_marker(pytest.mark.realtime)


@cache
def lies_in(path: Path, places: tuple[str, ...]) -> bool:
    """Is it one of these files, or in one of these folders? Asked of six thousand tests in some 260 files."""
    return any(HERE / place == path or HERE / place in path.parents for place in places)


def is_timed(item: pytest.Item) -> bool:
    """Has it assertions that the clock judges?"""
    return item.get_closest_marker("realtime") is not None or lies_in(item.path, TIMED)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if is_timed(item):
        item.stash[BEGUN] = taken()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    error = call.excinfo and call.excinfo.value
    if report.failed and BEGUN in item.stash:
        excuse(report, error, taken().others_since(item.stash[BEGUN]))
    put_off(report, error)
    return report


@pytest.fixture(scope="session", autouse=True)
def garbage() -> Iterator[None]:
    """A daemon that runs in this process does not collect at its start: all tests lie in its memory.

    That is a quarter of a second each time. What was imported so far is left out of every later collection instead.
    Daemons in processes of their own do as ever.
    """
    gc.collect()
    gc.freeze()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hoopd.daemon.app.freeze_garbage", lambda: 0)
        yield
