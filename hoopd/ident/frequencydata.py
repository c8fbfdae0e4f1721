"""Inputs and outputs over frequency, and what python-control's frequency responses (`control.FRD`) lack.

Sums, products, powers, quotients of one input and output, `append` and plots are python-control's own. Here: slices in
Hz and rad/s, responses side by side, inverses and quotients of many channels, roots, feedback of either sign (theirs
takes every sign for -1), and the sample time, which their algebra loses.

Rules of this file: w in rad/s, names with `hz` in Hz; frequencies along the first axis of FrequencyData and along the
last one of an FRD, as python-control has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
from hoopd.ident.gaps import whole

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Lti: TypeAlias = ct.TransferFunction | ct.StateSpace | ct.FRD

TAU = 2.0 * np.pi


@dataclass(frozen=True)
class FrequencyData:
    """One experiment over frequency.

    A transformed record obeys y = G u up to the difference of its first and last state; a periodic one obeys it
    exactly.

    Attributes
    ----------
    y : ndarray of complex, shape (nw, ny)
        Outputs.
    u : ndarray of complex, shape (nw, nu)
        Inputs.
    w : ndarray, shape (nw,)
        Frequencies in rad/s.
    dt : float
        Step in s, 0 for continuous.
    samples : int
        Samples of the record that it was transformed from, 0 for none.
    outputs, inputs : tuple of str
        Names by channel.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import FrequencyData
    >>> data = FrequencyData(np.ones((3, 1)), np.ones((3, 1)), 2 * np.pi * np.array([1.0, 2.0, 3.0]))
    >>> data.n, data.hz, data.between_hz(1.5, 3.0).n
    (3, array([1., 2., 3.]), 2)
    """

    y: Complex
    u: Complex
    w: Array
    dt: float = 0.0
    samples: int = 0
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()

    @property
    def n(self) -> int:
        """Frequencies."""
        return len(self.w)

    @property
    def ny(self) -> int:
        """Outputs."""
        return int(self.y.shape[1])

    @property
    def nu(self) -> int:
        """Inputs."""
        return int(self.u.shape[1])

    @property
    def hz(self) -> Array:
        """(nw,) Hz."""
        return np.asarray(self.w / TAU)

    def __getitem__(self, rows: slice) -> FrequencyData:
        """Frequencies by number."""
        if not isinstance(rows, slice):
            raise TypeError("frequencies are taken as data[first:last:step]")
        return replace(self, y=self.y[rows], u=self.u[rows], w=self.w[rows])

    def between(self, low: float, high: float) -> FrequencyData:
        """What lies within low <= w <= high rad/s."""
        return self[_range(self.w, low, high)]

    def between_hz(self, low: float, high: float) -> FrequencyData:
        """What lies within low to high Hz, both included."""
        return self.between(TAU * low, TAU * high)


def frequencydata(
    y: ArrayLike, u: ArrayLike | None, w: ArrayLike, dt: float = 0.0,
    *, outputs: Sequence[str] = (), inputs: Sequence[str] = (),
) -> FrequencyData:  # fmt: skip
    """Of arrays (nw,) or (nw, channels); u = None for none. ValueError for lengths that differ and w not rising."""
    axis = np.asarray(w, dtype=float).reshape(-1)
    if not (np.isfinite(axis).all() and (np.diff(axis) > 0.0).all() and (axis >= 0.0).all()):
        raise ValueError("w must be finite, not negative and rising")
    if dt > 0.0 and len(axis) and axis[-1] > np.pi / dt * (1.0 + 1e-9):
        raise ValueError(f"w goes to {axis[-1]:g} rad/s, half of the sampling frequency is {np.pi / dt:g}")
    outs, ins = _columns(y, len(axis), "y"), _columns(np.zeros((len(axis), 0)) if u is None else u, len(axis), "u")
    return FrequencyData(outs, ins, axis, dt, 0, tuple(outputs), tuple(inputs))


def frequency_axis(dt: float, n: int) -> Array:
    """Give frequencies from 0 to half of the sampling frequency.

    Parameters
    ----------
    dt : float
        Step in s.
    n : int
        How many.

    Returns
    -------
    ndarray, shape (n,)
        Frequencies in rad/s.

    Examples
    --------
    >>> from hoopd.ident import frequency_axis
    >>> frequency_axis(0.1, 3).round(3)
    array([ 0.   , 15.708, 31.416])
    """
    return np.linspace(0.0, np.pi / dt, n)


def fft(data: Data) -> FrequencyData:
    """Give the discrete Fourier transform of data.

    Y(w_k) = sum_t y(t) exp(-j w_k t)/sqrt(N), w_k = 2 pi k/(N dt) up to pi/dt. So scaled, |Y|^2 of white noise is its
    variance whatever N.

    Parameters
    ----------
    data : Data
        One experiment without gaps.

    Returns
    -------
    FrequencyData
        Outputs and inputs over frequency.

    Raises
    ------
    ValueError
        A gap.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 2.37.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, fft
    >>> found = fft(iddata(np.cos(2 * np.pi * 5.0 * 0.01 * np.arange(100)), dt=0.01))
    >>> found.hz[np.abs(found.y[:, 0]).argmax()].round(6).item()
    5.0
    """
    done = whole(data, "transform")
    root = np.sqrt(max(done.n, 1))
    w = np.asarray(TAU * np.fft.rfftfreq(done.n, done.dt), dtype=float)
    return FrequencyData(
        np.fft.rfft(done.y, axis=0) / root, np.fft.rfft(done.u, axis=0) / root, w,
        done.dt, done.n, done.outputs, done.inputs,
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------- responses


def frequency_response(system: Lti, w: ArrayLike) -> ct.FRD:
    """Give the frequency response of a system, with the system's names and sample time.

    Parameters
    ----------
    system : control.StateSpace, control.TransferFunction or control.FRD
        The system; an FRD is asked at its own frequencies.
    w : array_like, shape (nw,)
        Frequencies in rad/s.

    Returns
    -------
    control.FRD
        The response.

    Raises
    ------
    ValueError
        An FRD, at a frequency that it does not have.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import frequency_response
    >>> lag = frequency_response(control.tf([1.0], [1.0, 1.0]), [1.0])
    >>> abs(lag.frdata[0, 0]).round(3)  # 1/sqrt 2 at the corner
    array([0.707])
    """
    axis = np.asarray(w, dtype=float).reshape(-1)
    if not isinstance(system, ct.FRD):
        return ct.FRD(system, axis, inputs=system.input_labels, outputs=system.output_labels)
    rows = np.searchsorted(system.omega, axis * (1.0 - 1e-9))
    if (rows >= len(system.omega)).any() or not np.allclose(system.omega[rows], axis, rtol=1e-8):
        raise ValueError("a frequency response is known at its own frequencies only")
    return _like(system, system.frdata[:, :, rows], axis)


def between(frd: ct.FRD, low: float, high: float) -> ct.FRD:
    """Cut a frequency response to a band in rad/s.

    Parameters
    ----------
    frd : control.FRD
        The response.
    low, high : float
        Band in rad/s, both ends included.

    Returns
    -------
    control.FRD
        The response within it.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import between, frequency_response
    >>> between(frequency_response(control.tf([1.0], [1.0, 1.0]), [1.0, 2.0, 3.0]), 1.5, 3.0).omega
    array([2., 3.])
    """
    rows = _range(frd.omega, low, high)
    return _like(frd, frd.frdata[:, :, rows], frd.omega[rows])


def between_hz(frd: ct.FRD, low: float, high: float) -> ct.FRD:
    """Cut a frequency response to a band in Hz.

    Parameters
    ----------
    frd : control.FRD
        The response.
    low, high : float
        Band in Hz, both ends included.

    Returns
    -------
    control.FRD
        The response within it.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import between_hz, frequency_response
    >>> between_hz(frequency_response(control.tf([1.0], [1.0, 1.0]), [1.0, 6.2, 12.6]), 0.5, 1.5).omega
    array([6.2])
    """
    return between(frd, TAU * low, TAU * high)


def sampled(frd: ct.FRD, dt: float) -> ct.FRD:
    """The same response of a system sampled each `dt` s: python-control's algebra gives results without it."""
    return ct.FRD(frd.frdata, frd.omega, dt)


def beside(*parts: ct.FRD) -> ct.FRD:
    """Responses with the same outputs, their inputs side by side: [G H]."""
    return ct.FRD(np.concatenate(_aligned(parts), axis=1), parts[0].omega, parts[0].dt)


def stacked(*parts: ct.FRD) -> ct.FRD:
    """Responses to the same inputs, their outputs one under the other: [G; H]."""
    return ct.FRD(np.concatenate(_aligned(parts), axis=0), parts[0].omega, parts[0].dt)


def inverse(frd: ct.FRD) -> ct.FRD:
    """G^-1 of as many inputs as outputs; ValueError where it has none."""
    try:
        return _like(frd, _last(np.asarray(np.linalg.inv(_first(frd.frdata)), complex)), frd.omega)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"this response has no inverse: {error}") from error


def root(frd: ct.FRD) -> ct.FRD:
    """The square root of each entry, its phase continuous over frequency from half of the first."""
    phase = np.unwrap(np.angle(frd.frdata), axis=2)
    return _like(frd, np.sqrt(np.abs(frd.frdata)) * np.exp(0.5j * phase), frd.omega)


def feedback(forward: Lti, back: Lti | float = 1.0, sign: int = -1, w: ArrayLike | None = None) -> ct.FRD:
    """The closed loop G (I - sign K G)^-1 over the frequencies of the first response among the two, or w.

    `back` as a number stands for so many times the identity.
    """
    axis = next((one.omega for one in (forward, back) if isinstance(one, ct.FRD)), w)
    if axis is None:
        raise ValueError("two systems without frequencies: give w")
    g = frequency_response(forward, axis)
    number = isinstance(back, int | float | np.number)
    k = back * np.eye(g.ninputs, g.noutputs)[None] if number else _first(frequency_response(back, axis).frdata)
    if k.shape[1:] != (g.ninputs, g.noutputs):
        raise ValueError(f"the loop of {g.noutputs} outputs and {g.ninputs} inputs is closed by {k.shape[1:]}")
    through = _first(g.frdata)
    closed = through @ np.linalg.inv(np.eye(g.ninputs) - sign * k @ through)
    return _like(g, _last(closed), g.omega)


# ---------------------------------------------------------------------------------------------- inside


def _range(w: Array, low: float, high: float) -> slice:
    first, last = np.searchsorted(w, low * (1.0 - 1e-9)), np.searchsorted(w, high * (1.0 + 1e-9), side="right")
    return slice(int(first), int(last))


def _columns(values: ArrayLike, n: int, name: str) -> Complex:
    found = np.array(values, dtype=complex)
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or len(found) != n:
        raise ValueError(f"{name} must be (nw,) or (nw, channels) with nw = {n}, not {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} is not finite")
    return found


def _like(frd: ct.FRD, values: Complex, w: Array) -> ct.FRD:
    same = values.shape[:2] == (frd.noutputs, frd.ninputs)
    names = {"inputs": frd.input_labels, "outputs": frd.output_labels} if same else {}
    return ct.FRD(values, w, frd.dt, **names)


def _aligned(parts: Sequence[ct.FRD]) -> list[Complex]:
    w = parts[0].omega
    if any(len(one.omega) != len(w) or not np.allclose(one.omega, w, rtol=1e-9) for one in parts):
        raise ValueError("responses at different frequencies are not put together")
    return [one.frdata for one in parts]


def _first(values: Complex) -> Complex:
    return np.moveaxis(values, 2, 0)


def _last(values: Complex) -> Complex:
    return np.moveaxis(values, 0, 2)
