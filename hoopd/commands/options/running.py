"""Options of what runs the daemon, or speaks with one that runs.

Rules of this file: the records alone; what they lead to stands in `commands.cli` and `commands.operator`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import json_option
from hoopd.files.reading import InputError


def config_option() -> Any:
    """The configuration."""
    return option("--config", text="Configuration file (YAML).", metavar="FILE", python=False)


def sets_option() -> Any:
    """Single keys that go over the configuration."""
    return option("--set", text="Override one key: a.b=value.", metavar="KEY=VALUE", default=(), python="sets")


def speed_option() -> Any:
    """Real time or not."""
    return option("--speed", text="1: real time; max: lock-step virtual time (--sim).", default="1", python=False)


def camera_option() -> Any:
    """Pictures or not."""
    return option("--camera", text="direct: the rig's ball angle without pictures (--sim).", python=False)


def arm_option() -> Any:
    """Whether it arms by itself."""
    return option("--arm", text="Arm by itself once everything is well (terminal only).", default=False, python=False)


def checked_speed(text: str) -> Literal["1", "max"]:
    """InputError for what is neither 1 nor max."""
    if text not in ("1", "max"):
        raise InputError("--speed", "", f"must be 1 or max, not {text!r}")
    return "max" if text == "max" else "1"


def without_pictures(camera: str | None) -> bool:
    """Whether the camera is `direct`; InputError for any other word."""
    if camera not in (None, "direct"):
        raise InputError("--camera", "", f"must be direct, not {camera!r}")
    return camera == "direct"


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Run the daemon, or one of the commands below."""

    sim: bool = option("--sim", text="Run against the simulated rig.", default=False)
    config: Path | None = config_option()
    duration: float | None = option("--duration", min=0.1, text="Seconds to run; without it until stopped.")
    record: Path | None = option("--record", text="Existing folder for the recording.")
    seed: int = option("--seed", min=0, text="Seed of everything random in the rig.", default=0)
    sets: tuple[str, ...] = sets_option()
    speed: str = speed_option()
    camera: str | None = camera_option()
    arm: bool = arm_option()
    json_path: Path | None = json_option()
    version: bool = option("--version", text="Print the version and end.", default=False)


@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Show what is configured and what is granted; proves the board's time-out by going silent."""

    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    sim: bool = option("--sim", text="Check the simulated rig.", default=False)
    json_path: Path | None = json_option()


@dataclass(frozen=True, kw_only=True)
class DaemonOptions:
    """Which daemon is meant."""

    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()


@dataclass(frozen=True, kw_only=True)
class ArmOptions(DaemonOptions):
    """Arm the running daemon (acknowledges faults that are over)."""


@dataclass(frozen=True, kw_only=True)
class DisarmOptions(DaemonOptions):
    """Switch the running daemon's drive off at once."""


@dataclass(frozen=True, kw_only=True)
class StopOptions(DaemonOptions):
    """Let the running daemon brake the hoop, then disarm."""


@dataclass(frozen=True, kw_only=True)
class ClearOptions(DaemonOptions):
    """Acknowledge the running daemon's faults that are over; it stays disarmed."""


@dataclass(frozen=True, kw_only=True)
class RefOptions:
    """Set the running daemon's reference."""

    value: float = argument("Ball angle in rad.", metavar="RAD")
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()


@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """Change a parameter of the running daemon's law."""

    key: str = argument("Parameter of the running law.", metavar="KEY")
    value: float = argument("Its new value.", metavar="VALUE")
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()


@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """Let the running daemon take over a controller out of its folder."""

    file: str = argument("Its file as it is here, or NAME.yaml@SHA256.", metavar="FILE")
    trial: bool = option("--trial", text="On trial: watched by this command until accepted or returned.", default=False)
    experiment: bool = option("--experiment", text="A test signal: played once.", default=False)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()


@dataclass(frozen=True, kw_only=True)
class AcceptOptions(DaemonOptions):
    """Keep the controller that is on trial in the running daemon."""


@dataclass(frozen=True, kw_only=True)
class RevertOptions(DaemonOptions):
    """End a trial: the running daemon goes back to the accepted controller."""


@dataclass(frozen=True, kw_only=True)
class StatusOptions:
    """Show the running daemon's mode, faults and what clears them, reference, lateness and counts."""

    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    json_path: Path | None = json_option()
