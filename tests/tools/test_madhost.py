"""The mad host's table in docs/reference/board.md against the bench that prints it."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "board.md").read_text()
SECTION = PAGE.split("## What a mad host can reach")[1].split("\n## ")[0]
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in SECTION.splitlines() if line[:1] == "|"][2:]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "bench"))
    import madhost

    return madhost


@pytest.mark.parametrize("cells", ROWS, ids=[row[0] for row in ROWS])
def test_the_table_is_what_the_bench_finds(cells: list[str], bench: ModuleType) -> None:
    name, ended, speed, turned, ball, track = cells
    found = bench.run(name, bench.hosts()[name], 5.0)
    assert found.cut_s == pytest.approx(math.inf if ended == "never" else float(ended.split()[0]), abs=6e-4)
    assert found.speed_rad_s <= bench.LIMIT_RAD_S + 0.5
    assert found.leaves is (track == "leaves the track")
    # a ball that leaves goes its own way: a rounding of another machine is enough to change it
    near = 0.2 if found.leaves else 0.01
    assert found.speed_rad_s == pytest.approx(float(speed), rel=0.05 if found.leaves else 0.001)
    assert found.angle_rad == pytest.approx(float(turned), rel=near)
    assert found.ball_speed_rad_s == pytest.approx(float(ball), rel=near)
