"""Spectra, coherence, correlations and the frequency response straight from data, for any number of channels.

    y = G u + v:   Phi_yu = G Phi_uu,   Phi_vv = Phi_yy - Phi_yu Phi_uu^-1 Phi_uy
By Welch (means over windowed segments that overlap) or by Blackman and Tukey (correlations under a Gaussian window).
A spectrum is two-sided, in unit^2/Hz: its integral from -fs/2 to fs/2 is the variance; white noise of variance r has
r dt everywhere. Means are not taken off: `detrend` first unless the gain at 0 is wanted.
Sources: Ljung, System Identification, 1999, 6.4; Bendat and Piersol, Random Data, 2010, ch. 9; P. D. Welch, IEEE Trans.
Audio Electroacoust. 15 (1967) for the number of independent means.

Rules of this file: one matrix of all cross spectra feeds every estimate; each estimate says how far it can be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, stats

from hoopd.ident.checks import BROAD, CONSTANT, Orders, check
from hoopd.ident.crossspectra import Cross, Given, Method, spectra
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.loopchecks import check_record
from hoopd.ident.response_model import ResponseModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, repr=False)
class FrequencyEstimate(FreeModel):
    """A frequency response and what it is worth.

    `system` and `noise` (spectrum of v, unit^2/Hz, ny x ny) are FRDs; `deviation` (ny, nu, nw) is the standard error of
    |G|; `coherence` (nw, ny) the share of each output that all inputs explain; `means` how many spectra were averaged.
    """

    system: ct.FRD
    noise: ct.FRD
    deviation: Array
    coherence: Array
    means: float
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self.system.input_labels)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.system.output_labels)

    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone, from rest, by the discrete Fourier transform."""
        return ResponseModel(self.system).simulate(data, x0, seed=seed)

    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """The simulation, whatever the horizon."""
        return self.simulate(data, x0)

    @property
    def w(self) -> Array:
        """(nw,) rad/s."""
        return np.asarray(self.system.omega)


class Spectrum(NamedTuple):
    """Power spectral density (nw, channels) in unit^2/Hz, two-sided, at w rad/s, with the bounds of its interval."""

    w: Array
    density: Array
    low: Array
    high: Array
    means: float


class Correlation(NamedTuple):
    """Correlations (lags, n first, n second) by lag in samples; within `bound` with the probability asked for.

    `pairs`, of the same shape: how many products each is the mean of.
    """

    lag: NDArray[np.int_]
    values: Array
    bound: float
    pairs: NDArray[np.int_]


# ---------------------------------------------------------------------------------------------- estimates


@estimated("frequency response")
def tfest(data: Given, method: Method = "welch", **options: float) -> FrequencyEstimate:
    """Estimate the frequency response from every input to every output, and the noise beside it.

        y = G u + v:   Phi_yu = G Phi_uu,   Phi_vv = Phi_yy - Phi_yu Phi_uu^-1 Phi_uy
        var |G_ij| = Phi_vv,ii [Phi_uu^-1]_jj / (means - nu) / 2, and twice that at 0 and at half the sampling frequency
    Feedback biases G towards -1/controller: a warning tells of it. Means are not taken off: `detrend` first unless the
    gain at 0 is wanted.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    method : {"welch", "correlation"}
        Means over windowed segments, or correlations under a Gaussian window (Blackman and Tukey).
    **options : int
        Of "welch": `segment` (samples; a tenth of the longest experiment) and `overlap` (samples; half a segment).
        Of "correlation": `width` of the lag window in samples (standard deviation; a twentieth of the experiment).

    Returns
    -------
    Estimate
        `system` and `noise` (unit^2/Hz) as control.FRD, the standard error `deviation` (ny, nu, nw) of |G|, the
        `coherence` (nw, ny) and the number of `means`.

    Raises
    ------
    ValueError
        Inputs that are missing or alike, and fewer means than inputs.

    Notes
    -----
    Sources: Ljung, System Identification, 1999, 6.4; Bendat and Piersol, Random Data, 2010, ch. 9; P. D. Welch, IEEE
    Trans. Audio Electroacoust. 15 (1967) for the number of independent means.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, tfest
    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal(4000)
    >>> y = 2.0 * u + 0.5 * rng.standard_normal(4000)
    >>> found = tfest(iddata(y, u, 0.1), segment=100)
    >>> np.abs(found.system.frdata[0, 0]).mean().round(2).item()  # the gain
    2.0
    >>> found.noise.frdata.real.mean().round(3).item()  # variance times dt: 0.025
    0.025
    """
    if isinstance(method, int | np.integer):
        raise TypeError(
            "this is the spectral estimate; a transfer function of so many poles is srivc(data, poles, zeros)"
        )
    _check(data)
    cross = spectra(data, method, **options)
    nu = cross.phi.shape[1] - cross.ny
    spare = _spare(cross, nu)
    inverse = _inverse(cross)
    g = cross.yu @ inverse
    # Phi_vv of `means` means with nu regressors in each is short by (means - nu)/means
    noise = (cross.yy - g @ _adjoint(cross.yu)) * cross.means / spare
    # half of the complex error lies along G, all of it where the transform is real
    along = 0.5 / _share(cross)
    spread = along * np.einsum("kii,kjj->ijk", noise.real, inverse.real) / spare
    system = ct.FRD(np.moveaxis(g, 0, 2), cross.w, cross.dt, **_names(data))
    return FrequencyEstimate(
        system, ct.FRD(np.moveaxis(noise, 0, 2), cross.w, cross.dt), np.sqrt(np.maximum(spread, 0.0)),
        _explained(cross, inverse), cross.means,
    )  # fmt: skip


class Coherence(NamedTuple):
    """Squared coherence (nw, ny), or (nw, ny, nu) by pairs, at w rad/s; unrelated channels stay below `chance`, (nw, 1)
    or (nw, 1, 1)."""

    w: Array
    values: Array
    chance: Array


def coherence(
    data: Given, method: Method = "welch", *, pairs: bool = False, level: float = 0.95, **options: float
) -> Coherence:
    """Give the share of each output's power that the inputs explain linearly, 0 to 1.

    That of unrelated channels has a beta distribution of nu and means - nu, of half as many at 0 and at half the
    sampling frequency, where the transform is real.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    method : {"welch", "correlation"}
        As in `tfest`.
    pairs : bool
        One input at a time, instead of all at once (multiple coherence, which one input's own would understate).
    level : float
        Probability with which unrelated channels stay below `chance` at a frequency.
    **options : int
        As in `tfest`.

    Returns
    -------
    Coherence
        Squared coherence `values` (nw, ny), or (nw, ny, nu) by pairs, at `w` rad/s, and `chance` (nw, 1) or (nw, 1, 1).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import coherence, iddata
    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal(4000)
    >>> y = u + rng.standard_normal(4000)  # half of the power is noise
    >>> found = coherence(iddata(y, u, 0.1), segment=100)
    >>> found.values.mean().round(2).item(), bool((found.values > found.chance).all())
    (0.5, True)
    """
    _check(data)
    cross = spectra(data, method, **options)
    nu = 1 if pairs else cross.phi.shape[1] - cross.ny
    spare = _spare(cross, nu)
    share = _share(cross)
    chance = np.asarray(stats.beta.ppf(level, share * nu, share * spare))[:, None]
    if not pairs:
        return Coherence(cross.w, _explained(cross, _inverse(cross)), chance)
    power = np.einsum("kii->ki", cross.phi).real
    shares = np.abs(cross.yu) ** 2 / _positive(power[:, : cross.ny, None] * power[:, None, cross.ny :])
    return Coherence(cross.w, np.clip(shares, 0.0, 1.0), chance[:, None])


def power_spectrum(data: Given, *, inputs: bool = False, level: float = 0.95, **options: float) -> Spectrum:
    """Give Welch's spectrum of each output (or input), with its interval.

    A spectrum is two-sided: its integral from -fs/2 to fs/2 is the variance. The interval is that of a chi square of
    2 x means degrees of freedom, of half as many at 0 and at half the sampling frequency, where the transform is real.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    inputs : bool
        The inputs instead of the outputs.
    level : float
        Probability of the interval.
    **options : int
        As in `tfest`.

    Returns
    -------
    Spectrum
        `density` (nw, channels) in unit^2/Hz at `w` rad/s, its bounds `low` and `high`, and the number of `means`.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, power_spectrum
    >>> noise = iddata(np.random.default_rng(0).standard_normal(4000), dt=0.1)
    >>> found = power_spectrum(noise, segment=100)
    >>> found.density[1:-1].mean().round(2).item()  # variance 1 times dt
    0.1
    >>> np.mean((found.low < 0.1) & (found.high > 0.1)).round(1).item()
    1.0
    """
    cross = spectra(data, "welch", **options)
    rows = slice(cross.ny, None) if inputs else slice(0, cross.ny)
    density = np.asarray(np.einsum("kii->ki", cross.phi).real[:, rows])
    freedom = 2.0 * cross.means * _share(cross)[:, None]
    low, high = (freedom / stats.chi2.ppf(p, freedom) for p in (0.5 + 0.5 * level, 0.5 - 0.5 * level))
    return Spectrum(cross.w, density, density * low, density * high, cross.means)


def correlation(
    first: NDArray[np.float64], second: NDArray[np.float64] | None = None, lags: int = 50, level: float = 0.95
) -> Correlation:
    """Give the correlation coefficients of first(t + lag) with second(t), means taken off.

    Of m samples whose partner was measured the mean is taken, times the (n - |lag|)/n that makes a matrix of
    correlations definite. Two unrelated white signals stay within normal quantile / sqrt(n), n the samples that have a
    partner at lag 0.

    Parameters
    ----------
    first : ndarray, shape (n,) or (n, p)
        Signals; NaN is missing.
    second : ndarray, shape (n,) or (n, q), optional
        Signals; without it `first` itself.
    lags : int
        Lags run from -lags to lags samples.
    level : float
        Probability of the bound.

    Returns
    -------
    Correlation
        `values` (lags, p, q) at `lag`, the `bound`, and how many `pairs` each is the mean of.

    Raises
    ------
    ValueError
        A constant channel.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import correlation
    >>> u = np.random.default_rng(0).standard_normal(1000)
    >>> found = correlation(np.roll(u, 3), u, lags=10)  # 3 samples later
    >>> found.lag[found.values[:, 0, 0].argmax()].item(), round(float(found.bound), 3)
    (3, 0.062)
    """
    one, other = (_centred(values) for values in (first, first if second is None else second))
    n, reach = len(one), min(lags, len(one) - 1)
    lag = np.arange(-reach, reach + 1)
    sums = _sums(np.nan_to_num(one), np.nan_to_num(other), lag)
    pairs = np.round(_sums(np.isfinite(one).astype(float), np.isfinite(other).astype(float), lag))
    values = sums / np.maximum(pairs, 1.0) * (1.0 - np.abs(lag) / n)[:, None, None]
    at_once = max(float(pairs[reach].min()), 1.0)
    return Correlation(lag, values, float(stats.norm.ppf(0.5 + 0.5 * level)) / np.sqrt(at_once), pairs.astype(int))


def _sums(one: Array, other: Array, lag: NDArray[np.int64]) -> Array:
    """sum_t one(t + lag) other(t), (lags, p, q)."""
    size = fft.next_fast_len(2 * len(one))
    product = np.fft.rfft(one, size, axis=0)[:, :, None] * np.fft.rfft(other, size, axis=0)[:, None, :].conj()
    return np.asarray(np.fft.irfft(product, size, axis=0)[lag])


# ---------------------------------------------------------------------------------------------- inside


def _check(data: Given) -> None:
    """Between the lines of an input that has few nothing is known; a loop and a drift hide the system."""
    each = experiments(data)
    check(each, orders=Orders(0, BROAD))
    check_record(each)


def _spare(cross: Cross, nu: int) -> float:
    if nu < 1:
        raise ValueError("no input: power_spectrum gives the spectra of the outputs")
    if cross.means <= nu + 0.5:
        raise ValueError(f"{cross.means:.1f} independent means for {nu} inputs explain anything: take shorter segments")
    return cross.means - nu


def _inverse(cross: Cross) -> Complex:
    """Phi_uu^-1; inputs that move together or not at all have none."""
    power = np.einsum("kii->ki", cross.uu).real
    idle = power.max(axis=0, initial=0.0) == 0.0
    if idle.any():
        raise ValueError(f"input {int(np.flatnonzero(idle)[0])} is zero: nothing shows its effect")
    floor = 1e-14 * power.max(axis=0)
    scale = np.sqrt(np.maximum(power, floor))
    relative = cross.uu / (scale[:, :, None] * scale[:, None, :])
    if power.shape[1] > 1 and np.median(np.linalg.cond(relative)) > 1e8:
        raise ValueError("the inputs move together: their effects cannot be told apart")
    return np.asarray(np.linalg.pinv(relative, hermitian=True) / (scale[:, :, None] * scale[:, None, :]))


def _share(cross: Cross) -> Array:
    """Share (nw,) of the degrees of freedom of a complex transform: half of them at 0 and at half the sampling
    frequency, where that of real signals is real."""
    edge = np.pi / cross.dt
    return np.where((cross.w < 1e-9 * edge) | (cross.w > (1.0 - 1e-9) * edge), 0.5, 1.0)


def _explained(cross: Cross, inverse: Complex) -> Array:
    shown = np.einsum("kij,kjl,kil->ki", cross.yu, inverse, cross.yu.conj()).real
    return np.asarray(np.clip(shown / _positive(np.einsum("kii->ki", cross.yy).real), 0.0, 1.0))


def _adjoint(values: Complex) -> Complex:
    return np.swapaxes(values, 1, 2).conj()


def _positive(values: Array) -> Array:
    return np.maximum(values, np.finfo(float).tiny)


def _centred(values: Array) -> Array:
    found = np.asarray(values, dtype=float)
    found = found[:, None] if found.ndim == 1 else found
    if not np.isfinite(found).any(axis=0).all() or np.isinf(found).any():
        raise ValueError("a channel holds no number, or one that is not finite: it correlates with nothing")
    centred = found - np.nanmean(found, axis=0)
    spread = np.sqrt(np.nanmean(centred**2, axis=0))
    if not (spread > CONSTANT * np.nanmax(np.abs(found), axis=0)).all():
        raise ValueError("a channel is constant: it correlates with nothing")
    return np.asarray(centred / spread)


def _names(data: Given) -> dict[str, list[str]]:
    first = experiments(data)[0]
    return {"inputs": list(first.inputs), "outputs": list(first.outputs)}
