"""Systems as sums of known functions: Laguerre, Kautz and any other poles, continuous or sampled; leads and lags.

An orthonormal basis is the state of a chain of all-pass sections, each one balanced at its input:
    A + A' + B B' = 0:   real pole -a    A = -a,   B = sqrt(2a)
    pair s^2 + b s + c                   A = [[-b, -sqrt c], [sqrt c, 0]],   B = [sqrt(2b), 0]
    out = in - B' x  (all-pass, gain 1) feeds the next
Sampled, z = (1 + s)/(1 - s) keeps the balance (A A' + B B' = I) and so the orthonormality.
Sources: Heuberger, Van den Hof, Wahlberg, Modelling and Identification with Rational Orthogonal Basis Functions, 2005;
Wahlberg, System identification using Laguerre / Kautz models, IEEE Trans. AC 36 (1991), 39 (1994); Ninness, Gustafsson,
IEEE Trans. AC 42 (1997).

Rules of this file: a basis is a python-control system of one input whose outputs are the functions; poles lie in the
plane of the basis: s (rad/s), or z when it has a sample time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Section = tuple[Array, Array]


@dataclass(frozen=True)
class Basis:
    """n functions as the outputs of one system; `poles` (n,) when it is a chain that `add_poles` can lengthen."""

    system: ct.StateSpace
    poles: tuple[complex, ...] = ()

    def __len__(self) -> int:
        """Functions."""
        return int(self.system.noutputs)

    @property
    def dt(self) -> float:
        """Sample time in s, 0 for continuous."""
        return float(self.system.dt or 0.0)

    def __add__(self, other: Basis) -> Basis:
        """The functions of both."""
        if self.dt != other.dt:
            raise ValueError("bases of different sample times are not put together")
        one, two = self.system, other.system
        return Basis(
            ct.ss(
                linalg.block_diag(one.A, two.A), np.vstack([one.B, two.B]),
                linalg.block_diag(one.C, two.C), np.vstack([one.D, two.D]), self.dt,
            )
        )  # fmt: skip

    def responses(self, w: ArrayLike) -> Complex:
        """(nw, n) values of the functions at w rad/s."""
        axis = np.asarray(w, dtype=float).reshape(-1)
        at = np.exp(1j * axis * self.dt) if self.dt else 1j * axis
        own = self.system
        inner = at[:, None, None] * np.eye(own.nstates) - own.A
        states = np.linalg.solve(inner, np.broadcast_to(own.B.astype(complex), (len(axis), *own.B.shape)))
        return np.asarray((own.C @ states + own.D)[:, :, 0])

    def filtered(self, u: ArrayLike, dt: float = 0.0) -> Array:
        """u (N,) through every function from rest, (N, n); a continuous basis holds u for `dt` s each."""
        own = self.system if self.dt else ct.c2d(self.system, _step(dt), "zoh")
        values, x = np.asarray(u, dtype=float).reshape(-1), np.zeros(own.nstates)
        states = np.empty((len(values), own.nstates))
        driven = np.outer(values, own.B[:, 0])
        for i in range(len(values)):
            states[i] = x
            x = own.A @ x + driven[i]
        return np.asarray(states @ own.C.T + np.outer(values, own.D[:, 0]))

    def combined(self, coefficients: ArrayLike) -> ct.StateSpace:
        """The sum of the functions times (n,) coefficients, or (n, ny) for so many outputs."""
        weights = np.asarray(coefficients, dtype=float)
        rows = weights.reshape(len(self), -1).T
        own = self.system
        return ct.ss(own.A, own.B, rows @ own.C, rows @ own.D, self.dt)


def laguerre(pole: float, n: int, dt: float = 0.0) -> Basis:
    """Give n Laguerre functions: all poles at one real place.

    Parameters
    ----------
    pole : float
        Inside the left half plane (rad/s), or inside the unit circle with `dt`.
    n : int
        How many.
    dt : float
        Step in s, 0 for continuous.

    Returns
    -------
    Basis
        The functions as the outputs of one `system`.

    Raises
    ------
    ValueError
        A pole that is not stable.

    Notes
    -----
    Source: Wahlberg, System identification using Laguerre models, IEEE Trans. AC 36 (1991).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import laguerre
    >>> basis = laguerre(0.8, 2, dt=0.1)
    >>> pulse = basis.filtered(np.eye(200)[0])
    >>> np.allclose(pulse.T @ pulse, np.eye(2))  # orthonormal
    True
    """
    return orthonormal((pole,) * n, dt)


def kautz(poles: Sequence[complex], dt: float = 0.0) -> Basis:
    """Give Kautz functions of complex pairs of poles, in the order given.

    Parameters
    ----------
    poles : sequence of complex
        Each once or with its partner; inside the left half plane (rad/s), or inside the unit circle with `dt`.
    dt : float
        Step in s, 0 for continuous.

    Returns
    -------
    Basis
        The functions as the outputs of one `system`, two for each pair.

    Raises
    ------
    ValueError
        A pole that is not stable, or none.

    Notes
    -----
    Source: Wahlberg, System identification using Kautz models, IEEE Trans. AC 39 (1994).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import kautz, pole
    >>> basis = kautz([pole(w=3.0, zeta=0.2)])
    >>> len(basis), np.abs(basis.system.poles()).round(6)
    (2, array([3., 3.]))
    """
    return orthonormal(poles, dt)


def orthonormal(poles: Sequence[complex], dt: float = 0.0) -> Basis:
    """Give the orthonormal functions of any stable real poles and pairs, each building on those before it.

    White noise of variance 1 (of density 1, if continuous) drives uncorrelated outputs of variance 1.

    Parameters
    ----------
    poles : sequence of complex
        Inside the left half plane (rad/s), or inside the unit circle with `dt`; of a pair one or both.
    dt : float
        Step in s, 0 for continuous.

    Returns
    -------
    Basis
        The functions as the outputs of one `system`.

    Raises
    ------
    ValueError
        A pole that is not stable, or none.

    Notes
    -----
    Sources: Heuberger, Van den Hof, Wahlberg, Modelling and Identification with Rational Orthogonal Basis Functions,
    2005; Ninness, Gustafsson, IEEE Trans. AC 42 (1997).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import orthonormal
    >>> basis = orthonormal([0.5, 0.7 + 0.2j], dt=1.0)
    >>> pulse = basis.filtered(np.eye(100)[0])
    >>> np.allclose(pulse.T @ pulse, np.eye(3))
    True
    """
    each = _pairs(poles)
    if not each:
        raise ValueError("a basis wants at least one pole")
    for pole in each:
        if (abs(pole) if dt else 1.0 + pole.real) >= 1.0:
            raise ValueError(f"pole {pole:g} is not stable: its function does not die out")
    a, b = reduce(_chained, (_section((p - 1.0) / (p + 1.0) if dt else p) for p in each))
    n = len(a)
    if dt:
        inverse = np.linalg.inv(np.eye(n) - a)
        a, b = inverse @ (np.eye(n) + a), np.sqrt(2.0) * inverse @ b
    full = [q for p in each for q in ((p, p.conjugate()) if p.imag else (p,))]
    return Basis(ct.ss(a, b, np.eye(n), np.zeros((n, 1)), dt), tuple(full))


def leadlag(w: ArrayLike) -> Basis:
    """Give a constant and lags w_k/(s + w_k); any lead or lag of these poles is a sum of them.

    Parameters
    ----------
    w : array_like, shape (n,)
        Corners in rad/s, positive.

    Returns
    -------
    Basis
        n + 1 functions, the constant first.

    Raises
    ------
    ValueError
        A corner that is not positive.

    Examples
    --------
    >>> from hoopd.ident import leadlag
    >>> lead = leadlag([10.0]).combined([3.0, -2.0])  # 3 - 20/(s + 10) = (3 s + 10)/(s + 10)
    >>> lead.dcgain().item(), lead.zeros().real.round(3)
    (1.0, array([-3.333]))
    """
    corners = np.asarray(w, dtype=float).reshape(-1)
    if not (corners > 0.0).all():
        raise ValueError("the corners of leads and lags are positive, in rad/s")
    n = len(corners)
    direct = np.zeros((n + 1, 1))
    direct[0] = 1.0
    return Basis(ct.ss(-np.diag(corners), corners[:, None], np.vstack([np.zeros((1, n)), np.eye(n)]), direct))


def add_poles(basis: Basis, poles: Sequence[complex]) -> Basis:
    """Put further poles at the end of a basis; one that is no chain gets them as a chain of its own.

    Parameters
    ----------
    basis : Basis
        The basis.
    poles : sequence of complex
        Stable poles, as in `orthonormal`.

    Returns
    -------
    Basis
        A longer basis.

    Examples
    --------
    >>> from hoopd.ident import add_poles, laguerre
    >>> len(add_poles(laguerre(-1.0, 2), [-5.0]))
    3
    """
    if basis.poles:
        return orthonormal([*_pairs(basis.poles), *_pairs(poles)], basis.dt)
    return basis + orthonormal(poles, basis.dt)


def pole(w: float, zeta: float) -> complex:
    """Give the upper pole of s^2 + 2 zeta w s + w^2; the right one on the real axis when zeta > 1.

    Parameters
    ----------
    w : float
        Natural frequency in rad/s.
    zeta : float
        Damping ratio.

    Returns
    -------
    complex
        The pole in rad/s.

    Examples
    --------
    >>> from hoopd.ident import pole
    >>> pole(w=10.0, zeta=0.6)
    (-6+8j)
    """
    root = np.emath.sqrt(1.0 - zeta**2)
    return complex(-zeta * w + 1j * w * root)


# ---------------------------------------------------------------------------------------------- inside


def _pairs(poles: Sequence[complex]) -> list[complex]:
    """Each pair by its upper pole; a lower one given alone stands for its pair as well."""
    each, left = [complex(one) for one in poles], []
    for i, one in enumerate(each):
        upper = complex(one.real, abs(one.imag)) if one.imag else one
        partner = one.imag < 0.0 and upper in each[:i] and each[:i].count(upper) >= each[: i + 1].count(one)
        if not partner:
            left.append(upper)
    return left


def _section(pole: complex) -> Section:
    if not pole.imag:
        return np.array([[pole.real]]), np.array([[np.sqrt(-2.0 * pole.real)]])
    b, c = -2.0 * pole.real, abs(pole) ** 2
    return np.array([[-b, -np.sqrt(c)], [np.sqrt(c), 0.0]]), np.array([[np.sqrt(2.0 * b)], [0.0]])


def _chained(first: Section, second: Section) -> Section:
    """The states of both when the second is fed by the all-pass output of the first."""
    (a1, b1), (a2, b2) = first, second
    a = np.block([[a1, np.zeros((len(a1), len(a2)))], [-b2 @ b1.T, a2]])
    return a, np.vstack([b1, b2])


def _step(dt: float) -> float:
    if dt <= 0.0:
        raise ValueError("a continuous basis filters samples of a known step: give dt")
    return dt
