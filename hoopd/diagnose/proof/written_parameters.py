"""The parameters that a model is written with: those by which blocks of the training data that were held back are
simulated best.

The likelihood foretells the next reading, a model is simulated for seconds; where the model is right the same
parameters do both, and the likelihood's are the surer ones. Output error's scatter more, for free starts of windows
spend what a disturbance leaves. So the likelihood's are asked, and the user's own with the effects fitted beside them;
and where the model is shown to be wrong, by two estimates that are apart beyond chance (`two_estimates`), also those
that simulate windows best (output error), drawn to the user's by shares of the error. Each is fitted to two thirds of
every recording and simulates the third in windows. The best is taken, of those that a table shows as equally good the
one that stays nearest to the user's, and fitted to all.

How far two estimates of a parameter are apart is what the model is wrong by, and widens the interval: what is written
and the likelihood's, and, beyond chance, the likelihood's and output error's, whichever is written.

Rules of this file: which effects there are is decided before; no held-out datum is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from hoopd.diagnose.proof.fit_tables import Played, nrmse
from hoopd.diagnose.proof.fold_runs import HeldBlock, Values, blocks_of, fold_runs
from hoopd.diagnose.proof.free_run_refinement import Pull, Refined, refine
from hoopd.diagnose.proof.two_estimates import beyond_chance
from hoopd.diagnose.proof.window_lengths import WINDOW_S
from hoopd.diagnose.proof.worse_channels import LEAST_POINTS
from hoopd.diagnose.search.folds import FOLDS, fold_values
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretch_scatter import half_widths
from hoopd.plants.scales import parameter_size

Progress = Callable[[str], None]

# Drawn to the user's: a parameter that is as far off as it is believed to be costs this share of the runs' error.
DRAWN = (1.0, 0.1, 0.01)
# Of a parameter of which nobody said how well it is known.
BELIEVED = 1.0
# What is compared is refined until a step takes less than this share of the error.
ROUGHLY = 3e-3


@dataclass(frozen=True)
class Written:
    """What a model is written from, and why with these parameters."""

    fit: HypothesisFit
    note: str = ""


@dataclass(frozen=True)
class ParameterSet:
    """A set of parameters, and how it was come by."""

    kind: str
    values: Mapping[str, float]
    folds: Values  # of each block, fitted without it
    percent: float  # of fit of the blocks, the mean over recordings and channels


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
    freely = _simulated(found, found.values, blocks_of(found), None) if base else None
    wrong = beyond_chance(found, freely) if freely is not None else {}
    each = []
    for one in _candidates(found, users, base, freely.cost if freely is not None and any(wrong.values()) else None):
        progress(f"parameters of the model: {one.kind} {one.percent:.1f} %")
        each.append(one)
    best = chosen(each)
    return Written(_with(found, best.values, wrong), _note(best, each))


def chosen(each: Sequence[ParameterSet]) -> ParameterSet:
    """The first, in the order from the user's own on, that is as good as any."""
    most = max((one.percent for one in each if np.isfinite(one.percent)), default=np.nan)
    return next((one for one in each if one.percent >= most - LEAST_POINTS), each[-1])


def _candidates(
    found: HypothesisFit, users: Mapping[str, float], base: Sequence[str], error: float | None
) -> Iterator[ParameterSet]:
    """From the user's own on; `error`: that of what simulates best, drawn to nothing, where the model is wrong."""
    if base:
        yield _yours(found, users, base)
    if error is not None:
        for share in DRAWN:
            pull = Pull({n: users[n] for n in base}, {n: _size(found, n) for n in base}, share * error)
            yield _by_output_error(found, pull, share)
    yield _judged(found, "the likelihood's", found.values, fold_values(found))


def _yours(found: HypothesisFit, users: Mapping[str, float], base: Sequence[str]) -> ParameterSet:
    """The user's own parameters of the plant, effects fitted beside them."""
    own = tuple(name for name in found.free if name not in base)
    stretches = [track.stretch for track in found.tracks]
    held = {**found.values, **{name: users[name] for name in base}}
    yours = fit(stretches, found.effects, held, like=found, noise=found.noise, free=own)
    return _judged(found, "yours, effects beside them", yours.values, fold_values(yours))


def _by_output_error(found: HypothesisFit, pull: Pull, share: float) -> ParameterSet:
    blocks = blocks_of(found)
    whole = _simulated(found, found.values, blocks, pull).values
    folds = [
        _simulated(found, whole, [one for j, one in enumerate(blocks) if j != k], pull).values for k in range(FOLDS)
    ]
    return _judged(found, f"output error, drawn to yours by {share:g} of it", whole, folds)


def _simulated(
    found: HypothesisFit, values: Mapping[str, float], blocks: Sequence[Sequence[HeldBlock]], pull: Pull | None
) -> Refined:
    parts = [*chain(*blocks)]
    return refine(
        [one.stretch for one in parts], [one.reference for one in parts], found.effects, values, found.free,
        (WINDOW_S,), ROUGHLY, pull,
    )  # fmt: skip


def _judged(found: HypothesisFit, kind: str, values: Mapping[str, float], folds: Values) -> ParameterSet:
    return ParameterSet(kind, values, folds, mean_percent(fold_runs(found, folds)))


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
