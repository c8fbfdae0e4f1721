"""Prediction error estimate of a state-space model in innovation form, all matrices free.

Minimises sum_t |W e(t)|^2 (or another loss) over the minimal local coordinates of the model, by damped Gauss-Newton
from a subspace estimate (Ljung, 1999, chapters 7 and 10). W is the inverse root of the errors' covariance, renewed
until it is settled: that is the least determinant of the covariance, maximum likelihood for normal innovations.

Rules of this file: what is asked for and cannot be had is a ValueError; the data are not changed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.checks import check_channels, unsettled
from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.estimation_report import chosen, estimated
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import check_model
from hoopd.ident.models import Innovations
from hoopd.ident.simulationcheck import check_simulation, simulates_worse
from hoopd.ident.statespace import coordinates, gaussnewton, losses
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.gaussnewton import PemPoint, PemProblem
from hoopd.ident.statespace.incomplete import likeliest_model
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.losses import Loss
from hoopd.ident.statespace.ordering import check_states
from hoopd.ident.statespace.sensitivities import Piece, paired, piece
from hoopd.ident.statespace.subspace import check_focus, check_stable, subspaceid
from hoopd.ident.statespace.subspacefit import Focus
from hoopd.ident.statespace.uncertainty import coordinates_covariance

Array = NDArray[np.float64]

ROUNDS = 4  # of weights; the covariance settles in two or three
SETTLED = 1e-3  # relative change of the covariance


@dataclass(frozen=True)
class PemSettings:
    """How the minimum is looked for; see `pem`."""

    focus: Focus
    loss: Loss | None
    weight: Array | None
    iterations: int
    tolerance: float


@estimated("prediction errors (PEM)")
def pem(
    data: Data | Sequence[Data],
    order: int | None = None,
    *,
    start: Innovations | None = None,
    direct: bool | None = None,
    focus: Focus = "prediction",
    horizon: int = 1,
    x0: Literal["estimate", "zero"] = "estimate",
    loss: str | Loss | None = None,
    weight: ArrayLike | None = None,
    regulariser: Callable[[Innovations], Array] | None = None,
    stable: bool | float = False,
    iterations: int = 60,
    tolerance: float = 1e-8,
) -> Innovations:
    """Estimate a state-space model in innovation form with all matrices free, by the least prediction errors.

    Minimises sum_t |W e(t)|^2 (or another loss) over the minimal local coordinates of the model, by damped
    Gauss-Newton. W is the inverse root of the errors' covariance, renewed until it is settled: that is the least
    determinant of the covariance, maximum likelihood for normal innovations. Of missing outputs the exact likelihood
    is taken; with a loss, weight, regulariser, focus or horizon of one's own it corrects and counts nothing. Where
    the least errors belong to a model that is unstable or simulates much worse than it predicts, and no start was
    given, the search is stopped where it foretells data held back best; the report says so.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    order : int, optional
        States, of the subspace estimate that it starts from.
    start : Innovations, optional
        A model to begin with instead.
    direct : bool, optional
        Whether D is estimated; as the start has it, which is where the data tell that inputs act at once, unless given.
    focus : {"prediction", "simulation"}
        Errors `horizon` steps ahead, or those of the simulation (k = 0).
    horizon : int
        Samples ahead.
    x0 : {"estimate", "zero"}
        The initial state of every experiment.
    loss : str or callable, optional
        "squared", "huber", "soft_l1", "cauchy", or a function of squared standardised errors giving (rho, rho').
    weight : array_like, shape (ny, ny), optional
        Multiplies the errors instead of W.
    regulariser : callable, optional
        A function of the model whose squared entries, in standard deviations, are added.
    stable : bool or float
        True, or the largest modulus of a pole.
    iterations : int
        At most so many steps.
    tolerance : float
        Relative change at which the search ends.

    Returns
    -------
    Innovations
        The model. `names`, `values` and `covariance` are those of all matrices, in the coordinates orthogonal to
        changes of basis (singular therefore: use `response_covariance` and `pole_covariance`); x0 is that of the first
        experiment.

    Raises
    ------
    ValueError
        What is asked for and cannot be had; what makes the model doubtful is an `IdentificationWarning`.

    Notes
    -----
    Source: Ljung, System Identification, 1999, chapters 7 and 10.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, pem
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0, -0.5], [1.0, -0.8], 0.1 * e)
    >>> model = pem(iddata(y, u, 0.1), order=1)
    >>> model.a.round(2), (model.c @ model.b).round(1), model.r.round(2)  # 0.8, 2.0, 0.01
    (array([[0.8]]), array([[2.]]), array([[0.01]]))
    """
    each = experiments(data)
    check_channels(each)
    check_focus(focus)
    check_stable(stable)
    if horizon < 1 or iterations < 1:
        raise ValueError(f"horizon and iterations are from 1 on, not {horizon} and {iterations}")
    if start is not None:
        check_record(each, drift=False)
        check_states(each, start.nx)
    model = _start(each, order, start, direct, focus, stable)
    direct = bool(model.d.any()) if direct is None else direct
    limit = np.inf if stable is False else 1.0 - 1e-9 if stable is True else float(stable)
    given = None if weight is None else np.asarray(weight, dtype=float)
    problem = PemProblem(
        [piece(one) for one in each], np.eye(model.ny), Freedom(direct, focus == "prediction"), horizon,
        x0 == "estimate", losses.named(loss), regulariser, limit,
    )  # fmt: skip
    point, problem = _settle(problem, model, PemSettings(focus, problem.loss, given, iterations, tolerance))
    own, covariance, ended = gaussnewton.settled(point), None, point.ended
    own = replace(own, r=_covariance(problem, point), q=None, s=None)
    white = focus == "prediction" and horizon == 1
    if white and loss is None and regulariser is None and given is None and not all(one.complete for one in each):
        exact = likeliest_model(each, own, problem.free, free_start=x0 == "estimate", within=limit)
        own, covariance, ended = exact.model, exact.covariance, exact.settled
    else:
        covariance = coordinates_covariance(problem, point, white=white)
    if not ended:
        unsettled(iterations)
    found = replace(
        own, dt=each[0].dt, names=coordinates.names(model), values=coordinates.values(own), covariance=covariance,
        inputs=each[0].inputs, outputs=each[0].outputs,
    )  # fmt: skip
    if start is None and white and (radius(found.a) >= 1.0 or simulates_worse(found, each)):
        found = _stopped_early(found, each, direct, stable)
    check_model(found, sum(one.n for one in each))
    check_simulation(found, each)
    return found


def _stopped_early(found: Innovations, each: Sequence[Data], direct: bool, stable: bool | float) -> Innovations:
    """After as many steps as foretell what is held back best, where that is stable and the least error is not."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IdentificationWarning)
            other = subspaceid(each, found.nx, direct=direct, stable=stable, refine="held back")
    except ValueError:
        return found
    if radius(other.a) >= 1.0 or simulates_worse(other, each):
        return found
    chosen(
        "the least prediction errors belong to a model that is unstable or simulates much worse than it predicts: the "
        "search was stopped where it foretells thirds that were held back best"
    )
    return other


def _start(
    each: Sequence[Data],
    order: int | None,
    start: Innovations | None,
    direct: bool | None,
    focus: Focus,
    stable: bool | float,
) -> Innovations:
    if start is None:
        try:
            start = subspaceid(each, order, direct=direct, focus=focus, stable=stable, refine=0)
        except ValueError:
            if all(one.complete for one in each):
                raise
            # lines through gaps look like inputs that act at once
            start = subspaceid(
                [_filled(one) for one in each], order, direct=bool(direct), focus=focus, stable=stable, refine=0
            )
    if (start.ny, start.nu) != (each[0].ny, each[0].nu):
        raise ValueError(f"the start has {start.ny} outputs and {start.nu} inputs, not those of the data")
    return replace(start, k=np.zeros_like(start.k)) if focus == "simulation" else start


def _filled(one: Data) -> Data:
    """Gaps bridged by lines; good enough to begin with."""
    y, at = one.y.copy(), np.arange(one.n)
    for i in range(one.ny):
        seen = np.isfinite(y[:, i])
        y[:, i] = np.interp(at, at[seen], y[seen, i])
    return replace(one, y=y)


def _settle(problem: PemProblem, model: Innovations, options: PemSettings) -> tuple[PemPoint, PemProblem]:
    """Minima under weights that are renewed from the errors until they stay."""
    point = gaussnewton.with_best_starts(problem, model)
    if not np.isfinite(point.cost):
        raise ValueError("the start is not allowed: its predictor or, where that is asked, the model is not stable")
    for turn in range(1 if options.weight is not None or (model.ny == 1 and options.loss is None) else ROUNDS):
        before = problem.weight
        problem = replace(problem, weight=_weight(problem, point) if options.weight is None else options.weight)
        point = replace(gaussnewton.evaluate(problem, point.model, point.starts), ended=point.ended)
        if turn and np.linalg.norm(problem.weight - before) < SETTLED * np.linalg.norm(before):
            break
        point = gaussnewton.minimise(problem, point, options.iterations, options.tolerance)
    if options.weight is None:
        problem = replace(problem, weight=_weight(problem, point))
        point = replace(gaussnewton.evaluate(problem, point.model, point.starts), ended=point.ended)
    return point, problem


def _weight(problem: PemProblem, point: PemPoint) -> Array:
    """Inverse root of the errors' covariance; by the median of each where outliers are expected."""
    if problem.loss is not None:
        errors = np.hstack([path.ahead for path in point.paths])
        known = np.hstack([one.known for one in problem.pieces])
        return np.diag(1.0 / np.maximum(losses.spread(errors, known), 1e-300))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(_covariance(problem, point))))


def _covariance(problem: PemProblem, point: PemPoint) -> Array:
    """Of the errors that count (ny, ny), lifted where there are none; missing ones left out pair by pair."""
    ahead = [path.ahead for path in point.paths]
    r = paired(ahead, [one.known for one in problem.pieces])
    power = np.array([_power(problem.pieces, i) for i in range(len(r))])
    r = np.asarray(r + np.diag(1e-18 * power + 1e-300))
    low = float(np.linalg.eigvalsh(r / np.sqrt(np.outer(np.diag(r), np.diag(r)))).min())
    return r if low > 1e-6 else np.diag(np.diag(r))


def _power(pieces: Sequence[Piece], i: int) -> float:
    return float(sum(np.vdot(one.y[i], one.y[i]) for one in pieces) / max(sum(one.known[i].sum() for one in pieces), 1))
