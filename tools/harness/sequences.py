"""Random sequences of commands, faults and board latches on the tick alone, judged by a referee.

Rules of this file: a sequence is names with the ticks after each; what happens is listed here, what is right is not.
"""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import strategies as st

from harness.referee import Referee
from harness.smallrig import PERIOD_S, TORQUE_LIMIT_NM, SmallRig, healthy
from hoopd.core.tick import Output

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
