"""The configuration: every key, its unit, its default and its safe range.

Rules of this file: typed and complete; an unknown key, a wrong unit or an unsafe value is one clear line
(`InputError`). Layers, later ones win: the shipped hoop.yaml, the shipped sim.yaml with --sim, the
file of --config, each --set. Paths of models and controllers are looked up beside the file that names them, then
among the shipped ones.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import cos, sin
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from hoopd.core.health import Thresholds
from hoopd.core.limits import SLEW_NM_PER_TICK, TORQUE_LIMIT_NM
from hoopd.core.ticksettings import TickSettings
from hoopd.files.calibration import Calibrations, Part
from hoopd.files.config_layers import layer_of, merged_with, override_of
from hoopd.files.reading import ANY_NUMBER, InputError, os_reason, to_struct
from hoopd.files.records import Strict
from hoopd.files.shipped import defaults_folder
from hoopd.files.yaml_text import text_of

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Moderate = Annotated[float, Meta(ge=-1000, le=1000)]  # of numbers near one: keeps products finite
Fraction = Annotated[float, Meta(ge=0, le=1)]
Bytes = Annotated[int, Meta(ge=0)]
# No picture is wider than 4096; even, because a camera's colour planes have half the size.
Width = Annotated[int, Meta(ge=64, le=4096, multiple_of=2)]
Extent = Annotated[float, Meta(gt=0, le=4096)]
BallSize = Annotated[float, Meta(ge=2, le=400)]
Pixel = Annotated[float, Meta(ge=-4096, le=8192)]

# zenoh's keys that hold a secret itself or, in base64, a private key.
_SECRET = re.compile(r"password|private_key|secret", re.IGNORECASE)
BLANK = "***"


class Device(Strict, frozen=True):
    """Which plant this is."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}\Z")] = "hoop"
    model: str = ""  # of the filter; empty: the model that the controller was designed on


class Serial(Strict, frozen=True):
    """The line to the driver board."""

    port: str = "/dev/hoop-driver"
    baud: Annotated[int, Meta(ge=1200, le=4_000_000)] = 115200
    reopen_s: Annotated[float, Meta(gt=0, le=60)] = 0.5
    layout: str = "default"  # or a YAML file that tables another firmware's frames


Gain = Annotated[float, Meta(gt=0, le=100)]


class Camera(Strict, frozen=True):
    """The camera and how its pictures come."""

    backend: Literal["rpicam", "picamera2", "v4l2", "video", "direct"] = "rpicam"
    command: tuple[str, ...] = ("rpicam-vid",)
    device: str = "/dev/video0"
    file: str = ""
    width_px: Width = 480
    height_px: Width = 480
    fps: Annotated[float, Meta(ge=1, le=240)] = 50.0
    stride_px: Annotated[int, Meta(ge=0, le=8192)] = 0  # 0: found from the first picture (rpicam)
    exposure_s: Annotated[float, Meta(gt=0, le=0.1)] = 0.005
    gain: Annotated[float, Meta(gt=0, le=1000)] = 2.0
    awb_gains: tuple[Gain, Gain] = (1.6, 1.8)
    delay_s: Annotated[float, Meta(ge=0, le=0.2)] = 0.04  # usual age on arrival, for pictures that carry no time
    stall_s: Annotated[float, Meta(ge=0.01, le=5)] = 0.3


class CircleConfig(Strict, frozen=True):
    """A circle in the picture."""

    centre: tuple[Pixel, Pixel] = (240.0, 240.0)
    radius: Extent = 182.0


class Vision(Strict, frozen=True):
    """From picture to ball angle; `hoopd calibrate` proposes this section."""

    weights: tuple[Moderate, Moderate, Moderate] = (1.0, -0.5, -0.5)  # of R, G, B
    threshold: Annotated[float, Meta(gt=0, lt=255)] = 70.0
    circle_px: CircleConfig = CircleConfig()  # on which the ball's centre moves
    homography: list[list[float]] | None = None  # picture to hoop plane; replaces the circle
    zero_angle_rad: Annotated[float, Meta(ge=-3.2, le=3.2)] = 0.0
    ball_radius_px: BallSize = 23.0
    band_px: BallSize = 20.0  # the ball's centre lies this near to the circle
    flying: bool = False  # a ball inside the circle is looked for, too: one that was thrown
    inner_px: Annotated[float, Meta(ge=0, le=10_000)] = 0.0  # circle of the ball's centre on an inner hoop; 0: none

    def __post_init__(self) -> None:
        """Refuse weights that see nothing and a homography that is none."""
        if max(self.weights) <= 0.0:
            raise ValueError("weights need one above zero")
        rows = self.homography
        if rows is not None and ([len(row) for row in rows] != [3, 3, 3] or np.linalg.det(np.array(rows)) == 0.0):
            raise ValueError("homography must be three rows of three numbers that can be inverted")


class CalibrationConfig(Strict, frozen=True):
    """Accepted calibrations (`hoopd calibration`): the newest counts over `vision` and `camera` of the user's file."""

    folder: str = ""  # of the versions; empty: none are kept


class Control(Strict, frozen=True):
    """Which law acts: a controller file, or a Python file with a law of the user's own."""

    file: str = "controllers/lqg.yaml"
    law: str = ""  # a Python file with a class `Law`; the file above still gives estimator and limits
    folder: str = ""  # of controllers that may be loaded while it runs; empty: the folder of the file above
    feedforward: bool = True  # of the effects in the filter's model


class LimitsConfig(Strict, frozen=True):
    """What no controller may exceed."""

    torque_nm: Annotated[float, Meta(gt=0, le=TORQUE_LIMIT_NM)] = TORQUE_LIMIT_NM
    slew_nm_per_tick: Positive = SLEW_NM_PER_TICK


class RecordingConfig(Strict, frozen=True):
    """Where runs go and how much room they may take."""

    directory: str = ""
    quota_bytes: Bytes = 2 * 2**30
    min_free_bytes: Bytes = 200 * 2**20


class ControlSession(Strict, frozen=True):
    """The session for commands over zenoh: nobody gets in without a password or a certificate."""

    endpoint: str = ""  # tls/0.0.0.0:7448
    zenoh: dict[str, Any] = {}  # as below


class TelemetryConfig(Strict, frozen=True):
    """Publishing and commands over zenoh; the defaults never leave this machine."""

    enabled: bool = True
    endpoint: str = "tcp/127.0.0.1:7447"
    commands: bool = False  # over `control`; `disarm` and `stop` need neither
    control: ControlSession = ControlSession()
    zenoh: dict[str, Any] = {}  # zenoh's own keys: TLS, user and password, access control


class Commands(Strict, frozen=True):
    """The socket by which programs of this machine command; who may open it may."""

    enabled: bool = True
    socket: str = ""  # its file; empty: /run/hoopd, $XDG_RUNTIME_DIR/hoopd or /tmp/hoopd-UID, by the device's name


class Log(Strict, frozen=True):
    """How facts are logged."""

    format: Literal["auto", "human", "json"] = "auto"
    level: Literal["debug", "info", "warning", "error"] = "info"


class SimFault(Strict, frozen=True):
    """One scripted fault of the rig."""

    kind: str
    at_s: NotNegative
    for_s: NotNegative = 0.0
    params: dict[str, float | str] = {}


class SimCommand(Strict, frozen=True):
    """One scripted command of the operator, for runs without one."""

    at_s: NotNegative
    name: Literal[
        "arm",
        "disarm",
        "stop",
        "shutdown",
        "clear",
        "reference",
        "speed",
        "tune",
        "controller",
        "trial",
        "experiment",
        "accept",
        "revert",
        "alive",
    ]
    value: Annotated[float, ANY_NUMBER] = 0.0
    key: str = ""


class SimEffect(Strict, frozen=True):
    """Physics of the rig's plant that no model file tells: an effect by its name, its parameters in SI units."""

    name: str
    parameters: dict[str, float] = {}
    at_s: NotNegative = 0.0  # it begins then
    for_s: NotNegative = 0.0  # and goes again after so long; 0: it stays


class SimExchange(Strict, frozen=True):
    """Another ball or hoop in the rig from a time on; pictures keep the radii of the vision section."""

    at_s: NotNegative
    parameters: Annotated[dict[str, float], Meta(min_length=1)]  # of the model's structure, in SI units; others stay


class SimBoard(Strict, frozen=True):
    """What the rig's board refuses by itself (docs/reference/board.md); the defaults are what a firmware must have."""

    # The host calls 200 rad/s implausible: a cut beyond it could not be told from a broken answer.
    overspeed_rad_s: Annotated[float, Meta(gt=0, le=200)] = 100.0
    current_limit_a: Annotated[float, Meta(gt=0, le=1000)] = 2.5
    slew_nm_per_ms: Annotated[float, Meta(ge=1e-3, le=1000)] = TORQUE_LIMIT_NM  # as the rig's torque stage


class Sim(Strict, frozen=True):
    """The simulated rig."""

    model: str = "models/hoop.yaml"
    psi_rad: Annotated[float, Meta(ge=-3.2, le=3.2)] = 0.4  # released from here
    held: bool = True  # a hand holds the ball there until the drive gives its first torque
    hold_s: NotNegative = 0.0  # and at least this long
    directory: str = ""  # existing folder for the board's log of its torque and for the true state
    delay_frames: Annotated[float, Meta(ge=0, le=10)] = 2.0
    camera_phase: Fraction = 0.35  # of a period, between the tick and the exposure's middle
    psi_noise_rad: Annotated[float, Meta(ge=0, le=1000)] = 0.002  # of --camera direct
    angle_offset_rad: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0  # zero-angle error of the camera
    dtheta_noise_rad_s: Annotated[float, Meta(ge=0, le=1000)] = 0.05
    current_noise_a: Annotated[float, Meta(ge=0, le=1000)] = 0.02
    torque_constant_nm_per_a: Annotated[float, Meta(ge=1e-3, le=1000)] = 0.37
    board: SimBoard = SimBoard()
    board_program: str = ""  # plays the board in its place, a firmware's host build; its limits are its own
    disturbance_rad: Moderate = 0.0  # added to psi of one picture
    disturbance_at_s: NotNegative = 0.0
    effects: list[SimEffect] = []  # beside those of the rig's model; no recording tells of them
    exchanges: list[SimExchange] = []  # no recording tells of them either
    faults: list[SimFault] = []
    commands: list[SimCommand] = []


class Config(Strict, frozen=True):
    """Everything."""

    device: Device = Device()
    calibration: CalibrationConfig = CalibrationConfig()
    serial: Serial = Serial()
    camera: Camera = Camera()
    vision: Vision = Vision()
    control: Control = Control()
    limits: LimitsConfig = LimitsConfig()
    loop: TickSettings = TickSettings()
    faults: Thresholds = Thresholds()
    recording: RecordingConfig = RecordingConfig()
    telemetry: TelemetryConfig = TelemetryConfig()
    commands: Commands = Commands()
    log: Log = Log()
    sim: Sim = Sim()


def load(path: Path | None, *, sim: bool, overrides: list[str]) -> Config:
    """Configuration from its layers; InputError names file, key and reason."""
    layers: list[tuple[object, dict[str, Any]]] = [layer_of(defaults_folder() / "hoop.yaml")]
    if sim:
        layers.append(layer_of(defaults_folder() / "sim.yaml"))
    if path is not None:
        layers.append(layer_of(path))
    over = [override_of(text) for text in overrides]
    layers += [*_calibration(layers + over, path), *over]
    merged: dict[str, Any] = {}
    for source, layer in layers:
        merged = merged_with(merged, layer)
        config = to_struct(merged, Config, source)  # a mistake is reported with the layer that brought it
    _check_picture(config.camera, config.vision)
    return config


def load_to_ask(path: Path | None, overrides: list[str]) -> Config:
    """For who speaks with a daemon: a calibration that cannot be used keeps nobody from a disarm."""
    return load(path, sim=False, overrides=[*overrides, "calibration.folder=''"])


def calibrations(path: Path | None, overrides: list[str]) -> Calibrations | None:
    """The folder of a device's calibrations, whatever lies in it; None where no configuration names one."""
    layers = [layer_of(path)] if path is not None else []
    return _calibrations(layers + [override_of(text) for text in overrides], path)


def calibration_part(data: dict[str, Any], source: object) -> Part:
    """Keys of a calibration with values in their usual units; InputError for what the configuration would refuse."""
    whole = msgspec.to_builtins(to_struct(data, Config, source))
    part = {name: section for name, section in data.items() if isinstance(section, dict)}
    return {name: {key: whole[name][key] for key in section} for name, section in part.items()}


def _calibrations(layers: Sequence[tuple[object, dict[str, Any]]], path: Path | None) -> Calibrations | None:
    source, name = _told(layers, "calibration", "folder", "")
    if not isinstance(name, str):
        raise InputError(source, "calibration.folder", "expected the name of a folder")
    return Calibrations((path.parent if path is not None else Path()) / Path(name).expanduser()) if name else None


def _calibration(
    layers: Sequence[tuple[object, dict[str, Any]]], path: Path | None
) -> list[tuple[object, dict[str, Any]]]:
    """What was accepted last, as a layer above the user's file."""
    folder = _calibrations(layers, path)
    version = folder.in_force() if folder is not None else None
    if folder is None or version is None:
        return []
    source, (_, device) = folder.folder / f"{version.number:04}.yaml", _told(layers, "device", "name", Device().name)
    if version.device != device:
        raise InputError(source, "device", f"is of {version.device!r}, this daemon's is {str(device)[:40]!r}")
    return [(source, version.configuration)]


def _told(
    layers: Sequence[tuple[object, dict[str, Any]]], section: str, key: str, otherwise: object
) -> tuple[object, Any]:
    """The last layer that tells a key, and what it tells."""
    found = [(source, layer[section]) for source, layer in layers if isinstance(layer.get(section), dict)]
    return next(((source, part[key]) for source, part in reversed(found) if key in part), ("", otherwise))


def _check_picture(camera: Camera, vision: Vision) -> None:
    """InputError for what no single key tells: a picture and a circle that do not fit each other."""
    width, height, stride = camera.width_px, camera.height_px, camera.stride_px
    if camera.exposure_s > 1.0 / camera.fps:
        reason = f"{camera.exposure_s:g} s is longer than a picture's period, {1.0 / camera.fps:g} s"
        raise InputError("configuration", "camera.exposure_s", reason)
    if not any(vision.weights):
        raise InputError("configuration", "vision.weights", "all zero: nothing could be seen")
    if camera.backend in ("video", "v4l2"):  # the device tells the size
        return
    if width % 2 or height % 2 or stride % 2 or 0 < stride < width:
        reason = f"{width} x {height} with stride {stride or width}: must be even, the stride not below the width"
        raise InputError("configuration", "camera.width_px", reason)
    (cx, cy), radius, zero = vision.circle_px.centre, vision.circle_px.radius, vision.zero_angle_rad
    x, y = cx - radius * sin(zero), cy + radius * cos(zero)
    if not (0 <= x < width and 0 <= y < height):
        reason = f"the ball at rest, at {x:.0f}, {y:.0f}, would be outside of the {width} x {height} picture"
        raise InputError("configuration", "vision.circle_px", reason)


def find(name: str, config_path: Path | None) -> Path:
    """A model or controller file: absolute, beside the configuration, in this folder, or shipped."""
    folders = ([config_path.parent] if config_path is not None else []) + [Path(), defaults_folder()]
    for folder in folders:
        candidate = folder / Path(name).expanduser()
        try:
            found = candidate.is_file()
        except OSError as error:  # a name too long
            raise InputError(name[:100], "", os_reason(error)) from None
        if found:
            return candidate
    raise InputError(name, "", f"no such file (looked in {', '.join(str(folder) for folder in folders)})")


def dump(config: Config) -> str:
    """The resolved configuration as YAML text, keys in the order of this file, without secrets: recordings travel."""
    data = msgspec.to_builtins(config)
    for session in (data["telemetry"], data["telemetry"]["control"]):
        session["zenoh"] = _without_secrets(session["zenoh"])
    return text_of(data)


def _without_secrets(data: Any) -> Any:
    if isinstance(data, dict):
        return {k: BLANK if _SECRET.search(str(k)) else _without_secrets(v) for k, v in data.items()}
    return [_without_secrets(item) for item in data] if isinstance(data, list | tuple) else data
