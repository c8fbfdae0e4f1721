"""What every test shares.

Command sockets lie in a folder of this run, not among those of a daemon that runs beside it. Tests in which the clock
counts (marker `realtime`) are named here by their place, or at the test itself: they run one after the other, while
`tools/suite.py` runs the others side by side. Linear algebra has one thread, as in the program itself: of two beside
another process, each waits for the other, and a small matrix takes fifty times as long.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pytest

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # before numpy is imported
    os.environ.setdefault(threads, "1")

HERE = Path(__file__).parent
ON_THE_CLOCK = (
    "shell",
    "sim/test_boardprocess.py",
    "sim/test_camera.py",
    "system/test_check_device.py",
    "system/test_rig_priority.py",
)


def pytest_configure(config: pytest.Config) -> None:
    folder = tempfile.mkdtemp(prefix="hoopd-test-")  # short: a socket's path has 107 bytes at most
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    os.environ["XDG_RUNTIME_DIR"] = folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = tuple(HERE / place for place in ON_THE_CLOCK)
    for item in items:
        if any(place == item.path or place in item.path.parents for place in places):
            item.add_marker(pytest.mark.realtime)
