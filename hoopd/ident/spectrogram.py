"""Spectra that change with time: a parametric model of each short piece, whose spectrum is drawn.

The classical spectrogram is `scipy.signal.spectrogram`; a model of low order shows a few sharp lines in far shorter
pieces.

Rules of this file: any estimator will do that makes a model with a noise part out of Data.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations, Model, Polynomials, state_space

Array = NDArray[np.float64]


class Spectrogram(NamedTuple):
    """Densities (nt, nw) in unit^2/Hz, two-sided, at the middles t (nt,) s of the pieces and at w (nw,) rad/s."""

    t: Array
    w: Array
    density: Array
    models: tuple[Model, ...]


def noise_spectrum(model: Model, w: ArrayLike) -> Array:
    """Give the spectrum of the disturbance at the outputs of a model: H R H* dt, with H from e to y and R = cov e.

    Of a continuous model R is a density, and the spectrum H R H*.

    Parameters
    ----------
    model : Polynomials or Innovations
        The model, sampled or continuous (dt = 0).
    w : array_like, shape (nw,)
        Frequencies in rad/s.

    Returns
    -------
    ndarray of complex, shape (nw, ny, ny)
        Two-sided density in unit^2/Hz.

    Raises
    ------
    ValueError
        A model that does not know the covariance of its innovations.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, noise_spectrum
    >>> white = Polynomials(0.1, variance=4.0)
    >>> noise_spectrum(white, [1.0, 10.0])[:, 0, 0].real.round(6)
    array([0.4, 0.4])
    """
    own = state_space(model) if isinstance(model, Polynomials) else model
    if own.r is None:
        raise ValueError("the model does not know the covariance of its innovations")
    h = _transfer(own, np.asarray(w, dtype=float).reshape(-1))
    return np.asarray(h @ own.r @ np.swapaxes(h, 1, 2).conj() * (own.dt or 1.0))


def model_spectrum(
    data: Data,
    estimator: Callable[[Data], Model],
    segment: int,
    *,
    overlap: int | None = None,
    w: ArrayLike | None = None,
) -> Spectrogram:
    """Give the spectrum of the first output in each short piece, by a parametric model of the piece.

    A model of low order shows a few sharp lines in far shorter pieces than the classical spectrogram
    (`scipy.signal.spectrogram`).

    Parameters
    ----------
    data : Data
        One experiment.
    estimator : callable
        Makes a model with a noise part of a piece, for instance `lambda piece: ar(piece, 6)`; what it raises names the
        piece.
    segment : int
        Samples of a piece.
    overlap : int, optional
        Samples that neighbours share; half a piece unless given.
    w : array_like, shape (nw,), optional
        Frequencies in rad/s; 256 to half of the sampling frequency unless given.

    Returns
    -------
    Spectrogram
        Two-sided `density` (nt, nw) in unit^2/Hz at the middles `t` (nt,) s and at `w` rad/s, and the `models`.

    Raises
    ------
    ValueError
        Pieces that do not fit into the data.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import ar, iddata, model_spectrum
    >>> t = 0.01 * np.arange(2000)
    >>> tone = np.sin(2 * np.pi * np.where(t < 10.0, 5.0, 20.0) * t)  # 5 Hz, then 20 Hz
    >>> data = iddata(tone + 0.1 * np.random.default_rng(0).standard_normal(2000), dt=0.01)
    >>> found = model_spectrum(data, lambda piece: ar(piece, 4), segment=500, overlap=0)
    >>> found.t, (found.w[found.density.argmax(axis=1)] / (2 * np.pi)).round()
    (array([ 2.5,  7.5, 12.5, 17.5]), array([ 5.,  5., 20., 20.]))
    """
    shared = segment // 2 if overlap is None else overlap
    if not 0 <= shared < segment <= data.n:
        raise ValueError(f"pieces of {segment} samples with {shared} shared do not fit into {data.n} samples")
    axis = np.linspace(0.0, np.pi / data.dt, 256) if w is None else np.asarray(w, dtype=float)
    starts = range(0, data.n - segment + 1, segment - shared)
    models = tuple(_estimated(estimator, data[i : i + segment]) for i in starts)
    density = np.array([noise_spectrum(one, axis)[:, 0, 0].real for one in models])
    return Spectrogram(data.t[list(starts)] + 0.5 * segment * data.dt, axis, density, models)


def _estimated(estimator: Callable[[Data], Model], piece: Data) -> Model:
    try:
        return estimator(piece)
    except ValueError as error:
        raise ValueError(f"from {piece.t0:g} to {piece.t0 + piece.n * piece.dt:g} s: {error}") from error


def _transfer(model: Innovations, w: Array) -> NDArray[np.complex128]:
    """I + C (zI - A)^-1 K at z = exp(j w dt), or s = j w of a continuous model, (nw, ny, ny)."""
    z = np.exp(1j * w * model.dt) if model.dt else 1j * w
    inner = z[:, None, None] * np.eye(model.nx) - model.a
    gain = np.broadcast_to(model.k.astype(complex), (len(w), *model.k.shape))
    return np.asarray(np.eye(model.ny) + model.c @ np.linalg.solve(inner, gain))
