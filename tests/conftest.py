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
from pathlib import Path

import pytest
from disturbance import excuse, waited

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # before numpy is imported
    os.environ[threads] = "1"

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
    "tools/test_benches.py",
)
BEGUN = pytest.StashKey()


def pytest_configure(config: pytest.Config) -> None:
    folder = tempfile.mkdtemp(prefix="hoopd-test-")  # short: a socket's path has 107 bytes at most
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    os.environ["XDG_RUNTIME_DIR"] = folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if lies_in(item, ON_THE_CLOCK):
            item.add_marker(pytest.mark.realtime)


def lies_in(item: pytest.Item, places: tuple[str, ...]) -> bool:
    """Is it in one of these files or folders?"""
    return any(HERE / place == item.path or HERE / place in item.path.parents for place in places)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[BEGUN] = waited()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and (item.get_closest_marker("realtime") or lies_in(item, TIMED)):
        excuse(report, waited().share_since(item.stash[BEGUN]))
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
