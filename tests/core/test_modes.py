"""The mode table: every pair of mode and event, and what must never happen."""

from __future__ import annotations

import itertools

import pytest

from hoopd.core.modes import ENERGISED, TRANSITIONS, Event, Mode, next_mode

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
    leaving = {event for (mode, event) in TRANSITIONS if mode is Mode.FAULT}
    assert leaving == {Event.CLEAR, Event.ARM}


def test_every_mode_can_be_reached_and_left() -> None:
    assert {mode for mode, _ in TRANSITIONS} == set(Mode)
    assert set(TRANSITIONS.values()) == set(Mode)
