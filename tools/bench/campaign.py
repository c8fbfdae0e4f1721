"""The fault campaign: the daemon in real time on the full rig, one fault a run, judged by the board's log of torque.

    python tools/bench/campaign.py [--direct] [--fifo] [--only KIND ...] [--keep FOLDER] [--json FILE]

Every run lasts some seven seconds. A failed one is repeated, at most three times, when an independent witness saw the
machine stand still for more than 50 ms (or starve a core), or when it did not control yet as the fault came. Exit code
1 when one fails.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from system.realrun import Daemon, gaps_in, zero_of  # noqa: E402
from system.runs import TORQUE_LIMIT_NM, Run  # noqa: E402
from system.test_realtime import FLOOD, SUBSCRIBER, neighbour  # noqa: E402
from system.witness import Witness  # noqa: E402

from hoopd.replay import replay  # noqa: E402

MARGIN_S = 0.1  # zero torque this long after the deadline that the rule sets
AT_S = 4.0  # run time at which a scripted fault begins
OBSERVE_S = 3.0  # from then on, a little more for scripted ones
BOARD_TIMEOUT_S = 0.1
STOPPING_S = 1.0  # a controlled stop may take this long
CAMERA_S = 0.06  # a picture is two to three periods old when it is judged
ATTEMPTS = 4
LONGEST_PAUSE_S = 0.06  # without torque while control goes on: a lost request or two

Outcome = Literal["goes on", "pause", "stop", "cut"]


class Way(NamedTuple):
    """How the daemon is run."""

    direct: bool
    fifo: bool


@dataclass
class Kind:
    """One fault: how it is made, what the rule says, which message must name it."""

    outcome: Outcome
    deadline_s: float  # from the fault to the rule's action, a controlled stop included
    causes: tuple[str, ...]  # any of these in the log, in the summary of the line, or none needed
    script: dict[str, Any] | None = None
    act: Callable[[Daemon], float] | None = None  # does it, tells when; the script's AT_S otherwise
    exit_code: int = 0


def scripted(kind: str, for_s: float = 1.0, **params: Any) -> dict[str, Any]:
    return {"kind": kind, "at_s": AT_S, "for_s": for_s, "params": params}


def stop_and_continue(daemon: Daemon) -> float:
    at = daemon.signal(signal.SIGSTOP)
    time.sleep(0.5)
    daemon.signal(signal.SIGCONT)
    return at


def terminate(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGTERM)


def kill(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGKILL)


def fill_disk(daemon: Daemon) -> float:
    """No file of the daemon may grow: its writes fail as on a full disk."""
    size = max(path.stat().st_size for path in daemon.record.iterdir())
    resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return time.monotonic()


def flood(daemon: Daemon) -> float:
    with neighbour(FLOOD, daemon.endpoint, "2"):
        at = time.monotonic()
        time.sleep(2.0)
    return at


def freeze_subscriber(daemon: Daemon) -> float:
    with neighbour(SUBSCRIBER, daemon.endpoint) as subscriber:
        assert subscriber.stdout is not None
        subscriber.stdout.readline()
        subscriber.send_signal(signal.SIGSTOP)
        at = time.monotonic()
        time.sleep(2.0)
    return at


def kill_camera(daemon: Daemon) -> float:
    for camera in daemon.family("hoopd.sim.camera"):
        camera.kill()
    return time.monotonic()


NOTHING_TO_SAY = ("",)
LINE = ("bad CRC", "garbage bytes", "no answer", "not asked for")

KINDS: dict[str, Kind] = {
    "bit flips": Kind("goes on", 0.0, LINE, scripted("bit_flips", every=6)),
    "lost frames": Kind("goes on", 0.0, LINE, scripted("lost_frames", rate=0.0, every=5)),
    "late frames": Kind("cut", 0.08, ("link_lost",), scripted("late_frames", delay_s=0.03)),
    "duplicated frames": Kind("goes on", 0.0, LINE, scripted("duplicated_frames")),
    "garbage": Kind("goes on", 0.0, LINE, scripted("garbage", rate=0.0, every=3)),
    "board silent": Kind("cut", 0.08, ("link_lost",), scripted("board_silent")),
    "board reset": Kind("cut", 0.04, ("board_reset",), scripted("board_reset")),
    "board fault": Kind("cut", 0.04, ("board_fault",), scripted("board_fault")),
    "drive blocked": Kind("cut", 0.04, ("board_reset",), scripted("drive_blocked")),
    "current implausible": Kind("cut", 0.24, ("current_implausible",), scripted("implausible_current", value=3.0)),
    "speed implausible": Kind("cut", 0.24, ("speed_implausible",), scripted("implausible_speed", value=30.0)),
    "camera stall": Kind("stop", CAMERA_S + 0.1 + STOPPING_S, ("camera_lost",), scripted("camera_stall")),
    "camera program dies": Kind("stop", CAMERA_S + 0.1 + STOPPING_S, ("camera_lost",), act=kill_camera),
    "late pictures": Kind("goes on", 0.0, ("camera_late",), scripted("late_pictures", delay_s=0.06)),
    "black pictures": Kind("pause", CAMERA_S + 0.22, ("ball_lost",), scripted("black_pictures")),
    "ball gone": Kind("pause", CAMERA_S + 0.22, ("ball_lost",), scripted("ball_gone")),
    "ball held": Kind(
        "stop", CAMERA_S + 1.0 + STOPPING_S, ("ball_implausible",), scripted("ball_held", 2.0, psi_rad=-0.4)
    ),
    "false red object": Kind("goes on", 0.0, NOTHING_TO_SAY, scripted("false_red_object")),
    "disk full": Kind("goes on", 0.0, ("recorder_trouble",), act=fill_disk),
    "command flood": Kind("goes on", 0.0, NOTHING_TO_SAY, act=flood),
    "frozen subscriber": Kind("goes on", 0.0, NOTHING_TO_SAY, act=freeze_subscriber),
    "SIGSTOP, SIGCONT": Kind("cut", BOARD_TIMEOUT_S, ("board_timeout", "overrun_persistent"), act=stop_and_continue),
    "SIGTERM": Kind("stop", 0.02 + STOPPING_S, ("stop",), act=terminate),
    "SIGKILL": Kind("cut", BOARD_TIMEOUT_S, NOTHING_TO_SAY, act=kill, exit_code=-signal.SIGKILL),
}
PICTURES_ONLY = ("false red object", "camera program dies")  # without pictures there is nothing to see or to kill


@dataclass
class Verdict:
    """One row of the table."""

    kind: str
    outcome: str
    deadline_s: float
    zero_s: float = math.nan  # measured; NaN where control went on
    max_torque_nm: float = math.nan
    controlled: bool = True  # when the fault came
    opens: bool = False
    message: str = ""
    wrong: list[str] = field(default_factory=list)
    attempts: int = 1

    def demand(self, fine: bool, what: str) -> None:
        """Note what is wrong."""
        if not fine:
            self.wrong.append(what)


def run_one(folder: Path, kind: Kind, way: Way) -> tuple[Run, float, int]:
    """The run, the monotonic time of the fault, the exit code."""
    faults = [kind.script] if kind.script else []
    commands = [{"at_s": AT_S - 1.2, "name": "reference", "value": 0.1}]  # keeps the motor busy
    with Daemon(folder, **way._asdict(), faults=faults, commands=commands) as daemon:
        daemon.wait_for(event="mode", mode="RUNNING")
        daemon.wait_for(event="reference")
        time.sleep(0.6)
        at = kind.act(daemon) if kind.act else math.nan
        begun = time.monotonic()
        while time.monotonic() < begun + OBSERVE_S and daemon.process.poll() is None:
            time.sleep(0.05)
        code = daemon.stop() if daemon.process.poll() is None else daemon.wait_exit()
        found = daemon.result()
    return found, (zero_of(found) + AT_S if math.isnan(at) else at), code


def judge(name: str, kind: Kind, folder: Path, way: Way, witness: Witness) -> Verdict:
    """Run and judge one kind."""
    verdict = Verdict(name, kind.outcome, kind.deadline_s)
    found, at, code = run_one(folder, kind, way)
    verdict.max_torque_nm = found.torque.max_abs()
    verdict.demand(verdict.max_torque_nm <= TORQUE_LIMIT_NM, f"torque {verdict.max_torque_nm:.3f} N m")
    verdict.controlled = found.torque.max_abs(at - 0.1, at) > 0.0
    verdict.demand(verdict.controlled, "no torque before the fault")
    verdict.demand(found.torque.rows[-1].torque_nm == 0.0, "torque at the end")
    verdict.demand(code == kind.exit_code, f"exit code {code}")
    if kind.outcome == "goes on":
        _went_on(verdict, found, at, witness)
    else:
        _went_off(verdict, kind, found, at)
    _opens(verdict, found)
    verdict.message = message(kind, found, at - zero_of(found) - MARGIN_S)
    verdict.demand(bool(verdict.message), f"no message names {' or '.join(kind.causes)}")
    return verdict


def _went_on(verdict: Verdict, found: Run, at: float, witness: Witness) -> None:
    stop = at + 1.5
    rows = [row for row in found.torque.rows if at <= row.t <= stop]
    pauses = [b.t - a.t for a, b in pairwise(rows) if a.torque_nm == 0.0]
    verdict.demand(max(pauses, default=0.0) <= LONGEST_PAUSE_S, f"no torque for {max(pauses, default=0.0):.3f} s")
    verdict.demand(found.torque.torque_at(stop) != 0.0, "control did not go on")
    zero = zero_of(found)
    missed = [(t, n) for t, n in gaps_in(found, at - zero, stop - zero) if not witness.gaps(zero + t - 0.2, zero + t)]
    verdict.demand(not missed, f"missed ticks {missed}")


def _went_off(verdict: Verdict, kind: Kind, found: Run, at: float) -> None:
    until = at + kind.deadline_s + MARGIN_S
    # A pause ends with the ball; the others only with the operator, who never comes here.
    stop = AT_S + 1.0 + zero_of(found) if kind.outcome == "pause" else math.inf
    spans = [row for row in found.torque.rows if row.torque_nm != 0.0 and row.t < stop]
    after = [row.t for row in found.torque.rows if row.t > spans[-1].t] if spans else []
    verdict.zero_s = max(after[0] - at, 0.0) if after else math.inf
    verdict.demand(verdict.zero_s <= until - at, f"torque until {verdict.zero_s:.3f} s")
    if kind.outcome == "pause":
        verdict.demand(found.torque.max_abs(stop + 0.5, stop + 1.0) > 0.0, "control did not come back with the ball")


def _opens(verdict: Verdict, found: Run) -> None:
    results = [replay(path) for path in found.recordings[:1]]
    verdict.opens = bool(results) and all(result["equal"] for result in results)
    verdict.demand(verdict.opens, "; ".join(r["first_difference"] for r in results) or "no recording")


def message(kind: Kind, found: Run, since: float) -> str:
    """The words that name the cause, from this run time on."""
    if kind.causes == NOTHING_TO_SAY:
        return "-"
    for cause in kind.causes:
        for line in found.log:
            if cause in (line.get("fault"), line["event"], line.get("command")) and line["t"] >= since:
                return f"{line['t']:.2f} s {line['event']}: {line.get('meaning') or line.get('reason') or cause}"
        for row in found.events:  # the recording tells more than the log
            if row.event == "fault" and row.fields["fault"] == cause and row.t >= since:
                return f"{row.t:.2f} s {row.event}: {row.fields['meaning']}"
    link = found.summary.get("link", {})
    return ", ".join(f"{name} {link[name]}" for name in kind.causes if name in link)


def campaign(names: list[str], folder: Path, way: Way) -> list[Verdict]:
    """All kinds, one after the other."""
    verdicts = []
    for index, name in enumerate(names):
        sys.stderr.write(f"\r\x1b[2K{index + 1}/{len(names)} {name}")
        sys.stderr.flush()
        verdicts.append(repeated(name, folder / name.replace(" ", "-").replace(",", ""), way))
    sys.stderr.write("\r\x1b[2K")
    return verdicts


def repeated(name: str, folder: Path, way: Way) -> Verdict:
    """One kind, again when the machine stood still."""
    for attempt in range(1, ATTEMPTS + 1):
        mine = folder / str(attempt)
        mine.mkdir(parents=True)
        with Witness(mine / "gaps.txt") as witness:
            try:
                verdict = judge(name, KINDS[name], mine, way, witness)
            except (AssertionError, OSError, IndexError) as error:
                verdict = Verdict(name, KINDS[name].outcome, KINDS[name].deadline_s, wrong=[str(error)[:200]])
            verdict.attempts = attempt
            if not verdict.wrong or (verdict.controlled and not witness.gaps()):
                break
    return verdict


def show(verdicts: list[Verdict], took_s: float, way: Way) -> None:
    """The table."""
    print(f"{'kind':<20} {'rule':<8} {'deadline':>8} {'zero at':>9} {'max N m':>8} {'replay':>7}  verdict, message")
    for v in verdicts:
        deadline = "-" if v.outcome == "goes on" else f"{v.deadline_s:.2f} s"
        zero = "went on" if v.outcome == "goes on" else f"{v.zero_s:.3f} s"
        verdict = "FAILED: " + "; ".join(v.wrong) if v.wrong else "ok"
        again = f" (attempt {v.attempts})" if v.attempts > 1 else ""
        equal = "equal" if v.opens else "NO"
        print(
            f"{v.kind:<20} {v.outcome:<8} {deadline:>8} {zero:>9} {v.max_torque_nm:>8.3f} {equal:>7}"
            f"  {verdict}{again}; {v.message}"
        )
    failed = sum(bool(v.wrong) for v in verdicts)
    camera = "angles without pictures" if way.direct else "rendered pictures"
    priority = "FIFO" if way.fifo else "no priority"
    print(f"{len(verdicts)} kinds, {failed} failed, {took_s:.0f} s, {camera}, {priority}")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--direct", action="store_true", help="ball angles without pictures")
    parser.add_argument("--fifo", action="store_true", help="with real-time priority, as the unit grants it")
    parser.add_argument("--only", nargs="*", choices=sorted(KINDS), metavar="KIND", help="some of the kinds")
    parser.add_argument("--keep", type=Path, help="existing folder for what the runs leave behind")
    parser.add_argument("--json", type=Path, help="write the table to this file")
    options = parser.parse_args()
    names = options.only or [name for name in KINDS if not (options.direct and name in PICTURES_ONLY)]
    way, begun = Way(options.direct, options.fifo), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hoopd-campaign-") as scratch:
        verdicts = campaign(names, options.keep or Path(scratch), way)
    show(verdicts, time.monotonic() - begun, way)
    if options.json:
        options.json.write_text(json.dumps([vars(verdict) for verdict in verdicts], indent=2))
    return int(any(verdict.wrong for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
