"""One run of races on the machine's clock: a daemon as a process, operators at its socket, on zenoh and with signals.

Rules of this file: a way to send is a row of `TRANSPORTS`; a command goes out at its time, whatever became of the
others; only the daemon that was started here is signalled.
"""

from __future__ import annotations

import json
import random
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import zenoh
from harness.realrun import Daemon, fifo_granted
from harness.referee import OFF
from harness.runs import Run

from hoopd.daemon.replay import replay
from hoopd.files.reading import InputError
from hoopd.shell.operator import NoDaemonError, ask
from hoopd.shell.session import DEVICE, connecting, device_key
from racing import judge
from racing.lockstep import REFERENCE_RAD, deaf_in, window
from racing.script import PERIOD_S, SIGTERM, Script, Sent, make_script

START_S = 30.0  # until the daemon answers, on a busy machine
EXIT_S = 10.0
ANSWER_S = 3.0
# The rig's board is a process beside others here: it may be late by this much. As in the campaign.
MARGIN_S = 0.1
ORIGIN = 300  # ticks: the daemon has started, and the race about its beginning is over
SENDERS = 16  # more commands than wait for their answers at once
STOP_S = 0.13  # a host that stands still

Send = Callable[[str], dict[str, Any]]  # sends one command; the daemon's answer, InputError when it refuses


class Transport(NamedTuple):
    """One way to a daemon, and the commands that everybody may send by it."""

    names: tuple[str, ...]
    open: Callable[[Daemon], Any]


@contextmanager
def _at_socket(daemon: Daemon) -> Iterator[Send]:
    yield lambda name: ask({"command": name, **_value(name)}, DEVICE, str(socket_of(daemon)))


@contextmanager
def _on_zenoh(daemon: Daemon) -> Iterator[Send]:
    with zenoh.open(connecting(daemon.endpoint, {}, ANSWER_S)) as session:

        def send(name: str) -> dict[str, Any]:
            for reply in session.get(device_key(DEVICE, "cmd", name), payload="{}", timeout=ANSWER_S):
                if reply.ok is not None:
                    return dict(json.loads(reply.ok.payload.to_string()))
                if reply.err is not None:
                    raise InputError("", "", reply.err.payload.to_string())
            raise NoDaemonError("no answer")

        yield send


@contextmanager
def _by_signal(daemon: Daemon) -> Iterator[Send]:
    def send(name: str) -> dict[str, Any]:
        if daemon.process.poll() is None:
            daemon.signal(signal.SIGTERM)
        return {}

    yield send


TRANSPORTS: dict[str, Transport] = {
    "socket": Transport(("arm", "disarm", "stop", "clear", "reference"), _at_socket),
    "zenoh": Transport(("disarm", "stop"), _on_zenoh),
    "signal": Transport((SIGTERM,), _by_signal),
}


class Answered(NamedTuple):
    """What became of a command, as its sender knows it."""

    transport: str
    name: str
    t: float  # s, run time at which it was sent
    outcome: str  # done, refused or unanswered
    mode: str  # that the answer told


class Live(NamedTuple):
    """A run's races, and every command with its answer."""

    outcomes: list[judge.Outcome]
    answers: list[Answered]


def socket_of(daemon: Daemon) -> Path:
    """Its command socket."""
    return daemon.folder / "s"


def run(seed: int, races: int) -> Live:
    """Play a seed on the machine's clock and judge its races."""
    script, draw = make_script(seed, races, ORIGIN), random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="hoopd-races-") as scratch:
        folder = Path(scratch)
        commands = {"socket": str(folder / "s")}
        options: dict[str, Any] = {"config": {"commands": commands}, "fifo": fifo_granted(), "seed": seed}
        with Daemon(folder, faults=script.faults, **options) as daemon:
            answers = _played(daemon, script, draw)
            code = daemon.wait_exit(EXIT_S)
            found = daemon.result()
        replays = replay(found.recordings[0])["equal"]
    wrong = [*_wrong_in(script, found, answers), *judge.whole(found, replays)]
    if code != 0:
        wrong.append(judge.Wrong(float("nan"), f"exit code {code}"))
    return Live(judge.outcomes(seed, [window(script, race) for race in script.races], found, wrong), answers)


def _played(daemon: Daemon, script: Script, draw: random.Random) -> list[Answered]:
    """Everything that the script asks for, at its time."""
    zero, start_up_s = _begun(daemon)
    script.shift_first(round(start_up_s / PERIOD_S))
    plan: list[tuple[float, Callable[[], Answered | None]]] = []
    with ThreadPoolExecutor(SENDERS) as pool, _opened(daemon) as lines:
        for sent in [*script.sent, *(Sent(tick, SIGTERM) for tick in script.signals)]:
            name = draw.choice([name for name, row in TRANSPORTS.items() if sent.name in row.names])
            at = (sent.tick + draw.uniform(-0.5, 0.5)) * PERIOD_S
            plan.append((at, partial(_deliver, lines[name], name, sent.name, zero)))
        plan += [(tick * PERIOD_S, partial(_stand_still, daemon)) for tick in script.stalls]
        futures: list[Future[Answered | None]] = []
        for at, act in sorted(plan, key=lambda row: row[0]):
            time.sleep(max(0.0, zero + at - time.monotonic()))
            futures.append(pool.submit(act))
        answers = [future.result() for future in futures]
    return [answer for answer in answers if answer is not None]


@contextmanager
def _opened(daemon: Daemon) -> Iterator[dict[str, Send]]:
    with ExitStack() as stack:
        yield {name: stack.enter_context(row.open(daemon)) for name, row in TRANSPORTS.items()}


def _begun(daemon: Daemon) -> tuple[float, float]:
    """Monotonic time of run time zero, and s from there to the loop's first tick, by the daemon's own word."""
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        try:
            told = ask({"command": "status"}, DEVICE, str(socket_of(daemon)))["status"]
            return time.monotonic() - float(told["t"]), float(told["start_up_s"])
        except (InputError, KeyError, TypeError):
            time.sleep(0.01)
    raise RuntimeError("the daemon does not answer at its socket")


def _deliver(send: Send, transport: str, name: str, zero: float) -> Answered:
    t = time.monotonic() - zero
    try:
        answer = send(name)
    except NoDaemonError:
        return Answered(transport, name, t, "unanswered", "")
    except InputError as error:
        return Answered(transport, name, t, "refused" if "refused" in str(error) else "unanswered", "")
    return Answered(transport, name, t, "done", str(answer.get("mode", "")))


def _stand_still(daemon: Daemon) -> None:
    daemon.signal(signal.SIGSTOP)
    time.sleep(STOP_S)
    daemon.signal(signal.SIGCONT)


def _value(name: str) -> dict[str, float]:
    return {"value": REFERENCE_RAD} if name == "reference" else {}


def _wrong_in(script: Script, found: Run, answers: list[Answered]) -> list[judge.Wrong]:
    """All that broke the rule, and every answer that says so."""
    rows, zero = judge.taken(found), float(found.summary["start_monotonic_s"])
    # Run time by the answer of a status lags by up to a tick and the way there.
    armed_t = [answer.t for answer in answers if answer.name == "arm"]
    wrong = judge.modes_wrong(found) + judge.armed_by_nobody(armed_t, rows, MARGIN_S)
    wrong += judge.torque_wrong(found, rows, deaf_in(script), zero=zero, margin_s=MARGIN_S)
    return wrong + [
        judge.Wrong(answer.t, f"{answer.name} over {answer.transport} was answered with {answer.mode}")
        for answer in answers
        if answer.mode
        and answer.mode not in {"disarm": OFF, "stop": (*OFF, "STOPPING")}.get(answer.name, (answer.mode,))
    ]


def counted(answers: list[Answered]) -> list[str]:
    """One line a transport: commands, and what became of them."""
    lines = []
    for transport in TRANSPORTS:
        outcomes = Counter(answer.outcome for answer in answers if answer.transport == transport)
        told = ", ".join(f"{outcome} {count}" for outcome, count in sorted(outcomes.items()))
        lines.append(f"{transport:<10} {outcomes.total():>6} commands: {told or '-'}")
    return lines
