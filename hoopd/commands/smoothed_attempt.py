"""One recorded attempt of a planned motion as the plan sees it: smoothed states at the edges of its ticks.

Rules of this file: ValueError says why nothing can be learned of a recording; nothing is learned here.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.core.controllers import DONE
from hoopd.daemon.maneuver import recorded_maneuvers
from hoopd.diagnose.inputs import source_of
from hoopd.files.trajectory import TrajectoryFile
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.likelihood.fitting import fit
from hoopd.recording.mcap import read, read_run

Array = NDArray[np.float64]

# Of the recording around an attempt, s, so that the smoother knows what was before and after.
MARGIN_S = 1.0
# A tick that is longer or shorter by this share was missed, or is none.
UNEVEN = 0.2


class SmoothedAttempt(NamedTuple):
    """A row a tick, from the plan's first to the edge behind its last."""

    states: Array  # (n + 1, 4) smoothed, theta as the encoder counts it
    zero: Array  # (4,) of the plan in them: where the hoop began, and the bottom that the ball was at
    estimates: Array  # (n, 4) of the filter
    torques: Array  # (n,) N m

    @property
    def planned_states(self) -> Array:
        """(n + 1, 4) of the plan's own zero."""
        return self.states - self.zero


def smoothed_attempt(path: Path, trajectory: TrajectoryFile, model: FoundEffects) -> SmoothedAttempt:
    """The first maneuver of a recording, smoothed by the likelihood of a diagnosis on the plan's model."""
    run, reason = recorded_maneuvers(read_run(path))[0]
    n, tick_s = len(trajectory.plan.torques_nm), trajectory.sample_time_s
    if reason != DONE:
        raise ValueError(reason)
    if int((run.t < run.ended_t - 1e-9).sum()) != n or len(run.t) <= n:
        raise ValueError("rows of it are missing in the recording")
    edges = run.t[: n + 1]
    if np.abs(np.diff(edges) - tick_s).max() > UNEVEN * tick_s:
        raise ValueError("a tick was missed")
    zero = np.array([run.states[0, 0], 0.0, run.bottom, 0.0])
    return SmoothedAttempt(_states_at(model, path, edges), zero, run.states[:n], run.torques[:n])


def _states_at(model: FoundEffects, path: Path, t: Array) -> Array:
    """(n, 4) states at times of a recording, with disturbances as large as the model needs."""
    recording = read(path)
    begin = float(recording.t[0])
    first, last = t[0] - begin, t[-1] - begin
    stretches = source_of(str(path), recording, model.plant).stretches
    whole = next((part for part in stretches if part.t[0] <= first and last <= part.t[-1]), None)
    if whole is None:
        raise ValueError("its readings have a gap")
    part = whole.seconds(first - MARGIN_S, last + MARGIN_S)
    smooth = fit([part], model.effects(), model.values, free=(), move=False)
    track = smooth.tracks[0]
    if not (np.isfinite(smooth.stacked()).all() and np.isfinite(track.z).all()):
        raise ValueError("the plan's model does not follow it")
    return np.column_stack([np.interp(t, track.stretch.t + begin, track.z[:, i]) for i in range(4)])
