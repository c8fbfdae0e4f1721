"""A folder of recordings, as a laboratory has one: two runs of a hoop, one with a hostile name, and a broken file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from hoopd.recording.formats import save
from hoopd.recording.recording import from_columns

HOSTILE = "<img src=x onerror=window.broken=1>.csv"
TICK_S = 0.02


def lay_out(folder: Path, rows: int = 600) -> Path:
    """Write them."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for name in ("first.csv", "second.csv", HOSTILE):
        u = np.repeat(rng.choice([-0.05, 0.05], rows // 10), 10)
        dtheta = lfilter([0.0, 0.4], [1.0, -0.97], u) + 1e-3 * rng.standard_normal(rows)
        columns = {
            "t": TICK_S * np.arange(rows),
            "u": u,
            "theta": TICK_S * np.cumsum(dtheta),
            "dtheta": dtheta,
            "psi": 0.1 * dtheta,
        }
        save(from_columns(columns), folder / name)
    (folder / "broken.csv").write_text("no recording\n1\n", encoding="utf-8")
    (folder / "notes.txt").write_text("no recording either\n", encoding="utf-8")
    return folder
