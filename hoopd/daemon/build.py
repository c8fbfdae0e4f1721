"""From files to a tick: the same construction for the daemon and for a replay.

Rules of this file: everything is made from texts, so that a recording that holds them rebuilds the same tick; no
port, no camera, no clock.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import MutableMapping
from functools import partial
from math import isinf
from pathlib import Path
from typing import Any, NamedTuple, cast

import msgspec

from hoopd.core.controllers import Controller
from hoopd.core.estimator import EkfSettings
from hoopd.core.excitation import Excitation
from hoopd.core.feedforward import FeedForward
from hoopd.core.hooponly import HoopOnly
from hoopd.core.installed import ControllerLabel, Filter, Installed
from hoopd.core.limits import Limiter
from hoopd.core.tick import Tick
from hoopd.core.tracker import MotionTracker
from hoopd.files.controller import (
    ControllerFile,
    ControllerLimits,
    controller_of,
    levels_of,
    parse_controller,
    parse_recorded_controller,
    settings_of,
)
from hoopd.files.loaded_controller import LoadedController, filter_key, parse_loaded
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError, read_text
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.writeback import Unused, ball_motion, estimator_with, feedforward_of, hoop_motion, unused
from hoopd.plants.model_file import effects_of, parse_model
from hoopd.shell.config import Config, dump, find

# The line of a controller file that names its model, when the way there leads through folders of this machine.
_MODEL_FOLDERS = re.compile(r"(?m)^(model: +[\"']?)(?:/|~|\.\.).*/(?=[^/\n]+$)")


class Texts(NamedTuple):
    """All that a tick is made of, as the files hold it."""

    config: str
    model: str
    controller: str
    law: str = ""


class NewController(NamedTuple):
    """A controller that is about to be loaded."""

    loaded: LoadedController
    law: Controller
    filter: Filter | None  # None: made when it is known to be another one than the running one


Prepared = MutableMapping[str, NewController]


def read_texts(config: Config, config_path: Path | None) -> Texts:
    """Texts of the files that a configuration names."""
    law, controller = config.control.law, read_text(find(config.control.file, config_path))
    parse_controller(controller, config.control.file)  # before anything is built of it
    return Texts(
        dump(without_places(config)),
        read_text(model_path(config, config_path)),
        _without_folder(controller),
        read_text(find(law, config_path)) if law else "",
    )


def model_path(config: Config, config_path: Path | None) -> Path:
    """The filter's model: the one that the configuration names, or else the one that the controller was designed on,
    which is looked up beside the controller's file first."""
    if config.device.model:
        return find(config.device.model, config_path)
    path = find(config.control.file, config_path)
    name = parse_controller(read_text(path), config.control.file).model
    beside = path.parent / name
    return beside if beside.is_file() else find(name, config_path)


def without_places(config: Config) -> Config:
    """What a recording may tell: no folders and devices of this machine, nothing that the rig hides."""
    change = msgspec.structs.replace
    control, device = config.control, config.device
    return change(
        config,
        calibration=change(config.calibration, folder=""),
        device=change(device, model=_name(device.model)),
        control=change(control, file=_name(control.file), law=_name(control.law), folder=""),
        recording=change(config.recording, directory=""),
        commands=change(config.commands, socket=_name(config.commands.socket)),
        sim=change(
            config.sim,
            model=_name(config.sim.model),
            directory="",
            board_program=_name(config.sim.board_program),
            effects=[],
        ),
    )


def _without_folder(controller: str) -> str:
    """A controller file's text whose model is named without the folders on the way to it."""
    return _MODEL_FOLDERS.sub(r"\1", controller)


def _name(text: str) -> str:
    path = Path(text)
    return path.name if path.is_absolute() else text


def limits_in_force(config: Config, model: ModelFile, file: ControllerFile) -> ControllerLimits:
    """The narrowest of the configuration's, the device's and the controller's."""
    return ControllerLimits(
        torque_nm=min(config.limits.torque_nm, model.device.torque_limit_nm, file.limits.torque_nm),
        slew_nm_per_tick=min(config.limits.slew_nm_per_tick, file.limits.slew_nm_per_tick),
    )


def build_tick(config: Config, texts: Texts, prepared: Prepared | None = None) -> Tick:
    """A tick in its first state; InputError names the file that does not fit.

    `prepared`: controllers that are about to be loaded, by the text that loads them.
    """
    file = parse_recorded_controller(texts.controller, config.control.file)
    model = parse_model(texts.model, config.device.model or file.model)
    same_period(config, file, config.control.file)
    law = load_law(texts.law, config.control.law) if config.control.law else controller_of(file)
    limits = limits_in_force(config, model, file)
    limiter = Limiter(limits.torque_nm, limits.slew_nm_per_tick)
    if not config.faults.ball_expected:
        _needs_no_ball(config, file, law)
        hoop = hoop_motion(effects_of(model), settings_of(file))
        return Tick(config.loop, config.faults, HoopOnly(), law, limiter, hoop=hoop)
    _holds_the_ball(config, law)
    _watches_the_ball(config, law)
    made = filter_of(config, texts.model, file, limiter.torque_nm)
    feedforward = FeedForward() if isinstance(law, Excitation) else made.feedforward
    name, content = Path(config.control.law or config.control.file).name, texts.law or texts.controller
    return Tick(
        config.loop,
        config.faults,
        made.estimator,
        law,
        limiter,
        feedforward,
        made.levels,
        made.ball,
        made.hoop,
        key=made.key,
        label=ControllerLabel(name, hashlib.sha256(content.encode()).hexdigest()),
        make=partial(make_controller, config, limiter.torque_nm, {} if prepared is None else prepared),
    )


def filter_of(config: Config, model_text: str, file: ControllerFile, limit_nm: float) -> Filter:
    """The filter of a controller on its model, its feed-forward, and what both say of an honest device.

    `limit_nm`: torque that the drive may be asked for, of which feed-forward has its share.
    """
    found, settings = effects_of(parse_model(model_text, file.model)), settings_of(file)
    return Filter(
        estimator_with(found, settings),
        _feed_forward(config, found, settings, limit_nm),
        levels_of(file),
        ball_motion(found),
        hoop_motion(found, settings),
        filter_key(model_text, file),
    )


def new_controller(config: Config, text: str, filter_: Filter | None = None) -> NewController:
    """What the text of a command stands for; ValueError when it cannot act here."""
    loaded = parse_loaded(text)
    same_period(config, loaded.controller, loaded.file)
    law = controller_of(loaded.controller)
    _watches_the_ball(config, law)
    return NewController(loaded, law, filter_)


def make_controller(config: Config, limit_nm: float, prepared: Prepared, text: str, running: Filter) -> Installed:
    """What the text of a command stands for; of the same model, with the running filter.

    What was prepared for the text is taken from there; it is the same as what is made here, sooner.
    """
    ready = prepared.pop(text, None)
    loaded, law, filter_ = ready or new_controller(config, text)
    file = loaded.controller
    if loaded.filter_key == running.key:
        filter_ = running
    return Installed(
        law,
        filter_ or filter_of(config, loaded.model, file, limit_nm),
        file.limits.torque_nm,
        file.limits.slew_nm_per_tick,
        fed=not isinstance(law, Excitation | MotionTracker),
        label=ControllerLabel(loaded.file, loaded.sha256, loaded.by),
    )


def _feed_forward(config: Config, found: FoundEffects, settings: EkfSettings, limit_nm: float) -> FeedForward:
    if not config.control.feedforward:
        return FeedForward()
    return feedforward_of(
        found,
        limit_nm,
        tick_s=config.loop.period_s,
        wire_s=config.loop.wire_s,
        speed_noise_rad_s=settings.r_dtheta**0.5,
    )


def _holds_the_ball(config: Config, law: Controller) -> None:
    """A maneuver begins where another law has brought the ball to rest, and gives it back."""
    if isinstance(law, MotionTracker):
        raise InputError(config.control.file, "kind", "a maneuver holds no ball: play it from a law that does")


def _watches_the_ball(config: Config, law: Controller) -> None:
    """A test signal knows how far the ball may go."""
    if isinstance(law, Excitation) and isinf(law.limits.ball_angle_rad):
        reason = "missing, but a ball is expected: say how far it may go, or set faults.ball_expected to false"
        raise InputError(config.control.file, "gains.ball_angle_rad", reason)


def _needs_no_ball(config: Config, file: ControllerFile, law: Controller) -> None:
    if config.control.law or not isinstance(law, Excitation) or law.around is not None:
        reason = f"false, but {config.control.law or file.name} acts on the ball: only an excitation can do without one"
        raise InputError("configuration", "faults.ball_expected", reason)


def mismatch(config: Config, texts: Texts) -> str:
    """Why the controller may not fit the model that the filter uses; empty when it was designed on it."""
    designed_on = parse_controller(texts.controller, config.control.file).model
    if not config.device.model or Path(designed_on).name == Path(config.device.model).name:
        return ""
    return f"{config.control.file} was designed on {designed_on}, the filter uses {config.device.model}"


def unused_effects(config: Config, texts: Texts) -> tuple[Unused, ...]:
    """Effects of the model that neither filter nor feed-forward can do anything with."""
    return unused(effects_of(parse_model(texts.model, config.device.model)))


def same_period(config: Config, file: ControllerFile, path: object) -> None:
    """InputError for a law that was designed for another tick."""
    sample_time_s = file.sample_time_s
    if abs(sample_time_s - config.loop.period_s) > 1e-9:
        reason = f"designed for {sample_time_s} s, the loop's period is {config.loop.period_s} s"
        raise InputError(path, "sample_time_s", reason)


def load_law(text: str, name: str) -> Controller:
    """An object of class `Law` of a user's Python file; it is the user's own code and runs with the daemon's rights."""
    space: dict[str, Any] = {"__name__": "hoopd_law"}
    try:
        exec(compile(text, name, "exec"), space)
        make = space.get("Law")
        law: Any = make() if isinstance(make, type) else None
        if all(callable(getattr(law, part, None)) for part in ("update", "reset")):
            law.reset()
            return cast(Controller, law)
    except (Exception, SystemExit) as error:
        raise InputError(name, "", f"cannot be loaded: {type(error).__name__}: {error}") from None
    raise InputError(name, "Law", "needs a class Law with update(measurement) and reset()")
