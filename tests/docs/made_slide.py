"""A laboratory's recording of the slide of docs/guides/your_plant.md: `python made_slide.py FILE.csv`.

The carriage has dry friction, which the guide's plant file does not have. Integrated in steps of a tenth of a
millisecond by a rule of this file, so that nothing of the package made what it reads.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

MASS_KG, VISCOUS, DRY_N, LIMIT_N = 2.2, 3.4, 1.5, 20.0
STEP_S, FINE, SECONDS, NOISE_M = 0.02, 200, 24.0, 2e-5


def made(seed: int = 0) -> np.ndarray:
    """Rows of time in s, position in mm, force in N."""
    rng = np.random.default_rng(seed)
    samples = round(SECONDS / STEP_S)
    levels = rng.uniform(-0.4, 0.4, samples // 20 + 1) * LIMIT_N
    force = np.repeat(levels, 20)[:samples]
    x, v, rows = 0.0, 0.0, []
    for k in range(samples):
        rows.append((k * STEP_S, 1e3 * (x + NOISE_M * rng.standard_normal()), force[k]))
        for _ in range(FINE):
            x, v = _advanced(x, v, force[k], STEP_S / FINE)
    return np.array(rows)


def _advanced(x: float, v: float, force: float, h: float) -> tuple[float, float]:
    """Dry friction ends a motion within the step and holds what it can hold."""
    free = v + h * (force - VISCOUS * v) / MASS_KG
    most = h * DRY_N / MASS_KG
    after = 0.0 if abs(free) <= most else free - most * np.sign(free)
    return x + h * (v + after) / 2, after


if __name__ == "__main__":
    text = "\n".join(f"{t:.3f},{x:.4f},{f:.4f}" for t, x, f in made())
    Path(sys.argv[1]).write_text(f"time [s],position,drive\n{text}\n")
