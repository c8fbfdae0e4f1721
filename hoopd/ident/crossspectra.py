"""Cross spectra of all channels at once: what every estimate over frequency is made of.

By Welch (means over windowed segments that overlap) or by Blackman and Tukey (correlations under a Gaussian window).
Sources: Ljung, System Identification, 1999, 6.4; P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) for the number
of independent means.

Rules of this file: means are not taken off; a segment never runs across a gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.gaps import whole

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Given = Data | Sequence[Data]
Method = Literal["welch", "correlation"]

TAU = 2.0 * np.pi
# The Gaussian lag window is cut at so many of its widths, where it is 3e-4.
CUT = 4.0
OPTIONS: Mapping[str, frozenset[str]] = MappingProxyType(
    {"welch": frozenset({"segment", "overlap"}), "correlation": frozenset({"width"})}
)


class Cross(NamedTuple):
    """Cross spectra (nw, m, m) of the channels [y, u] at w (nw,) rad/s, and the number of independent means in each."""

    w: Array
    phi: Complex
    means: float
    ny: int
    dt: float

    @property
    def yy(self) -> Complex:
        """(nw, ny, ny)."""
        return self.phi[:, : self.ny, : self.ny]

    @property
    def yu(self) -> Complex:
        """(nw, ny, nu)."""
        return self.phi[:, : self.ny, self.ny :]

    @property
    def uu(self) -> Complex:
        """(nw, nu, nu)."""
        return self.phi[:, self.ny :, self.ny :]


def spectra(data: Given, method: Method = "welch", **options: float) -> Cross:
    """Cross spectra of all channels over all experiments; the options are those of `tfest`."""
    if method not in OPTIONS:
        raise ValueError(f'a spectrum is estimated by "welch" or "correlation", not {method!r}')
    strange = options.keys() - OPTIONS[method]
    if strange:
        raise ValueError(f"{method} has no {', '.join(strange)}; it has {', '.join(sorted(OPTIONS[method]))}")
    each = experiments(data)
    return _welch(each, **options) if method == "welch" else _correlated(each, **options)


def _welch(each: list[Data], segment: float = 0, overlap: float = -1) -> Cross:
    """Means of windowed segments; segments in which an output is missing are left out."""
    size = int(segment) or max(one.n for one in each) // 10
    shared = size // 2 if overlap < 0 else int(overlap)
    if size < 2 or shared >= size:
        raise ValueError(f"a segment of {size} samples with {shared} shared: it wants at least 2, and fewer shared")
    window, hop = signal.get_window("hann", size), size - shared
    total, count = np.zeros(1, complex), 0
    for piece in _segments(each, size, hop):
        total = total + _squared(piece * window[:, None])
        count += 1
    if not count:
        raise ValueError(f"no {size} samples in a row without a gap: take shorter segments or fill_gaps(data)")
    phi = total * each[0].dt / (count * np.sum(window**2))
    w = TAU * np.fft.rfftfreq(size, each[0].dt)
    return Cross(np.asarray(w, float), phi, _independent(window, hop, count), each[0].ny, each[0].dt)


def _segments(each: list[Data], size: int, hop: int) -> Iterator[Array]:
    """Channels [y, u] of the segments (size, m), one after the other: no more than one of them exists at a time."""
    for data in each:
        for one in runs(data):
            for i in range(0, one.n - size + 1, hop):
                yield np.hstack([one.y[i : i + size], one.u[i : i + size]])


def _squared(piece: Array) -> Complex:
    """X(w) X(w)*, (nw, m, m)."""
    x = np.fft.rfft(piece, axis=0)
    return np.asarray(x[:, :, None] * x[:, None, :].conj())


def _independent(window: Array, hop: int, count: int) -> float:
    """How many independent means so many overlapping segments are worth (Welch 1967, his rho)."""
    share, power = 0.0, np.sum(window**2)
    for m in range(1, min(count, -(-len(window) // hop))):
        rho = np.sum(window[m * hop :] * window[: -m * hop]) / power
        share += 2.0 * (1.0 - m / count) * rho**2
    return count / (1.0 + float(share))


def _correlated(each: list[Data], width: float = 0.0) -> Cross:
    """The transform of the correlations under exp(-lag^2 / (2 width^2))."""
    length = max(one.n for one in each)
    spread = width or length / 20.0
    reach = int(min(np.ceil(CUT * spread), length - 1))
    total = sum((_lagged(whole(one, "correlation"), reach) for one in each), np.zeros(1))
    samples = sum(one.n for one in each)
    lag = np.arange(-reach, reach + 1)
    weighted = total * np.exp(-0.5 * (lag / spread) ** 2)[:, None, None] * each[0].dt / samples
    size = fft.next_fast_len(2 * reach + 1)
    padded = np.zeros((size, *weighted.shape[1:]))
    padded[lag] = weighted
    phi = np.fft.rfft(padded, axis=0)
    # var/Phi^2 = (sum of the squared window) / N
    means = samples / (np.sqrt(np.pi) * spread)
    return Cross(np.asarray(TAU * np.fft.rfftfreq(size, each[0].dt), float), phi, means, each[0].ny, each[0].dt)


def _lagged(data: Data, reach: int) -> Array:
    """Sums over t of x(t + lag) x(t)', (2 reach + 1, m, m), lags from -reach to reach."""
    x = np.hstack([data.y, data.u])
    size = fft.next_fast_len(data.n + reach)
    transform = np.fft.rfft(x, size, axis=0)
    sums = np.fft.irfft(transform[:, :, None] * transform[:, None, :].conj(), size, axis=0)
    return np.asarray(sums[np.arange(-reach, reach + 1)])
