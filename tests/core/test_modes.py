"""The mode table: every pair of mode and event, and what must never happen."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from hoopd.core.modes import ENERGISED, REVOKING, TRANSITIONS, Event, Mode, next_mode

ALL = list(itertools.product(Mode, Event))


@pytest.mark.parametrize(("mode", "event"), ALL)
def test_a_pair_outside_the_table_changes_nothing(mode: Mode, event: Event) -> None:
    after = next_mode(mode, frozenset({event}))
    assert after is TRANSITIONS.get((mode, event), mode)


@pytest.mark.parametrize("mode", list(Mode))
def test_only_an_arm_energises(mode: Mode) -> None:
    for event in Event:
        after = next_mode(mode, frozenset({event}))
        if mode not in ENERGISED and after in ENERGISED:
            assert event is Event.ARM


@pytest.mark.parametrize("mode", sorted(ENERGISED))
def test_cut_and_disarm_end_every_energised_mode(mode: Mode) -> None:
    assert next_mode(mode, frozenset({Event.CUT})) is Mode.FAULT
    assert next_mode(mode, frozenset({Event.DISARM})) is Mode.DISARMED


def test_the_strongest_event_wins_in_every_set() -> None:
    for size in (2, 3):
        for events in itertools.combinations(Event, size):
            if Event.CUT in events:
                assert next_mode(Mode.RUNNING, frozenset(events)) is Mode.FAULT
            elif Event.DISARM in events:
                assert next_mode(Mode.RUNNING, frozenset(events)) is Mode.DISARMED
            elif Event.STOP in events:
                assert next_mode(Mode.RUNNING, frozenset(events)) is Mode.STOPPING


def test_a_fault_is_left_by_the_operator_only() -> None:
    leaving = {event for (mode, event), after in TRANSITIONS.items() if mode is Mode.FAULT is not after}
    assert leaving == {Event.CLEAR, Event.ARM}


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("name", REVOKING)
def test_whatever_comes_beside_it_what_switches_off_wins(name: str, mode: Mode) -> None:
    allowed = {Mode.DISARMED, Mode.FAULT}
    if REVOKING[name] is Event.STOP and mode in (Mode.RUNNING, Mode.STOPPING):
        allowed.add(Mode.STOPPING)
    for size in range(len(Event) + 1):
        for others in itertools.combinations(Event, size):
            assert next_mode(mode, frozenset({REVOKING[name], *others})) in allowed


def test_a_stop_that_is_over_is_over_however_often_it_is_asked_for() -> None:
    assert next_mode(Mode.STOPPING, frozenset({Event.STOP, Event.STOPPED})) is Mode.DISARMED


def test_every_mode_can_be_reached_and_left() -> None:
    assert {mode for mode, _ in TRANSITIONS} == set(Mode)
    assert set(TRANSITIONS.values()) == set(Mode)


def test_the_diagram_of_the_readme_is_the_table() -> None:
    """Rows that stay where they are have no arrow; an arrow may say after its events where they come from."""
    text = (Path(__file__).resolve().parents[2] / "README.md").read_text()
    diagram = text.split("stateDiagram-v2")[1].split("```")[0]
    arrows = re.findall(r"(\w+) --> (\w+): ([a-z, ]+)", diagram)
    drawn = {(Mode(a), Event(event.strip()), Mode(b)) for a, b, events in arrows for event in events.split(",")}
    assert drawn == {(mode, event, after) for (mode, event), after in TRANSITIONS.items() if mode is not after}
