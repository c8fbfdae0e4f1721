"""Subspace identification from time data: MOESP, N4SID, CVA and IVM, with a Kalman gain.

What is not given is chosen: the direct term by a test of the long autoregression, order, horizon, weighting and steps
of refinement by prediction of data held back (`choice`). An order that is given is taken with the usual horizon, unless
that leads to an unstable model or one that simulates far worse than it predicts: then the horizon is chosen, too.
Gauss-Newton steps on the prediction error (`refine`) bring the fit of 5,000 samples with 10 % noise from 0.02 to 0.005
points of the best.

Rules of this file: what makes the answer doubtful is a warning that names the cause; what makes it void a ValueError.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import check_channels
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import chosen, estimated
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations
from hoopd.ident.simulationcheck import check_simulation, simulates_worse
from hoopd.ident.statespace import heldback, projection
from hoopd.ident.statespace.choice import CandidateRange, choose, horizons_of
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.ordering import check_order, check_windows, has_direct_term, split_of
from hoopd.ident.statespace.projection import WEIGHTINGS, Weighting
from hoopd.ident.statespace.structure_choice import StructureChoice
from hoopd.ident.statespace.subspacefit import Focus, Goal, SubspaceEstimate, WindowedData, estimate, refined

Array = NDArray[np.float64]

LEAST_NOISE = 1e-4  # of an output: data with less are taken as if they had so much


@dataclass(frozen=True)
class SubspaceChoice:
    """How the estimate is asked for; see `subspaceid`."""

    order: int | None
    weighting: Weighting | None
    horizon: int | None
    most_order: int
    direct: bool | None
    goal: Goal
    refine: int | Literal["held back"] | None
    disturbance: bool


@dataclass(frozen=True)
class ChannelScale:
    """What inputs and outputs are divided by."""

    u: Array
    y: Array


@estimated("subspace")
def subspaceid(
    data: Data | Sequence[Data],
    order: int | None = None,
    *,
    weighting: Weighting | None = None,
    horizon: int | None = None,
    most_order: int = 10,
    direct: bool | None = None,
    focus: Focus = "prediction",
    stable: bool | float = False,
    scale: bool = True,
    refine: int | Literal["held back"] | None = None,
    disturbance: bool = True,
) -> Innovations:
    """Identify a state-space model from time data by subspaces: CVA, MOESP, N4SID or IVM, with a Kalman gain.

    Moments of all windows, LQ factor, weighted singular values, A and C by shift invariance, noise covariances and the
    gain by the Riccati equation, B, D and x0 by least squares. What is not given is chosen by prediction of thirds of
    the record that are held back, one step and ten steps ahead and in simulation; `choice` of the result tells what.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; of missing outputs only windows without gaps are used.
    order : int, optional
        States; up to `most_order` where it is chosen.
    weighting : {"CVA", "MOESP", "N4SID", "IVM"}, optional
        Of the singular value decomposition; CVA where the order is given, CVA or MOESP where it is chosen.
    horizon : int, optional
        Samples of past and future. Where it is chosen with an order that is given: twice the lags of the
        autoregression of least AIC, and enough for the order; another one where that leads to an unstable model or one
        that simulates far worse than it predicts.
    most_order : int
        Largest order that is looked at.
    direct : bool, optional
        Whether D is estimated; unless given, where the inputs tell the outputs of their own sample beyond chance.
    focus : {"prediction", "simulation"}
        B, D, x0 (and with "prediction" K, by `refine` steps) fit the errors one step ahead or those of the simulation.
    stable : bool or float
        True, or the largest modulus that a pole may have.
    scale : bool
        Whether inputs are divided by their standard deviations meanwhile, outputs by their noise.
    refine : int or "held back", optional
        Gauss-Newton steps on all matrices afterwards: so many, or as many as foretell what is held back best; none
        where the order is given, "held back" where it is chosen. The bands of a model that was not refined are those of
        an efficient estimate, and up to a quarter too narrow.
    disturbance : bool
        Whether, where the order is chosen, outputs that wander may get a state for it, that no input reaches.

    Returns
    -------
    Innovations
        The model with its noise covariances `q`, `r`, `s`, the `x0` of the first experiment, the `singular_values` and
        the `choice`.

    Raises
    ------
    ValueError
        Data or options that give no model; what makes it doubtful is an `IdentificationWarning`.

    Notes
    -----
    Sources: Van Overschee & De Moor (1996); Ljung, System Identification, 1999, 10.6.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, subspaceid
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 1.0], [1.0, -1.5, 0.7], u) + 0.05 * e
    >>> model = subspaceid(iddata(y, u, 0.1), order=2)
    >>> np.poly(model.a).round(1), model.system.dcgain().round(1).item()  # 1/(1 - 1.5 + 0.7) = 5
    (array([ 1. , -1.5,  0.7]), 5.0)
    """
    if weighting is not None and weighting not in WEIGHTINGS:
        raise ValueError(f"weighting is one of {', '.join(WEIGHTINGS)}, not {weighting!r}")
    each = experiments(data)
    check_channels(each)
    options = SubspaceChoice(order, weighting, horizon, most_order, direct, Goal(focus, stable), refine, disturbance)
    _check_options(options)
    looped = check_record(each, drift=False)
    sizes = _scale(each, scale)
    scaled = [replace(_divided(one, sizes), dt=1.0, x=None) for one in each]
    split, level = split_of([part for one in scaled for part in runs(one)], order, horizon)
    # by their noise, so that an output that is mostly noise does not speak for the others
    noise = ChannelScale(np.ones(len(sizes.u)), np.maximum(level, LEAST_NOISE) if scale else np.ones(len(sizes.y)))
    model, choice = _estimated([_divided(one, noise) for one in scaled], split, options, looped)
    model = _multiplied(model, noise)
    check_model(model, sum(one.n for one in each))
    check_simulation(model, scaled)
    return replace(
        _multiplied(model, sizes), dt=each[0].dt, inputs=each[0].inputs, outputs=each[0].outputs, choice=choice
    )  # fmt: skip


def _check_options(options: SubspaceChoice) -> None:
    """ValueError for numbers that mean nothing."""
    for name in ("order", "horizon", "most_order"):
        value = getattr(options, name)
        if value is not None and (value < 1 or value != int(value)):
            raise ValueError(f"{name} is a whole number from 1 on, not {value}")
    if options.refine is not None and options.refine != "held back" and not options.refine >= 0:
        raise ValueError(f'refine is a number of steps or "held back", not {options.refine}')
    check_focus(options.goal.focus)
    check_stable(options.goal.stable)


def check_focus(focus: str) -> None:
    """ValueError for what is no focus."""
    if focus not in ("prediction", "simulation"):
        raise ValueError(f'focus is "prediction" or "simulation", not {focus!r}')


def check_stable(stable: bool | float) -> None:
    """ValueError for a limit of the poles that is none."""
    if not isinstance(stable, bool) and not stable > 0.0:
        raise ValueError(f"stable is True, False or the largest modulus of a pole, above 0, not {stable}")


def _estimated(
    each: Sequence[Data], split: projection.WindowSplit, options: SubspaceChoice, looped: bool
) -> tuple[Innovations, StructureChoice]:  # fmt: skip
    """The model of scaled experiments, and what was chosen."""
    parts = [part for one in each for part in runs(one)]
    windowed = WindowedData.of(parts, split)
    check_windows(windowed.factor, parts)
    direct = options.direct
    if direct is None:
        direct = has_direct_term(parts, split.past)
        if direct and looped:
            warn(
                "a direct term was found and feedback is suspected: where the input answers the output of its own "
                "sample, that answer looks like a direct term (direct=False leaves it out)"
            )
        chosen(
            f"{'a' if direct else 'no'} direct term, as inputs {'tell' if direct else 'do not tell'} outputs at once"
        )
    if options.order is None or options.refine == "held back":
        found = _by_what_is_held_back(each, parts, options, direct)
        if found is not None:
            return found
        order = _by_information(windowed, options) if options.order is None else options.order
        return _plain(windowed, order, options, direct)
    check_order(windowed.factor, options.order)
    model, choice = _plain(windowed, options.order, options, direct)
    if options.horizon is None and _needs_another_horizon(model, each):
        found = _by_what_is_held_back(each, parts, options, direct)
        if found is not None:
            return found
    return model, choice


def _plain(
    windowed: WindowedData, order: int, options: SubspaceChoice, direct: bool
) -> tuple[Innovations, StructureChoice]:  # fmt: skip
    """One estimate, nothing compared."""
    weighting: Weighting = options.weighting or "CVA"
    found = estimate(windowed, order, weighting, direct, options.goal)
    steps = 0 if options.refine is None or options.refine == "held back" else options.refine
    model = _stepped(found, direct, options.goal, steps)
    return model, StructureChoice(order, windowed.factor.split.future, weighting, direct, steps, {})


def _stepped(found: SubspaceEstimate, direct: bool, goal: Goal, steps: int) -> Innovations:
    return list(islice(refined(found, direct, goal), steps + 1))[-1]


def _by_information(windowed: WindowedData, options: SubspaceChoice) -> int:
    order = projection.choose_order(windowed.factor, min(options.most_order, windowed.most_order))
    check_order(windowed.factor, order)
    return order


def _by_what_is_held_back(
    each: Sequence[Data], parts: Sequence[Data], options: SubspaceChoice, direct: bool
) -> tuple[Innovations, StructureChoice] | None:  # fmt: skip
    """The choice by prediction of what was held back; None where the record is too short for it."""
    given = options.order is not None
    allowed = CandidateRange(
        [options.order] if options.order is not None else range(1, options.most_order + 1),
        [options.horizon] if options.horizon is not None else horizons_of(parts, options.order),
        [options.weighting] if options.weighting is not None else ["CVA", "MOESP"],
        direct, _steps_asked(options), options.goal, options.disturbance and not given,
    )  # fmt: skip
    found = choose(each, allowed)
    if found is None:
        return None
    chosen(str(found[1]))
    return found


def _steps_asked(options: SubspaceChoice) -> int | None:
    """None: as many as foretell best."""
    if options.refine == "held back":
        return None
    return 0 if options.order is not None and options.refine is None else options.refine


def _needs_another_horizon(model: Innovations, each: Sequence[Data]) -> bool:
    return radius(model.a) >= 1.0 or simulates_worse(model, [one[: heldback.MOST] for one in each])


def _scale(each: Sequence[Data], on: bool) -> ChannelScale:
    if not on:
        return ChannelScale(np.ones(each[0].nu), np.ones(each[0].ny))
    u = np.sqrt(np.mean([np.mean(np.square(one.u), axis=0) for one in each], axis=0))
    y = np.sqrt(np.mean([np.nanmean(np.square(one.y), axis=0) for one in each], axis=0))
    return ChannelScale(np.where(u > 0.0, u, 1.0), np.where(y > 0.0, y, 1.0))


def _divided(one: Data, by: ChannelScale) -> Data:
    return replace(one, u=one.u / by.u, y=one.y / by.y)


def _multiplied(model: Innovations, by: ChannelScale) -> Innovations:
    """The model of the channels in their own units."""
    y = by.y[:, None]
    return replace(
        model, b=model.b / by.u, c=y * model.c, d=y * model.d / by.u, k=model.k / by.y,
        r=None if model.r is None else y * model.r * by.y, s=None if model.s is None else model.s * by.y,
    )  # fmt: skip
