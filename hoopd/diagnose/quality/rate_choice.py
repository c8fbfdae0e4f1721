"""Which rate to believe: the one that was measured, or the slope of what was counted.

Rules of this file: decided by the recording; both are measured (gain, delay, noise), and the reason is said in words.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.noise_floor import clipped_sigma
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]

# A speed that is off by more than this is no measurement of the speed.
GAIN_TOLERANCE = 0.02
LAG_STEPS = 0.25
# Over a second a lag of 0.1 s takes less than this from a speed that comes and goes within two.
WRONG_GAIN, SLOW_S = 0.1, 1.0
REACH = 5  # rows to each side among which the best delay is looked for
FEWEST = 30


class Speed(NamedTuple):
    """The verdict and what it rests on; NaN where it cannot be measured."""

    channel: str  # of the rate, or `<channel>_rate`: the slope of the other one
    reason: str
    gain: float  # of the rate against the slope
    noise: float  # unit of the rate; what is left between the two at best gain and delay
    rate_noise: float  # unit of the rate, of the slope
    slow_gain: float = float("nan")  # against the slope, both over a second: what a lag or an uneven turn cannot change

    @property
    def wrong(self) -> bool:
        """It is another quantity than the rate: no sensor's lag or delay makes it that."""
        return abs(self.slow_gain - 1.0) > WRONG_GAIN


def speed(recording: Recording, counted: str, rate: str, sigma: float) -> Speed:
    """Compare channel `rate` with the slope of channel `counted`, whose samples have the noise `sigma`.

    The recording has its bad samples as NaN.
    """
    t, place, measured = recording.t, recording.column(counted), recording.column(rate)
    words, nothing = _Words(counted, rate, recording.channels[rate].unit), (float("nan"),) * 3
    if np.isfinite(place).sum() < FEWEST:
        return Speed(rate, f"{counted} is missing", *nothing)
    if np.isfinite(measured).sum() < FEWEST:
        return Speed(words.slope, f"{rate} is missing", *nothing)
    span = t[2:] - t[:-2]
    slope = np.concatenate([[np.nan], (place[2:] - place[:-2]) / span, [np.nan]])
    rate_noise = float(sigma * np.sqrt(2.0) / np.median(span))
    if np.nanstd(slope) < 3.0 * rate_noise:
        reason = f"hardly anything moves: {counted} is the finer of the two"
        return Speed(words.slope, reason, *nothing[:2], rate_noise)
    gain, lag, noise = _compared(slope, measured)
    verdict = words.verdict(gain, lag, noise, rate_noise)
    return Speed(*verdict, gain, noise, rate_noise, _slow_gain(t, slope, measured))


def _slow_gain(t: Array, slope: Array, rate: Array) -> float:
    """Of the rate against the slope, means over SLOW_S of both, their own means taken off; NaN: too little to tell."""
    both = np.isfinite(slope) & np.isfinite(rate)
    width = max(1, round(SLOW_S / float(np.median(np.diff(t)))))
    if both.sum() < 3 * width:
        return float("nan")
    kernel = np.ones(width) / width
    x, y = (np.convolve(one[both], kernel, "valid") for one in (slope, rate))
    return _line(x - x.mean(), y - y.mean(), 0)[0]


def _compared(slope: Array, rate: Array) -> tuple[float, float, float]:
    """Gain, delay in rows and left-over spread of the rate against the slope, at the delay where they agree best."""
    rest = [_line(slope, rate, k)[1] for k in range(-REACH, REACH + 1)]
    best = min(range(len(rest)), key=rest.__getitem__)
    lag = float(best - REACH)
    if 0 < best < 2 * REACH:
        # vertex of the parabola through the squares
        a, b, c = rest[best - 1] ** 2, rest[best] ** 2, rest[best + 1] ** 2
        lag += 0.5 * (a - c) / max(a - 2 * b + c, 1e-300)
    return _line(slope, rate, best - REACH)[0], lag, rest[best]


def _line(slope: Array, rate: Array, k: int) -> tuple[float, float]:
    n = len(slope)
    x, y = slope[max(0, -k) : n - max(0, k)], rate[max(0, k) : n - max(0, -k)]
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    gain = float(x @ y) / max(float(x @ x), 1e-300)
    return gain, clipped_sigma(y - gain * x)


class _Words(NamedTuple):
    """How both are called."""

    counted: str
    rate: str
    unit: str

    @property
    def slope(self) -> str:
        return f"{self.counted}_rate"

    def verdict(self, gain: float, lag: float, noise: float, rate_noise: float) -> tuple[str, str]:
        """Which one, and why."""
        counted, rate, unit = self
        if abs(gain - 1.0) > GAIN_TOLERANCE:
            return self.slope, f"{rate} is {gain:.3f} times the slope of {counted}"
        if abs(lag) > LAG_STEPS:
            return self.slope, f"{rate} is {lag:.2f} samples late against {counted}"
        if noise > rate_noise:
            spread = f"the slope of {counted} by {rate_noise:.3g} {unit}"
            return self.slope, f"{rate} scatters by {noise:.3g} {unit}, {spread}"
        return rate, f"{rate} agrees with the slope of {counted} to {noise:.3g} {unit}"
