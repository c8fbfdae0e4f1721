"""How old the ball's angle is in a recording that does not say it: the delay under which the filter predicts best.

Rules of this file: numbers in, numbers out; recordings are never changed in place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.experiments import prepare
from hoopd.ident.noise import NoiseModel
from hoopd.ident.prediction import PredictionSolution, fit_prediction_error
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]

# Whole ticks of 20 ms: the delayed samples fall on the nodes that are there.
DELAYS_S = (0.0, 0.02, 0.04, 0.06)


class DelayProfile(NamedTuple):
    """Log-likelihoods of the same samples under each delay, and the vertex of the parabola through the best three."""

    delays_s: Array  # (d,)
    log_likelihoods: Array  # (d,)
    best_s: float
    sd_s: float  # from the parabola's curvature; NaN at an end of the range
    solution: PredictionSolution  # of the best delay tried


def with_camera_delay(recording: Recording, delay_s: float) -> Recording:
    """The same with the ball's angles taken `delay_s` earlier than it says."""
    return replace(recording, psi_t=recording.psi_t - delay_s)


def delay_profile(
    structure: str,
    values: Mapping[str, float],
    names: Sequence[str],
    recordings: Sequence[Recording],
    delays_s: Sequence[float] = DELAYS_S,
    *,
    progress: Callable[[str], None] = lambda text: None,
) -> DelayProfile:
    """Prediction-error fit of `names` under each delay (increasing, evenly spaced, three or more)."""
    trimmed = [_without_first_pictures(recording, max(delays_s)) for recording in recordings]
    found: list[PredictionSolution] = []
    for delay in delays_s:
        runs = prepare([with_camera_delay(one, delay) for one in trimmed], ("theta", "psi"))
        # the last solution is a good place to begin
        start = found[-1].values if found else values
        levels = {name: found[-1].levels[name] for name in found[-1].noise_names} if found else {}
        found.append(fit_prediction_error(structure, start, names, runs, noise=NoiseModel(start=levels)))
        progress(f"delay {1e3 * delay:.0f} ms: log likelihood {found[-1].log_likelihood:.1f}")
    likelihoods = np.array([one.log_likelihood for one in found])
    best, sd = _vertex(np.asarray(delays_s, float), likelihoods)
    return DelayProfile(np.asarray(delays_s, float), likelihoods, best, sd, found[int(np.argmax(likelihoods))])


def _without_first_pictures(recording: Recording, longest_s: float) -> Recording:
    """No delay may lose a sample that another one keeps."""
    psi = np.where(recording.psi_t - longest_s < recording.t[0], np.nan, recording.psi)
    return replace(recording, psi=psi)


def _vertex(x: Array, y: Array) -> tuple[float, float]:
    top = int(np.argmax(y))
    if not 0 < top < len(x) - 1:
        return float(x[top]), float("nan")
    bend, slope, _ = np.polyfit(x[top - 1 : top + 2] - x[top], y[top - 1 : top + 2], 2)
    # log likelihood = top - (x - best)^2 / (2 sd^2)
    return float(x[top] - slope / (2 * bend)), float(1 / np.sqrt(-2 * bend))
