"""The worlds a loop can run in: the device, the rig in real time, the rig in virtual time.

Rules of this file: a world gives a loop its timer, drive and camera, and takes them away again whatever happens;
what differs between the device and the rig in real time is two device files: the serial port and the camera's
command.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import Layout, layout_from_table, layout_to_table
from hoopd.eye import Analyser
from hoopd.files import InputError, parse_yaml, read_text
from hoopd.shell.config import Config, find
from hoopd.shell.link import BITS_PER_BYTE, Codec, SerialDrive
from hoopd.shell.loop import Drive, Eye, Timer

if TYPE_CHECKING:
    from hoopd.sim.boardprocess import ProcessConfig
    from hoopd.sim.camera import CameraConfig
    from hoopd.sim.faults import FaultScript
    from hoopd.sim.rig import Rig

TORQUE_LOG = "torque.jsonl"


class World(NamedTuple):
    """What a loop runs against."""

    timer: Timer
    drive: Drive
    eye: Eye


def read_layout(config: Config, config_path: Path | None) -> Layout:
    """The frames' layout: ours, or a file's."""
    if config.serial.layout == "default":
        return DEFAULT_LAYOUT
    path = find(config.serial.layout, config_path)
    try:
        return layout_from_table(parse_yaml(read_text(path), path))
    except ValueError as error:
        raise InputError(path, "", str(error)) from None


@contextmanager
def lockstep(config: Config, layout: Layout, plant: dict[str, Any], seed: int, *, direct: bool) -> Iterator[World]:
    """The rig in virtual time."""
    from hoopd.sim.board import BoardConfig, DriverBoard
    from hoopd.sim.faults import FaultScript
    from hoopd.sim.lockstep import LockstepEye, LockstepRig
    from hoopd.sim.plant import make_plant
    from hoopd.sim.wiredboard import WiredBoard

    sim, byte_s = config.sim, BITS_PER_BYTE / config.serial.baud
    script = FaultScript(fault_list(config), seed)
    model = make_plant(**plant)
    constants = BoardConfig(byte_s=byte_s, **board_constants(config))
    with torque_log(config) as sink:
        board = DriverBoard(model, np.random.default_rng([seed, 1]), layout=layout, config=constants, sink=sink)
        wired = WiredBoard(board, script, layout=layout, byte_s=byte_s)
        frame_s = 1.0 / config.camera.fps
        rig = LockstepRig(
            model,
            wired,
            Codec(layout, config.serial.baud),
            make_watcher(config, script, seed, direct=direct),
            script,
            period_s=config.loop.period_s,
            frame_s=frame_s,
            phase_s=sim.camera_phase * frame_s,
            delay_s=sim.delay_frames * frame_s,
        )
        yield World(rig, rig, LockstepEye(rig, config.camera.stall_s))
        rig.finish(2.0 * constants.timeout_s)


def plant_arguments(config: Config, structure: str, parameters: dict[str, float]) -> dict[str, Any]:
    """What the rig's plant is made of."""
    sim = config.sim
    return {
        "structure": structure,
        "parameters": parameters,
        "x0": [0.0, 0.0, sim.psi_rad, 0.0],
        "held": sim.held,
        "hold_s": sim.hold_s,
    }


def fault_list(config: Config) -> list[Any]:
    """The rig's scripted faults."""
    from hoopd.sim.faults import fault_from_table

    return [checked_fault(fault_from_table, index, row) for index, row in enumerate(fault_rows(config))]


def fault_rows(config: Config) -> list[dict[str, Any]]:
    """The scripted faults as plain data; a duration of zero means for good."""
    return [
        {"kind": f.kind, "at_s": f.at_s, "for_s": f.for_s or None, "params": dict(f.params)} for f in config.sim.faults
    ]


def checked_fault(make: Any, index: int, row: dict[str, Any]) -> Any:
    """One fault, or the line that says what is wrong with it."""
    try:
        return make(row)
    except ValueError as error:
        raise InputError("configuration", f"sim.faults[{index}]", str(error)) from None


def board_constants(config: Config) -> dict[str, Any]:
    """The rig's board as the configuration describes it."""
    sim = config.sim
    return {
        "dtheta_noise": sim.dtheta_noise_rad_s,
        "current_noise": sim.current_noise_a,
        "kt": sim.torque_constant_nm_per_a,
    }


@contextmanager
def torque_log(config: Config) -> Iterator[Any]:
    """Sink for the rig's log of the torque that it really applied."""
    if not config.sim.directory:
        yield None
        return
    from hoopd.sim.torque_log import TorqueLogFile

    log = TorqueLogFile(Path(config.sim.directory) / TORQUE_LOG)
    try:
        yield log
    finally:
        log.close()


def make_watcher(config: Config, script: Any, seed: int, *, direct: bool) -> Any:
    """The rig's camera in virtual time."""
    from hoopd.sim.camera import Painter
    from hoopd.sim.watchers import DirectWatcher, Disturbance, PictureWatcher

    sim, frame_s = config.sim, 1.0 / config.camera.fps
    if not direct:
        painter = Painter(camera_config(config, seed, ring="", start=0.0), script)
        return PictureWatcher(painter, Analyser(config.vision, config.faults.minimum_confidence), frame_s)
    disturbance = Disturbance(sim.disturbance_at_s, sim.disturbance_rad)
    return DirectWatcher(
        script,
        seed,
        noise_rad=sim.psi_noise_rad,
        offset_rad=sim.angle_offset_rad,
        centre_px=config.vision.circle_px.centre,
        radius_px=config.vision.circle_px.radius,
        disturbance=disturbance,
        frame_s=frame_s,
    )


def camera_config(config: Config, seed: int, *, ring: str, start: float) -> CameraConfig:
    """What the rig's camera is told: it shows the hoop where the vision section expects it."""
    from hoopd.sim.camera import CameraConfig

    sim, camera, vision = config.sim, config.camera, config.vision
    return CameraConfig(
        ring=ring,
        start=start,
        phase_s=sim.camera_phase / camera.fps,
        delay_s=sim.delay_frames / camera.fps,
        scene={
            "width": camera.width_px,
            "height": camera.height_px,
            "centre": vision.circle_px.centre,
            "track_radius": vision.circle_px.radius,
            "ball_radius": vision.ball_radius_px,
            "exposure_s": camera.exposure_s,
            "seed": seed,
        },
        angle_offset_rad=sim.angle_offset_rad,
        disturbance_at_s=sim.disturbance_at_s,
        disturbance_rad=sim.disturbance_rad,
        faults=fault_rows(config),
        seed=seed,
    )


@contextmanager
def device(config: Config, layout: Layout) -> Iterator[World]:
    """The laboratory device: a serial port and a camera."""
    from hoopd.shell.clock import TickTimer

    with TickTimer(config.loop.period_s) as timer, _drive(config, layout, config.serial.port, timer) as drive:
        with _camera_thread(config, timer) as eye:
            yield World(timer, drive, eye)


@contextmanager
def realtime_rig(config: Config, layout: Layout, plant: dict[str, Any], seed: int, *, direct: bool) -> Iterator[World]:
    """The rig as processes of its own on the machine's clock; the daemon sees a port and a camera."""
    from hoopd.shell.clock import TickTimer
    from hoopd.sim.faults import FaultScript
    from hoopd.sim.rig import rig_processes

    script = FaultScript(fault_list(config), seed)
    with ExitStack() as stack:
        timer = stack.enter_context(TickTimer(config.loop.period_s))
        start = timer.start_ns / 1e9

        def board(folder: Path) -> ProcessConfig:
            return board_process(config, layout, plant, seed, start, folder)

        rig = stack.enter_context(rig_processes(board, fifo=os.sched_getscheduler(0) == os.SCHED_FIFO))
        drive = stack.enter_context(_drive(config, layout, str(rig.port), timer))
        if direct:
            eye: Eye = stack.enter_context(_direct_eye(config, script, rig, seed, timer, start))
        else:
            eye = stack.enter_context(_camera_thread(config, timer))
        yield World(timer, drive, eye)


def board_process(
    config: Config, layout: Layout, plant: dict[str, Any], seed: int, start: float, folder: Path
) -> ProcessConfig:
    """What the board's process is told; `start` is the monotonic time of run time zero."""
    from hoopd.sim.boardprocess import ProcessConfig

    logs = Path(config.sim.directory) if config.sim.directory else folder
    return ProcessConfig(
        plant="hoopd.sim.plant:make_plant",
        plant_arguments=plant,
        torque_log=str(logs / TORQUE_LOG),
        state_ring=str(folder / "ring"),
        seed=seed,
        t0=start,
        layout=layout_to_table(layout),
        board={**board_constants(config), "byte_s": BITS_PER_BYTE / config.serial.baud},
        faults=fault_rows(config),
    )


@contextmanager
def _direct_eye(config: Config, script: FaultScript, rig: Rig, seed: int, timer: Timer, start: float) -> Iterator[Eye]:
    from hoopd.sim.rig import DirectEye

    frame_s = 1.0 / config.camera.fps
    eye = DirectEye(
        rig.ring,
        make_watcher(config, script, seed, direct=True),
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
def _camera_thread(config: Config, timer: Timer) -> Iterator[Eye]:
    raise InputError("camera", "", "not built yet")
    yield


@contextmanager
def _drive(config: Config, layout: Layout, port: str, timer: Timer) -> Iterator[SerialDrive]:
    drive = SerialDrive(port, config.serial.baud, Codec(layout, config.serial.baud), timer.now, config.serial.reopen_s)
    try:
        yield drive
    finally:
        drive.close()
