"""The worlds a loop can run in: the device, the rig in real time, the rig in virtual time.

Rules of this file: a world gives a loop its timer, drive and camera, and takes them away again whatever happens;
what differs between the device and the rig in real time is two device files: the serial port and the camera's
command.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import Layout, layout_from_table
from hoopd.files import InputError, parse_yaml, read_text
from hoopd.shell.config import Config, find
from hoopd.shell.link import BITS_PER_BYTE, Codec
from hoopd.shell.loop import Drive, Eye, Timer


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


def board_constants(config: Config) -> dict[str, float]:
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


TORQUE_LOG = "torque.jsonl"


def make_watcher(config: Config, script: Any, seed: int, *, direct: bool) -> Any:
    """The rig's camera in virtual time."""
    from hoopd.sim.watchers import DirectWatcher, Disturbance

    sim, frame_s = config.sim, 1.0 / config.camera.fps
    disturbance = Disturbance(sim.disturbance_at_s, sim.disturbance_rad)
    if not direct:
        raise NotImplementedError
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


@contextmanager
def device(config: Config, layout: Layout) -> Iterator[World]:
    """The laboratory device."""
    raise NotImplementedError
    yield


@contextmanager
def realtime_rig(config: Config, layout: Layout, plant: dict[str, Any], seed: int, *, direct: bool) -> Iterator[World]:
    """The rig as processes of its own, on the machine's clock."""
    raise NotImplementedError
    yield
