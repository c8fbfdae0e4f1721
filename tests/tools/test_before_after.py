"""The bench that holds this state beside an earlier one: its arithmetic, and one tick of each checkout."""

from __future__ import annotations

import json
import sys
from math import inf, isnan
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools" / "bench"))

from beforeafter import figures, ratios, realrecordings, speed, trees  # noqa: E402

KEPT = ROOT / "tests" / "data" / "before_the_move"


def said(verdict: str, base: float, **effects: float) -> dict[str, Any]:
    """A diagnosis in the form in which it is kept; every standard error is 0.5."""
    width = figures.WIDTH_OF_95 / 4.0

    def one(value: float) -> dict[str, Any]:
        return {"value": value, "ci95": [value - width, value + width]}

    named = [{"name": f"hoop.{name}", "parameters": {"A": one(value)}} for name, value in effects.items()]
    return {"verdict": verdict, "base": {"J11": one(base)}, "effects": named}


def test_a_distance_is_counted_in_standard_errors_of_what_was_kept() -> None:
    kept, now = said("missing_physics", 1.0, friction=3.0), said("missing_physics", 1.05, friction=2.5)
    assert figures.largest(kept, kept).errors == 0.0
    assert figures.largest(kept, now) == ("hoop.friction.A", pytest.approx(1.0))
    kept["effects"][0]["parameters"]["A"]["ci95"] = None
    assert figures.largest(kept, now).errors == inf  # nothing says how much that is


def test_names_are_the_verdict_and_the_effects_in_their_order() -> None:
    kept = said("missing_physics", 1.0, friction=3.0, drag=1.0)
    assert figures.names(kept) == ("missing_physics", "hoop.friction", "hoop.drag")
    assert figures.names(kept) != figures.names(said("missing_physics", 1.0, drag=1.0, friction=3.0))
    assert figures.names(kept) != figures.names(said("unknown_physics", 1.0, friction=3.0, drag=1.0))


def test_a_parameter_that_is_gone_is_infinitely_far() -> None:
    kept, now = said("parameters", 1.0), said("parameters", 1.0)
    now["base"] = {}
    assert figures.largest(kept, now) == ("J11", inf)


def test_the_interval_of_eleven_pairs_leaves_one_out_at_each_end() -> None:
    after = [1.0 + 0.01 * k for k in (5, 3, 8, 1, 0, 10, 4, 2, 9, 6, 7)]
    found = ratios.paired([1.0] * 11, after)
    assert found.median == pytest.approx(1.05)
    assert (found.low, found.high) == pytest.approx((1.01, 1.09))
    assert found.level == pytest.approx(1.0 - 2.0 * 12.0 / 2048.0)  # none or one of eleven below the median


def test_five_pairs_give_no_interval_of_95_percent() -> None:
    assert isnan(ratios.paired([2.0] * 5, [2.0] * 5).low)
    assert ratios.paired([2.0] * 6, [1.0] * 6)[:3] == (0.5, 0.5, 0.5)


def test_what_is_kept_is_what_the_bench_asks() -> None:
    concealed = json.loads((KEPT / "concealed.json").read_text())
    assert len(concealed["cases"]) == 10
    families = [case["family"] for case in concealed["cases"].values()]
    assert {name: families.count(name) for name in families} == {"null": 2, "single": 6, "compound": 1, "unknown": 1}
    kept = json.loads((KEPT / "real.json").read_text())["cases"]
    asked = {one.name: one.command for one in (*realrecordings.FITS, *realrecordings.DIAGNOSES)}
    assert {name: case["command"] for name, case in kept.items()} == asked


def test_a_tick_is_timed_in_a_process_of_its_own(tmp_path: Path) -> None:
    taken = speed.tick(ROOT, tmp_path)
    assert 0.0 < taken.clock_s < 0.02
    assert json.loads((tmp_path / "tick.json").read_text())["steps"] > 1000


def test_a_command_that_fails_says_so_in_one_error(tmp_path: Path) -> None:
    with pytest.raises(trees.ToolError, match=r"exit code 2: .*nowhere\.mcap"):
        trees.hoopd(ROOT, ["replay", "nowhere.mcap"], tmp_path)
