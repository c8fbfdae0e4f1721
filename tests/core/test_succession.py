"""Another controller while the daemon runs: no step in the torque, no wider limit, and what switches off wins."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from math import inf, nan

import pytest
from harness.smallrig import SmallRig, healthy, running

from hoopd.core.bridge import MOST_NM
from hoopd.core.controllers import Log, Measurement
from hoopd.core.installed import ControllerLabel, Filter, Installed
from hoopd.core.records import Command

LIMIT_NM = 0.7


class Turn:
    """A law that wants the hoop to turn, and remembers nothing."""

    def __init__(self, gain: float, speed: float = 20.0) -> None:
        self.gain, self.speed = gain, speed

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        return self.gain * (self.speed - measurement.x[1]), {}

    def reset(self) -> None: ...

    def tune(self, key: str, value: float) -> bool:
        return False

    def take_over(self, other: object) -> bool:
        return True


class Cold(Turn):
    """A law that has to follow first."""

    def take_over(self, other: object) -> bool:
        return False


class Lost(Turn):
    """A law that has no torque."""

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        return nan, {}


def named(law: Turn, torque_nm: float = LIMIT_NM, slew_nm: float = LIMIT_NM) -> Callable[[Filter], Installed]:
    """A controller of the same filter."""
    return lambda running: Installed(law, running, torque_nm, slew_nm, label=ControllerLabel("other.yaml", "ab" * 32))


def with_laws(rig: SmallRig, **laws: Callable[[Filter], Installed]) -> SmallRig:
    """The same rig with what it may load."""
    rig.loadable = dict(laws)
    return rig


def load(text: str, purpose: str = "controller") -> Command:
    return Command(purpose, key="other.yaml@" + "ab" * 6, text=text)


def in_force(rig: SmallRig) -> str:
    return rig.tick.succession.acting.label.name


def test_in_the_tick_of_a_change_the_torque_is_the_old_law_s_and_then_goes_over() -> None:
    rig, twin = with_laws(running(), other=named(Turn(0.03, 19.0))), running()
    assert rig.step(load("other")).command.torque_nm == pytest.approx(twin.step().command.torque_nm, abs=1e-15)
    assert in_force(rig) == "other.yaml"
    torques = [rig.step().command.torque_nm for _ in range(60)]
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) < 0.02
    assert torques[-1] == pytest.approx(0.03 * (19.0 - rig.board.dtheta), abs=2e-3)
    assert torques[0] != twin.step().command.torque_nm


def test_a_large_difference_is_a_step_within_the_slew_limit() -> None:
    rig = with_laws(running(), other=named(Turn(1.0, -20.0), slew_nm=0.05))
    torques = [rig.step().command.torque_nm, rig.step(load("other")).command.torque_nm]
    torques += [rig.step().command.torque_nm for _ in range(40)]
    assert min(torques) < -0.5
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) <= 0.05 + 1e-12


def test_the_same_law_again_and_again_changes_nothing() -> None:
    rig, twin = with_laws(running(), same=named(Turn(0.02))), running()
    for _ in range(100):
        assert rig.step(load("same")).command.torque_nm == twin.step().command.torque_nm


def test_changes_in_a_row_accumulate_nothing() -> None:
    rig = with_laws(running(), one=named(Turn(0.02, 25.0)), other=named(Turn(0.04, 15.0)))
    for k in range(100):
        rig.step(load("one" if k % 2 else "other"))
        assert abs(rig.tick._bridge.torque_nm) <= MOST_NM
    torques = [rig.step().command.torque_nm for _ in range(100)]
    assert torques[-1] == pytest.approx(0.02 * (25.0 - rig.board.dtheta), abs=2e-3)


def test_a_refusal_tells_of_which_file() -> None:
    rig = with_laws(running(), cold=named(Cold(0.03)))
    rig.step(load("cold", "trial"))
    rig.step(load("unknown"))
    told = [note.fields for note in rig.notes if note.name == "command_refused"]
    assert all(one["sha256"].startswith("ab") for one in told) and len(told) == 2
    rig.step("revert")
    assert "sha256" not in [note.fields for note in rig.notes if note.name == "command_refused"][-1]


def test_a_law_that_knows_nothing_of_the_past_follows_first() -> None:
    rig = with_laws(running(), cold=named(Cold(0.03)))
    rig.step(load("cold"))
    ticks = next(k for k in range(100) if rig.step() and in_force(rig) == "other.yaml")
    assert 20 <= ticks <= 30
    assert rig.mode == "RUNNING" and not rig.refused()


@pytest.mark.parametrize(("torque_nm", "slew_nm"), [(0.71, LIMIT_NM), (inf, inf), (nan, nan), (LIMIT_NM, 1.4)])
def test_limits_never_widen_beyond_those_of_the_start(torque_nm: float, slew_nm: float) -> None:
    for rig in (running(), healthy()):
        with_laws(rig, wide=named(Turn(5.0), torque_nm, slew_nm), narrow=named(Turn(5.0), 0.1, 0.05))
        for name, most_nm, most_slew_nm in (("narrow", 0.1, 0.05), ("wide", LIMIT_NM, LIMIT_NM)) * 2:
            rig.step(load(name))
            rig.board.dtheta = 0.0  # from here on it wants far more
            rig.step("arm") if rig.mode == "DISARMED" else None
            torques = [rig.step().command.torque_nm for _ in range(40)]
            assert max(map(abs, torques)) == most_nm
            assert (rig.tick.limiter.torque_nm, rig.tick.limiter.slew_nm_per_tick) == (most_nm, most_slew_nm)
        assert not rig.refused()


@pytest.mark.parametrize("name", ["disarm", "stop", "shutdown"])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
@pytest.mark.parametrize("rig_of", [running, healthy])
def test_what_switches_off_takes_a_change_back(
    name: str, order: tuple[int, ...], rig_of: Callable[[], SmallRig]
) -> None:
    rig = with_laws(rig_of(), other=named(Turn(0.5)))
    before = in_force(rig)
    three = (load("other"), name, "arm")
    output = rig.step(*(three[i] for i in order))
    assert ("controller", f"revoked by {name}") in rig.refused()
    assert {output.record.mode, *rig.run(80)} <= {"DISARMED", "STOPPING"} and in_force(rig) == before


@pytest.mark.parametrize("name", ["disarm", "stop", "shutdown"])
def test_who_follows_is_forgotten_when_the_law_no_longer_acts(name: str) -> None:
    rig = with_laws(running(), cold=named(Cold(0.03)))
    rig.step(load("cold"))
    rig.run(3)
    rig.step(name)
    assert rig.refused()[-1] == ("controller", f"the mode is {rig.mode}")
    rig.run(100)
    assert in_force(rig) == "" and rig.tick.succession.waiting == ""


def test_disarmed_it_is_in_force_at_once_and_gives_no_torque() -> None:
    rig = with_laws(healthy(), other=named(Turn(0.03)))
    output = rig.step(load("other"))
    assert in_force(rig) == "other.yaml"
    assert not output.command.enable and output.command.torque_nm == 0.0
    rig.step("arm")
    assert rig.run(60)[-1] == "RUNNING"
    assert rig.step().command.torque_nm == pytest.approx(0.03 * (20.0 - rig.tick.health.hoop_speed))


REFUSED = {
    "nothing was read": (Command("controller", key="other.yaml@abcdefabcdef"), "nothing was loaded"),
    "what cannot be made": (load("no such text"), "KeyError"),
    "accept without a trial": (Command("accept"), "there is no trial"),
    "revert without a trial": (Command("revert"), "there is no trial"),
    "alive without a trial": (Command("alive"), "there is no trial"),
    "a law as an experiment": (load("other", "experiment"), "is not an excitation"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_one_line_and_the_law_goes_on(name: str) -> None:
    command, says = REFUSED[name]
    rig, twin = with_laws(running(), other=named(Turn(0.5))), running()
    assert rig.step(command).command.torque_nm == twin.step().command.torque_nm
    ((refused, reason),) = rig.refused()
    assert refused == command.name and says in reason and "\n" not in reason


def test_a_law_without_a_torque_is_refused_and_the_acting_one_goes_on() -> None:
    rig, twin = with_laws(running(), lost=named(Lost(0.0))), running()
    assert rig.step(load("lost")).command.torque_nm == twin.step().command.torque_nm
    assert rig.refused() == [("controller", "its torque is not a number")] and rig.mode == "RUNNING"


def test_loaded_disarmed_a_law_without_a_torque_is_cut_when_it_would_act() -> None:
    rig = with_laws(healthy(), lost=named(Lost(0.0)))
    rig.step(load("lost"))
    rig.step("arm")
    outputs = [rig.step() for _ in range(60)]
    assert {output.command.torque_nm for output in outputs} == {0.0} and rig.mode == "FAULT"


class Sour(Turn):
    """A law that cannot be reset."""

    def reset(self) -> None:
        raise RuntimeError("no memory to clear")


@pytest.mark.parametrize("ticks", [5, 6, 7, 8])
def test_a_law_that_cannot_be_reset_is_not_armed(ticks: int) -> None:
    rig = with_laws(healthy(), sour=named(Sour(0.03)), other=named(Turn(0.03)))
    rig.step(load("sour"))
    rig.run(ticks)
    rig.step("arm")
    assert set(rig.run(60)) == {"DISARMED"}
    assert rig.refused() == [("arm", "not_finite")]
    assert [note.fields["reason"] for note in rig.notes if note.name == "law_failed"] == [
        "RuntimeError: no memory to clear"
    ]
    rig.step(load("other"))
    rig.run(2)
    rig.step("arm")
    assert rig.run(60)[-1] == "RUNNING"


class Boastful(Turn):
    """A law that tells what it should not."""

    speed_limit = 20  # a whole number

    @property
    def tunables(self) -> dict[str, float]:
        raise RuntimeError("not now")


class Shy(Turn):
    @property
    def speed_limit(self) -> float:
        raise RuntimeError("not now")


def test_whatever_a_law_tells_of_itself_the_tick_goes_on() -> None:
    rig = with_laws(running(), boastful=named(Boastful(0.03)), shy=named(Shy(0.03)))
    rig.step(load("boastful"))
    rig.run(60)
    rig.step(Command("speed", 5.0))
    assert rig.tick.operator.speed == 5.0 and rig.tick.succession.tunables == {}
    rig.step(load("shy"))
    rig.run(60)
    rig.step(Command("speed", 5.0))
    assert rig.refused()[-1][0] == "speed" and rig.mode == "RUNNING"
