"""A hypothesis held to disturbances of a usual size, where the likeliest are so large that they explain everything.

An effect that is left out (a late camera, an uneven scale) makes the likeliest disturbance so large and fast that
the model may do what it likes between two readings: the base's parameters run away, and no screen about them sees
the effect, because the disturbance follows the readings just as well. Held to disturbances of a usual size the fit is
nearly one of simulation error; what it proposes is judged by the likelihood afterwards, like every proposal.

Rules of this file: it proposes and decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hoopd.diagnose.search.screen import Score
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.noise_tuning import first_noise

# Disturbances this many times the usual one are far beyond it.
FAR_BEYOND = 3.0
# No less than this share of what the inputs hold is usual: a plant that is held against its weight moves slowly, and
# what its coil is off by is a share of the weight.
BALANCED_SHARE = 0.01


def usual_noise(found: HypothesisFit) -> dict[str, Noise]:
    """By recording: disturbances of a usual size, by how the plant usually moves and by what its inputs hold."""
    usual = first_noise(found.tracks, found.values)
    for track in found.tracks:
        known = usual[track.stretch.recording]
        by_force = track.mobility(found.values)
        share = BALANCED_SHARE * track.balanced(found.values) / np.where(by_force > 0.0, by_force, np.inf)
        force = np.maximum(known.force, np.pad(share, (0, len(known.force) - len(share))))
        usual[track.stretch.recording] = known._replace(force=force)
    return usual


def far_beyond(found: HypothesisFit) -> bool:
    """Whether any recording's disturbances are far beyond the usual."""
    usual = usual_noise(found)
    return any(bool(np.any(noise.force > FAR_BEYOND * usual[name].force)) for name, noise in found.noise.items())


def stiffened(found: HypothesisFit) -> HypothesisFit:
    """The same hypothesis on the same stretches, fitted with disturbances that are not beyond the usual."""
    usual = usual_noise(found)
    noise = {name: _no_more(one, usual[name]) for name, one in found.noise.items()}
    stretches = [track.stretch for track in found.tracks]
    return fit(stretches, found.effects, found.values, like=found, noise=noise, free=found.free, tune_noise=False)


def likeliest(found: HypothesisFit, start: HypothesisFit | None = None) -> HypothesisFit:
    """The fit, or one that starts from where usual disturbances lead, or `start` itself, whichever is likeliest.

    `start`: parameters as given, with the same effects on the same stretches; no fit is to end less likely than there.
    """
    every = [found]
    if far_beyond(found):
        every.append(_again(stiffened(found), found.free))
    if start is not None and not min(one.criterion for one in every) <= start.criterion:
        every += [_again(start, found.free), start]
    return min(every, key=lambda one: one.criterion)


def _again(origin: HypothesisFit, free: Sequence[str]) -> HypothesisFit:
    """Everything fitted from another fit's end."""
    stretches = [track.stretch for track in origin.tracks]
    return fit(stretches, origin.effects, origin.values, like=origin, noise=origin.noise, free=free)


def unexplained_sentences(found: HypothesisFit) -> list[str]:
    """A line for each disturbance that is far beyond the usual: so much force is explained by nothing."""
    usual, out = usual_noise(found), []
    plants = {track.stretch.recording: track.stretch.plant for track in found.tracks}
    for recording, noise in found.noise.items():
        plant, least = plants[recording], usual[recording].force
        for name, size, time_s, known in zip(plant.disturbed, noise.force, noise.time_s, least, strict=True):
            if size > FAR_BEYOND * known:
                force = f"{size:.3g} {plant.disturbance_unit(name)}"
                out.append(
                    f"{recording}: a disturbance of {force} that lasts {time_s:.2g} s moves {name}, "
                    f"{size / known:.0f} times the usual: so much is explained by nothing that was named."
                )
    return out


def _no_more(noise: Noise, usual: Noise) -> Noise:
    large = noise.force > usual.force
    return Noise(np.minimum(noise.force, usual.force), np.where(large, usual.time_s, noise.time_s), noise.reading)


def deflated(scores: Sequence[Score], about: HypothesisFit) -> list[Score]:
    """Gains in units of what the fit itself leaves: its rows are no longer of unit variance."""
    excess = left_variance(about)
    return [replace(one, gain=one.gain / excess) for one in scores]


def left_variance(about: HypothesisFit) -> float:
    """Of a fit's whitened rows, 1 and more: how much of them its own noise does not explain."""
    rows = about.stacked()[:, 0]
    return max(float(rows @ rows) / max(int(np.count_nonzero(rows)), 1), 1.0)
