"""Operators who race: disarm, stop and shutdown win in every order, and take back every arm that waits."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from harness.smallrig import HEALTHY_TICKS, SmallRig, healthy, running

from hoopd.core.operator import BOARD_LATCHES, WISH_TICKS
from hoopd.core.records import Command

SETTLED_TICKS = 80  # more than an arm may wait and a stop may brake
REVOKING = ("disarm", "stop", "shutdown")
ORDERS_OF_TWO, ORDERS_OF_THREE = (list(itertools.permutations(range(n))) for n in (2, 3))


def latched() -> SmallRig:
    """In FAULT by the board's own fault, whose condition is over: an arm has to wait until it is cleared."""
    rig = running()
    rig.board.condition = True
    rig.run(3)
    rig.board.condition = False
    rig.run(HEALTHY_TICKS)
    assert rig.mode == "FAULT"
    assert set(rig.tick.health.hindrances()) == {"board_fault"} <= BOARD_LATCHES
    return rig


def test_an_arm_waits_for_the_board_and_then_energises() -> None:
    rig = latched()
    modes = [rig.step("arm").record.mode, *rig.run(SETTLED_TICKS)]
    assert modes[0] == "FAULT" and "READY" in modes[: WISH_TICKS + 1] and modes[-1] == "RUNNING"


@pytest.mark.parametrize("name", REVOKING)
@pytest.mark.parametrize("order", ORDERS_OF_TWO)
def test_in_one_tick_an_arm_loses_in_any_order(name: str, order: tuple[int, ...]) -> None:
    rig = healthy()
    both = ("arm", name)
    rig.step(*(both[i] for i in order))
    assert {rig.mode, *rig.run(SETTLED_TICKS)} == {"DISARMED"}
    assert rig.refused() == [("arm", f"revoked by {name}")]


@pytest.mark.parametrize("name", REVOKING)
@pytest.mark.parametrize("order", ORDERS_OF_THREE)
def test_in_a_fault_nothing_is_cleared_nor_armed_beside_it(name: str, order: tuple[int, ...]) -> None:
    rig = latched()
    three = ("arm", "clear", name)
    rig.step(*(three[i] for i in order))
    assert {rig.mode, *rig.run(SETTLED_TICKS)} == {"FAULT"}


@pytest.mark.parametrize("name", REVOKING)
@pytest.mark.parametrize("wish", ["arm", "clear"])
def test_a_wish_that_waits_for_the_board_is_revoked(name: str, wish: str) -> None:
    rig = latched()
    assert rig.step(wish).command.clear_fault and rig.mode == "FAULT"
    assert not rig.step(name).command.clear_fault  # nothing is asked of the board any more
    assert {rig.mode, *rig.run(SETTLED_TICKS)} == {"FAULT"}
    assert rig.refused() == [(wish, f"revoked by {name}")]


@pytest.mark.parametrize("name", ["disarm", "stop"])
def test_a_later_arm_is_obeyed(name: str) -> None:
    rig = healthy()
    rig.step("arm", name)
    rig.step("arm")
    assert rig.run(SETTLED_TICKS)[-1] == "RUNNING"


def test_after_a_shutdown_no_arm_is_taken() -> None:
    rig = running()
    rig.step("shutdown")
    assert rig.mode == "STOPPING"
    assert rig.run(SETTLED_TICKS)[-1] == "DISARMED"
    for _ in range(3):
        rig.step("arm")
        assert set(rig.run(WISH_TICKS + 2)) == {"DISARMED"}
    assert rig.refused() == [("arm", "the daemon is ending")] * 3


@pytest.mark.parametrize("name", ["stop", "shutdown"])
def test_a_stop_again_and_again_does_not_brake_for_longer(name: str) -> None:
    once, often = running(), running()
    once.step(name)
    modes = [once.mode, *once.run(SETTLED_TICKS)]
    repeated = [often.step(name).record.mode for _ in modes]
    assert "STOPPING" in modes and modes[-1] == "DISARMED"
    assert repeated == modes


def test_a_hoop_that_cannot_be_braked_is_switched_off_after_a_second_of_stops() -> None:
    rig = running()
    rig.board.dtheta = 59.0
    modes = [rig.step("stop").record.mode]
    while modes[-1] == "STOPPING":
        rig.board.dtheta = 59.0  # something drives the hoop on
        modes.append(rig.step("stop").record.mode)
    assert modes[-1] == "DISARMED" and 50 <= len(modes) <= 52


def test_an_arm_while_it_brakes_is_refused_and_not_kept() -> None:
    rig = running()
    rig.step("stop")
    rig.step("arm")
    assert rig.refused() == [("arm", "the mode is STOPPING")]
    assert rig.run(SETTLED_TICKS)[-1] == "DISARMED"


def test_what_ended_control_is_known_after_it_is_over() -> None:
    rig = running()
    rig.blind = 10
    assert "STOPPING" in rig.run(200) and rig.mode == "DISARMED"
    assert rig.tick.faults == () and rig.tick.because == ("camera_lost",)
    rig.step("arm")
    rig.run(SETTLED_TICKS)
    assert rig.mode == "RUNNING" and rig.tick.because == ()
    rig.step("stop")
    rig.run(SETTLED_TICKS)
    assert rig.mode == "DISARMED" and rig.tick.because == ()


@pytest.mark.parametrize("fault", ["silent", "blind"])
@pytest.mark.parametrize("name", REVOKING)
def test_a_fault_in_the_same_tick_changes_nothing(fault: str, name: str) -> None:
    rig = running()
    setattr(rig, fault, 20)
    for _ in range(20):
        rig.step(name, "arm")
        assert rig.mode in ("DISARMED", "FAULT", "STOPPING")
    assert "STOPPING" not in rig.run(SETTLED_TICKS)[-1] and rig.mode in ("DISARMED", "FAULT")


def test_a_stop_while_ready_switches_off() -> None:
    rig = healthy()
    rig.dark = 200
    rig.step("arm")
    assert rig.run(20)[-1] == "READY"
    rig.step("stop")
    assert {rig.mode, *rig.run(SETTLED_TICKS)} == {"DISARMED"}


def test_the_later_of_arm_and_clear_is_the_one_that_waits() -> None:
    rig = latched()
    rig.step("arm", "clear")
    assert rig.run(SETTLED_TICKS)[-1] == "DISARMED"
    assert rig.refused() == [("arm", "followed by clear")]


def test_an_arm_that_is_refused_says_what_hinders_it() -> None:
    rig = healthy()
    rig.silent = 10
    rig.run(10)
    rig.step("arm")
    assert rig.refused() == [("arm", "link_lost")]
    assert set(rig.run(SETTLED_TICKS)) == {"DISARMED"}


@pytest.mark.parametrize("ticks", [1, 50])
def test_a_reference_that_is_wanted_while_nothing_acts_is_refused(ticks: int) -> None:
    rig = healthy()
    rig.step(Command("reference", 0.3))
    rig.run(ticks)
    rig.step("arm")
    assert rig.run(60)[-1] == "RUNNING" and rig.tick.operator.reference == 0.0
    assert rig.refused() == [("reference", "the mode is DISARMED")]
    rig.step(Command("reference", 0.3))
    assert rig.tick.operator.reference == 0.3


@pytest.mark.parametrize("slew_nm", [0.02, 0.005, 0.002])
def test_a_stop_does_not_drive_the_hoop_on_however_slow_the_slew_limit(slew_nm: float) -> None:
    rig = healthy()
    acting = rig.tick.succession.acting
    rig.tick.succession.acting = rig.tick.succession.accepted = replace(acting, slew_nm_per_tick=slew_nm)
    rig.step("arm")
    while rig.board.dtheta < 10.0:
        assert rig.step().record.mode in ("READY", "RUNNING")
    stopping = [rig.step("stop")]
    while rig.mode == "STOPPING":
        stopping.append(rig.step())
    assert max(output.command.torque_nm for output in stopping) <= 0.0
    assert min(output.command.torque_nm for output in stopping) < 0.0
