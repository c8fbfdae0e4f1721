"""The two passes of the tests: each finds its own, a failure in either fails the whole, nothing found is told."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

SUITE = Path(__file__).parents[2] / "tools" / "suite.py"
TESTS = """
import pytest

def test_side_by_side():
    assert {first}

@pytest.mark.realtime
def test_on_the_clock():
    assert {second}

@pytest.mark.proof
def test_long():
    pass
"""


LATE = """
import os
from pathlib import Path

def test_that_is_late_beside_others():
    if place := os.environ.get("HOOPD_TESTS_LATE"):
        Path(place).write_text("test_late.py::test_that_is_late_beside_others\\n")
        import pytest
        pytest.skip("late beside other tests")
    assert {alone}
"""


def suite(folder: Path, *arguments: str, first: bool = True, second: bool = True) -> tuple[int, str]:
    (folder / "test_made_up.py").write_text(TESTS.format(first=first, second=second))
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n  realtime: the clock counts\n  proof: long\n")
    command = [sys.executable, str(SUITE), "-n", "0", "-p", "no:cacheprovider", *arguments]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=100, check=False)
    return ended.returncode, ended.stdout.splitlines()[-1]


def test_both_passes_run(tmp_path: Path) -> None:
    assert suite(tmp_path) == (0, "2 passed, 0 failed, 0 skipped")


def test_proofs_run_alone_when_they_are_asked_for(tmp_path: Path) -> None:
    assert suite(tmp_path, "--proof") == (0, "1 passed, 0 failed, 0 skipped")


@pytest.mark.parametrize("alone", [True, False])
def test_what_was_late_beside_others_is_asked_again_alone(tmp_path: Path, alone: bool) -> None:
    (tmp_path / "test_late.py").write_text(LATE.format(alone=alone))
    told = "3 passed, 0 failed, 0 skipped" if alone else "2 passed, 1 failed, 0 skipped"
    assert suite(tmp_path) == (0 if alone else 1, told)


@pytest.mark.parametrize("broken", ["first", "second"])
def test_a_failure_in_either_pass_fails(tmp_path: Path, broken: str) -> None:
    assert suite(tmp_path, **{broken: False}) == (1, "1 passed, 1 failed, 0 skipped")


def test_a_choice_that_leaves_one_pass_empty_is_well(tmp_path: Path) -> None:
    assert suite(tmp_path, "-k", "clock") == (0, "1 passed, 0 failed, 0 skipped")


def test_a_choice_that_finds_nothing_is_told(tmp_path: Path) -> None:
    assert suite(tmp_path, "-k", "nothing_of_this_name") == (5, "0 passed, 0 failed, 0 skipped")


@pytest.mark.parametrize(
    ("cpu_max", "most"), [("200000 100000", 2), ("150000 100000", 2), ("20000 100000", 1), ("max 100000", 4), ("", 4)]
)
def test_a_container_s_share_of_the_cores_is_taken(
    cpu_max: str, most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(SUITE.parent))
    monkeypatch.setattr(os, "cpu_count", lambda: 64)  # the machine's
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2, 3})
    place = tmp_path / "cpu.max"
    place.write_text(cpu_max)
    tool = importlib.import_module("suite")
    assert tool.processes(place) == most and tool.processes(tmp_path / "none") == 4
