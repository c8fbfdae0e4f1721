"""The checks of `hoopd check` put together for one configuration.

Rules of this file: opens what a check needs, closes it again, decides nothing; the order of the rows is the order in
which a person would look.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from pathlib import Path

import msgspec

from hoopd.core.layout import Layout
from hoopd.core.records import CameraSample
from hoopd.daemon import checks as check
from hoopd.daemon.build import model_path
from hoopd.daemon.checks import Check, CheckResult, Verdict
from hoopd.files.reading import InputError, parse_yaml, read_text
from hoopd.shell import cores, probe
from hoopd.shell.clock import TickTimer
from hoopd.shell.config import Config, find
from hoopd.shell.link import is_missing
from hoopd.shell.loop import Eye
from hoopd.shell.service import granted_realtime

# As in the unit.
FIFO_PRIORITY = 50
WATCH_S = 1.0
# The camera's program starts within two seconds; its first pictures come at an irregular rate.
FIRST_PICTURE_S = 6.0
SETTLING_PICTURES = 10
# Ten looks in a picture's period: the slot holds one picture only.
LOOK_S = 0.002
TIMER_TICKS = 50
CORE_TICKS = 25
SERVICE_RECORDINGS = Path("/var/lib/hoopd")
FORMATS = {"model": "hoopd.model/1", "controller": "hoopd.controller/1"}

Watch = Callable[[float], list[CameraSample]]
OpenCamera = Callable[[Config, TickTimer], AbstractContextManager[Eye]]


def check_device(
    config: Config, config_path: Path | None, layout: Layout, camera: OpenCamera, json_path: Path | None = None
) -> int:
    """Run every check, print the table, write the JSON file; the exit code."""

    def watch(seconds: float) -> list[CameraSample]:
        with TickTimer(config.loop.period_s) as timer, camera(config, timer) as eye:
            return collect(eye, seconds)

    rows = check.run_checks(device_checks(config, config_path, layout, watch))
    check.print_table(rows)
    if json_path is not None:
        try:
            json_path.write_bytes(msgspec.json.format(msgspec.json.encode(check.as_data(rows)), indent=2) + b"\n")
        except OSError as error:
            raise InputError(json_path, "", (error.strerror or "cannot be written").lower()) from None
    return check.exit_code(rows)


def collect(eye: Eye, seconds: float) -> list[CameraSample]:
    """Pictures of so many seconds, after the camera has settled; fewer or none when it gives none."""
    samples: list[CameraSample] = []
    settling, end = SETTLING_PICTURES, time.monotonic() + FIRST_PICTURE_S
    while time.monotonic() < end:
        sample = eye.take()
        if sample is None:
            time.sleep(LOOK_S)
        elif settling > 0:
            settling -= 1
            end = end if settling else time.monotonic() + seconds
        else:
            samples.append(sample)
    return samples


def device_checks(config: Config, config_path: Path | None, layout: Layout, watch: Watch) -> list[tuple[str, Check]]:
    """Every check of the device; `watch(seconds)` gives the analysed pictures of that time."""
    period_s = config.loop.period_s
    return [
        ("files", lambda: _files(config, config_path)),
        ("fault rows", lambda: check.fault_rows(config.faults, config.loop.period_s, 1.0 / config.camera.fps)),
        ("board", lambda: _board(config, layout)),
        ("camera", lambda: _camera(config, watch)),
        ("priority", _scheduling),
        ("memory lock", _memory_lock),
        ("clock", lambda: _clock(period_s)),
        ("cores", lambda: _cores(period_s)),
        ("wall clock", lambda: check.wall_clock(probe.clock_synchronised())),
        ("power", lambda: check.power(probe.throttled_word())),
        ("disk", lambda: _disk(config)),
        ("telemetry", lambda: _telemetry(config)),
    ]


def _files(config: Config, config_path: Path | None) -> CheckResult:
    paths = {"model": model_path(config, config_path), "controller": find(config.control.file, config_path)}
    formats = {}
    for kind, path in paths.items():
        formats[kind] = str(parse_yaml(read_text(path), path).get("schema", ""))
    return check.configuration_files(formats, FORMATS)


def _board(config: Config, layout: Layout) -> list[CheckResult]:
    port, baud = config.serial.port, config.serial.baud
    try:
        line = probe.BoardLine(port, baud, layout)
    except OSError as error:
        row = check.serial_port(port, baud, error.strerror or str(error), missing=is_missing(error))
        return [row, *(CheckResult(name, "", "no port", Verdict.SKIPPED) for name in ("board", "board time-out"))]
    with closing(line):
        rows = [check.serial_port(port, baud, ""), check.board_answers(line)]
        if rows[-1].verdict is Verdict.FAIL:
            return [*rows, CheckResult("board time-out", "", "the board does not answer", Verdict.SKIPPED)]
        return [*rows, check.board_timeout(line)]


def _camera(config: Config, watch: Watch) -> list[CheckResult]:
    try:
        samples = watch(WATCH_S)
    except InputError as error:  # here a camera that cannot be had is a finding, not unusable input
        wanted = f"{config.camera.backend}, {config.camera.fps:g} pictures a second"
        return [CheckResult("camera", wanted, str(error), Verdict.FAIL, "see the section camera")]
    return [check.camera_rate(config.camera.backend, config.camera.fps, samples), check.ball_seen(samples)]


def _scheduling() -> CheckResult:
    pid = probe.service_pid()
    if pid:
        return check.scheduling(FIFO_PRIORITY, granted_realtime(pid), "the running service")
    return check.scheduling(FIFO_PRIORITY, probe.try_realtime(FIFO_PRIORITY), "this process, on request")


def _memory_lock() -> CheckResult:
    pid = probe.service_pid()
    if pid:
        found = granted_realtime(pid)
        return check.memory_lock("", found["locked_bytes"], found["memlock_limit_bytes"])
    reason, locked_bytes = probe.try_memory_lock()
    return check.memory_lock(reason, locked_bytes, granted_realtime()["memlock_limit_bytes"])


def _clock(period_s: float) -> CheckResult:
    return check.clock(period_s, probe.clock_resolution_s(), probe.timer_lateness_s(period_s, TIMER_TICKS))


def _cores(period_s: float) -> CheckResult:
    pid, of_unit = probe.service_pid(), cores.unit_cores()
    allowed = os.sched_getaffinity(pid) if pid or not of_unit else of_unit
    whose = "the running service" if pid else "the unit" if of_unit else "this process"
    late = probe.core_lateness_s(allowed, FIFO_PRIORITY, period_s, CORE_TICKS)
    return check.cores(allowed, whose, cores.present_cores(), cores.isolated_cores(), late, period_s)


def _disk(config: Config) -> CheckResult:
    settings = config.recording
    folder = Path(settings.directory) if settings.directory else SERVICE_RECORDINGS
    if not folder.is_dir():
        if not settings.directory:
            return CheckResult("disk", str(folder), "no such folder", Verdict.SKIPPED, "made by the installer")
        return CheckResult("disk", str(folder), "no such folder", Verdict.FAIL, "see recording.directory")
    used = sum(path.stat().st_size for path in folder.glob("*.mcap"))
    free = shutil.disk_usage(folder).free
    return check.disk(str(folder), settings.quota_bytes, used, free, settings.min_free_bytes)


def _telemetry(config: Config) -> CheckResult:
    endpoint = config.telemetry.endpoint
    if not config.telemetry.enabled:
        return CheckResult("telemetry", "off", "", Verdict.SKIPPED)
    try:
        probe.claim_endpoint(endpoint)
    except OSError as error:
        return check.telemetry(endpoint, (error.strerror or str(error)).lower())
    return check.telemetry(endpoint, "")
