"""The gate of the operator's commands: what is taken, what is refused and why."""

from __future__ import annotations

import threading
from collections import deque

import pytest
from harness.smallrig import healthy
from hypothesis import given, strategies as st
from shell.peers import wait_until

from hoopd.core.records import Command
from hoopd.core.succession import LOADED
from hoopd.core.tick import Note
from hoopd.files.reading import InputError
from hoopd.shell.commands import NAMES, WAITING, Gate, Ranges, RefusedError, Ticket

RANGES = Ranges((-1.0, 1.0), {"q_psi": (0.0, 10.0)})


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


@pytest.mark.parametrize("name", LOADED)
def test_a_daemon_that_loads_nothing_says_so(name: str) -> None:
    with pytest.raises(RefusedError, match=f"{name}: this daemon loads none"):
        Gate(Ranges()).offer(name, b'{"key": "mine.yaml@0123456789ab"}')


def loaded(gate: Gate, ticket: Ticket) -> tuple[Command, ...]:
    """What the loop takes once the file was read; the thread that reads it is short."""
    taken: list[Command] = []
    wait_until(lambda: taken.extend(gate.take()) or taken or ticket.outcome is not None)
    return tuple(taken)


def test_a_file_is_read_beside_the_loop_and_enters_with_its_text() -> None:
    asked: list[tuple[str, str, str]] = []

    def load(key: str, by: str) -> str:
        asked.append((key, by, threading.current_thread().name))
        return "text"

    gate = Gate(RANGES, load)
    ticket = gate.offer("controller", b'{"key": "mine.yaml@0123456789ab"}', by="user 7")
    assert loaded(gate, ticket) == (Command("controller", 0.0, "mine.yaml@0123456789ab", "text"),)
    assert asked == [("mine.yaml@0123456789ab", "user 7", "loading")]
    gate.settle(Note("controller", "info", {"command": "controller"}), healthy().step().record)
    assert ticket.answer()["key"] == "mine.yaml@0123456789ab" and "text" not in ticket.answer()


@pytest.mark.parametrize("error", [InputError("mine.yaml", "gains", "none"), OSError("disk"), RecursionError()])
def test_what_cannot_be_read_is_an_answer_and_no_command(error: Exception) -> None:
    def load(key: str, by: str) -> str:
        raise error

    gate = Gate(RANGES, load)
    ticket = gate.offer("trial", b'{"key": "mine.yaml@0123456789ab"}')
    assert loaded(gate, ticket) == ()
    with pytest.raises(RefusedError, match=type(error).__name__ if not isinstance(error, InputError) else "gains"):
        ticket.answer()


def test_one_file_at_a_time_and_what_switches_off_passes() -> None:
    goes_on = threading.Event()

    def load(key: str, by: str) -> str:
        goes_on.wait(10.0)
        return "text"

    gate = Gate(RANGES, load)
    first = gate.offer("controller", b'{"key": "one.yaml@0123456789ab"}')
    with pytest.raises(RefusedError, match=r"busy: one\.yaml@0123456789ab is being loaded"):
        gate.offer("trial", b'{"key": "other.yaml@0123456789ab"}')
    gate.offer("disarm")
    assert gate.take() == (Command("disarm"),)
    goes_on.set()
    assert [command.key for command in loaded(gate, first)] == ["one.yaml@0123456789ab"]


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
        ("speed", b"41", "41 is outside -40 to 40"),
        ("reference", b"NaN", "expected a number or"),
        ("reference", b"1e999", "expected a"),
        ("reference", b'{"valu": 1}', "expected a number or"),
        ("reference", b"\xff", "expected a number or"),
        ("reference", b" " * 2000, "more than 1000 bytes"),
        ("tune", b'{"key": "x", "value": 1}', "unknown key 'x'; known: q_psi"),
        ("tune", b'{"key": "q_psi", "value": 11}', "outside 0 to 10"),
        ("experiment", b"1", "experiment: this daemon loads none"),
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
