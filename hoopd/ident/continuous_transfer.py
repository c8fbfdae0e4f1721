"""A continuous transfer function with a dead time from sampled data: refined instrumental variables, then likelihood.

    y(t) = B(s)/A(s) u(t - T) + e(t_k),   A = s^n + a_1 s^(n-1) + ... + a_n,   u held between samples
For a dead time on a grid of samples the coefficients come from filtered derivatives: 1/A of the last turn filters y, u
and the simulated output, which is the instrument (Young & Jakeman, Int. J. Control 31, 1980; Garnier & Young, 2014).
From the best of them the simulation error is made least over all coefficients and T, which is then any number: maximum
likelihood for white e, with the errors of coloured e told by its autocorrelation.

Rules of this file: one input and output; poles of the search stay in the left half plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd.ident.data import Data, one_experiment
from hoopd.ident.estimation_report import EstimationReport, chosen, estimated
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.models import Innovations, standard_errors
from hoopd.ident.polynomial.structure import single
from hoopd.ident.statespace.linear import states
from hoopd.ident.statespace.structured import Structured, structured_pem

Array = NDArray[np.float64]

TURNS, SETTLED = 25, 1e-5
# Band widths of the first filter that are tried, in parts of half the sampling frequency.
WIDTHS = (0.01, 0.03, 0.1, 0.3)
# Dead times that are tried when none is given, in samples.
MOST_DELAY = 20
DELAY = "delay"


@dataclass(frozen=True, repr=False)
class ContinuousTransfer(IdentifiedModel):
    """B(s)/A(s) with the dead time `delay` in s; values and covariance in the order of `names` (b, a, delay).

    `sampled`: the same behind a hold, as it was fitted.
    """

    num: Array
    den: Array
    delay: float
    names: tuple[str, ...]
    values: Array
    covariance: Array
    sampled: Structured
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def continuous(self) -> ct.TransferFunction:
        """B/A without the dead time."""
        return ct.TransferFunction(self.num, self.den)

    @property
    def undelayed(self) -> Innovations:
        """B/A without the dead time as a continuous state space (dt = 0)."""
        return companion(self.num, self.den[1:])

    @property
    def delays(self) -> tuple[float]:
        """The dead time of its input in s."""
        return (self.delay,)

    @property
    def state_space(self) -> Innovations:
        """Sampled, dead time and hold included."""
        return self.sampled.model

    @property
    def system(self) -> ct.StateSpace:
        """From u to y, sampled."""
        return self.sampled.system

    def deviations(self) -> dict[str, float]:
        """Standard errors by name."""
        return standard_errors(self.names, self.covariance)


@estimated("continuous transfer function")
def srivc(data: Data, poles: int, zeros: int | None = None, *, delay: float | None = None) -> ContinuousTransfer:
    """Fit a continuous transfer function with a dead time to sampled data, with standard errors.

    Parameters
    ----------
    data : Data
        One experiment of one input and output, the input held between samples.
    poles : int
        Their number.
    zeros : int, optional
        Their number; one fewer than poles, unless given.
    delay : float, optional
        Dead time in s that is known; estimated unless given.

    Returns
    -------
    ContinuousTransfer
        `num`, `den` (its first coefficient 1), `delay` in s, their `covariance`; `continuous` is B/A, `system` the
        sampled one.

    Raises
    ------
    ValueError
        Orders that do not fit, and data that tell no stable model of them.
    TypeError
        Several experiments.

    Notes
    -----
    Sources: Young & Jakeman, Int. J. Control 31, 1980; Garnier & Young, Int. J. Control 87, 2014.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import iddata, simulate, srivc
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.choice([-1.0, 1.0], 150), 6)
    >>> y = simulate(control.tf([2.0], [1.0, 0.6, 1.0]), iddata(u, u, 0.1), "zero")[:, 0]
    >>> late = np.concatenate([np.zeros(5), y[:-5]]) + 0.05 * rng.standard_normal(900)  # 0.5 s later
    >>> found = srivc(iddata(late, u, 0.1), poles=2, zeros=0)
    >>> found.den.round(1), found.num.round(1), round(found.delay, 2)
    (array([1. , 0.6, 1. ]), array([2.]), 0.5)
    """
    one_experiment(data, "srivc")
    single([data])
    m = poles - 1 if zeros is None else zeros
    if data.nu != 1:
        raise ValueError(f"srivc takes data of one input, not of {data.nu}")
    if poles < 1 or not 0 <= m < poles:
        raise ValueError(f"poles={poles}, zeros={m}: one pole at least, and fewer zeros than poles")
    if delay is not None and not delay >= 0.0:
        raise ValueError(f"the delay is from 0 s on, not {delay}")
    start, late = _start(data, poles, m, delay)
    free = delay is None
    p0 = np.concatenate([start, [late]]) if free else start
    low, high = np.full(len(p0), -np.inf), np.full(len(p0), np.inf)
    if free:
        low[-1], high[-1] = max(late - 1.5 * data.dt, 0.0), late + 1.5 * data.dt
        chosen(f"a dead time near {late:g} s: of whole samples up to {MOST_DELAY} the one of least simulation error")
    names = [f"b{k}" for k in range(m + 1)] + [f"a{k + 1}" for k in range(poles)] + [DELAY] * free

    def built(p: Array) -> Innovations:
        return sampled(p[: m + 1], p[m + 1 : m + 1 + poles], float(p[-1]) if free else late, data.dt, high[-1])

    if not free:
        high[-1] = np.inf
    fit = structured_pem(data, built, p0, names=names, bounds=(low, high), focus="simulation", gain="zero")
    values = np.array(list(fit.parameters.values()))
    return ContinuousTransfer(
        values[: m + 1], np.concatenate([[1.0], values[m + 1 : m + 1 + poles]]), float(values[-1]) if free else late,
        tuple(names), values, fit.covariance, fit,
    )  # fmt: skip


def companion(b: Array, a: Array) -> Innovations:
    """B/A, A = s^n + a_1 s^(n-1) + ..., as a continuous state space."""
    n = len(a)
    lines = np.eye(n, k=1)
    lines[-1] = -a[::-1]
    out = np.zeros((1, n))
    out[0, : len(b)] = b[::-1]
    return Innovations(lines, np.eye(n)[:, -1:], out, np.zeros((1, 1)), np.zeros((n, 1)), 0.0)


def sampled(b: Array, a: Array, delay: float, dt: float, most: float) -> Innovations:
    """B/A behind a hold and a dead time, with as many states as the longest dead time `most` (s) wants.

    With delay = d dt - f, 0 <= f < dt: x+ = e^(A dt) x + Phi(dt - f) ... the input of d samples before acts for f, the
    one before that for the rest of the step.
    """
    n, count = len(a), int(np.ceil((most if np.isfinite(most) else delay) / dt - 1e-9))
    lines = np.eye(n, k=1)
    lines[-1] = -a[::-1]
    force = np.eye(n)[:, -1:]
    d = int(np.ceil(delay / dt - 1e-9))
    f = d * dt - delay
    whole, last = _held(lines, force, dt), _held(lines, force, f)
    old = whole[1] - last[1]  # of u(t - d), that acts before the newer one
    size = n + max(count, 1)
    big = np.zeros((size, size))
    big[:n, :n] = whole[0]
    enter = np.zeros((size, 1))
    # states after the plant's: u(t-1), u(t-2), ...
    for late, part in ((d, old), (d - 1, last[1])):
        if late > 0:
            big[:n, n + late - 1] += part[:, 0]
        elif late == 0:
            enter[:n] += part
    enter[n, 0] = 1.0
    big[n + 1 :, n:-1] = np.eye(size - n - 1)
    out = np.zeros((1, size))
    out[0, : len(b)] = b[::-1]
    return Innovations(big, enter, out, np.zeros((1, 1)), np.zeros((size, 1)), dt)


def _held(a: Array, b: Array, dt: float) -> tuple[Array, Array]:
    """e^(A dt) and the integral of e^(A s) B over dt."""
    n = len(a)
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n:] = a, b
    e = linalg.expm(both * dt)
    return np.asarray(e[:n, :n]), np.asarray(e[:n, n:])


# ------------------------------------------------------------------------------------------------- where to begin


def _start(data: Data, n: int, m: int, delay: float | None) -> tuple[Array, float]:
    """Coefficients b, a and a dead time of whole samples (or the given one), of least simulation error."""
    y, u = data.y[:, 0], data.u[:, 0]
    seen = np.isfinite(y)
    y = np.interp(np.arange(len(y)), np.flatnonzero(seen), y[seen])
    shifts = [round(delay / data.dt)] if delay is not None else range(min(MOST_DELAY, data.n // 10) + 1)
    best: tuple[float, Array, float] | None = None
    for shift in shifts:
        moved = np.concatenate([np.full(shift, u[0]), u[: len(u) - shift]])
        for x in _candidates(y, moved, n, m, data.dt):
            with np.errstate(all="ignore"):
                cost = float(np.square(y - _response(x, moved, m, data.dt)).sum())
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = cost, x, shift * data.dt if delay is None else delay
    if best is None:
        raise ValueError("no stable model of these orders is near the data: take other orders, or more samples")
    return best[1], best[2]


def _candidates(y: Array, u: Array, n: int, m: int, dt: float) -> Iterator[Array]:
    """Of filters of several band widths, the coefficients when the turns have settled."""
    for width in WIDTHS:
        a = np.asarray(np.poly(np.full(n, -width * np.pi / dt))[1:], dtype=float)
        x: Array | None = None
        for turn in range(TURNS):
            instrument = None if turn == 0 or x is None else _response(x, u, m, dt)
            new = _regressed(y, u, a, m, dt, instrument)
            if new is None:
                break
            done = x is not None and np.linalg.norm(new - x) < SETTLED * np.linalg.norm(new)
            x, a = new, _left_half(new[m + 1 :])
            x = np.concatenate([new[: m + 1], a])
            if done:
                break
        if x is not None:
            yield x


def _regressed(y: Array, u: Array, a: Array, m: int, dt: float, instrument: Array | None) -> Array | None:
    """Coefficients b, a of y^(n) = -a y^(n-1) ... + b u^(m) ..., all filtered by 1/A."""
    n = len(a)
    fy, fu = _filtered(y, a, dt), _filtered(u, a, dt)
    # y^(n)/A = y - sum a_k y^(n-k)/A
    highest = y - fy[:, ::-1] @ a
    rows = np.hstack([fu[:, m::-1], -fy[:, ::-1]])
    left = rows if instrument is None else np.hstack([fu[:, m::-1], -_filtered(instrument, a, dt)[:, ::-1]])
    try:
        with np.errstate(all="ignore"):
            scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
            found = np.linalg.solve((left / scale).T @ (rows / scale), (left / scale).T @ highest) / scale
    except np.linalg.LinAlgError:
        return None
    return found if np.isfinite(found).all() and len(found) == m + 1 + n else None


def _filtered(x: Array, a: Array, dt: float) -> Array:
    """x/A and its derivatives up to n - 1, (samples, n), the signal held between samples."""
    n = len(a)
    lines = np.eye(n, k=1)
    lines[-1] = -a[::-1]
    step, enter = _held(lines, np.eye(n)[:, -1:], dt)
    return states(step, enter @ x[None]).T


def _response(x: Array, u: Array, m: int, dt: float) -> Array:
    return np.asarray(_filtered(u, x[m + 1 :], dt)[:, : m + 1] @ x[m::-1])


def _left_half(a: ArrayLike) -> Array:
    """The coefficients with poles of the right half plane mirrored."""
    roots = np.roots(np.concatenate([[1.0], np.asarray(a, dtype=float)]))
    return np.asarray(np.real(np.poly(-np.abs(roots.real) + 1j * roots.imag))[1:])
