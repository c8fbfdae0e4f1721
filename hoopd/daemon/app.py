"""The composition root: puts a tick, a world and those who want its records together, and runs them.

Rules of this file: decides nothing about control; whatever happens, the loop's last frame has zero torque and
everything that was opened is closed, each within a bound.
"""

from __future__ import annotations

import asyncio
import secrets
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

from hoopd.core.records import Command
from hoopd.core.succession import LOADED
from hoopd.core.tick import Note, Tick
from hoopd.daemon.build import Prepared, Texts, build_tick, mismatch, read_texts, unused_effects
from hoopd.daemon.loading import ControllerLoader
from hoopd.daemon.report import Watch, operator_status, print_summary, status, status_line, summarise
from hoopd.daemon.sinks import CommandSink, RecorderSink, TelemetrySink
from hoopd.daemon.world import Say, World, camera_eye, device, lockstep, read_layout, realtime_rig, rig_devices
from hoopd.files.installed_versions import installed_versions
from hoopd.files.reading import InputError
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import Header
from hoopd.shell import config as configuration, descriptors, log, signals
from hoopd.shell.camera import CameraThread
from hoopd.shell.clock import wall_zero_ns
from hoopd.shell.commands import NO_CONTROL, Gate, Ranges
from hoopd.shell.commandserver import CommandServer
from hoopd.shell.config import Config
from hoopd.shell.loop import Eye, Loop, Sink
from hoopd.shell.recorder import Recorder
from hoopd.shell.run_files import Limits as RoomLimits
from hoopd.shell.service import Notifier, freeze_garbage, is_under_systemd, lock_memory
from hoopd.shell.socketfile import listening_socket

# The interpreter hands over between threads this often; the default of 5 ms is a quarter of a tick.
SWITCH_INTERVAL_S = 0.0005
# What may be changed while running, and how far; a law knows only some of them.
TUNABLE = {
    "k_dtheta": (0.0, 0.1),
    "k_psi": (0.0, 2.0),
    "k_dpsi": (0.0, 0.5),
    "hoop_speed_limit": (0.0, 40.0),
    "feedforward": (-5.0, 5.0),
    "gain": (0.0, 3.0),
}
# A name for the run beside every message, so that two daemons are not taken for one.
SESSION_BYTES = 8
# Without a board the service still comes up, disarmed, and says what is missing.
READY_PATIENCE_S = 5.0


class Options(NamedTuple):
    """The command line of the daemon."""

    sim: bool = False
    config: Path | None = None
    sets: tuple[str, ...] = ()
    duration_s: float | None = None
    record: Path | None = None
    seed: int = 0
    speed: Literal["1", "max"] = "1"
    direct: bool = False
    arm: bool = False


class Guest(Sink, Protocol):
    """Who takes part in a run beside the loop: sees every tick as a sink does, and may ask for the end."""

    def attend(self, loop: Loop) -> AbstractContextManager[None]:
        """Be there while the loop runs."""
        ...

    def status(self) -> str:
        """One line for a terminal."""
        ...

    @property
    def loads(self) -> Sequence[str]:
        """Keys of the files that its commands name."""
        ...

    def commands(self, t: float) -> tuple[Command, ...]:
        """What it asks of the next tick; the text of a file is filled in for it."""
        ...


def run_daemon(options: Options) -> dict[str, Any]:
    """Run until the end; the summary, with `exit` as the exit code."""
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    check_options(options, config)
    summary = perform(options, config, read_texts(config, options.config))
    print_summary(summary, virtual=options.speed == "max")
    return summary


def perform(options: Options, config: Config, texts: Texts, guest: Guest | None = None) -> dict[str, Any]:
    """One run with these texts, whoever wrote them; its summary."""
    log.configure(config.log.format, config.log.level)
    prepared: Prepared = {}
    tick = build_tick(config, texts, prepared)
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    descriptors.raise_limit()
    notifier = Notifier()
    with ExitStack() as stack:
        stack.enter_context(signals.unwinding())
        stack.callback(notifier.close)
        reporter = log.Reporter(notifier.status)
        if reason := mismatch(config, texts):
            reporter.note(0.0, Note("controller_mismatch", "warning", {"reason": reason}))
        for name, reason in unused_effects(config, texts):
            reporter.note(0.0, Note("effect_unused", "warning", {"effect": name, "reason": reason}))
        world = stack.enter_context(_world(options, config, _say(reporter)))
        summary = asyncio.run(_run(options, config, texts, tick, prepared, world, notifier, reporter, guest))
        signals.ignore()
    summary["start_monotonic_s"] = getattr(world.timer, "start_ns", 0) / 1e9
    return summary


def check_options(options: Options, config: Config) -> None:
    """InputError for what cannot be run, before anything is opened."""
    for flag, given in (("--speed max", options.speed == "max"), ("--camera direct", options.direct)):
        if given and not options.sim:
            raise InputError(flag, "", "only with --sim")
    if config.telemetry.commands and not config.telemetry.control.endpoint:
        raise InputError("configuration", "telemetry.commands", NO_CONTROL)
    if options.arm and is_under_systemd():
        raise InputError("--arm", "", "refused under systemd: the daemon starts disarmed; use `hoopd arm`")
    if options.arm and not sys.stdin.isatty():
        raise InputError("--arm", "", "only on a terminal; use `hoopd arm`")
    if options.speed == "max" and options.duration_s is None:
        raise InputError("--speed max", "", "needs --duration")
    folders = (
        ("--record", options.record),
        ("sim.directory", Path(config.sim.directory) if config.sim.directory else None),
    )
    for name, folder in folders:
        if folder is not None and not folder.is_dir():
            raise InputError(folder, name, "no such folder")


def check_device(path: Path | None, sets: list[str], *, sim: bool, json_path: Path | None) -> int:
    """`hoopd check` for the device, or for the rig that takes its place; the exit code."""
    from hoopd.daemon.device_checks import check_device as run

    config = configuration.load(path, sim=sim, overrides=sets)
    layout = read_layout(config, path)
    if not sim:
        return run(config, path, layout, camera_eye, json_path)
    plant = _plant(config, path)
    with signals.unwinding(), rig_devices(config, layout, plant, 0, time.monotonic()) as (rigged, _):
        return run(rigged, path, layout, camera_eye, json_path)


def _plant(config: Config, path: Path | None) -> dict[str, Any]:
    from hoopd.sim.parts import plant_arguments

    return plant_arguments(config, load_model(configuration.find(config.sim.model, path)))


@contextmanager
def _world(options: Options, config: Config, say: Say) -> Iterator[World]:
    layout = read_layout(config, options.config)
    if not options.sim:
        with device(config, layout, say) as world:
            yield world
        return
    plant = _plant(config, options.config)
    make = lockstep if options.speed == "max" else partial(realtime_rig, say=say)
    with make(config, layout, plant, options.seed, direct=options.direct) as world:
        yield world


async def _run(
    options: Options,
    config: Config,
    texts: Texts,
    tick: Tick,
    prepared: Prepared,
    world: World,
    notifier: Notifier,
    reporter: log.Reporter,
    guest: Guest | None,
) -> dict[str, Any]:
    virtual = options.speed == "max"
    world.drive.open()  # first: without its port a run leaves no file and no log
    with ExitStack() as stack:
        session = secrets.token_hex(SESSION_BYTES)
        loader = ControllerLoader(config, options.config, *(() if virtual else (tick, prepared)))
        limit = config.loop.reference_limit_rad
        gate = Gate(Ranges((-limit, limit), TUNABLE), loader.load)
        operators = CommandSink(gate, session, lambda: operator_status(loop, gate, recorder, telemetry))
        if not virtual:
            _serve_commands(stack, options, config, reporter, operators)
        zero_ns = (lambda: 0) if virtual else partial(wall_zero_ns, world.timer.now)
        recorder = _recorder(stack, options, config, texts, reporter, zero_ns, "" if virtual else session)
        telemetry = (
            None
            if virtual
            else _telemetry(
                stack, config, texts, reporter, operators, lambda: status(loop, recorder, TUNABLE), world.eye
            )
        )
        watch = Watch(world.truth)
        watchers = (reporter, recorder, telemetry, operators, watch, guest)
        sinks: list[Sink] = [sink for sink in watchers if sink is not None]
        loop = Loop(
            tick,
            world.timer,
            world.drive,
            world.eye,
            sinks=tuple(sinks),
            troubles=tuple(_trouble(sink) for sink in (recorder, telemetry)),
            sources=(_script(config, loader), operators.commands, *_asked_by(guest, loader)),
            beat=_beat(notifier, tick),
            auto_arm=options.sim or options.arm,
            duration_s=options.duration_s,
            collect=not virtual,
        )
        descriptors.RESERVE.fill(descriptors.KEPT)  # the last to be opened: what is open already needs none
        stack.callback(descriptors.RESERVE.empty)
        stack.callback(reporter.close)
        reporter.start(guest.status if guest else lambda: status_line(loop))
        signals.handle(loop.request_stop)
        if guest is not None:
            stack.enter_context(guest.attend(loop))
        _quiet(virtual)
        started, started_cpu = time.perf_counter(), time.process_time()
        await loop.run()
        wall_s, cpu_s = time.perf_counter() - started, time.process_time() - started_cpu
        notifier.stopping()
    return {**summarise(loop, watch, recorder, telemetry, wall_s), "cpu_s": cpu_s}


def _script(config: Config, loader: ControllerLoader) -> Callable[[float], tuple[Command, ...]]:
    """The rig's operator: commands at their times; what they load is read before the run."""
    rows = sorted(config.sim.commands, key=lambda command: command.at_s)
    texts = [loader.load(row.key, "the rig's script") if row.name in LOADED else "" for row in rows]
    waiting = deque(
        (row.at_s, Command(row.name, row.value, row.key, text)) for row, text in zip(rows, texts, strict=True)
    )

    def due(t: float) -> tuple[Command, ...]:
        commands = []
        while waiting and waiting[0][0] <= t:
            commands.append(waiting.popleft()[1])
        return tuple(commands)

    return due


def _asked_by(guest: Guest | None, loader: ControllerLoader) -> Iterator[Callable[[float], tuple[Command, ...]]]:
    """A guest's commands, with the texts of the files that they name (`loads`), which are read before the run."""
    if guest is None:
        return
    texts = {key: loader.load(key, "the run itself") for key in guest.loads}

    def asked(t: float) -> tuple[Command, ...]:
        return tuple(one._replace(text=texts.get(one.key, one.text)) for one in guest.commands(t))

    yield asked


def _beat(notifier: Notifier, tick: Tick) -> Callable[[float], None]:
    """READY once the board answers (or after a while without it), then the watchdog from the tick."""
    ready = False

    def beat(t: float) -> None:
        nonlocal ready
        if not ready and (tick.health.link_seen or t > READY_PATIENCE_S):
            ready = notifier.ready(str(tick.mode)) or not notifier.active
        notifier.beat(t)

    return beat


def _quiet(virtual: bool) -> None:
    """Nothing made at start-up is ever collected again; memory stays where it is."""
    freeze_garbage()
    if not virtual:
        lock_memory()


def _trouble(sink: RecorderSink | TelemetrySink | None) -> Callable[[], bool]:
    return (lambda: False) if sink is None else (lambda: sink.trouble)


def _say(reporter: log.Reporter) -> Say:
    """Facts of the camera and of the serial line go to the log."""
    return lambda who, text: reporter.note(reporter.t, Note(who, "warning", {"says": text}))


def _tell(reporter: log.Reporter) -> Callable[[str, str, Mapping[str, Any]], None]:
    """A helper's own facts go to the log."""
    return lambda name, level, fields: reporter.note(reporter.t, Note(name, level, dict(fields)))


def _recorder(
    stack: ExitStack,
    options: Options,
    config: Config,
    texts: Texts,
    reporter: log.Reporter,
    zero_ns: Callable[[], int],
    session: str,
) -> RecorderSink | None:
    folder = options.record or (Path(config.recording.directory) if config.recording.directory else None)
    if folder is None:
        return None
    header = Header(
        device=config.device.name,
        config=texts.config,
        model=texts.model,
        controller=texts.controller,
        law=texts.law,
        versions=installed_versions("hoopd", "numpy", "casadi"),
        seed=options.seed if options.sim else None,
        session=session,
    )
    limits = RoomLimits(config.recording.quota_bytes, config.recording.min_free_bytes)
    recorder = Recorder(
        folder,
        header,
        limits=limits,
        synchronous=options.speed == "max",
        zero_ns=zero_ns,
        on_event=_tell(reporter),
    )
    stack.callback(_close, recorder.close, "recorder")
    return RecorderSink(recorder)


def _telemetry(
    stack: ExitStack,
    config: Config,
    texts: Texts,
    reporter: log.Reporter,
    operators: CommandSink,
    status: Callable[[], dict[str, Any]],
    eye: Eye,
) -> TelemetrySink | None:
    if not config.telemetry.enabled:
        return None
    from hoopd.shell.live_picture import LivePicture
    from hoopd.shell.telemetry import Telemetry, TelemetrySettings

    settings = TelemetrySettings(
        device=config.device.name,
        endpoint=config.telemetry.endpoint,
        commands=config.telemetry.commands,
        control_endpoint=config.telemetry.control.endpoint,
        control_zenoh=config.telemetry.control.zenoh,
        session=operators.session,
        zenoh=config.telemetry.zenoh,
    )
    picture = LivePicture(eye.analysed, config.vision) if isinstance(eye, CameraThread) else None
    telemetry = Telemetry(settings, operators.gate, config_text=texts.config, on_event=_tell(reporter), picture=picture)
    telemetry.start()
    stack.callback(_close, telemetry.close, "telemetry")
    return TelemetrySink(telemetry, status)


def _serve_commands(
    stack: ExitStack,
    options: Options,
    config: Config,
    reporter: log.Reporter,
    operators: CommandSink,
) -> None:
    """Listen at the command socket. Without it nobody could command the device: then it does not start; a rig does,
    because several may stand side by side, and says so."""
    if not config.commands.enabled:
        return
    try:
        listening = listening_socket(config.device.name, config.commands.socket)
    except InputError as error:
        if not options.sim:
            raise
        reporter.note(0.0, Note("commands_unavailable", "warning", {"reason": str(error)}))
        return
    asking, name = operators.ask, operators.session
    server = CommandServer(listening, operators.gate, asking, session=name, on_event=_tell(reporter))
    server.start()
    stack.callback(_close, server.close, "commands")


def _close(close: Callable[[], bool], what: str) -> None:
    """Close within the helper's own bound; helpers are daemon threads, so one that hangs cannot hold the process."""
    if not close():
        sys.stderr.write(f"hoopd: {what} did not close in time\n")
