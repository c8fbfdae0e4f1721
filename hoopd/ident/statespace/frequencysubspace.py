"""Subspace identification from frequency data (McKelvey, Akcay & Ljung, IEEE Trans. Automatic Control 41, 1996).

With z_k = exp(j w_k dt) the columns [Y_k; z_k Y_k; z_k^2 Y_k; ...] are the observability matrix times states, plus what
the inputs [U_k; z_k U_k; ...] add. The LQ factor of the real and imaginary parts removes the inputs; singular vectors
give A and C, linear least squares B and D. Spectra of a finite record have a transient besides: an input z_k through a
vector that is estimated.

Rules of this file: w is in rad/s and dt in seconds always; dt = 0 is continuous time, by the bilinear map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd.ident.checks import SINGULAR
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import estimated
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.frequencyinputs import Spectra, fit_inputs, fit_outputs, fit_rest, ones
from hoopd.ident.statespace.stabilise import stabilize

# Singular values of white noise lie within so many times their median (Marchenko & Pastur, 1967, for square matrices).
CHANCE = 3.0
# A pole at this share of the lowest frequency turns the phase there by 63 degrees, an integrator by 90.
SLOWER = 0.5

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class GivenMatrices:
    """Matrices that are given and not estimated."""

    a: Array | None = None
    b: Array | None = None
    c: Array | None = None


@estimated("subspace over frequency")
def frequency_subspace(
    w: ArrayLike,
    y: ArrayLike,
    u: ArrayLike | None = None,
    *,
    dt: float,
    order: int | None = None,
    most_order: int = 10,
    horizon: int | None = None,
    direct: bool = True,
    transient: bool | None = None,
    weights: ArrayLike | None = None,
    stable: bool = False,
    known: GivenMatrices | None = None,
) -> Innovations:
    """Identify a state-space model from frequency data by subspaces.

    Parameters
    ----------
    w : array_like, shape (n,)
        Frequencies in rad/s, up to pi/dt.
    y : array_like of complex, shape (n, ny, nu) or (n, ny)
        A frequency response, or the spectra of outputs.
    u : array_like of complex, shape (n, nu), optional
        The spectra of inputs.
    dt : float
        Step in s, 0 for continuous time (by the bilinear map).
    order : int, optional
        States; without it the largest ratio of neighbouring singular values.
    most_order : int
        Largest order that is looked at.
    horizon : int, optional
        Block rows; 2 order + 2 unless given.
    direct : bool
        Whether D is estimated.
    transient : bool, optional
        Whether the vector x0 - x(N), over sqrt(N) for a unitary transform, is estimated and handed out as `x0`; it is
        where `u` is given.
    weights : array_like, shape (n,), optional
        They multiply the errors.
    stable : bool
        Whether poles outside the unit circle are moved in.
    known : Known, optional
        A and C, or A and B; the rest is least squares.

    Returns
    -------
    Innovations
        The model, k = 0.

    Raises
    ------
    ValueError
        Shapes that do not fit, frequencies beyond pi/dt, too few points.

    Notes
    -----
    Source: McKelvey, Akcay & Ljung, IEEE Trans. Automatic Control 41, 1996.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import frequency_subspace
    >>> w = np.linspace(0.1, 20.0, 100)
    >>> z = np.exp(1j * w * 0.1)
    >>> g = 1.0 / (z**2 - 1.5 * z + 0.7)
    >>> np.poly(frequency_subspace(w, g[:, None, None], dt=0.1, order=2).a).round(6)
    array([ 1. , -1.5,  0.7])
    """
    own = np.asarray(w, dtype=float)
    step, points = _sampled(own, dt)
    has_transient = (u is not None) if transient is None else transient
    data = _spectra(points, y, u, weights)
    given = known or GivenMatrices()
    _check_sizes(order, most_order, horizon)
    _check_power(own, data)
    if given.a is None:
        a, c, s = _dynamics(data, order, most_order, horizon, has_transient)
        model = fit_rest(data, stabilize(a) if stable else a, c, direct, has_transient)
        model = replace(model, singular_values=s)
    elif given.c is not None:
        model = fit_inputs(data, given.a, given.c, direct, has_transient)
    elif given.b is not None:
        model = fit_outputs(data, given.a, given.b, np.zeros(len(given.a)), direct)
    else:
        raise ValueError("known gives A with C, or A with B")
    model = _continuous(model, step) if dt == 0.0 else replace(model, dt=dt)
    _check_slow(model, own)
    return model


def _check_sizes(*sizes: int | None) -> None:
    if any(one is not None and one < 1 for one in sizes):
        raise ValueError(f"order, most_order and horizon are from 1 on, not {', '.join(map(str, sizes))}")


def _check_power(w: Array, data: Spectra) -> None:
    """ValueError for a channel that moves at no frequency but 0."""
    for kind, values in (("output", data.y), ("input", data.u)):
        power = np.square(np.abs(values)).sum(axis=2)
        idle = np.flatnonzero(power[w > 0.0].max(axis=0, initial=0.0) <= SINGULAR * power.max(axis=0, initial=0.0))
        if len(idle):
            raise ValueError(f"{kind} {idle[0] + 1} is constant or zero: it tells nothing at any frequency")


def _check_excitation(inputs: Array, rows: int) -> None:
    """Warn when the triangular factor of the inputs' block rows (and the transient's) has less than full rank."""
    size = np.maximum(np.linalg.norm(inputs, axis=0), 1e-300)
    rank = int(np.linalg.matrix_rank(inputs / size, tol=np.sqrt(SINGULAR * len(size))))
    if rank < len(size):
        warn(
            f"not persistently exciting: the {rows} block rows of the inputs have rank {rank} and {len(size)} is "
            "wanted; take an input of more lines or a lower order"
        )


def _check_slow(model: Innovations, w: Array) -> None:
    """Warn of a pole so near to 1 (to 0 in continuous time) that no frequency shows where it ends."""
    low = w[w > 0.0].min(initial=np.inf)
    poles = np.linalg.eigvals(model.a).astype(complex)
    rate = poles if model.dt == 0.0 else np.log(np.where(poles == 0.0, 1e-300, poles)) / model.dt
    if (np.abs(rate) < SLOWER * low).any():
        warn(f"an integrator: a pole is slower than the lowest frequency, {low:.3g} rad/s; simulations drift")


def from_response(response: ct.FrequencyResponseData, *, dt: float | None = None, **options: object) -> Innovations:
    """Identify a state-space model from python-control's frequency response data.

    Parameters
    ----------
    response : control.FrequencyResponseData
        The response, frequencies in rad/s.
    dt : float, optional
        Step in s, 0 for continuous time; that of the response unless given.
    **options : object
        As in `frequency_subspace`.

    Returns
    -------
    Innovations
        The model, k = 0.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import from_response, frequency_response
    >>> truth = control.tf([1.0], [1.0, 0.4, 4.0])
    >>> model = from_response(frequency_response(truth, np.linspace(0.1, 10.0, 80)), order=2)
    >>> np.poly(model.a).round(6)
    array([1. , 0.4, 4. ])
    """
    step = float(response.dt or 0.0) if dt is None else dt
    values = np.moveaxis(np.asarray(response.frdata), 2, 0)
    return frequency_subspace(np.asarray(response.omega), values, dt=step, **options)  # type: ignore[arg-type]


def _sampled(w: Array, dt: float) -> tuple[float, Complex]:
    """The step and z; continuous frequencies by w -> 2 atan(w T / 2), T in the middle of them."""
    if w.ndim != 1 or not np.isfinite(w).all() or (w < 0.0).any():
        raise ValueError("w must be (n,) frequencies in rad/s, none negative")
    if dt > 0.0:
        if w.max() * dt > np.pi * (1.0 + 1e-9):
            raise ValueError(f"{w.max():g} rad/s is beyond the Nyquist frequency of {dt:g} s: {np.pi / dt:g} rad/s")
        return dt, np.exp(1j * w * dt)
    inner = w[w > 0.0]
    step = 2.0 / float(np.sqrt(inner.min() * inner.max()))
    return step, np.exp(2j * np.arctan(w * step / 2.0))


def _spectra(z: Complex, y: ArrayLike, u: ArrayLike | None, weights: ArrayLike | None) -> Spectra:
    out = np.asarray(y, dtype=complex)
    n = len(z)
    if len(out) != n:
        raise ValueError(f"{len(out)} values at {n} frequencies")
    if u is None:
        out = out.reshape(n, 1, 1) if out.ndim == 1 else out
        if out.ndim != 3:
            raise ValueError(
                f"a frequency response is (n, outputs, inputs), not {out.shape}; of spectra, u is wanted too"
            )
        into = np.broadcast_to(np.eye(out.shape[2], dtype=complex), (n, out.shape[2], out.shape[2]))
    else:
        out = out.reshape(n, -1, 1)
        into = np.asarray(u, dtype=complex).reshape(n, -1, 1)
    if not (np.isfinite(out).all() and np.isfinite(into).all()):
        raise ValueError("a value is not finite")
    by = np.ones(n) if weights is None else np.asarray(weights, dtype=float)
    return Spectra(z, out, np.asarray(into), by)


def _dynamics(
    data: Spectra, order: int | None, most: int, horizon: int | None, transient: bool
) -> tuple[Array, Array, Array]:
    """A, C and the singular values."""
    ny = data.y.shape[1]
    u = data.u if not transient else np.concatenate([data.u, ones(data) * data.z[:, None, None]], axis=1)
    columns = 2 * len(data.z) * data.y.shape[2]
    r = horizon or min(2 * (order or most) + 2, max(columns // (2 * (ny + u.shape[1])), 2))
    low = linalg.qr(np.vstack([_stacked(data, u, r), _stacked(data, data.y, r)]).T, mode="r")[0]
    nu, rows = r * u.shape[1], r * (ny + u.shape[1])
    if len(low) < rows:
        raise ValueError(f"too few frequencies: {len(data.z)} for {r} block rows")
    _check_excitation(low[:nu, :nu], r)
    left, s, _ = linalg.svd(low[nu:rows, nu:rows].T)
    nx = order or _gap(s, min(most, len(s) - ny))
    if nx > (r - 1) * ny:
        raise ValueError(f"order {nx} needs more than {r} block rows")
    if s[nx - 1] < 1e-13 * s[0]:
        warn(f"order too high: singular value {nx} is rounding")
    elif s[nx - 1] < CHANCE * np.median(s[nx:]) and len(s) > 2 * nx:
        warn(f"order too high: singular value {nx} is no larger than those of the noise after it")
    gamma = left[:, :nx]
    a = np.linalg.lstsq(gamma[:-ny], gamma[ny:], rcond=None)[0]
    return np.asarray(a, dtype=float), gamma[:ny], s


def _stacked(data: Spectra, values: Complex, r: int) -> Array:
    """[V; z V; ...] (r rows(V), 2 n m), real parts beside imaginary ones."""
    powers = data.z[:, None] ** np.arange(r)
    all_rows = np.einsum("n,ni,nrm->irnm", data.weights, powers, values).reshape(r * values.shape[1], -1)
    return np.asarray(np.hstack([all_rows.real, all_rows.imag]))


def _gap(s: Array, most: int) -> int:
    """Where neighbouring singular values differ most, rounding counted as nothing."""
    floor = np.maximum(s, 1e-13 * s[0])
    return int(np.argmax(floor[:most] / floor[1 : most + 1])) + 1


def _continuous(model: Innovations, step: float) -> Innovations:
    """s = (2/T)(z - 1)/(z + 1) put into the model, T the step of the map."""
    inverse = np.linalg.inv(model.a + np.eye(model.nx))
    root = np.sqrt(4.0 / step)
    return replace(
        model, a=(2.0 / step) * inverse @ (model.a - np.eye(model.nx)), b=root * inverse @ model.b,
        c=root * model.c @ inverse, d=model.d - model.c @ inverse @ model.b, dt=0.0,
    )  # fmt: skip
