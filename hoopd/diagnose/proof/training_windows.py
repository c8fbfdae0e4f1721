"""Which names the training data themselves are simulated worse with, window by window.

A larger model that repeats its own data worse has not learnt what moves the plant for seconds: it has learnt what
foretells the next reading. A cogging may be there, and a simulation that has lost the angle by part of a tooth is
farther off with it than without.

Names are taken up one after the other, the one with the most evidence first, each fitted beside those that are kept;
one beside which any channel of the windows is surely worse is left. So two that do harm together are told, though each
of them does little beside the other.

Rules of this file: fits of the training data in, names out; what follows from them is decided in `confirmation`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

# The windows of a fit, simulated.
Play = Callable[[HypothesisFit], Played]


def simulated_worse(named: Named, play: Play, seed: int = 0) -> dict[str, dict[str, float]]:
    """Names that are left when all are taken up by the windows of the training data, and what each of them costs there.

    Returns
    -------
    dict of str to dict of str to float
        By name: points of fit that a channel loses.
    """
    kept, left = named.base, dict[str, dict[str, float]]()
    for one in sorted(named.accepted, key=lambda one: -named.losses[one.effect.name]):
        more = fitted_with(named, kept, one.effect)
        if lost := _harm(play(kept), play(more), seed, len(named.accepted)):
            left[one.effect.name] = lost
        else:
            kept = more
    return left


def reason_of(lost: Mapping[str, float]) -> str:
    """In words."""
    worse = " and ".join(f"{channel} by {points:.1f} points" for channel, points in lost.items())
    return f"with it the simulation of the training data is worse: {worse}"


def _harm(before: Played, after: Played, seed: int, names: int) -> dict[str, float]:
    """Points by channel that is worse; none where another is better by more."""
    lost = lowered(before, after, seed, names)
    return lost if sum(lost.values()) > sum(lowered(after, before, seed, names).values()) else {}


def fitted_with(named: Named, kept: HypothesisFit, effect: Effect) -> HypothesisFit:
    """One more effect fitted beside those that are kept; a fit that was made already is taken."""
    effects = (*kept.effects, effect)
    names = {one.name for one in effects}
    for found in (named.final, *named.without.values()):
        if {*found.names} == names:
            return found
    stretches = [track.stretch for track in kept.tracks]
    return fit(stretches, effects, {**named.final.values, **kept.values}, like=kept, noise=kept.noise)
