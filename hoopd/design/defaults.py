"""The controllers that ship with hoopd, remade from their models: `python -m hoopd.design.defaults FOLDER`.

Rules of this file: seeded, so that the same code makes the same numbers; they are written with eight digits, which
no machine's last bits reach.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.core.estimator import EkfSettings
from hoopd.core.records import PICTURE_AGE_S
from hoopd.design.arx import ArxModel, arx_lqg, fit_arx
from hoopd.design.controller_text import controller_data, controller_text, plain
from hoopd.design.innovation_levels import innovation_levels
from hoopd.design.lqg import lqg_gains
from hoopd.design.weights import Weights
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, plant_of

TICK_S = 0.02
WIRE_S = 8 * 10 / 115200  # a request on the wire; the board samples at its end

# The thesis's printed coefficients, Tustin at 0.02 s, of
#   PID   Kp (1 + 1/(Ti s) + Td s/(1 + s Td/15)), Kp 0.164256, Ti 0.0390661 s, Td 0.393028 s
#   lead  (0.0279508 s + 1)/(0.00559017 s + 1)
PID_B = [1.9895532268941687, -3.781042887492248, 1.837946360416423]
PID_A = [1.0, -1.4475426500133597, 0.4475426500133597]
LEAD_B = [2.4342806945451483, -1.1514210418177229]
LEAD_A = [1.0, 0.28285965272742575]

HEAD = "Made by hoopd.design.defaults from {model}: change the design there, or make a file of your own."


def experiment(plant: HoopPlant, ticks: int = 3000, amplitude_nm: float = 0.06, seed: int = 5) -> tuple[Any, Any]:
    """A random two-level run as a daemon records it: u (n,), y (n, 2) = (dtheta, psi) as they arrive in the tick."""
    rng = np.random.default_rng(seed)
    x, u, y = np.zeros(4), np.zeros(ticks), np.zeros((ticks, 2))
    for k in range(ticks):
        u[k] = amplitude_nm * rng.choice((-1.0, 1.0)) if k % 3 == 0 else u[k - 1]
        before = plant.advance(x, u[k - 1] if k else 0.0, WIRE_S)
        if k + 1 < ticks:
            y[k + 1, 0] = before[1]
        seen = k + 1 + int(PICTURE_AGE_S // TICK_S)
        if seen < ticks:
            y[seen, 1] = plant.advance(before, u[k], TICK_S - PICTURE_AGE_S % TICK_S - WIRE_S)[2]
        x = plant.advance(before, u[k], TICK_S - WIRE_S)
    return u, y + rng.normal(size=y.shape) * (0.05, 0.002)


def fitted(plant: HoopPlant) -> ArxModel:
    """ARX model of the simulated experiment."""
    return fit_arx(*experiment(plant))


def make_defaults(config: Path) -> dict[str, dict[str, Any]]:
    """Controller files by name; `config` is the folder that holds models/hoop.yaml."""
    plant = plant_of(load_model(config / "models" / "hoop.yaml"))
    arx = plain(arx_lqg(fitted(plant), Weights(), TICK_S)._asdict())
    lqg = plain(asdict(lqg_gains(plant, Weights(), TICK_S)))
    levels = innovation_levels(plant, EkfSettings(), PICTURE_AGE_S, TICK_S)
    laws = {
        "lqg": ("lqg", lqg, "state feedback on the filter's estimate; hoop speed regulated"),
        "arx": ("lqg_linear", arx, "LQG on an ARX model identified from a simulated run"),
        "pid": ("pid", {"b": PID_B, "a": PID_A}, "the thesis's PID; sees psi alone"),
        "lead": ("lead", {"b": LEAD_B, "a": LEAD_A}, "the thesis's lead link; sees psi alone"),
    }
    return {name: _file(name, *law, levels) for name, law in laws.items()}


def write_defaults(config: Path, folder: Path) -> None:
    """Write every default controller as YAML."""
    for name, file in make_defaults(config).items():
        text = controller_text(file, HEAD.format(model=file["model"]))
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")


def _file(name: str, kind: str, gains: dict[str, Any], notes: str, levels: dict[str, list[float]]) -> dict[str, Any]:
    model = "models/hoop.yaml"
    return controller_data(name, kind, gains, model=model, notes=notes, sample_time_s=TICK_S, innovations=levels)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="write the shipped controllers anew from models/hoop.yaml")
    parser.add_argument("config", type=Path, help="folder with models/ and controllers/")
    target = parser.parse_args().config
    write_defaults(target, target / "controllers")
