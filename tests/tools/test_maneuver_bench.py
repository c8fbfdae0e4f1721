"""The bench of loops on sealed rigs: what is drawn, and one rig of it from sealed parameters to a judged loop."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
sys.path[:0] = [str(TOOLS), str(TOOLS / "bench")]

import maneuver as bench  # noqa: E402
from sealedrigs.rigs import NOT_OF_A_RIG, sealed_rig  # noqa: E402

from hoopd.plants.model_file import load_model  # noqa: E402


def test_a_seed_is_a_rig_and_every_number_of_it_is_off(tmp_path: Path) -> None:
    rigs = [sealed_rig(seed) for seed in range(30)]
    assert rigs == [sealed_rig(seed) for seed in range(30)]
    assert {len(rig.effects) for rig in rigs} == {1, 2}
    assert all(abs(factor - 1.0) == pytest.approx(0.1) for rig in rigs for factor in rig.factors.values())
    assert not {name for rig in rigs for name in rig.effects} & NOT_OF_A_RIG
    for rig in rigs:
        model = load_model(rig.write(tmp_path / "sealed.yaml"))
        assert {entry.name for entry in model.effects} == rig.effects.keys()


@pytest.mark.proof
def test_one_rig_is_recorded_planned_and_looped() -> None:
    row = bench.run_rig(1, ["nominal"])
    assert row["feasible"] and row["arms"]["nominal"]["success"], row


def test_what_the_rig_s_own_state_says_counts_too() -> None:
    good = {"attempts": [{"success": True, "shortfalls": [], "ended": "done"}], "outcome": "done"}
    assert bench.judged(good, 0.3) == {"success": True, "why": ""}
    assert bench.judged(good, -0.01) == {"success": False, "why": "the rig's contact was lost"}
    assert not bench.judged({"attempts": [], "outcome": "the ball did not come to rest"}, 0.3)["success"]


@pytest.mark.proof
def test_the_way_up_is_drawn_with_a_ball_in_the_air_and_on_the_inner_hoop() -> None:
    sys.path.append(str(TOOLS))
    import maneuver_picture as drawn

    one, times = drawn.played("up"), drawn.SHOWN["up"].times_s
    assert len(drawn.strip("up", one)) == len(times)
    modes = {t: one.rows[round(t / 0.02)].ball_mode for t in times}
    assert set(modes.values()) == {"rolling", "air", "inner"} and modes[3.0] == "inner"
    assert len(drawn.draw("up", one).axes) == len(times) + 3


def test_the_strip_of_pictures_is_of_a_first_attempt() -> None:
    sys.path.append(str(TOOLS))
    import maneuver_picture as drawn

    one, times = drawn.played("loop"), drawn.SHOWN["loop"].times_s
    pictures = drawn.strip("loop", one)
    assert [t for t, _ in pictures] == list(times) and 0.0 < times[0] < times[-1] < 0.02 * len(one.plan)
    assert len(drawn.draw("loop", one).axes) == len(times) + 2
