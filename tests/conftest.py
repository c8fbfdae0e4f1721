"""What every test shares: command sockets in a folder of this run, not among those of a daemon that runs beside it."""

from __future__ import annotations

import os
import shutil
import tempfile

import pytest


def pytest_configure(config: pytest.Config) -> None:
    folder = tempfile.mkdtemp(prefix="hoopd-test-")  # short: a socket's path has 107 bytes at most
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
    os.environ["XDG_RUNTIME_DIR"] = folder
