"""Ten rigs whose parameters are off, and the effects that may be hidden in one.

Rules of this file: a rig is its number; nothing here is a fault: every rig is a device that a laboratory may have.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from harness.effectcases import SIZES

from hoopd.files.shipped import defaults_folder
from hoopd.plants.effects.library import library
from hoopd.plants.model_file import effects_plant, load_model

MODEL = defaults_folder() / "models" / "hoop.yaml"
LIBRARY = library(effects_plant(load_model(MODEL)))
RIGS = 10
OFF = 0.3  # of a parameter that is fitted, at most
WEIGHED_OFF = 0.03  # of what is weighed and measured; beyond, the shipped laws do not hold the ball
WEIGHED = ("ball_mass_kg", "hoop_radius_m", "ball_radius_m")

# Both are told from a recording alone, so that a rig has them as faults of single pictures.
OF_PICTURES = ("camera.late_frames", "camera.outliers")
# A switch of the simulation alone: a ball that loses the track is beyond every reference and test signal.
UNHIDEABLE = tuple(name for name in LIBRARY if name not in SIZES)
# Rows that are right about an effect, though nothing is broken: a ball that slips does not answer the hoop.
RIGHT = {"ball.slip": ("ball_unresponsive",)}
HIDDEN = tuple(name for name in LIBRARY if name in SIZES)


def off_by(rig: int) -> dict[str, float]:
    """By how much each number of the model is off: the worst parameter by `OFF`."""
    names, rng = sorted(load_model(MODEL).parameters), np.random.default_rng([rig, 71])
    direction = rng.uniform(-1.0, 1.0, len(names))
    parameters = (OFF * direction / np.abs(direction).max()).tolist()
    weighed = rng.uniform(-WEIGHED_OFF, WEIGHED_OFF, len(WEIGHED)).tolist()
    return dict(zip((*names, *WEIGHED), (*parameters, *weighed), strict=True))


def write_model(rig: int, path: Path) -> None:
    """The rig's model as a file."""
    content = yaml.safe_load(MODEL.read_text())
    plain = load_model(MODEL).device
    for name, share in off_by(rig).items():
        if name in content["parameters"]:
            row = content["parameters"][name]
            row["value"] = float(row["value"]) * (1.0 + share)
        else:
            content["device"][name] = getattr(plain, name) * (1.0 + share)
    path.write_text(yaml.safe_dump(content))


def effects(name: str) -> list[dict[str, Any]]:
    """A hidden effect as the rig's configuration has it, of a size that matters."""
    return [] if not name or name in OF_PICTURES else [{"name": name, "parameters": SIZES[name]}]


def picture_faults(name: str, seconds: float, missing: float, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Single pictures that are missing, that repeat the one before, or that show something else as the ball."""
    period_s = 0.02
    repeated = SIZES[name]["share"] if name == "camera.late_frames" else 0.0
    false = SIZES[name]["share"] if name == "camera.outliers" else 0.0
    kinds = ("camera_stall", "ball_gone", "pictures_frozen", "picture_ball_painted")
    shares = np.cumsum([0.5 * missing, 0.5 * missing, repeated, false])
    found: list[dict[str, Any]] = []
    for k, drawn in enumerate(rng.random(round(seconds / period_s))):
        which = int(np.searchsorted(shares, drawn, side="right"))
        if which < len(kinds):
            params = {"psi_rad": float(rng.uniform(-1.5, 1.5))} if kinds[which] == "picture_ball_painted" else {}
            found.append({"kind": kinds[which], "at_s": k * period_s, "for_s": period_s, "params": params})
    return found
