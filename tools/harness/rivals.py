"""Two designs on one rig: the same seeds and scenarios, judged by the plant's true state.

Rules of this file: the measures are stated before the runs: how far the ball is from where it was told to be (RMS),
and the cost that both designs minimise, with their own weights, a tick:
(w/6)^2 + (off/0.2)^2 + (psi'/1.2)^2 + (u/0.05)^2 in rad/s, rad, rad/s, N m.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.rigrun import RigRun, run_rig
from hoopd.design.weights import Weights

REST = "sim.psi_rad=0"
# The ball is told where to be; 0.1 rad needs 23 rad/s of hoop speed on the rig's device.
REFERENCES = ((2.0, 0.1), (5.0, -0.1), (8.0, 0.05), (11.0, 0.0))
SEEDS = (0, 1, 2)


class Scenario(NamedTuple):
    """What is asked of a controller."""

    sets: tuple[str, ...]
    duration_s: float


SCENARIOS = {
    "references": Scenario(
        (
            REST,
            "sim.commands=["
            + ", ".join(f"{{at_s: {t:g}, name: reference, value: {v:g}}}" for t, v in REFERENCES)
            + "]",
        ),
        14.0,
    ),
    "release": Scenario(("sim.psi_rad=0.4",), 6.0),
}


class Judged(NamedTuple):
    """One run by both measures."""

    off_rms_rad: float
    hoop_rms_rad_s: float
    cost: float


def cost(run: RigRun, weights: Weights | None = None) -> float:
    """Mean cost a tick of the true state and the board's torque."""
    w = weights or Weights()
    off = run.psi - run.reference
    parts = ((run.dtheta, w.dtheta_rad_s), (off, w.psi_rad), (run.dpsi, w.dpsi_rad_s), (run.u, w.torque_nm))
    return float(sum(np.mean((values / unit) ** 2) for values, unit in parts))


def judged(run: RigRun) -> Judged:
    """Both measures."""
    off, hoop = (float(np.sqrt(np.mean(values**2))) for values in (run.psi - run.reference, run.dtheta))
    return Judged(off, hoop, cost(run))


def race(folder: Path, controller: Path, scenario: Scenario, seeds: Sequence[int] = SEEDS) -> list[RigRun]:
    """One controller file through a scenario, once a seed."""
    sets = (*scenario.sets, f"control.file={controller}")
    return [
        run_rig(folder / f"{controller.stem}-{seed}", *sets, duration_s=scenario.duration_s, seed=seed)
        for seed in seeds
    ]
