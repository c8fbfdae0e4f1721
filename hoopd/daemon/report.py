"""What a run tells of itself: status line, status message, and the summary at its end.

Rules of this file: reads the loop and its sinks, changes nothing; plain data first, the table is made from that.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from hoopd.core.faulttable import FAULTS, Action, Fault
from hoopd.core.installed import Estimator
from hoopd.core.modes import Mode
from hoopd.core.records import Inputs, LinkCounts, TickRecord
from hoopd.core.succession import CONTROLLER, TRIAL, Succession
from hoopd.core.tick import Note
from hoopd.daemon.sinks import RecorderSink, TelemetrySink
from hoopd.daemon.tracking_error import RELEASE_S, TrackingError, Truth
from hoopd.shell.camera import CameraCounts
from hoopd.shell.commands import Gate, Range
from hoopd.shell.loop import Loop

STATES = 4  # of the filter, those of `x_hat`; a bias that it knows, too, comes after them
WELL = LinkCounts(good=1)
ENDING = frozenset(fault.name for fault in FAULTS if fault.action >= Action.STOP)


class Watch:
    """Counts what the summary tells: modes, faults, torque and angles."""

    trouble = False

    def __init__(self, truth: Truth | None = None) -> None:
        """`truth`: of the rig, where there is one."""
        self.error = TrackingError(truth)
        self.faults: dict[str, int] = {}
        self.link: dict[str, int] = {}  # what was wrong on the line, by kind
        self.running_ticks = self._ticks = 0
        self.max_torque_nm = 0.0
        self.ended_by: list[str] = []  # faults that ended control, unless it was taken up again
        self.ended_at_s: float | None = None

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """Look at one tick."""
        self.max_torque_nm = max(self.max_torque_nm, abs(record.u))
        self._ticks += 1
        if self._ticks > 1 and (inputs.link != WELL or inputs.driver is None):  # nothing was asked before the first
            self._count_link(inputs)
        self.running_ticks += record.mode == Mode.RUNNING
        self.error.put(record)

    def _count_link(self, inputs: Inputs) -> None:
        link = inputs.link
        counts = {
            "no answer": inputs.driver is None,
            "bad CRC": link.bad_crc,
            "garbage bytes": link.garbage_bytes,
            "not asked for": link.unexpected_seq,
            "implausible": link.implausible,
            "port lost": link.lost,
        }
        for name, count in counts.items():
            if count:
                self.link[name] = self.link.get(name, 0) + count

    def note(self, t: float, note: Note) -> None:
        """Count faults by name; remember which of them ended control."""
        if note.name == "fault":
            name = note.fields["fault"]
            self.faults[name] = self.faults.get(name, 0) + 1
        elif note.name == "mode":
            self._follow(t, Mode(note.fields["mode"]), note.fields["because"])

    def _follow(self, t: float, mode: Mode, because: Iterable[str]) -> None:
        ending = [name for name in because if name in ENDING]
        if mode in (Mode.READY, Mode.RUNNING):
            self.ended_by, self.ended_at_s = [], None
        elif ending and not self.ended_by:
            self.ended_by, self.ended_at_s = ending, t


def status(loop: Loop, recorder: RecorderSink | None, ranges: Mapping[str, Range]) -> dict[str, Any]:
    """What the status message tells beside the newest tick; `ranges` are those of `tune`."""
    statistics, counts = loop.statistics, getattr(loop.eye, "counts", None)  # none without a camera
    return {
        "faults": loop.tick.faults,
        "causes": causes(loop),
        "because": loop.tick.because,
        "arming": _arming(loop),
        "reference_limit": loop.tick.settings.reference_limit_rad,
        "speed_limit": loop.tick.operator.speed_limit,
        "deviation": deviation(loop.tick.succession.acting.filter.estimator),
        "camera": asdict(counts) if isinstance(counts, CameraCounts) else None,
        "controller": controller_status(loop.tick.succession),
        "tunables": tunables(loop.tick.succession, ranges),
        "innovations": {name: level._asdict() for name, level in loop.tick.health.drift.latest().items()},
        "missed_ticks": statistics.missed,
        "lateness_p99_s": statistics.lateness.quantile(0.99),
        "execution_p99_s": statistics.execution.quantile(0.99),
        "recorder": recorder.recorder.counts._asdict() if recorder else None,
    }


def operator_status(
    loop: Loop, gate: Gate, recorder: RecorderSink | None, telemetry: TelemetrySink | None
) -> dict[str, Any]:
    """How the daemon stands, for an operator who asks."""
    record, statistics = loop.record, loop.statistics
    health = loop.tick.health
    return {
        "mode": str(loop.tick.mode),
        "t": record.t if record else None,
        "reference": loop.tick.operator.reference,
        "psi": record.x_hat[2] if record else None,
        "u": record.u if record else None,
        "faults": causes(loop),
        "arming": _arming(loop),
        "controller": controller_status(loop.tick.succession),
        "rows_off": {**health.thresholds.off_rows(), **health.too_slow_for},
        **statistics.summary(),
        "commands": {"accepted": gate.accepted, "refused": gate.refused},
        "recorder": recorder.recorder.counts._asdict() if recorder else None,
        "telemetry": telemetry.telemetry.counts._asdict() if telemetry else None,
    }


def causes(loop: Loop) -> dict[str, dict[str, str]]:
    """What each active fault means, and what makes it go."""
    health = loop.tick.health
    hindrances = health.hindrances()
    return {
        fault.name: {"meaning": fault.meaning, "clears": clearing(fault, fault.name in hindrances)}
        for fault in health.active()
    }


def _arming(loop: Loop) -> str:
    return ", ".join(loop.tick.health.arming_hindrances()) or "possible"


def deviation(estimator: Estimator) -> list[float] | None:
    """Standard deviations of the estimate by the filter's own covariance; None for a filter that tells none."""
    covariance = getattr(estimator, "covariance", None)
    if covariance is None:
        return None
    # sigma_i = sqrt(P_ii)
    return [math.sqrt(max(0.0, float(variance))) for variance in covariance.diagonal()[:STATES]]


def controller_status(succession: Succession) -> dict[str, Any]:
    """Which controller acts, for what it was loaded, since when, and which one is about to take over."""
    name, sha256, by = succession.acting.label
    return {
        "file": name,
        "sha256": sha256,
        "by": by,
        "trial": succession.purpose == TRIAL,
        "purpose": succession.purpose,
        "accepted": succession.accepted.label.name,
        "since": succession.since,
        "next": succession.waiting,
        "filter": succession.acting.filter.key,
    }


def tunables(succession: Succession, ranges: Mapping[str, Range]) -> dict[str, dict[str, float]]:
    """What `tune` changes of the acting law: value now, and from where to where it may be set."""
    try:
        now = dict(succession.tunables)
    except Exception:  # a user's own law may tell nonsense
        return {}
    return {name: {"value": now[name], "low": low, "high": high} for name, (low, high) in ranges.items() if name in now}


def clearing(fault: Fault, lasts: bool) -> str:
    """What makes a fault go."""
    if not fault.latched:
        return f"by itself, after {fault.off} good periods"
    return "first its cause, then `hoopd clear`" if lasts else "it is over: `hoopd clear` or `hoopd arm`"


def status_line(loop: Loop) -> str:
    """One line for a terminal."""
    record = loop.record
    if record is None:
        return "waiting for the first tick"
    faults, succession = ", ".join(loop.tick.faults), loop.tick.succession
    loaded = "" if succession.purpose == CONTROLLER else f"{succession.purpose} {succession.acting.label.name}  "
    return (
        f"{record.t:6.1f} s {record.mode:8} {faults + '  ' if faults else ''}{loaded}psi {record.x_hat[2]:+.3f} rad"
        f" ref {record.reference:+.2f}  hoop {record.x_hat[1]:+6.2f} rad/s  u {record.u:+.3f} N m"
        f"  late {1e3 * loop.statistics.take_worst():.1f} ms"
    )


def summarise(
    loop: Loop,
    watch: Watch,
    recorder: RecorderSink | None,
    telemetry: TelemetrySink | None,
    wall_s: float,
) -> dict[str, Any]:
    """What a run was, as plain data."""
    record = loop.record
    return {
        "exit": 0,
        "seconds": record.t if record else 0.0,
        "real_time_factor": loop.statistics.last_t / wall_s if wall_s else 0.0,
        **loop.statistics.summary(),
        "final_mode": str(loop.tick.mode),
        "running_s": watch.running_ticks * loop.tick.settings.period_s,
        "control": _control(loop, watch),
        "psi_error": watch.error.summary() if loop.tick.health.thresholds.ball_expected else None,
        "max_torque_nm": watch.max_torque_nm,
        "faults": watch.faults,
        "link": watch.link,
        "recording": recorder.recorder.counts._asdict() if recorder else None,
        "telemetry": {k: v for k, v in telemetry.telemetry.counts._asdict().items() if k != "open"}
        if telemetry
        else None,
    }


def _control(loop: Loop, watch: Watch) -> dict[str, Any]:
    """What ended control, or what was in its way when there was none."""
    hindered = [fault.name for fault in loop.tick.health.active() if fault.action >= Action.PAUSE]
    hindered += [name for name in loop.tick.health.arming_hindrances() if name not in hindered]
    return {
        "ended_by": watch.ended_by,
        "ended_at_s": watch.ended_at_s,
        "hindered_by": [] if watch.running_ticks else hindered,
    }


def print_summary(summary: dict[str, Any], *, virtual: bool = False) -> None:
    """The table at the end of a run; in virtual time with how fast it went."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="run", show_header=False, title_justify="left")
    for name, text in _summary_rows(summary, virtual):
        table.add_row(name, text)
    with contextlib.suppress(OSError):  # nobody reads it, or its disk is full: the run was good
        Console().print(table)


def _summary_rows(summary: dict[str, Any], virtual: bool) -> Iterator[tuple[str, str]]:
    late, execution = summary["lateness_s"], summary["execution_s"]
    faster = f" at {summary['real_time_factor']:.1f} x real time" if virtual else ""
    start_up = f", of it {summary['start_up_s']:.2f} s start-up" if summary["start_up_s"] else ""
    yield "duration", f"{summary['seconds']:.2f} s{start_up}{faster}"
    yield "ticks", f"{summary['ticks']} and {summary['missed']} missed, every {1e3 * summary['period_s']:g} ms"
    yield "mean period", f"{1e3 * summary['mean_period_s']:.4f} ms"
    yield "lateness p50 / p99 / max", " / ".join(f"{1e3 * late[k]:.3f}" for k in ("p50", "p99", "max")) + " ms"
    yield "execution p50 / p99 / max", " / ".join(f"{1e3 * execution[k]:.3f}" for k in ("p50", "p99", "max")) + " ms"
    yield "mode at the end", f"{summary['final_mode']}, {_controlled(summary)}"
    yield from _error_rows(summary)
    yield "largest torque", f"{summary['max_torque_nm']:.3f} N m"
    yield "faults", ", ".join(f"{name} x{count}" for name, count in summary["faults"].items()) or "none"
    yield "serial line", ", ".join(f"{name} {count}" for name, count in summary["link"].items()) or "well"
    for part in ("recording", "telemetry"):
        if summary[part]:
            yield part, ", ".join(f"{key} {value}" for key, value in summary[part].items())


def _controlled(summary: dict[str, Any]) -> str:
    control, running_s = summary["control"], summary["running_s"]
    if not running_s:
        return "never controlled" + (f": {', '.join(control['hindered_by'])}" if control["hindered_by"] else "")
    ended = (
        f", ended by {', '.join(control['ended_by'])} at {control['ended_at_s']:.2f} s" if control["ended_by"] else ""
    )
    return f"controlled for {running_s:.1f} s{ended}"


def _error_rows(summary: dict[str, Any]) -> Iterator[tuple[str, str]]:
    if summary["psi_error"] is None or summary["running_s"] == 0:
        return
    measured, true = summary["psi_error"]["measured"], summary["psi_error"]["true"]
    if measured is None:
        yield "psi error", f"- (never controlled for more than {RELEASE_S:g} s with the ball in sight)"
    else:
        about = f"{measured['samples']} pictures, their noise {measured['noise_rad']:.2g}"
        yield f"psi error, {_span(measured)}", f"{measured['rms_rad']:.4f} rad rms ({about})"
    if true is not None:
        yield "  by the rig's own state", f"{true['rms_rad']:.4f} rad rms, {_span(true)}"


def _span(judged: dict[str, Any]) -> str:
    first, last = judged["over_s"]
    return f"{first:.1f} to {last:.1f} s"
