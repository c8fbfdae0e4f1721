"""Random sequences of commands, faults and board latches: the rule of what switches off holds in every tick.

A run of the tests tries a thousand sequences; `python tools/bench/races.py` tries 5,000.
"""

from __future__ import annotations

from collections.abc import Callable

from core.smallrig import PERIOD_S, TORQUE_LIMIT_NM, SmallRig, healthy
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from referee import Referee

from hoopd.core.tick import Output

SEQUENCES = 1000  # some ten seconds
COMMANDS = ("arm", "arm", "arm", "disarm", "stop", "clear", "reference", "shutdown")


def overcurrent(rig: SmallRig) -> None:
    rig.board.condition = True


def healed(rig: SmallRig) -> None:
    rig.board.condition = False


def attribute(name: str, ticks: int) -> Callable[[SmallRig], None]:
    return lambda rig: setattr(rig, name, ticks)


# What happens to board, line and camera; how often a name stands here is how likely it is.
HAPPENINGS: dict[str, Callable[[SmallRig], None]] = {
    "overcurrent": overcurrent,
    "healed": healed,
    "restart": lambda rig: rig.board.restart(),
    "one answer lost": attribute("silent", 1),
    "link lost": attribute("silent", 4),
    "board times out": lambda rig: rig.stall(6),
    "ball lost": attribute("dark", 15),
    "camera lost": attribute("blind", 8),
    "overrun": attribute("late", 12),
}
# Ticks until the next: often none or one, so that things meet; now and then long enough for a fault to be well again.
GAPS = (0, 0, 0, 1, 1, 1, 2, 3, 5, 9, 11, 30, 60)
EVENT = st.tuples(st.sampled_from([*COMMANDS, *COMMANDS, *HAPPENINGS]), st.sampled_from(GAPS))
Sequence = list[tuple[str, int]]
SEQUENCE = st.lists(EVENT, min_size=2, max_size=20)


def by_tick(sequence: Sequence) -> list[list[str]]:
    """Names by tick; the last has two seconds after it, in which nothing may happen by itself."""
    ticks: list[list[str]] = [[]]
    for name, gap in sequence:
        ticks[-1].append(name)
        ticks.extend([] for _ in range(gap))
    return [*ticks, *([] for _ in range(round(2.0 / PERIOD_S)))]


def play(rig: SmallRig, names: list[str]) -> Output:
    """One tick in which this happens."""
    for name in names:
        if name in HAPPENINGS:
            HAPPENINGS[name](rig)
    return rig.step(*(name for name in names if name in COMMANDS))


def broken(sequence: Sequence) -> list[str]:
    """Where the rule does not hold."""
    rig, referee = healthy(), Referee()
    for names in by_tick(sequence):
        output = play(rig, names)
        command = output.command
        referee.look(names, output.record.mode, command.torque_nm, command.enable)
        if abs(command.torque_nm) > TORQUE_LIMIT_NM:
            referee.wrong.append(f"tick {referee.tick}: {command.torque_nm} N m")
    return referee.wrong


@example([("arm", 0), ("disarm", 0)])
@example([("disarm", 0), ("arm", 0)])
@example([("arm", 60), ("overcurrent", 3), ("healed", 60), ("arm", 1), ("stop", 0)])
@example([("arm", 60), ("overcurrent", 3), ("healed", 60), ("arm", 1), ("shutdown", 0)])
@example([("arm", 60), ("stop", 1), ("arm", 0)])
@example([("arm", 60), ("overcurrent", 0), ("arm", 2), ("healed", 30)])
@settings(max_examples=SEQUENCES, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(SEQUENCE)
def test_what_switches_off_always_wins(sequence: Sequence) -> None:
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
