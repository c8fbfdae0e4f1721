"""How far the parameters of the likelihood and those that simulate windows best are apart, beyond chance.

Both estimate the same numbers where the model is right: then the likelihood's are the better ones, and the two differ
by no more than output error scatters from window to window (Hausman, Specification tests in econometrics,
Econometrica 46, 1978). Where they differ by more, the model is wrong, each of them in its own way: one weighs the next
reading, the other seconds. A single recording that is wrong all along shows it here alone, for its stretches agree.

Rules of this file: estimates in, differences out; what they widen is decided in `written_parameters`.
"""

from __future__ import annotations

import numpy as np

from hoopd.diagnose.proof.free_run_refinement import PRIOR_SIZE, PRIOR_WEIGHT, Refined, sizes, window_pieces
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.stretch_scatter import FEWEST, scatter, student


def beyond_chance(found: HypothesisFit, simulated: Refined) -> dict[str, float]:
    """By name: the likelihood's number less that of output error, 0 where chance explains the difference.

    Parameters
    ----------
    found
        The fit by the likelihood.
    simulated
        The same parameters fitted to windows, drawn to nothing.

    Returns
    -------
    dict of str to float
        Of every free parameter, in its unit. Once in twenty a right model has a difference.
    """
    if not np.isfinite(simulated.cost):
        return dict.fromkeys(found.free, 0.0)
    scale = sizes(simulated.values, found.free, found.effects, [track.stretch.plant for track in found.tracks])
    few = np.eye(len(found.free)) * PRIOR_WEIGHT / PRIOR_SIZE**2
    spread, freedom = scatter(window_pieces(simulated, scale), few, np.zeros(len(found.free)))
    return {
        name: apart if freedom[i] >= FEWEST - 1.0 and abs(apart) > student(freedom[i]) * spread[i] * scale[i] else 0.0
        for i, name in enumerate(found.free)
        for apart in [_apart(found, simulated, name)]
    }


def _apart(found: HypothesisFit, simulated: Refined, name: str) -> float:
    """An angle the short way round."""
    apart = found.values[name] - simulated.values[name]
    own = {effect.key(p.name): p for effect in found.effects for p in effect.parameters}
    phase = plain(name) in own and own[plain(name)].role == "phase"
    return float(np.angle(np.exp(1j * apart))) if phase else apart
