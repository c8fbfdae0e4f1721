"""Systems and data sets of the state-space criteria, made here from their description.

Rules of this file: a seed gives the same data; noise levels are shares of the clean output's standard deviation.
"""

from __future__ import annotations

import control as ct
import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import states

Array = NDArray[np.float64]


def pair(radius: float, angle: float) -> Array:
    """A 2 x 2 block with the poles radius exp(+-i angle)."""
    c, s = radius * np.cos(angle), radius * np.sin(angle)
    return np.array([[c, s], [-s, c]])


def mimo4() -> Innovations:
    """2 inputs, 3 outputs, poles 0.95 at +-0.25 rad and 0.85 at +-0.9 rad, no direct term."""
    a = np.zeros((4, 4))
    a[:2, :2], a[2:, 2:] = pair(0.95, 0.25), pair(0.85, 0.9)
    b = np.array([[1.0, 0.3], [0.0, 0.6], [0.8, -0.5], [-0.4, 1.0]])
    c = np.array([[1.0, 0.0, 0.5, 0.2], [0.3, 1.0, 0.0, -0.6], [-0.5, 0.4, 1.0, 0.3]])
    return Innovations(a, b, c, np.zeros((3, 2)), np.zeros((4, 3)), 1.0)


def mimo4k_gain() -> Array:
    """A Kalman gain for the same system, the predictor well inside the circle."""
    return np.array([[0.3, 0.1, -0.2], [-0.1, 0.3, 0.1], [0.1, -0.2, 0.2], [0.0, -0.1, 0.1]])


def made(model: Innovations, u: Array, e: Array, x0: Array | None = None) -> Data:
    """Data of an innovation form driven by u (n, nu) and e (n, ny)."""
    x = states(model.a, model.b @ u.T + model.k @ e.T, x0)
    return iddata((model.c @ x).T + u @ model.d.T + e, u, model.dt)


def mimo_set(seed: int, n: int = 5000, *, gain: bool = False, share: float = 0.1) -> tuple[Data, Data, Innovations]:
    """Estimation and validation halves of mimo4 (output noise) or mimo4k (noise through K too), and the truth."""
    rng = np.random.default_rng(seed)
    model = mimo4()
    u = rng.standard_normal((2 * n, 2))
    clean = made(model, u, np.zeros((2 * n, 3))).y
    e = share * clean.std(axis=0) * rng.standard_normal((2 * n, 3))
    if gain:
        k = mimo4k_gain()
        model = Innovations(model.a, model.b, model.c, model.d, k, 1.0, r=np.diag(e.var(axis=0)))
    both = made(model, u, e)
    return both[:n], both, model


def fit_percent(y: Array, said: Array) -> float:
    """100 (1 - |y - yhat| / |y - mean|), mean over outputs."""
    off, spread = np.linalg.norm(y - said, axis=0), np.linalg.norm(y - y.mean(axis=0), axis=0)
    return float(np.mean(100.0 * (1.0 - off / spread)))


def responses(model: Innovations, w: Array) -> NDArray[np.complex128]:
    """(nw, ny, nu) from u to y at w rad a sample."""
    z = np.exp(1j * w)[:, None, None] * np.eye(model.nx)
    return np.asarray(
        model.c @ np.linalg.solve(z - model.a, np.broadcast_to(model.b, (len(w), *model.b.shape))) + model.d
    )


def output_error(system: ct.StateSpace, dt: float) -> Innovations:
    """A python-control system, sampled with held inputs where it is continuous, as a model without a gain."""
    own = ct.sample_system(ct.ss(system), dt) if not system.dt else ct.ss(system)
    return Innovations(own.A, own.B, own.C, own.D, np.zeros((own.nstates, own.noutputs)), dt)


def resonant(dt: float) -> Innovations:
    """Well damped, poles -0.25 +- 0.1j, unit static gain."""
    w2 = 0.25**2 + 0.1**2
    return output_error(ct.tf([w2], [1.0, 0.5, w2]), dt)


def resonant3() -> Innovations:
    """The same behind 1 / (0.1 s + 1), at one second."""
    w2 = 0.25**2 + 0.1**2
    return output_error(ct.tf([w2], [1.0, 0.5, w2]) * ct.tf([1.0], [0.1, 1.0]), 1.0)


def doyle() -> Innovations:
    """A 2 x 2 rotation without damping, poles +-10j, at 0.01 s."""
    a = np.array([[0.0, 10.0], [-10.0, 0.0]])
    return output_error(ct.ss(a, np.eye(2), np.array([[1.0, 10.0], [-10.0, 1.0]]), np.zeros((2, 2))), 0.01)


def random_model(
    rng: np.random.Generator, nx: int, ny: int, nu: int, *, radius: float = 0.9, dt: float = 1.0
) -> Innovations:
    """Stable, the slowest pole of the given modulus."""
    a = rng.standard_normal((nx, nx))
    a *= radius / np.abs(np.linalg.eigvals(a)).max()
    b, c, d = (rng.standard_normal(shape) for shape in ((nx, nu), (ny, nx), (ny, nu)))
    return Innovations(a, b, c, d, np.zeros((nx, ny)), dt)


PITCH = np.array([-0.313, 56.7, -0.0139, -0.426, 0.232, 0.0203])


def pitch(p: Array) -> ct.StateSpace:
    """An aircraft's angle of attack, pitch rate and pitch; angle of attack and pitch are measured."""
    a = np.array([[p[0], p[1], 0.0], [p[2], p[3], 0.0], [0.0, 56.7, 0.0]])
    b, c = np.array([[p[4]], [p[5]], [0.0]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return ct.ss(a, b, c, np.zeros((2, 1)))


TANK = np.array([1.6, 1.6, 4.9, 0.2])  # pump gains, area of a tank, share of the valve
TANK_START = np.array([2.5, 1.5, 3.2, 2.8])


def tank_rates(x: Array, u: Array, p: Array) -> Array:
    """Four tanks (Johansson, 2000), levels x: dx/dt with the first axis the tank."""
    first, second, area, share = p[0], p[1], p[2], p[3]
    outlet = 0.03 / area * np.sqrt(2.0 * 9.81 * np.maximum(x, 1e-6))
    return np.stack([
        outlet[2] - outlet[0] + share * first / area * u[0],
        outlet[3] - outlet[1] + share * second / area * u[1],
        -outlet[2] + (1.0 - share) * second / area * u[1],
        -outlet[3] + (1.0 - share) * first / area * u[0],
    ])  # fmt: skip


def tank_step(x: Array, u: Array, p: Array, t: float) -> Array:
    """One second of it, one Runge-Kutta step."""
    k1 = tank_rates(x, u, p)
    k2 = tank_rates(x + 0.5 * k1, u, p)
    k3 = tank_rates(x + 0.5 * k2, u, p)
    return np.asarray(x + (k1 + 2.0 * k2 + 2.0 * k3 + tank_rates(x + k3, u, p)) / 6.0)


def tank_levels(x: Array, u: Array, p: Array, t: float) -> Array:
    """The two lower levels."""
    return x[:2]


def tank_data(seed: int, n: int = 1101, noise: float = 0.01) -> Data:
    """Pumps switched slowly, both lower levels measured."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)
    u = 0.25 + 0.2 * np.sign(np.stack([np.sin(0.01 * t * (1.0 + t / 800.0)), np.cos(0.013 * t)], axis=1))
    x, y = TANK_START.copy(), np.empty((n, 2))
    for i in range(n):
        y[i] = x[:2]
        x = tank_step(x, u[i], TANK, 0.0)
    return iddata(y + noise * rng.standard_normal((n, 2)), u)
