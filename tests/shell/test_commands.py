"""The gate of the operator's commands: what is taken, what is refused and why."""

from __future__ import annotations

from collections import deque

import pytest
from harness.smallrig import healthy
from hypothesis import given
from hypothesis import strategies as st

from hoopd.core.records import Command
from hoopd.shell.commands import NAMES, WAITING, Gate, Ranges, RefusedError, Ticket

RANGES = Ranges((-1.0, 1.0), {"q_psi": (0.0, 10.0)}, {"step": (0.0, 0.3)})


def test_who_is_not_trusted_may_disarm_and_stop() -> None:
    gate = Gate(RANGES)
    for name in set(NAMES) - {"disarm", "stop"}:
        with pytest.raises(RefusedError, match=r"commands are off: set telemetry.commands"):
            gate.offer(name, b"0.1", untrusted="commands are off: set telemetry.commands")
    gate.offer("stop")
    gate.offer("disarm")
    assert gate.take() == (Command("stop"), Command("disarm"))
    assert gate.take() == ()
    assert (gate.accepted, gate.refused) == (2, len(NAMES) - 2)


def test_a_daemon_without_experiments_says_where_they_are() -> None:
    with pytest.raises(RefusedError, match=r"starts none; end it and run `hoopd experiment`"):
        Gate(Ranges()).offer("experiment", b'{"key": "prbs", "value": 1}')


def test_order_and_safe_ones_last() -> None:
    gate = Gate(RANGES)
    gate.offer("disarm")
    gate.offer("reference", b"0.5")
    gate.offer("tune", b'{"key": "q_psi", "value": 2}')
    gate.offer("arm")
    assert gate.take() == (Command("reference", 0.5), Command("tune", 2.0, "q_psi"), Command("arm"), Command("disarm"))


@pytest.mark.parametrize(
    ("name", "payload", "says"),
    [
        ("reference", b"", "expected a finite number from -1 to 1"),
        ("reference", b"1.5", "1.5 is outside -1 to 1"),
        ("reference", b"NaN", "expected a number or"),
        ("reference", b"1e999", "expected a"),
        ("reference", b'{"valu": 1}', "expected a number or"),
        ("reference", b"\xff", "expected a number or"),
        ("reference", b" " * 2000, "more than 1000 bytes"),
        ("tune", b'{"key": "x", "value": 1}', "unknown key 'x'; known: q_psi"),
        ("tune", b'{"key": "q_psi", "value": 11}', "outside 0 to 10"),
        ("experiment", b"1", "unknown key ''; known: step"),
        ("fly", b"", "unknown command 'fly'; known: disarm"),
    ],
)
def test_refusals_say_what_would_be_right(name: str, payload: bytes, says: str) -> None:
    gate = Gate(RANGES)
    with pytest.raises(RefusedError, match=says):
        gate.offer(name, payload)
    assert gate.take() == ()


def test_flood_is_bounded_and_disarm_still_comes_through() -> None:
    gate = Gate(RANGES)
    for _ in range(WAITING):
        gate.offer("arm")
    for _ in range(1000):
        with pytest.raises(RefusedError, match="busy"):
            gate.offer("arm")
        gate.offer("disarm")
    taken = gate.take()
    assert len(taken) == WAITING + 1 and taken[-1] == Command("disarm")


@given(st.sampled_from(NAMES), st.binary(max_size=40))
def test_any_payload_is_taken_or_refused(name: str, payload: bytes) -> None:
    gate = Gate(RANGES)
    try:
        gate.offer(name, payload)
    except RefusedError:
        assert gate.take() == ()
    else:
        assert len(gate.take()) == 1


def test_an_arm_offered_before_a_disarm_never_comes_in_a_later_tick() -> None:
    gate = Gate(RANGES)

    class Interrupted(deque[Ticket]):
        """A queue after whose first taken command another thread offers both."""

        def popleft(self) -> Ticket:
            gate._waiting = deque(self)
            ticket = gate._waiting.popleft()
            self.clear()
            gate.offer("arm")
            gate.offer("disarm")
            return ticket

    gate._waiting = Interrupted()
    gate.offer("reference", b"0.1")
    ticks = [gate.take(), gate.take()]
    armed, disarmed = (next(k for k, taken in enumerate(ticks) if Command(name) in taken) for name in ("arm", "disarm"))
    assert armed <= disarmed


def test_who_arms_after_a_clear_is_not_told_what_became_of_the_arm_before_it() -> None:
    rig, gate = healthy(), Gate(Ranges())
    first, clear, last = gate.offer("arm"), gate.offer("clear"), gate.offer("arm")
    output = rig.step(*(command.name for command in gate.take()))
    for note in output.notes:
        gate.settle(note, output.record)
    assert output.record.mode == "READY" and last.answer()["mode"] == "READY"
    for ticket, reason in ((first, "followed by clear"), (clear, "followed by arm")):
        with pytest.raises(RefusedError, match=reason):
            ticket.answer()
