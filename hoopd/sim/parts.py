"""The rig's parts as the configuration describes them.

Rules of this file: translates, starts nothing; a wrong fault is told as one line with its place in the configuration.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Any

import msgspec

from hoopd.core.layout import Layout, layout_to_table
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.found_effects import EffectError, checked
from hoopd.plants.hoop.equations import without_ball
from hoopd.plants.hoop.parameters import ParameterError, check_parameters
from hoopd.plants.model_file import effects_of, effects_plant
from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import Config
from hoopd.shell.link import BITS_PER_BYTE
from hoopd.sim.boardprocess import ProcessConfig
from hoopd.sim.camera import CameraConfig, Painter
from hoopd.sim.faults import FaultScript, ScriptedFault, fault_from_table
from hoopd.sim.torque_log import TorqueLogFile
from hoopd.sim.truth import TruthFile
from hoopd.sim.watchers import DirectWatcher, Disturbance, PictureWatcher, Watcher

TORQUE_LOG = "torque.jsonl"
TRUTH_LOG = "truth.csv"


def plant_arguments(config: Config, model: ModelFile) -> dict[str, Any]:
    """What the rig's plant is made of: the model with its effects, and what the configuration hides in it."""
    sim = config.sim
    later = [(t, rig_effects(config, model, t), rig_parameters(config, model, t)) for t in _changes_s(config)]
    return {
        "structure": model.structure,
        "parameters": rig_parameters(config, model),
        "x0": [0.0, 0.0, sim.psi_rad, 0.0],
        "held": sim.held,
        "hold_s": sim.hold_s,
        "effects": rig_effects(config, model),
        **({"later": later} if later else {}),
    }


def _changes_s(config: Config) -> list[float]:
    """Run times at which an effect that the configuration hides begins or goes, or a body is exchanged."""
    sim = config.sim
    ends = {one.at_s + one.for_s for one in sim.effects if one.for_s > 0.0}
    begins = {one.at_s for one in sim.effects} | {one.at_s for one in sim.exchanges}
    return sorted((ends | begins) - {0.0})


def rig_parameters(config: Config, model: ModelFile, t: float = 0.0) -> dict[str, float]:
    """All parameters of the rig's plant at a run time; InputError for an exchange that no plant can have."""
    so_far = values = own = model.values()
    alone = own if config.faults.ball_expected else without_ball(model.structure, own)
    for index, exchange in sorted(enumerate(config.sim.exchanges), key=lambda pair: pair[1].at_s):
        key = f"sim.exchanges[{index}].parameters"
        for name in exchange.parameters:
            if alone.get(name) != own.get(name):
                raise InputError("configuration", f"{key}.{name}", "there is no ball: faults.ball_expected is false")
        try:
            so_far = check_parameters(model.structure, so_far | exchange.parameters)
        except ParameterError as error:
            raise InputError("configuration", f"{key}.{error.name}", error.reason) from None
        values = so_far if exchange.at_s <= t else values
    return values if config.faults.ball_expected else without_ball(model.structure, values)


def rig_effects(config: Config, model: ModelFile, t: float = 0.0) -> dict[str, dict[str, float]]:
    """Parameters by `slot.effect` of all that the rig's plant has at a run time and that do something; InputError."""
    plant = effects_plant(model)
    told = {one.name: dict(one.parameters) for one in effects_of(model).entries}
    for index, entry in enumerate(config.sim.effects):
        key = f"sim.effects[{index}]"
        try:
            values = checked(plant, entry.name, entry.parameters)
        except EffectError as error:
            raise InputError("configuration", f"{key}.{error.key}", error.reason) from None
        if not entry.at_s <= t < (entry.at_s + entry.for_s if entry.for_s > 0.0 else inf):
            continue
        if entry.name in told:
            raise InputError("configuration", f"{key}.name", f"{entry.name} is in the rig's plant already")
        told[entry.name] = values
    known = known_effects(plant, told)
    for name in told:
        if known[name].found_by == "quality":
            raise InputError("configuration", "sim.effects", f"{name} is no physics of a plant: see sim.faults")
    # a switch has no number that could be neutral: where it stands it is on
    acts = {name: known[name].found_by == "switch" or values != known[name].neutral() for name, values in told.items()}
    return {name: values for name, values in told.items() if acts[name]}


def fault_list(config: Config) -> list[ScriptedFault]:
    """The rig's scripted faults."""
    return [_checked(index, row) for index, row in enumerate(fault_rows(config))]


def fault_rows(config: Config) -> list[dict[str, Any]]:
    """The scripted faults as plain data; a duration of zero means for good. InputError for one that is not known."""
    rows = [
        {"kind": f.kind, "at_s": f.at_s, "for_s": f.for_s or None, "params": dict(f.params)} for f in config.sim.faults
    ]
    for index, row in enumerate(rows):
        _checked(index, row)
    return rows


def fault_script(config: Config, seed: int) -> FaultScript:
    """The rig's script."""
    return FaultScript(fault_list(config), seed)


def _checked(index: int, row: dict[str, Any]) -> ScriptedFault:
    try:
        return fault_from_table(row)
    except ValueError as error:
        raise InputError("configuration", f"sim.faults[{index}]", str(error)) from None


def board_program(config: Config) -> str:
    """The program that plays the board, empty for ours; InputError when it cannot be run."""
    program = config.sim.board_program
    if program and not (Path(program).is_file() and os.access(program, os.X_OK)):
        raise InputError("configuration", "sim.board_program", f"no program that may be run: {program}")
    return str(Path(program).resolve()) if program else ""


def board_constants(config: Config) -> dict[str, Any]:
    """The rig's board as the configuration describes it."""
    sim = config.sim
    return {
        "dtheta_noise": sim.dtheta_noise_rad_s,
        "current_noise": sim.current_noise_a,
        "kt": sim.torque_constant_nm_per_a,
        **msgspec.structs.asdict(sim.board),
    }


@contextmanager
def torque_log(config: Config) -> Iterator[Any]:
    """Sink for the rig's log of the torque that it really applied."""
    if not config.sim.directory:
        yield None
        return
    log = TorqueLogFile(Path(config.sim.directory) / TORQUE_LOG)
    try:
        yield log
    finally:
        log.close()


@contextmanager
def truth_log(config: Config) -> Iterator[Any]:
    """Sink for the plant's true state."""
    if not config.sim.directory:
        yield None
        return
    with TruthFile(Path(config.sim.directory) / TRUTH_LOG) as log:
        yield log


def make_watcher(config: Config, script: FaultScript, seed: int, *, direct: bool) -> Watcher:
    """The rig's camera in virtual time."""
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
        inner=config.vision.inner_px / config.vision.circle_px.radius,
        disturbance=disturbance,
        frame_s=frame_s,
    )


def camera_config(config: Config, seed: int, *, ring: str, start: float) -> CameraConfig:
    """What the rig's camera is told: it shows the hoop where the vision section expects it."""
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
            "inner_radius": max(vision.inner_px - vision.ball_radius_px, 0.0),
            "exposure_s": camera.exposure_s,
            "seed": seed,
        },
        angle_offset_rad=sim.angle_offset_rad,
        disturbance_at_s=sim.disturbance_at_s,
        disturbance_rad=sim.disturbance_rad,
        faults=fault_rows(config),
        seed=seed,
    )


def board_process(
    config: Config, layout: Layout, plant: dict[str, Any], seed: int, start: float, folder: Path
) -> ProcessConfig:
    """What the board's process is told; `start` is the monotonic time of run time zero."""
    logs = Path(config.sim.directory) if config.sim.directory else folder
    return ProcessConfig(
        plant="hoopd.sim.plant:make_plant",
        plant_arguments=plant,
        torque_log=str(logs / TORQUE_LOG),
        truth_log=str(logs / TRUTH_LOG) if config.sim.directory else "",
        state_ring=str(folder / "ring"),
        truth_ring=str(folder / "truth"),
        seed=seed,
        t0=start,
        layout=layout_to_table(layout),
        program=board_program(config),
        board={**board_constants(config), "byte_s": BITS_PER_BYTE / config.serial.baud},
        faults=fault_rows(config),
    )
