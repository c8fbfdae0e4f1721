"""A run of the whole daemon in lock-step, in this process: bytes, board, camera; judged by the plant's true state.

Rules of this file: what comes back is what the plant and the board did, not what the daemon believed.
"""

from __future__ import annotations

import contextlib
import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.daemon.app import Options, run_daemon
from hoopd.recording.mcap import read
from hoopd.sim import torque_log, truth

Column = NDArray[np.float64]


@dataclass(frozen=True)
class RigRun:
    """One row a tick, from the release on; torque as the board's own log has it."""

    t: Column  # s, zero at the board's first torque
    dtheta: Column  # rad/s, true
    psi: Column  # rad, true
    dpsi: Column  # rad/s, true
    u: Column  # N m, applied from this tick on
    psi_seen: Column  # rad, as the camera saw it, NaN without a new picture
    reference: Column  # rad
    torque: torque_log.TorqueLog
    summary: dict[str, Any]

    def settled_s(self, values: Column, bound: float, start_s: float = 0.0) -> float:
        """Seconds after `start_s` from which |values| stays below the bound; inf when it never does."""
        outside = np.flatnonzero((np.abs(values) >= bound) & (self.t >= start_s))
        if len(outside) == 0:
            return 0.0
        following = outside[-1] + 1
        return float(self.t[following] - start_s) if following < len(self.t) else float("inf")

    def after(self, start_s: float) -> NDArray[np.bool_]:
        """Rows from here on."""
        return self.t >= start_s


def run_rig(
    folder: Path, *sets: str, duration_s: float, pictures: bool = False, seed: int = 0, config: Path | None = None
) -> RigRun:
    """Run the daemon with `sets`; times of the result end where it was asked to stop."""
    folder.mkdir(parents=True, exist_ok=True)
    options = Options(
        sim=True,
        config=config,
        sets=(*sets, f"sim.directory={folder}", "log.level=error"),
        duration_s=duration_s,
        record=folder,
        seed=seed,
        speed="max",
        direct=not pictures,
    )
    summary = _quietly(options)
    log = torque_log.read(folder / "torque.jsonl")
    state = truth.read(folder / "truth.csv")
    recording = read(folder / summary["recording"]["file"])
    rows = min(len(recording), int(np.searchsorted(state.t, duration_s - 1e-6)))
    # A request is on the wire for 0.7 ms: 2 ms after a tick its torque acts.
    u = np.array([log.torque_at(t + 0.002) for t in state.t[:rows]])
    first = int(np.argmax(u != 0.0)) if np.any(u) else 0
    part = slice(first, rows)
    return RigRun(
        state.t[part] - state.t[first],
        state.dtheta[part],
        state.psi[part],
        state.dpsi[part],
        u[part],
        recording.psi[part],
        recording.extra["reference"][part],
        log,
        summary,
    )


def _quietly(options: Options) -> dict[str, Any]:
    """Run without the summary table; what the daemon sets for its own process goes back."""
    interval = sys.getswitchinterval()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return run_daemon(options)
    finally:
        sys.setswitchinterval(interval)
