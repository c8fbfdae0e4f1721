"""Which names blocks of the training data speak against, simulated with parameters fitted to the other blocks.

A larger model that foretells the next reading better need not have learnt what moves the plant for seconds. Of most
laws it is asked whether windows are worse with them beyond noise: a single window, in which something that has no
name moves the plant, says nothing about a friction. A law with a phase that moves the plant (a cogging) has to bring
a sure gain, and one run over each block may not be a point worse with it: a simulation that has lost the angle by
part of a period is farther off with it than without, and another recording is where it will be off. A sensor's error
moves nothing.

Laws without a phase are taken out one at a time beside each other, the one that costs most first: what a friction and
a delay say together, neither may say alone. The others are then taken up one at a time, the one with the most evidence
first, each beside those that are kept; so two that do harm together are told, though each of them does little beside
the other. What held-out data deny is not among them: it would be asked what a name costs beside a wrong one.

Rules of this file: fits of the training data in, names out; what follows from them is decided in `confirmation`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import inf

from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.fold_runs import fold_runs
from hoopd.diagnose.proof.window_lengths import WINDOW_S
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

SENSOR = "sensor"
# A fit's blocks, simulated in windows of a length; None: in one run each.
Play = Callable[[HypothesisFit, float | None], Played]
# Points of fit by channel that a name costs; none where it brings no sure gain, and needs one.
Lost = Mapping[str, float]


def simulated_worse(named: Named, asked: Collection[str], seed: int = 0) -> dict[str, Lost]:
    """Names, of those that are `asked` about, that blocks of the training data are better simulated without.

    Returns
    -------
    dict of str to mapping of str to float
        By name: points of fit that a channel loses.
    """
    accepted = sorted(
        (one.effect for one in named.accepted if one.effect.name in asked), key=lambda one: -named.losses[one.name]
    )
    play, left = _Played(), dict[str, Lost]()
    kept = [one for one in accepted if not is_wave(one)]
    while costly := _costly(named, kept, play, seed, len(accepted)):
        worst = max(costly, key=lambda one: sum(costly[one].values()))
        left[worst] = costly[worst]
        kept = [one for one in kept if one.name != worst]
    for wave in filter(is_wave, accepted):
        lost = harm(play, fitted_with(named, kept), fitted_with(named, [*kept, wave]), wave, seed, len(accepted))
        if lost is None:
            kept.append(wave)
        else:
            left[wave.name] = lost
    return left


def _costly(named: Named, kept: Sequence[Effect], play: Play, seed: int, names: int) -> dict[str, Lost]:
    """What each costs beside the others, of those that cost anything."""
    found: dict[str, Lost] = {}
    for effect in kept:
        rest = [one for one in kept if one is not effect]
        lost = harm(play, fitted_with(named, rest), fitted_with(named, kept), effect, seed, names)
        if lost is not None:
            found[effect.name] = lost
    return found


class _Played:
    """Runs that were made already."""

    def __init__(self) -> None:
        # with the fits themselves: the address of one that is gone is soon another's
        self._known: dict[tuple[int, float | None], tuple[HypothesisFit, Played]] = {}

    def __call__(self, found: HypothesisFit, length_s: float | None) -> Played:
        key = id(found), length_s
        if key not in self._known:
            self._known[key] = found, fold_runs(found, length_s=length_s)
        return self._known[key][1]


def reason_of(lost: Lost) -> str:
    """In words."""
    if not lost:
        return (
            "blocks of the training data that were held back are not surely simulated better with it, "
            "and where it is off by part of its period it does harm"
        )
    worse = " and ".join(f"{channel} by {points:.1f} points" for channel, points in lost.items())
    return f"with it blocks of the training data that were held back are simulated worse: {worse}"


def harm(play: Play, before: HypothesisFit, after: HypothesisFit, effect: Effect, seed: int, names: int) -> Lost | None:
    """What blocks have against an effect, which only `after` has; None where there is nothing.

    A channel that is worse counts where no other one is better by more.
    """
    one, other = play(before, WINDOW_S), play(after, WINDOW_S)
    lost, gained = (lowered(*pair, seed, names, inf) for pair in ((one, other), (other, one)))
    if sum(lost.values()) > sum(gained.values()):
        return lost
    if not (is_wave(effect) and moves(effect, after)):
        return None
    return {} if not gained or lowered(play(before, None), play(after, None), seed, names) else None


def moves(effect: Effect, found: HypothesisFit) -> bool:
    """Whether it acts on the plant, and not on what is read of it alone."""
    slots = {name: slot for track in found.tracks for name, slot in track.stretch.plant.slots.items()}
    return effect.slot not in slots or slots[effect.slot].kind != SENSOR


def is_wave(effect: Effect) -> bool:
    """Whether it comes again and again along its variable. A simulation that has lost the variable by part of a period
    is farther off with such a law than without it: it has to be right about where it is."""
    return any(p.role == "phase" for p in effect.parameters)


def fitted_with(named: Named, effects: Sequence[Effect]) -> HypothesisFit:
    """The base with these effects; a fit that was made already is taken."""
    names = {*named.base.names, *(one.name for one in effects)}
    for found in (named.base, named.final, *named.without.values(), *named.others):
        if {*found.names} == names:
            return found
    every, final = (*named.base.effects, *effects), named.final
    stretches = [track.stretch for track in final.tracks]
    named.others.append(fit(stretches, every, final.values, like=final, noise=final.noise))
    return named.others[-1]
