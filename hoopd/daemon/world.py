"""The worlds a loop can run in: the device, the rig in real time, the rig in virtual time.

Rules of this file: a world gives a loop its timer, drive and camera, and takes them away again whatever happens;
the rig in real time is the device with two other device files, the serial port and the camera's command.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import Layout, layout_from_table
from hoopd.core.records import CameraSample
from hoopd.daemon.tracking_error import Truth
from hoopd.files.reading import InputError, parse_yaml, read_text
from hoopd.shell.ball_detection import Analyser
from hoopd.shell.camera import Backend, CameraThread, analysis, make_backend
from hoopd.shell.clock import TickTimer
from hoopd.shell.config import Config, find
from hoopd.shell.link import BITS_PER_BYTE, Codec, SerialDrive
from hoopd.shell.loop import Drive, Eye, Timer
from hoopd.shell.service import fifo_priority

if TYPE_CHECKING:
    from hoopd.sim.plant import RigPlant
    from hoopd.sim.rig import Rig

Say = Callable[[str, str], None]  # who speaks and one line for the log


class World(NamedTuple):
    """What a loop runs against."""

    timer: Timer
    drive: Drive
    eye: Eye
    truth: Truth | None = None  # of the rig
    plant: RigPlant | None = None  # hoop and ball as they are, of a rig in lock-step


def read_layout(config: Config, config_path: Path | None) -> Layout:
    """The frames' layout: ours, or a file's."""
    if config.serial.layout == "default":
        return DEFAULT_LAYOUT
    path = find(config.serial.layout, config_path)
    try:
        return layout_from_table(parse_yaml(read_text(path), path))
    except ValueError as error:
        raise InputError(path, "", str(error)) from None


class NoEye:
    """The camera of a hoop without a ball: none is opened."""

    stalled = False

    def take(self) -> CameraSample | None:
        """No picture, ever."""
        return None


@contextmanager
def device(config: Config, layout: Layout, say: Say) -> Iterator[World]:
    """The laboratory device: a serial port and a camera."""
    with ExitStack() as stack:
        timer = stack.enter_context(TickTimer(config.loop.period_s))
        drive = stack.enter_context(serial_drive(config, layout, timer, say))
        needed = config.faults.ball_expected
        eye: Eye = stack.enter_context(camera_eye(config, timer, say)) if needed else NoEye()
        yield World(timer, drive, eye)


@contextmanager
def realtime_rig(
    config: Config, layout: Layout, plant: dict[str, Any], seed: int, *, direct: bool, say: Say
) -> Iterator[World]:
    """The rig as processes of its own on the machine's clock."""
    from hoopd.sim.rig import TruePsi

    with ExitStack() as stack:
        timer = stack.enter_context(TickTimer(config.loop.period_s))
        start = timer.start_ns / 1e9
        rigged, rig = stack.enter_context(rig_devices(config, layout, plant, seed, start))
        drive = stack.enter_context(serial_drive(rigged, layout, timer, say))
        eye: Eye = NoEye()
        if direct:
            eye = stack.enter_context(direct_eye(config, rig, seed, timer, start))
        elif config.faults.ball_expected:
            eye = stack.enter_context(camera_eye(rigged, timer, say))
        yield World(timer, drive, eye, TruePsi(rig.truth, start))


@contextmanager
def rig_devices(
    config: Config, layout: Layout, plant: dict[str, Any], seed: int, start: float
) -> Iterator[tuple[Config, Rig]]:
    """A running rig, and the configuration with its port and camera command in the place of the device's."""
    from hoopd.sim import parts
    from hoopd.sim.boardprocess import ProcessConfig
    from hoopd.sim.rig import rig_processes

    def board(folder: Path) -> ProcessConfig:
        return parts.board_process(config, layout, plant, seed, start, folder)

    fifo = fifo_priority()  # beside a load that would hold the rig up, a judge of the loop would judge the rig
    with rig_processes(board, fifo=fifo) as rig:
        told = parts.camera_config(config, seed, ring=str(rig.ring), start=start)
        path = rig.folder / "camera.json"
        path.write_bytes(msgspec.json.encode(told))
        command = (sys.executable, "-m", "hoopd.sim.cameraprogram", "--rig", str(path), "--fifo", str(fifo))
        camera = msgspec.structs.replace(config.camera, backend="rpicam", command=command)
        serial = msgspec.structs.replace(config.serial, port=str(rig.port))
        yield msgspec.structs.replace(config, camera=camera, serial=serial), rig


@contextmanager
def serial_drive(config: Config, layout: Layout, timer: Timer, say: Say) -> Iterator[SerialDrive]:
    """The port to the driver board; the loop opens it."""
    serial = config.serial
    codec = Codec(layout, serial.baud)
    drive = SerialDrive(serial.port, serial.baud, codec, timer.now, serial.reopen_s, partial(say, "serial"))
    try:
        yield drive
    finally:
        drive.close()


@contextmanager
def camera_eye(config: Config, timer: TickTimer, say: Say = lambda who, text: None) -> Iterator[CameraThread]:
    """The camera on a thread of its own, with the analysis of its pictures."""
    analyser = Analyser(config.vision, config.faults.minimum_confidence)
    start = timer.start_ns / 1e9

    def make() -> Backend:
        analyser.reset()  # a restarted camera may show the ball anywhere
        return make_backend(config.camera, timer.now, start)

    eye = CameraThread(make, analysis(analyser), timer.now, config.camera.stall_s, partial(say, "camera"))
    eye.start()
    try:
        yield eye
    finally:
        eye.stop()


@contextmanager
def direct_eye(config: Config, rig: Rig, seed: int, timer: Timer, start: float) -> Iterator[Eye]:
    """The rig's ball angle without pictures."""
    from hoopd.sim import parts
    from hoopd.sim.rig import DirectEye

    script = parts.fault_script(config, seed)
    frame_s = 1.0 / config.camera.fps
    eye = DirectEye(
        rig.ring,
        parts.make_watcher(config, script, seed, direct=True),
        script,
        clock=timer.now,
        start=start,
        frame_s=frame_s,
        phase_s=config.sim.camera_phase * frame_s,
        delay_s=config.sim.delay_frames * frame_s,
        stall_s=config.camera.stall_s,
    )
    try:
        yield eye
    finally:
        eye.close()


@contextmanager
def lockstep(config: Config, layout: Layout, plant: dict[str, Any], seed: int, *, direct: bool) -> Iterator[World]:
    """The rig in virtual time."""
    import numpy as np

    from hoopd.sim import parts
    from hoopd.sim.board import BoardConfig
    from hoopd.sim.boardprogram import powered_board
    from hoopd.sim.lockstep import LockstepEye, LockstepRig
    from hoopd.sim.plant import make_plant
    from hoopd.sim.wiredboard import WiredBoard

    sim, byte_s = config.sim, BITS_PER_BYTE / config.serial.baud
    script = parts.fault_script(config, seed)
    model = make_plant(**plant)
    constants = BoardConfig(byte_s=byte_s, **parts.board_constants(config))
    program, rng = parts.board_program(config), np.random.default_rng([seed, 1])
    with (
        parts.torque_log(config) as sink,
        parts.truth_log(config) as truth,
        powered_board(program, model, rng, layout=layout, config=constants, sink=sink) as board,
    ):
        wired = WiredBoard(board, script, layout=layout, byte_s=byte_s)
        frame_s = 1.0 / config.camera.fps
        rig = LockstepRig(
            model,
            wired,
            Codec(layout, config.serial.baud),
            parts.make_watcher(config, script, seed, direct=direct),
            script,
            period_s=config.loop.period_s,
            frame_s=frame_s,
            phase_s=sim.camera_phase * frame_s,
            delay_s=sim.delay_frames * frame_s,
            truth=truth,
        )
        try:
            yield World(rig, rig, LockstepEye(rig, config.camera.stall_s), rig.true_psi, model)
        finally:  # the last frame is on its way whatever ended the loop
            rig.finish(2.0 * constants.timeout_s)
