"""Cores: lists of the kernel's and of systemd's, and who leaves the loop its own."""

from __future__ import annotations

import os

import pytest

from hoopd.shell import cores
from hoopd.shell.config import Camera
from hoopd.shell.rpicam import RpicamVid


@pytest.mark.parametrize(
    ("text", "wanted"),
    [("\n", set()), ("3\n", {3}), ("0-1,3\n", {0, 1, 3}), ("2,3", {2, 3}), ("0-1 3\n", {0, 1, 3})],
)
def test_lists_of_cores(text: str, wanted: set[int]) -> None:
    assert cores.parse_cores(text) == wanted


def test_a_unit_that_is_not_there_holds_nobody() -> None:
    assert cores.unit_cores("hoopd-no-such-unit.service") == set()


@pytest.mark.parametrize(
    ("isolated", "allowed", "prefix"),
    [
        ({3}, {3}, ("taskset", "--cpu-list", "0,1,2")),
        ({2, 3}, {3}, ("taskset", "--cpu-list", "0,1")),
        ({3}, {0, 1, 2}, ()),  # the loop is not there
        (set(), {3}, ()),  # nobody's own core
        ({0, 1, 2, 3}, {3}, ()),  # nowhere else to go
    ],
)
def test_the_cameras_program_leaves_the_loop_its_core(
    isolated: set[int], allowed: set[int], prefix: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cores, "isolated_cores", lambda: isolated)
    monkeypatch.setattr(cores, "present_cores", lambda: {0, 1, 2, 3})
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: allowed)
    words = RpicamVid(Camera(command=("camera",)), lambda: 0.0, 0.0).arguments(tmp := os.path.devnull)  # type: ignore[arg-type]
    assert tmp in words
    assert tuple(words[: words.index("camera")])[-3:] == prefix or (not prefix and "taskset" not in words)
