"""The fault campaign: its kinds are those of docs/explanations/fault_campaign.md; its judge lets no late one pass."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hoopd.core.health import BY_NAME, Action
from hoopd.sim import faults

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "explanations" / "fault_campaign.md").read_text()


@pytest.fixture(scope="module")
def bench() -> Any:
    """The parts of the campaign."""
    sys.path.insert(0, str(ROOT / "tools" / "bench"))
    try:
        from faultcampaign import judging, kind, kinds, lies, onset, trials
    finally:
        sys.path.remove(str(ROOT / "tools" / "bench"))
    return SimpleNamespace(judging=judging, kind=kind, kinds=kinds, lies=lies, onset=onset, trials=trials)


def table(heading: str) -> list[list[str]]:
    lines = PAGE.split(heading, 1)[1].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[: lines.index("")]]
    assert rows
    return rows


def test_the_page_lists_every_kind_with_its_rule(bench: Any) -> None:
    words = {
        bench.kinds.LINE: "the line's counts",
        bench.lies.NO_ENCODER: "an encoder row",
        bench.lies.NO_BALL: "a ball row",
        (*bench.lies.NO_ENCODER, *bench.lies.NO_BALL): "either",
        bench.kind.NOTHING_TO_SAY: "-",
    }
    since = {"fault": "the fault", "overspeed": "the limit"}
    judged = {name: kind for name, kind in bench.kinds.KINDS.items() if kind.outcome != "untold"}
    rows = table("| kind | what is done |")
    assert [row[0] for row in rows] == list(judged)
    for (_, _, rule, told, deadline, begins), kind in zip(rows, judged.values(), strict=True):
        goes_on = kind.outcome == "goes on"
        assert rule == kind.outcome
        assert told == words.get(kind.causes, ", ".join(kind.causes))
        assert deadline == ("-" if goes_on else f"{kind.deadline_s:.3g} s")
        assert begins == ("-" if goes_on else since.get(kind.since, f"the {kind.since}"))
    assert {row[0] for row in table("| lie | what is done |")} == bench.kinds.KINDS.keys() - judged.keys()


def test_every_fault_of_the_rig_is_in_the_campaign(bench: Any) -> None:
    scripts = [kind.script for kind in bench.kinds.KINDS.values() if kind.script]
    assert {script["kind"] for script in scripts} == set(faults.KINDS)
    for script in scripts:
        faults.ScriptedFault(script["kind"], 4.0, script["for_s"] or 1.0, script["params"])


def test_every_row_that_ends_control_is_asked_for(bench: Any) -> None:
    """But those that need a law or a number gone wrong inside the daemon, or a board that never obeys."""
    told = {cause for kind in bench.kinds.KINDS.values() for cause in kind.causes}
    assert told - set(BY_NAME) <= {*bench.kinds.LINE, "", "disarm", "stop"}
    ending = {fault.name for fault in BY_NAME.values() if fault.action >= Action.PAUSE}
    assert ending - told == {"board_refuses", "ball_runaway", "not_finite"}


def play(bench: Any, folder: Path, name: str, **changes: Any) -> tuple[Any, Any]:
    """A trial of a kind, perhaps changed, in lock-step, and the verdict."""
    kind, way = replace(bench.kinds.KINDS[name], **changes), bench.trials.Way(direct=True, lockstep=True)
    trial = bench.trials.perform(folder, kind, way, 1)
    return trial, bench.judging.judge(name, kind, trial, lambda start, stop: ())


def test_what_is_in_time_passes_and_what_is_late_does_not(bench: Any, tmp_path: Path) -> None:
    trial, fine = play(bench, tmp_path, "camera stall")
    assert fine.wrong == []
    assert fine.began_s == pytest.approx(4.0237)
    assert 0.1 < fine.zero_s < 1.26
    kind = bench.kinds.KINDS["camera stall"]
    for change, word in (
        ({"deadline_s": fine.zero_s - 0.11}, "torque until"),
        ({"causes": ("board_fault",)}, "no message names board_fault"),
        ({"outcome": "goes on"}, "control did not go on"),
        ({"outcome": "pause"}, "control did not come back"),
        ({"exit_code": 1}, "exit code 0"),
    ):
        verdict = bench.judging.judge("", replace(kind, **change), trial, lambda start, stop: ())
        assert word in " ".join(verdict.wrong)


def test_a_lie_counts_from_where_report_and_truth_part(bench: Any, tmp_path: Path) -> None:
    """A painted ball is elsewhere at once, a scaled one not before the ball has left the bottom."""
    trial, verdict = play(bench, tmp_path / "painted", "ball painted")
    assert verdict.wrong == []
    assert 0.0 <= bench.onset.ball_departs(trial) - trial.at <= 0.04
    assert bench.onset.hoop_departs(trial) == float("inf")


def test_what_nothing_tells_is_shown_and_passes(bench: Any, tmp_path: Path) -> None:
    _, verdict = play(bench, tmp_path, "encoder 0.8", observe_s=3.0)
    assert verdict.wrong == []
    assert verdict.began_s >= 4.0237
    assert 0.0 < verdict.late_torque_nm <= 0.7
