"""Models with noise from continuous to sampled time and back; the cost of a linear regulator likewise.

A continuous innovation form has dt = 0: x' = a x + b u + k e; its q, r, s are densities. Inputs and innovations are
held over a step; the noise is integrated over it (Van Loan, IEEE Trans. Automatic Control 23, 1978), over a short step
that is then doubled.

Rules of this file: both ways are exact, so there and back is the same model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.models import Innovations, matrices_alone

Array = NDArray[np.float64]


def sampled_form(form: Innovations, dt: float) -> Innovations:
    """A continuous innovation form at a step in s, inputs and innovations held, its noise integrated over the step."""
    if form.dt != 0.0:
        raise ValueError(f"the model is sampled already, every {form.dt:g} s: d2d brings it to another step")
    if not 0.0 < dt < np.inf:
        raise ValueError(f"a step is a positive time in s, not {dt:g}")
    hold = held(form.a, dt)
    return replace(
        matrices_alone(form), a=linalg.expm(form.a * dt), b=hold @ form.b, k=hold @ form.k, dt=dt,
        q=None if form.q is None else sampled_noise(form.a, form.q, dt),
        r=None if form.r is None else form.r / dt,
        s=None if form.s is None else hold @ form.s / dt,
    )  # fmt: skip


def continuous_form(form: Innovations) -> Innovations:
    """The continuous innovation form that a sampled one comes from."""
    if form.dt <= 0.0:
        raise ValueError("the model is continuous already")
    a = _logarithm(form.a) / form.dt
    unhold = np.linalg.inv(held(a, form.dt))
    return replace(
        matrices_alone(form), a=a, b=unhold @ form.b, k=unhold @ form.k, dt=0.0,
        q=None if form.q is None else unsampled_noise(a, form.q, form.dt),
        r=None if form.r is None else form.r * form.dt,
        s=None if form.s is None else unhold @ form.s * form.dt,
    )  # fmt: skip


def sampled_noise(a: Array, q: Array, dt: float) -> Array:
    """integral_0^dt exp(a t) q exp(a t)' dt: the covariance that a white process of density q adds in a step.

    Van Loan's block holds exp(-a dt), which swallows everything where a pole is fast beside the step: it is taken over
    a step of norm 1, dt/2^k, and Q(2h) = Q(h) + F(h) Q(h) F(h)', F(2h) = F(h)^2 leads to dt.
    """
    n = len(a)
    norm = float(np.abs(a).sum(axis=0).max(initial=0.0)) * dt
    doublings = int(np.ceil(np.log2(norm))) if 1.0 < norm < np.inf else 0
    e = linalg.expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * (dt / 2.0**doublings))
    f = e[n:, n:].T
    found = f @ e[:n, n:]
    for _ in range(doublings):
        found, f = found + f @ found @ f.T, f @ f
    return np.asarray(0.5 * (found + found.T))


def unsampled_noise(a: Array, q: Array, dt: float) -> Array:
    """The density whose `sampled_noise` is q: a linear equation in its n^2 entries."""
    n = len(a)
    both = np.kron(a, np.eye(n)) + np.kron(np.eye(n), a)
    return np.asarray(np.linalg.solve(held(both, dt), q.ravel()).reshape(n, n))


def sampled_cost(
    a: Array, b: Array, q: Array, r: Array, dt: float, s: Array | None = None
) -> tuple[Array, Array, Array]:
    """Sample the cost of a linear regulator, so that held inputs cost the same.

    The sum of x'Qx + u'Ru + 2 x'Su is the integral of x'qx + u'ru + 2 x'su: integral of exp(F t)' W exp(F t) with
    F = [a b; 0 0].

    Parameters
    ----------
    a : ndarray, shape (nx, nx)
        Continuous dynamics.
    b : ndarray, shape (nx, nu)
        From the inputs.
    q : ndarray, shape (nx, nx)
        Cost of the states per second.
    r : ndarray, shape (nu, nu)
        Cost of the inputs per second.
    dt : float
        Step in s.
    s : ndarray, shape (nx, nu), optional
        Cost of both together per second.

    Returns
    -------
    q, r, s : ndarray
        Costs of the samples, (nx, nx), (nu, nu) and (nx, nu).

    Notes
    -----
    Source: Van Loan (1978).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import sampled_cost
    >>> zero, one = np.zeros((1, 1)), np.ones((1, 1))
    >>> q, r, s = sampled_cost(zero, one, one, zero, dt=0.1)  # x' = u, cost x^2: x^2 T, u^2 T^3/3, x u T^2/2
    >>> q.round(6), r.round(6), s.round(6)
    (array([[0.1]]), array([[0.000333]]), array([[0.005]]))
    """
    n, m = b.shape
    f = np.zeros((n + m, n + m))
    f[:n, :n], f[:n, n:] = a, b
    cross = np.zeros((n, m)) if s is None else s
    whole = sampled_noise(f.T, np.block([[q, cross], [cross.T, r]]), dt)
    return whole[:n, :n], whole[n:, n:], whole[:n, n:]


def held(a: Array, dt: float) -> Array:
    """integral_0^dt exp(a t) dt."""
    n = len(a)
    return np.asarray(linalg.expm(np.block([[a, np.eye(n)], [np.zeros((n, 2 * n))]]) * dt)[:n, n:])


def _logarithm(a: Array) -> Array:
    if not len(a):
        return np.zeros((0, 0))
    poles = np.linalg.eigvals(a)
    if ((np.abs(poles.imag) < 1e-12 * np.abs(poles)) & (poles.real <= 0.0)).any() or np.abs(poles).min() < 1e-300:
        raise ValueError(
            "a pole at zero (a delay is one) or on the negative real axis: no continuous model samples to this one"
        )
    return np.asarray(linalg.logm(a)).real
