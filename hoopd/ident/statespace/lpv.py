"""A state-space model whose A, B and K are affine in scheduling signals.

    x+ = A(p) x + B(p) u + K(p) e,   y = C x + D u + e,   A(p) = A_0 + A_1 p_1 + ...
The least prediction errors from a model without a schedule; changes of basis cost nothing and are damped away (Verdult,
Bergboer & Verhaegen, Proc. 13th IFAC Symposium on System Identification, 2003).

Rules of this file: the scheduling signal is known; all models that a derivative asks for run side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.checks import unsettled
from hoopd.ident.damped_least_squares import Damping, Ends, NormalEquations, minimise
from hoopd.ident.data import Data
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.models import Innovations
from hoopd.ident.schedule import schedule_of, with_one
from hoopd.ident.statespace.pem import pem

Array = NDArray[np.float64]

# Steps of the search, the gain at which it ends, the difference that its derivatives are taken by.
STEPS, GAIN, APART = 60, 1e-9, 1e-6
DAMPING = Damping(first=1e-4, easier=0.2, harder=8.0, again=1e-6)
# What has run away counts as so many deviations.
FAR = 1e150
LETTERS = ("a", "b", "k", "c", "x0")


@dataclass(frozen=True)
class LpvStateSpace:
    """A(p), B(p), K(p) as (1 + np, ...), constant part first; C, D; R of e; the state at the start."""

    a: Array
    b: Array
    k: Array
    c: Array
    d: Array
    r: Array
    x0: Array
    dt: float
    report: EstimationReport | None = field(default=None, compare=False)

    def frozen(self, p: ArrayLike) -> Innovations:
        """The model while the scheduling signals stay at p (np,)."""
        at = with_one(np.atleast_1d(np.asarray(p, dtype=float))[None])[0]
        a, b, k = (np.tensordot(at, one, 1) for one in (self.a, self.b, self.k))
        return Innovations(a, b, self.c, self.d, k, self.dt, r=self.r)

    def predict(self, data: Data, p: ArrayLike, x0: ArrayLike | None = None) -> Array:
        """Outputs (n, ny) one sample ahead, from rest or a given state; a missing output corrects nothing."""
        return self._run(data, p, x0, correct=True)

    def simulate(self, data: Data, p: ArrayLike, x0: ArrayLike | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone, from rest or a given state."""
        return self._run(data, p, x0, correct=False)

    def _run(self, data: Data, p: ArrayLike, x0: ArrayLike | None, *, correct: bool) -> Array:
        start = np.zeros(self.a.shape[1]) if x0 is None else np.asarray(x0, dtype=float)
        e = _errors(self, data, with_one(schedule_of(p, data.n)), start[None], (self,), correct=correct)[0]
        return np.asarray(data.y - e) if correct else np.asarray(-e)


@estimated("scheduled state space")
def lpv_pem(data: Data, p: ArrayLike, order: int, *, start: Innovations | None = None) -> LpvStateSpace:
    """Fit a state-space model whose A, B and K are affine in scheduling signals, by the least prediction errors.

    The start is the model without a schedule (`pem`); Gauss-Newton goes on over all matrices.

    Parameters
    ----------
    data : Data
        One experiment; a missing output corrects and counts nothing.
    p : array_like, shape (n,) or (n, np)
        Scheduling signals, one row a sample; those of sample t lead from x(t) to x(t+1).
    order : int
        States.
    start : Innovations, optional
        A model without a schedule to begin with.

    Returns
    -------
    LpvStateSpace
        The matrices; `frozen(p)` is the model at one place of the schedule.

    Raises
    ------
    ValueError
        Signals that do not fit; what makes the model doubtful is an `IdentificationWarning`.

    Notes
    -----
    Source: Verdult, Bergboer & Verhaegen, Proc. 13th IFAC Symposium on System Identification, 2003.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, lpv_pem
    >>> rng = np.random.default_rng(0)
    >>> u, p, x, y = rng.standard_normal(600), np.sin(0.02 * np.arange(600)), 0.0, np.zeros(600)
    >>> for t in range(600):  # a pole at 0.7 + 0.2 p
    ...     y[t] = x + 0.05 * rng.standard_normal()
    ...     x = (0.7 + 0.2 * p[t]) * x + u[t]
    >>> model = lpv_pem(iddata(y, u), p, order=1)
    >>> model.frozen([1.0]).a.round(2), model.frozen([-1.0]).a.round(2)
    (array([[0.9]]), array([[0.5]]))
    """
    at = with_one(schedule_of(p, data.n))
    first = pem(data, order, direct=False) if start is None else start
    none = at.shape[1] - 1
    a, b, k = (np.concatenate([one[None], np.zeros((none, *one.shape))]) for one in (first.a, first.b, first.k))
    x0 = np.zeros(first.nx) if first.x0 is None else first.x0
    model = LpvStateSpace(a, b, k, first.c, first.d, np.eye(first.ny), x0, data.dt)
    level = np.maximum(np.nanstd(data.y - _said(model, data, at), axis=0), 1e-300)
    best = minimise(
        _point(model, data, at, level), lambda one: _linearised(one, data, at, level),
        lambda one, step: _point(_moved(one.model, step), data, at, level), DAMPING, Ends(STEPS, gain=GAIN),
    )  # fmt: skip
    if not best.converged:
        unsettled(best.steps)
    e = _errors(best.point.model, data, at, best.point.model.x0[None], (best.point.model,))[0]
    seen = np.isfinite(e).all(axis=1)
    return replace(best.point.model, r=e[seen].T @ e[seen] / max(int(seen.sum()), 1))


@dataclass(frozen=True)
class _Point:
    model: LpvStateSpace
    errors: Array
    cost: float


def _said(model: LpvStateSpace, data: Data, at: Array) -> Array:
    return np.asarray(data.y - _errors(model, data, at, model.x0[None], (model,))[0])


def _point(model: LpvStateSpace, data: Data, at: Array, level: Array) -> _Point:
    e = _errors(model, data, at, model.x0[None], (model,))[0] / level
    e = np.nan_to_num(e, nan=0.0, posinf=FAR, neginf=-FAR)
    with np.errstate(over="ignore"):
        cost = float(np.vdot(e, e))
    return _Point(model, e, cost if np.isfinite(cost) else np.inf)


def _moved(model: LpvStateSpace, step: Array) -> LpvStateSpace:
    parts, first = {}, 0
    for letter in LETTERS:
        old = getattr(model, letter)
        parts[letter] = old + step[first : first + old.size].reshape(old.shape)
        first += old.size
    return replace(model, **parts)


def _linearised(point: _Point, data: Data, at: Array, level: Array) -> NormalEquations:
    """All models that are one entry aside, run together."""
    size = sum(getattr(point.model, letter).size for letter in LETTERS)
    aside = tuple(_moved(point.model, APART * one) for one in np.eye(size))
    e = _errors(point.model, data, at, np.stack([one.x0 for one in aside]), aside)
    j = np.nan_to_num((np.nan_to_num(e) / level - point.errors) / APART).reshape(size, -1)
    return NormalEquations(j @ j.T, j @ point.errors.ravel())


def _errors(
    like: LpvStateSpace, data: Data, at: Array, x: Array, models: Sequence[LpvStateSpace], *, correct: bool = True
) -> Array:  # fmt: skip
    """Errors (m, n, ny) of models side by side from states x (m, nx); not corrected: less their simulated outputs."""
    a, b, k, c = (np.stack([getattr(one, letter) for one in models]) for letter in "abkc")
    driven, direct = np.tensordot(b, data.u.T, 1), data.u @ like.d.T
    out = np.empty((len(models), data.n, like.d.shape[0]))
    known = np.isfinite(data.y)
    y = np.where(known, data.y, 0.0)
    with np.errstate(all="ignore"):
        for t in range(data.n):
            said = np.einsum("myx,mx->my", c, x) + direct[t]
            out[:, t] = y[t] - said if correct else -said
            e = out[:, t] * known[t] * correct
            step = np.einsum("msij,mj->msi", a, x) + driven[..., t] + np.einsum("msij,mj->msi", k, e)
            x = np.einsum("s,msi->mi", at[t], step)
    return np.where(known, out, np.nan) if correct else out
