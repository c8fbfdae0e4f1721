"""Random sequences of commands, faults and board latches: the rule of what switches off holds in every tick.

A run of the tests tries some hundred sequences, a proof a thousand; `python tools/bench/races.py` tries 5,000.
"""

from __future__ import annotations

import pytest
from harness.sequences import CHANGES, LOADABLE, SEQUENCE, Sequence, broken, by_tick, play
from harness.smallrig import healthy
from hypothesis import HealthCheck, example, given, settings

SAMPLE, SEQUENCES = 100, 1000
SETTINGS = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


@example([("arm", 0), ("disarm", 0)])
@example([("disarm", 0), ("arm", 0)])
@example([("arm", 60), ("overcurrent", 3), ("healed", 60), ("arm", 1), ("stop", 0)])
@example([("arm", 60), ("overcurrent", 3), ("healed", 60), ("arm", 1), ("shutdown", 0)])
@example([("arm", 60), ("stop", 1), ("arm", 0)])
@example([("arm", 60), ("overcurrent", 0), ("arm", 2), ("healed", 30)])
@settings(max_examples=SAMPLE, **SETTINGS)
@given(SEQUENCE)
def test_what_switches_off_always_wins(sequence: Sequence) -> None:
    assert broken(sequence) == []


@example([("arm", 60), ("controller good", 3), ("disarm", 0), ("arm", 60), ("controller wide", 1)])
@example([("arm", 300), ("trial good", 60), ("stop", 0), ("accept", 60)])
@example([("arm", 300), ("trial lost", 60), ("trial other model", 160), ("alive", 1), ("accept", 1), ("revert", 1)])
@example([("arm", 60), ("controller other model", 160), ("experiment signal", 9), ("overcurrent", 3)])
@settings(max_examples=SAMPLE // 10, **SETTINGS)
@given(CHANGES)
def test_what_switches_off_wins_over_new_controllers_and_limits_never_widen(sequence: Sequence) -> None:
    assert broken(sequence) == []


@pytest.mark.proof
@pytest.mark.timeout(600)
@settings(max_examples=SEQUENCES // 2, **SETTINGS)
@given(CHANGES)
def test_limits_never_widen_in_five_hundred_sequences_of_changes(sequence: Sequence) -> None:
    assert broken(sequence) == []


def test_sequences_of_changes_reach_every_end() -> None:
    names, told = ("controller", "trial_returned", "experiment_ended", "command_refused"), set()
    for sequence in (
        [("arm", 300), ("trial good", 300), ("trial cold", 60), ("accept", 1), ("controller cold", 60)],
        [("arm", 60), ("controller other model", 160), ("experiment signal", 60), ("controller lost", 5)],
    ):
        rig = healthy()
        rig.loadable = dict(LOADABLE)
        for happening in by_tick(sequence):
            play(rig, happening)
        told |= {note.name for note in rig.notes}
    assert told >= set(names)


@pytest.mark.proof
@settings(max_examples=SEQUENCES, **SETTINGS)
@given(SEQUENCE)
def test_what_switches_off_always_wins_in_a_thousand_sequences(sequence: Sequence) -> None:
    assert broken(sequence) == []


def test_the_sequences_reach_what_they_are_about() -> None:
    """Every mode, each of the faults, and an arm that waits."""
    modes, faults, waits = set(), set(), 0
    for sequence in (
        [("arm", 60), ("board times out", 60), ("clear", 20), ("arm", 60), ("stop", 60)],
        [("arm", 60), ("overcurrent", 60), ("arm", 9), ("healed", 60), ("ball lost", 30), ("camera lost", 60)],
        [("arm", 60), ("restart", 5), ("arm", 30), ("link lost", 60), ("arm", 60), ("overrun", 60)],
    ):
        rig = healthy()
        for names in by_tick(sequence):
            modes.add(play(rig, names).record.mode)
            waits += rig.tick.operator.waits
        faults |= {note.fields["fault"] for note in rig.notes if note.name == "fault"}
    assert modes == {"DISARMED", "READY", "RUNNING", "STOPPING", "FAULT"}
    stopping = {"ball_lost", "camera_lost", "overrun_persistent"}
    assert faults >= {"board_fault", "board_timeout", "board_reset", "link_lost", *stopping}
    assert waits > 5
