"""Why held-out data deny a name: a channel that they are simulated worse with, or log-likelihood that they lose by it.

A channel that is simulated worse counts where no other one is simulated better by more: without its friction a hoop may
turn on and on, and its ball be followed a little better all the same.

Two questions, for one does not answer the other: readings one after the other may be foretold better while a free run
of seconds is worse, and a run may be as good while what was fitted to the training data is refused, nat by nat.

Rules of this file: two hypotheses on the held-out data in, a denial or none out; what follows is in `confirmation`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil, log10

from hoopd.diagnose.proof.error_windows import window_of_the_loss
from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.search.candidates import UNSEEN_LOSS, UNSEEN_SHARE
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

# A name whose surprise is so many times the threshold is no chance, whatever a simulation makes of it.
STRONG = 2.0
# One whose surprise is so many times that is of something that happened, though it be in the training data alone, where
# what the held-out data lose is no more than this part of it.
CERTAIN, LESS = 4.0, 0.5
# Times in words: to this share of a window.
OF_A_WINDOW = 0.1


@dataclass(frozen=True)
class Denial:
    """What held-out data have against a name."""

    points: Mapping[str, float]  # of fit lost, by channel
    nats: float = 0.0  # that the held-out data gain by it
    is_refuted: bool = False  # they lose more than chance, or another effect that is still missing, explains
    # by channel, where one carries most of the loss: recording, start and end, s
    windows: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """In words."""
        worse = " and ".join(
            f"{channel} by {points:.1f} points{self._most_of_it(channel)}" for channel, points in self.points.items()
        )
        parts = [f"the held-out data lose {-self.nats:.1f} nats with it"] if self.is_refuted else []
        parts += [f"with it the simulation of the held-out data is worse: {worse}"] if worse else []
        return "; ".join(parts)

    def _most_of_it(self, channel: str) -> str:
        if channel not in self.windows:
            return ""
        recording, start, end = self.windows[channel]
        places = max(0, ceil(-log10(OF_A_WINDOW * max(end - start, 1e-12))))
        return f" (most of it at {start:.{places}f} to {end:.{places}f} s of {recording.rsplit('/', 1)[-1]})"

    def leaves_evidence(self, surprise: float, threshold: float) -> bool:
        """Whether something is there all the same: the training data say so far beyond chance, or the held-out data
        bear it out reading by reading. What these refuse altogether has to be certain of the training data."""
        if self.is_refuted:
            return surprise >= CERTAIN * threshold and -self.nats <= LESS * surprise
        return self.asks_for_another(surprise, threshold)

    def asks_for_another(self, surprise: float, threshold: float) -> bool:
        """Whether another name is to be looked for: not in the place of one that chance may have brought."""
        return surprise >= STRONG * threshold or self.nats >= UNSEEN_LOSS


def denial(before: Played, after: Played, gain: float, names: int = 1, seed: int = 0) -> Denial | None:
    """Of a name that the second hypothesis has and the first has not; None where nothing speaks against it.

    `gain`: nats that it explains of the training data; `names`: how many are asked about.
    """
    points, nats = lowered(before, after, seed, names), before.fit.criterion - after.fit.criterion
    raised = lowered(after, before, seed, names)
    if sum(points.values()) < sum(raised.values()):
        points = {}  # outweighed: what is taken from one channel another one gets back, and more
    # the rule by which folds of the training data refuse a name
    most = max(UNSEEN_LOSS, UNSEEN_SHARE * gain)
    if nats < -most:
        nats = max(nats, _gained_at_the_same_noise(before.fit, after.fit))
    # what a simulation is surely worse without is not refuted by what a filter makes of it
    refuted = nats < -most and (bool(points) or not raised)
    if not points and not refuted:
        return None
    windows = {channel: window_of_the_loss(before, after, channel) for channel in points}
    return Denial(points, nats, refuted, {channel: one for channel, one in windows.items() if one is not None})


def _gained_at_the_same_noise(before: HypothesisFit, after: HypothesisFit) -> float:
    """Nats, the noise of the second hypothesis sought from that of the first: a search from a first guess may end at
    levels that are far from the likeliest."""
    stretches = [track.stretch for track in after.tracks]
    again = fit(stretches, after.effects, after.values, free=after.free, noise=before.noise)
    return before.criterion - again.criterion
