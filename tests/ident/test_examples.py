"""The six examples of the toolbox: each finds its truth and leaves a figure."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("examples")
    arguments = [sys.executable, str(ROOT / "docs" / "ident_examples.py"), str(folder)]
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True, timeout=100)
    assert len(list(folder.glob("*.png"))) == 6
    return dict(line.split(": ", 1) for line in done.stdout.splitlines())


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"-?\d+\.\d+", text)]


def test_output_error_is_right_where_least_squares_is_biased(said: dict[str, str]) -> None:
    true, least, plr, oe = numbers(said["temperature"])
    assert abs(least - true) > 0.1 and abs(plr - true) < 0.03 and abs(oe - true) < 0.01


def test_the_delay_is_within_its_interval(said: dict[str, str]) -> None:
    found = re.search(r"found (\d+), 95 % interval (\d+) to (\d+)", said["dead_time"])
    assert found is not None
    assert int(found[2]) <= 21 <= int(found[3]) and found[1] == "21"


def test_the_nonlinearity_the_unstable_pole_and_the_tanks(said: dict[str, str]) -> None:
    true, offset, fit = numbers(said["static_nonlinearity"])
    assert abs(offset - true) < 0.02 and fit > 95.0
    true, pole, deviation = numbers(said["unstable"])
    assert abs(pole - true) < 4 * deviation + 1e-4
    for name, true in {"k1": 1.6, "k2": 1.6, "outlet": 4.9, "up": 0.2}.items():
        found = re.search(rf"{name} [\d.]+: ([\d.]+) \+- ([\d.]+)", said["four_tanks"])
        assert found is not None
        assert abs(float(found[1]) - true) < 4 * float(found[2])


def test_models_in_a_closed_loop_come_near(said: dict[str, str]) -> None:
    _, first, fourth, subspace = numbers(said["closed_loop"])
    assert abs(first - 0.9) < 0.02 and abs(fourth - 0.9) < 0.05 and abs(subspace - 0.9) < 0.1
