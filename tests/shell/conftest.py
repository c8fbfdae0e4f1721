"""Fixtures that tests of cameras share: a clock, a program in place of rpicam-vid, back ends that are closed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from shell.cameras import FAKE, H, RunTime, W

from hoopd.shell.config import Camera
from hoopd.shell.pictures import Backend


@pytest.fixture
def clock() -> RunTime:
    return RunTime()


@pytest.fixture
def fake(tmp_path: Path) -> Callable[..., Camera]:
    script = tmp_path / "fake_rpicam.py"
    script.write_text(FAKE)

    def settings(mode: str, **changes: Any) -> Camera:
        return Camera(command=(sys.executable, "-I", str(script), mode), width_px=W, height_px=H, **changes)

    return settings


@pytest.fixture
def opened() -> Iterator[Callable[[Backend], Backend]]:
    backends: list[Backend] = []

    def open_it(backend: Backend) -> Backend:
        backends.append(backend)
        backend.open()
        return backend

    yield open_it
    for backend in backends:
        backend.close()
