"""Random sequences of commands, faults and board latches on the tick alone, judged by a referee.

Rules of this file: a sequence is names with the ticks after each; what happens is listed here, what is right is not.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from hypothesis import strategies as st

from harness.referee import Referee
from harness.smallrig import PERIOD_S, TORQUE_LIMIT_NM, SmallRig, Spin, Told, healthy
from hoopd.core.controllers import Log, Measurement
from hoopd.core.excitation import Excitation, ExcitationLimits
from hoopd.core.installed import ControllerLabel, Filter, Installed
from hoopd.core.records import Command
from hoopd.core.tick import Output

COMMANDS = ("arm", "arm", "arm", "disarm", "stop", "clear", "reference", "shutdown")
WORDS = ("accept", "revert", "alive")


class Other(Spin):
    """A law with another gain, which remembers nothing or has to follow first."""

    def __init__(self, gain: float, *, knows: bool) -> None:
        self.gain, self.knows = gain, knows

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        return self.gain * (20.0 - measurement.x[1]), {}

    def take_over(self, other: object) -> bool:
        return self.knows


def signal() -> Excitation:
    """Half a second of a test signal."""
    return Excitation([0.05, -0.05] * 12, ExcitationLimits(0.1, 100.0, 1.0), around=Other(0.02, knows=True))


# What may be loaded, by the name of the file: as it should be, and as it should not.
LOADABLE: dict[str, Callable[[Filter], Installed]] = {
    "good": lambda running: Installed(Other(0.03, knows=True), running, 0.6, 0.6, label=ControllerLabel("good")),
    "cold": lambda running: Installed(Other(0.01, knows=False), running, 0.5, 0.6, label=ControllerLabel("cold")),
    "lost": lambda running: Installed(Other(nan, knows=True), running, 0.4, 0.4, label=ControllerLabel("lost")),
    "wide": lambda running: Installed(Other(1.0, knows=True), running, 7.0, 7.0, label=ControllerLabel("wide")),
    "other model": lambda running: Installed(Other(0.02, knows=True), Filter(Told()), 0.5, 0.5),
    "signal": lambda running: Installed(signal(), running, 0.5, 0.5, fed=False, label=ControllerLabel("signal")),
}
PURPOSES = ("controller", "trial", "experiment")
LOADS = {
    f"{purpose} {name}": Command(purpose, key=name, text=name) for purpose in PURPOSES for name in (*LOADABLE, "none")
}


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
CHANGE = st.tuples(st.sampled_from([*COMMANDS, *LOADS, *WORDS]), st.sampled_from((*GAPS, 160)))
Sequence = list[tuple[str, int]]
SEQUENCE = st.lists(EVENT, min_size=2, max_size=20)
# The same with changes of the controller; it begins with one that is armed.
CHANGES = st.lists(st.one_of(CHANGE, EVENT), min_size=2, max_size=12).map(lambda rest: [("arm", 60), *rest])


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
    taken = (*COMMANDS, *WORDS)
    return rig.step(*(LOADS.get(name, name) for name in names if name in taken or name in LOADS))


def broken(sequence: Sequence) -> list[str]:
    """Where the rule does not hold."""
    rig, referee = healthy(), Referee()
    rig.loadable = dict(LOADABLE)
    for names in by_tick(sequence):
        output = play(rig, names)
        command = output.command
        referee.look(names, output.record.mode, command.torque_nm, command.enable)
        _look_at_laws(rig, command.torque_nm, referee)
    return referee.wrong


def _look_at_laws(rig: SmallRig, torque_nm: float, referee: Referee) -> None:
    """No law gets more than the run began with or its own file says, and what is on trial acts while running alone."""
    succession = rig.tick.succession
    accepted, acting = succession.accepted, succession.acting
    if max(accepted.torque_nm, acting.torque_nm) > TORQUE_LIMIT_NM:
        referee.wrong.append(f"tick {referee.tick}: the limit of {TORQUE_LIMIT_NM} N m became {acting.torque_nm}")
    if abs(torque_nm) > acting.torque_nm:
        referee.wrong.append(f"tick {referee.tick}: {torque_nm} N m, the limit was {acting.torque_nm}")
    if acting is not accepted and rig.mode not in ("READY", "RUNNING"):
        referee.wrong.append(f"tick {referee.tick}: on {succession.purpose} in {rig.mode}")
