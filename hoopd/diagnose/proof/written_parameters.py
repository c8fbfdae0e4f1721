"""The parameters that a model is written with: those by which blocks of the training data that were held back are
simulated best.

The likelihood foretells the next reading, a model is simulated for seconds; where the model is right the same
parameters do both, and the likelihood's are the surer ones. Output error's scatter more, for free starts of windows
spend what a disturbance leaves. So the likelihood's are asked, and the user's own with the effects fitted beside them;
and where the model is shown to be wrong, by two estimates that are apart beyond chance (`two_estimates`), also those
that simulate windows best (output error), drawn to the user's by shares of the error. Each is fitted to two thirds of
every recording and simulates the third in windows. The best is taken, of those that a table shows as equally good the
one that stays nearest to the user's, and fitted to all.

Of the best, a parameter of the plant that is not surely another one than the user's (its interval, as wide as so many
parameters ask for, holds that) moves only where the blocks ask for it. It stays at the user's value if no channel is
then simulated surely worse, or by more than a point (`worse_channels`): first with all others as they are, then with
them fitted beside it; those that are missed least first, and all together against the best. What a recording tells only
in a sum, or by what its model is wrong by, is not carried to the next recording.

How far two estimates of a parameter are apart is what the model is wrong by, and widens the interval: what is written
and the likelihood's, and, beyond chance, the likelihood's and output error's, whichever is written.

Rules of this file: which effects there are is decided before; no held-out datum is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from statistics import NormalDist

import numpy as np

from hoopd.diagnose.proof.fit_tables import Played, nrmse
from hoopd.diagnose.proof.fold_runs import HeldBlock, Values, blocks_of, fold_runs
from hoopd.diagnose.proof.free_run_refinement import Pull, Refined, refine
from hoopd.diagnose.proof.two_estimates import beyond_chance
from hoopd.diagnose.proof.window_lengths import WINDOW_S
from hoopd.diagnose.proof.worse_channels import LEAST_POINTS, lowered
from hoopd.diagnose.search.folds import FOLDS, fold_values
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretch_scatter import half_widths
from hoopd.plants.scales import parameter_size
from hoopd.plots.number_format import listed

Progress = Callable[[str], None]

# Drawn to the user's: a parameter that is as far off as it is believed to be costs this share of the runs' error.
DRAWN = (1.0, 0.1, 0.01)
# Of a parameter of which nobody said how well it is known.
BELIEVED = 1.0
# That a parameter is told to have moved which has not.
CHANCE = 0.05
# What is compared is refined until a step takes less than this share of the error.
ROUGHLY = 3e-3


@dataclass(frozen=True)
class Written:
    """What a model is written from, and why with these parameters."""

    fit: HypothesisFit
    note: str = ""


Held = Callable[[Sequence[str], bool], "ParameterSet"]


@dataclass(frozen=True)
class ParameterSet:
    """A set of parameters, and how it was come by."""

    kind: str
    values: Mapping[str, float]
    runs: Played  # of each block, fitted without it
    percent: float  # of fit of the blocks, the mean over recordings and channels
    held: Held  # with these parameters of the plant as the user gave them, the others as they are or fitted


def written_parameters(
    found: HypothesisFit, users: Mapping[str, float], progress: Progress = lambda text: None
) -> Written:
    """The fit with the parameters that simulate best what was held back.

    Parameters
    ----------
    found
        The fit with the effects that are written.
    users
        Parameters of the plant as the user gave them.
    """
    if not found.free or not any(blocks_of(found)):
        return Written(found)
    base = [name for name in found.free if name in users and _size(found, name) > 0.0]
    freely = _simulated(found, found.values, blocks_of(found), None, found.free) if base else None
    wrong = beyond_chance(found, freely) if freely is not None else {}
    each = []
    for one in _candidates(found, users, base, freely.cost if freely is not None and any(wrong.values()) else None):
        progress(f"parameters of the model: {one.kind} {one.percent:.1f} %")
        each.append(one)
    best = chosen(each)
    least, stay = least_moved(best, _unsure(found, best.values, users, base, wrong), progress)
    return Written(_with(found, least.values, wrong), _note(best, each) + _staying(stay, least))


def chosen(each: Sequence[ParameterSet]) -> ParameterSet:
    """The first, in the order from the user's own on, that is as good as any."""
    most = max((one.percent for one in each if np.isfinite(one.percent)), default=np.nan)
    return next((one for one in each if one.percent >= most - LEAST_POINTS), each[-1])


def _unsure(
    found: HypothesisFit, values: Mapping[str, float], users: Mapping[str, float], base: Sequence[str],
    wrong: Mapping[str, float],
) -> list[str]:  # fmt: skip
    """Parameters that moved, and not surely: of all of them chance, and what the model is wrong by, moves one so far
    once in twenty."""
    half, each = half_widths(found), NormalDist().inv_cdf(1.0 - CHANCE / (2.0 * max(len(base), 1)))
    wide = each / NormalDist().inv_cdf(1.0 - CHANCE / 2.0)
    return [
        name
        for name in base
        if 0.0 < abs(values[name] - users[name]) <= np.hypot(wide * half[name], wrong.get(name, 0.0))
    ]


def least_moved(
    best: ParameterSet, base: Sequence[str], progress: Progress = lambda text: None
) -> tuple[ParameterSet, list[str]]:
    """The same with every parameter at the user's value that no channel of the blocks is surely worse with, and which.

    Each is asked beside those that stay already, always against the best.
    """
    now, stay = best, list[str]()
    for fitted in (False, True):
        asked = {}
        for name in (one for one in base if one not in stay):
            progress(f"whether {name} moves" + (", the others fitted beside it" if fitted else ""))
            asked[name] = best.held([*stay, name], fitted)
        before = [*stay]
        for name in sorted((one for one in asked if _as_good(asked[one], best)), key=lambda one: -asked[one].percent):
            tried = asked[name] if stay == before else best.held([*stay, name], fitted)
            if _as_good(tried, best):
                now, stay = tried, [*stay, name]
    return now, stay


def _as_good(tried: ParameterSet, best: ParameterSet) -> bool:
    return bool(np.isfinite(tried.percent)) and not lowered(best.runs, tried.runs)


def _candidates(
    found: HypothesisFit, users: Mapping[str, float], base: Sequence[str], error: float | None
) -> Iterator[ParameterSet]:
    """From the user's own on; `error`: that of what simulates best, drawn to nothing, where the model is wrong."""
    if base:
        yield _by_likelihood(found, users, base, base)
    if error is not None:
        for share in DRAWN:
            pull = Pull({n: users[n] for n in base}, {n: _size(found, n) for n in base}, share * error)
            yield _by_output_error(found, users, pull, share)
    yield _by_likelihood(found, users, base)


def _by_likelihood(
    found: HypothesisFit, users: Mapping[str, float], base: Sequence[str], held: Sequence[str] = ()
) -> ParameterSet:
    """`held`: of the plant's parameters those that are the user's, the others and the effects fitted beside them."""
    kind = "yours, effects beside them" if base and set(held) == set(base) else "the likelihood's"
    here = found
    if held:
        free = tuple(name for name in found.free if name not in held)
        values = {**found.values, **{name: users[name] for name in held}}
        stretches = [track.stretch for track in found.tracks]
        here = fit(stretches, found.effects, values, like=found, noise=found.noise, free=free)
    return _judged(found, kind, here.values, fold_values(here), users, partial(_by_likelihood, found, users, base))


def _by_output_error(
    found: HypothesisFit, users: Mapping[str, float], pull: Pull, share: float, held: Sequence[str] = ()
) -> ParameterSet:
    blocks, free = blocks_of(found), [name for name in found.free if name not in held]
    begin = {**found.values, **{name: users[name] for name in held}}
    whole = _simulated(found, begin, blocks, pull, free).values
    folds = [
        _simulated(found, whole, [one for j, one in enumerate(blocks) if j != k], pull, free).values
        for k in range(FOLDS)
    ]
    kind = f"output error, drawn to yours by {share:g} of it"
    return _judged(found, kind, whole, folds, users, partial(_by_output_error, found, users, pull, share))


def _simulated(
    found: HypothesisFit, values: Mapping[str, float], blocks: Sequence[Sequence[HeldBlock]], pull: Pull | None,
    free: Sequence[str],
) -> Refined:  # fmt: skip
    parts = [*chain(*blocks)]
    return refine(
        [one.stretch for one in parts], [one.reference for one in parts], found.effects, values, free, (WINDOW_S,),
        ROUGHLY, pull,
    )  # fmt: skip


def _judged(
    found: HypothesisFit, kind: str, values: Mapping[str, float], folds: Values, users: Mapping[str, float],
    fitted: Callable[[Sequence[str]], ParameterSet],
) -> ParameterSet:  # fmt: skip
    """`fitted`: the same with these as the user gave them, the others fitted beside them."""

    def with_held(names: Sequence[str], others: bool) -> ParameterSet:
        if others:
            return fitted(names)
        own = {name: users[name] for name in names}
        return _judged(found, kind, {**values, **own}, [{**one, **own} for one in folds], users, fitted)

    runs = fold_runs(found, folds)
    return ParameterSet(kind, values, runs, mean_percent(runs), with_held)


def mean_percent(runs: Played) -> float:
    """Of fit: the mean over recordings and channels."""
    each = [nrmse(one) for one in runs.by_recording().values()]
    known = [one for own in each for one in own.values() if np.isfinite(one)]
    return float(np.mean(known)) if known else float("nan")


def _size(found: HypothesisFit, name: str) -> float:
    """How far a parameter of a plant is believed to be off."""
    for plant in (track.stretch.plant for track in found.tracks):
        if name in plant.values:
            declared = abs(plant.values[name])
            return plant.beliefs.get(name, BELIEVED) * (declared or parameter_size(plant, name))
    return 0.0


def _with(found: HypothesisFit, values: Mapping[str, float], wrong: Mapping[str, float] | None = None) -> HypothesisFit:
    """The fit with these values; intervals about them hold what they are apart from the likelihood's by, and that from
    output error's (`wrong`), whichever is more."""
    apart = {name: max(found.values[name] - values[name], (wrong or {}).get(name, 0.0), key=abs) for name in found.free}
    widths = {name: float(np.hypot(half, apart[name])) for name, half in half_widths(found).items()}
    return replace(found, values={**found.values, **values}, widths=widths)


def _note(best: ParameterSet, each: Sequence[ParameterSet]) -> str:
    others = "; ".join(f"{one.kind}: {one.percent:.1f} %" for one in each if one is not best)
    return (
        f"parameters of the model are those of {best.kind}: they simulate best what was held back of the recordings, "
        f"block by block ({best.percent:.1f} %" + (f"; {others})" if others else ")")
    )


def _staying(stay: Sequence[str], least: ParameterSet) -> str:
    """Which parameters are the user's after all; empty where none is."""
    if not stay:
        return ""
    few = len(stay) == 1
    return (
        f"; of these {listed(stay)} {'stays' if few else 'stay'} yours: what was held back is simulated no worse "
        f"in any channel, by a point or surely, with {'it' if few else 'them'} ({least.percent:.1f} %)"
    )
