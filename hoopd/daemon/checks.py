"""`hoopd check`: what is configured, and what is granted.

Rules of this file: each check is a small function of plain values and calls, and gives one row; a probe that fails is
a row too, never a traceback; nothing is called well that was not seen. The torque is zero throughout.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Any, NamedTuple, Protocol

from hoopd.core.frames import STATUS_ENABLED, STATUS_FAULT, STATUS_TIMEOUT
from hoopd.core.health import Thresholds
from hoopd.core.records import CameraSample, DriverSample
from hoopd.core.slow_ticks import rows_off
from hoopd.core.ticksettings import TickSettings
from hoopd.exit_codes import FAILED, PORT_MISSING
from hoopd.files.reading import InputError


class Verdict(StrEnum):
    """How a row is judged."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    SKIPPED = "skipped"


class CheckResult(NamedTuple):
    """One row; the advice is empty when all is well."""

    name: str
    configured: str
    granted: str
    verdict: Verdict
    advice: str = ""
    code: int = 1  # exit code when it fails


class Board(Protocol):
    """The driver board; every request carries zero torque."""

    def exchange(self, enable: bool, clear: bool) -> DriverSample | None:
        """One request, one tick long, and its answer."""
        ...

    def silence(self, seconds: float) -> None:
        """Say nothing."""
        ...


# Ten ticks of the loop: a line that loses one of them is no line to control with.
EXCHANGES = 10
# The board's own limit is 100 ms; half as much again leaves no doubt about whose time-out it was.
SILENCE_S = 0.15
# A camera that gives less than 95 of 100 pictures delays the loop by a frame every second or so.
FRAME_RATE_SHARE = 0.95
BALL_SHARE = 0.9
# Late by more than a tenth of a tick at the 90th percentile: something else takes the processor.
LATENESS_SHARE = 0.1
# Firmware bits of the Raspberry Pi: now, and (16 places higher) since it was switched on.
POWER_BITS = ("undervoltage", "clock capped", "throttled", "soft temperature limit")


# --- serial port and board -------------------------------------------------------------------------------------------


def serial_port(port: str, baud: int, failure: str, *, missing: bool = False) -> CheckResult:
    """The port could be opened, alone and at this rate; one that is `missing` may come yet."""
    wanted = f"{port} at {baud} baud"
    if not failure:
        return CheckResult("serial port", wanted, "opened", Verdict.OK)
    busy = "busy" in failure.lower() or "lock" in failure.lower() or "temporarily unavailable" in failure.lower()
    advice = (
        "stop the daemon first: systemctl stop hoopd" if busy else "see serial.port; user in group dialout? reboot?"
    )
    return CheckResult("serial port", wanted, failure, Verdict.FAIL, advice, PORT_MISSING if missing else FAILED)


def board_answers(board: Board) -> CheckResult:
    """The board answers every request."""
    answers = [answer for answer in (board.exchange(False, False) for _ in range(EXCHANGES)) if answer is not None]
    granted = f"{len(answers)} answers"
    if not answers:
        advice = "board powered? TX and RX crossed? baud and serial.layout as in its firmware?"
        return CheckResult("board", f"{EXCHANGES} requests", granted, Verdict.FAIL, advice)
    last = answers[-1]
    granted += f", theta {last.theta:+.3f} rad, errors {last.errors:#04x}"
    if len(answers) < EXCHANGES:
        return CheckResult("board", f"{EXCHANGES} requests", granted, Verdict.WARN, "cable, ground, noise")
    return CheckResult("board", f"{EXCHANGES} requests", granted, Verdict.OK)


def board_timeout(board: Board) -> CheckResult:
    """The board switches itself off when nobody speaks, stays off, and can be cleared: proven by going silent."""
    wanted = f"drive off, latched, after {1e3 * SILENCE_S:.0f} ms of silence"
    try:
        _go_silent(board)
    except _UnprovenError as reason:
        advice = "do not arm: without this nothing stops the motor when the daemon dies"
        return CheckResult("board time-out", wanted, str(reason), Verdict.FAIL, advice)
    finally:
        board.exchange(False, True)
    return CheckResult("board time-out", wanted, "switched off, latched, cleared", Verdict.OK)


class _UnprovenError(Exception):
    """Why the time-out is not proven."""


def _demand(condition: bool, reason: str) -> None:
    if not condition:
        raise _UnprovenError(reason)


def _ask(board: Board, when: str, *, enable: bool, clear: bool, times: int = 3) -> DriverSample:
    """The last of a few answers: a request takes effect in the answer after it at the latest."""
    answer = [board.exchange(enable, clear) for _ in range(times)][-1]
    if answer is None:
        raise _UnprovenError(f"no answer {when}")
    return answer


def _go_silent(board: Board) -> None:
    cleared = _ask(board, "before the silence", enable=False, clear=True)
    _demand(not cleared.status & STATUS_FAULT, f"the board reports a fault (errors {cleared.errors:#04x})")
    _demand(not cleared.status & STATUS_TIMEOUT, "the time-out of before cannot be cleared")
    before = _ask(board, "before the silence", enable=True, clear=False)
    _demand(bool(before.status & STATUS_ENABLED), "the drive cannot be enabled (at zero torque)")
    board.silence(SILENCE_S)
    # The first answer after the silence, and the next: latched means that a new request does not undo it.
    for _ in range(2):
        after = _ask(board, "after the silence", enable=True, clear=False, times=1)
        off = bool(after.status & STATUS_TIMEOUT) and not after.status & STATUS_ENABLED
        _demand(off, f"not switched off and latched after {1e3 * SILENCE_S:.0f} ms of silence")
    end = _ask(board, "after the silence", enable=False, clear=True)
    _demand(not end.status & STATUS_TIMEOUT, "switched off and latched, but cannot be cleared")


# --- camera ----------------------------------------------------------------------------------------------------------


def camera_rate(backend: str, fps: float, samples: Sequence[CameraSample]) -> CheckResult:
    """Pictures come at the configured rate; their age is told."""
    wanted = f"{backend}, {fps:g} pictures a second"
    if len(samples) < 2:
        advice = "cable in the right way? rpicam-hello --list-cameras; user in group video?"
        return CheckResult("camera", wanted, f"{len(samples)} pictures", Verdict.FAIL, advice)
    span = samples[-1].t - samples[0].t
    rate = (len(samples) - 1) / span if span > 0 else math.inf
    age = statistics.median(sample.t_arrival - sample.t for sample in samples)
    granted = f"{rate:.1f} pictures a second, {1e3 * age:.0f} ms old"
    good = FRAME_RATE_SHARE * fps <= rate <= fps / FRAME_RATE_SHARE
    advice = "" if good else "exposure shorter than the picture's period? another mode of the sensor?"
    return CheckResult("camera", wanted, granted, Verdict.OK if good else Verdict.WARN, advice)


def ball_seen(samples: Sequence[CameraSample]) -> CheckResult:
    """The ball is found in the pictures."""
    if not samples:
        return CheckResult("ball", "found in the picture", "no pictures", Verdict.SKIPPED)
    found = [sample for sample in samples if math.isfinite(sample.psi)]
    granted = f"in {100 * len(found) / len(samples):.0f} % of {len(samples)} pictures"
    if found:
        granted += f", psi {statistics.median(sample.psi for sample in found):+.3f} rad"
    good = len(found) >= BALL_SHARE * len(samples)
    advice = "" if good else "ball in the hoop? lamp on? then hoopd calibrate"
    return CheckResult("ball", "found in the picture", granted, Verdict.OK if good else Verdict.WARN, advice)


# --- what the kernel grants ------------------------------------------------------------------------------------------


def scheduling(priority: int, granted: dict[str, Any], whose: str) -> CheckResult:
    """The loop runs before all ordinary work."""
    wanted = f"fifo {priority}"
    text = f"{granted['policy']} {granted['priority']} ({whose})"
    if granted["policy"] == "fifo" and granted["priority"] >= priority:
        return CheckResult("priority", wanted, text, Verdict.OK)
    limit = granted["rtprio_limit"]
    text += f", limit {'none' if limit is None else limit}"
    return CheckResult(
        "priority", wanted, text, Verdict.WARN, "the service's unit grants it; on a terminal: run as root"
    )


def memory_lock(reason: str, locked_bytes: int, limit_bytes: int | None) -> CheckResult:
    """The daemon's memory stays in memory."""
    limit = "unlimited" if limit_bytes is None else f"{limit_bytes / 2**20:.0f} MiB"
    if not reason and locked_bytes > 0:
        text = f"{locked_bytes / 2**20:.0f} MiB of mappings locked"
        return CheckResult("memory lock", "all memory", text, Verdict.OK)
    text = f"{reason or 'nothing is locked'}, limit {limit}"
    return CheckResult("memory lock", "all memory", text, Verdict.WARN, "the service's unit grants it (LimitMEMLOCK)")


def clock(period_s: float, resolution_s: float, lateness_s: Sequence[float]) -> CheckResult:
    """The clock is fine enough and the timer wakes the loop in time."""
    late = sorted(lateness_s)
    p90 = late[int(0.9 * (len(late) - 1))]
    granted = f"resolution {1e9 * resolution_s:.0f} ns, timer late by {1e3 * p90:.2f} ms (p90 of {len(late)})"
    wanted = f"ticks of {1e3 * period_s:g} ms"
    if resolution_s > 1e-6:
        return CheckResult("clock", wanted, granted, Verdict.FAIL, "CLOCK_MONOTONIC is too coarse: another kernel")
    good = p90 <= LATENESS_SHARE * period_s
    return CheckResult(
        "clock", wanted, granted, Verdict.OK if good else Verdict.WARN, "" if good else "what else runs?"
    )


def cores(
    allowed: set[int],
    whose: str,
    present: set[int],
    isolated: set[int],
    lateness_s: dict[int, list[float]],
    period_s: float,
) -> CheckResult:
    """Where the loop may run by `whose` word, who else may, and how late a timer wakes it there."""
    worst = {core: max(late) for core, late in lateness_s.items() if late}
    late = ", ".join(f"{core} by {1e3 * seconds:.2f} ms" for core, seconds in worst.items())
    granted = f"may run on {_listed(allowed)} ({whose}); isolated: {_listed(isolated)}; timer late at worst on core "
    granted += late or "-"
    wanted = "a core of its own, or all of them"
    verdict, advice = Verdict.WARN, ""
    if isolated and not allowed <= isolated:
        advice = "cores are isolated, but the loop may run elsewhere: CPUAffinity= in the unit (docs/guides/pi.md)"
    elif not isolated and allowed != present:
        advice = "held to a core that is everybody's: isolcpus= as well, or no CPUAffinity= (docs/guides/pi.md)"
    elif max(worst.values(), default=0.0) > LATENESS_SHARE * period_s:
        advice = "what else runs there at real-time priority, or does the machine itself stand still?"
    else:
        verdict = Verdict.OK
    return CheckResult("cores", wanted, granted, verdict, advice)


def _listed(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers))) or "none"


def wall_clock(synchronised: bool | None) -> CheckResult:
    """Only dates of files and logs depend on the wall clock; control does not."""
    if synchronised is None:
        return CheckResult("wall clock", "synchronised", "the kernel does not say", Verdict.SKIPPED)
    if synchronised:
        return CheckResult("wall clock", "synchronised", "synchronised", Verdict.OK)
    advice = "dates of recordings may be wrong; control does not use them"
    return CheckResult("wall clock", "synchronised", "not synchronised", Verdict.WARN, advice)


def power(word: int | None) -> CheckResult:
    """Enough voltage, no throttling, now and since power-on."""
    if word is None:
        return CheckResult("power", "no undervoltage, no throttling", "not a Raspberry Pi", Verdict.SKIPPED)
    now = [name for bit, name in enumerate(POWER_BITS) if word >> bit & 1]
    past = [name for bit, name in enumerate(POWER_BITS) if word >> (bit + 16) & 1]
    if not now and not past:
        return CheckResult("power", "no undervoltage, no throttling", "none since power-on", Verdict.OK)
    text = f"now: {', '.join(now) or 'none'}; since power-on: {', '.join(past) or 'none'} ({word:#x})"
    volts = any("voltage" in name for name in now + past)
    advice = "a stronger power supply or a shorter cable; motor on a supply of its own" if volts else "cooling"
    return CheckResult("power", "no undervoltage, no throttling", text, Verdict.FAIL if now else Verdict.WARN, advice)


# --- faults -----------------------------------------------------------------------------------------------------------


def fault_rows(faults: Thresholds, period_s: float = TickSettings.period_s, picture_s: float = math.nan) -> CheckResult:
    """No row of the fault table is off without having been accepted, or at a tick or pictures of these periods."""
    off, missing = {**faults.off_rows(), **rows_off(period_s, picture_s)}, faults.not_accepted()
    granted = "; ".join(f"{name} is off: {why}" for name, why in off.items()) or "all rows work"
    wanted = f"accepted_off: {', '.join(faults.accepted_off) or 'none'}"
    if missing:
        advice = f"arming is refused until faults.accepted_off has {', '.join(missing)}, or what it needs is set"
        return CheckResult("fault rows", wanted, granted, Verdict.FAIL, advice)
    return CheckResult("fault rows", wanted, granted, Verdict.WARN if off else Verdict.OK)


# --- files and network -----------------------------------------------------------------------------------------------


def disk(folder: str, quota_bytes: int, used_bytes: int, free_bytes: int, min_free_bytes: int) -> CheckResult:
    """The recordings' quota fits on the disk."""
    wanted = f"{folder}: up to {_size(quota_bytes)}, {_size(min_free_bytes)} left free"
    granted = f"{_size(used_bytes)} recorded, {_size(free_bytes)} free"
    if free_bytes < min_free_bytes:
        return CheckResult("disk", wanted, granted, Verdict.FAIL, "make room: recording will not start")
    missing = quota_bytes - used_bytes - (free_bytes - min_free_bytes)
    advice = f"{_size(missing)} short of the quota: old runs go earlier" if missing > 0 else ""
    return CheckResult("disk", wanted, granted, Verdict.WARN if missing > 0 else Verdict.OK, advice)


def telemetry(endpoint: str, failure: str) -> CheckResult:
    """The endpoint can be had."""
    if not failure:
        return CheckResult("telemetry", endpoint, "free", Verdict.OK)
    return CheckResult(
        "telemetry", endpoint, failure, Verdict.WARN, "a daemon runs already? control goes on without it"
    )


def configuration_files(versions: dict[str, str], expected: dict[str, str]) -> CheckResult:
    """Every file has the schema that this version reads: name -> schema."""
    wrong = [
        f"{name}: {versions.get(name) or 'no schema'}" for name in expected if versions.get(name) != expected[name]
    ]
    wanted = ", ".join(f"{name} {kind}" for name, kind in expected.items())
    if wrong:
        return CheckResult(
            "files", wanted, "; ".join(wrong), Verdict.FAIL, "made by another version: convert or replace"
        )
    return CheckResult("files", wanted, "as configured", Verdict.OK)


def _size(count: float) -> str:
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"


# --- together --------------------------------------------------------------------------------------------------------

Check = Callable[[], CheckResult | Sequence[CheckResult]]


def run_checks(checks: Sequence[tuple[str, Check]]) -> list[CheckResult]:
    """Every check in order; one that breaks is a failed row with its reason, unusable input is InputError."""
    rows: list[CheckResult] = []
    for name, check in checks:
        try:
            found = check()
        except InputError:
            raise
        except Exception as error:
            rows.append(CheckResult(name, "", f"{type(error).__name__}: {error}", Verdict.FAIL, "cannot be checked"))
            continue
        rows.extend([found] if isinstance(found, CheckResult) else found)
    return rows


def exit_code(rows: Sequence[CheckResult]) -> int:
    """0 when nothing failed, 3 when the port is missing (which fails what hangs on it, too), else 1."""
    return max((row.code for row in rows if row.verdict is Verdict.FAIL), default=0)


def as_data(rows: Sequence[CheckResult]) -> dict[str, Any]:
    """Plain data for --json."""
    return {"exit": exit_code(rows), "checks": [{**row._asdict(), "verdict": str(row.verdict)} for row in rows]}


_STYLE = {Verdict.OK: "green", Verdict.WARN: "yellow", Verdict.FAIL: "bold red", Verdict.SKIPPED: "dim"}


def print_table(rows: Sequence[CheckResult]) -> None:
    """The table for a person, and one line of verdict."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title="hoopd check", title_justify="left")
    for heading in ("", "configured", "granted", "verdict", "advice"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        verdict = Text(str(row.verdict), style=_STYLE[row.verdict])
        # Text, not markup: a reason may hold square brackets.
        table.add_row(Text(row.name), Text(row.configured), Text(row.granted), verdict, Text(row.advice))
    counts = ", ".join(f"{sum(row.verdict is v for row in rows)} {v}" for v in Verdict)
    console = Console()
    console.print(table)
    console.print(counts, highlight=False)
