"""Which speed of the hoop to believe: the driver's column or the slope of the counted angle.

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

    channel: str  # dtheta or theta_rate
    reason: str
    gain: float  # of dtheta against the slope of theta
    noise: float  # rad/s, what is left between the two at best gain and delay
    rate_noise: float  # rad/s, of the slope of theta
    slow_gain: float = float("nan")  # against the slope, both over a second: what a lag or an uneven turn cannot change

    @property
    def wrong(self) -> bool:
        """dtheta is another quantity than the rate of theta: no sensor's lag or delay makes it that."""
        return abs(self.slow_gain - 1.0) > WRONG_GAIN


def speed(recording: Recording, theta_sigma: float) -> Speed:
    """Compare both; theta_sigma: noise of a sample of theta, rad. The recording has its bad samples as NaN."""
    t, theta, dtheta = recording.t, recording.theta, recording.dtheta
    nothing = (float("nan"),) * 3
    if np.isfinite(theta).sum() < FEWEST:
        return Speed("dtheta", "theta is missing", *nothing)
    if np.isfinite(dtheta).sum() < FEWEST:
        return Speed("theta_rate", "dtheta is missing", *nothing)
    span = t[2:] - t[:-2]
    slope = np.concatenate([[np.nan], (theta[2:] - theta[:-2]) / span, [np.nan]])
    rate_noise = float(theta_sigma * np.sqrt(2.0) / np.median(span))
    if np.nanstd(slope) < 3.0 * rate_noise:
        return Speed("theta_rate", "the hoop hardly moves: theta is the finer of the two", *nothing[:2], rate_noise)
    gain, lag, noise = _compared(slope, dtheta)
    return Speed(*_verdict(gain, lag, noise, rate_noise), gain, noise, rate_noise, _slow_gain(t, slope, dtheta))


def _slow_gain(t: Array, slope: Array, dtheta: Array) -> float:
    """Of dtheta against the slope, means over SLOW_S of both, their own means taken off; NaN: too little to tell."""
    both = np.isfinite(slope) & np.isfinite(dtheta)
    width = max(1, round(SLOW_S / float(np.median(np.diff(t)))))
    if both.sum() < 3 * width:
        return float("nan")
    kernel = np.ones(width) / width
    x, y = (np.convolve(one[both], kernel, "valid") for one in (slope, dtheta))
    return _line(x - x.mean(), y - y.mean(), 0)[0]


def _compared(slope: Array, dtheta: Array) -> tuple[float, float, float]:
    """Gain, delay in rows and left-over spread of dtheta against the slope, at the delay where they agree best."""
    rest = [_line(slope, dtheta, k)[1] for k in range(-REACH, REACH + 1)]
    best = min(range(len(rest)), key=rest.__getitem__)
    lag = float(best - REACH)
    if 0 < best < 2 * REACH:
        # vertex of the parabola through the squares
        a, b, c = rest[best - 1] ** 2, rest[best] ** 2, rest[best + 1] ** 2
        lag += 0.5 * (a - c) / max(a - 2 * b + c, 1e-300)
    return _line(slope, dtheta, best - REACH)[0], lag, rest[best]


def _line(slope: Array, dtheta: Array, k: int) -> tuple[float, float]:
    n = len(slope)
    x, y = slope[max(0, -k) : n - max(0, k)], dtheta[max(0, k) : n - max(0, -k)]
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    gain = float(x @ y) / max(float(x @ x), 1e-300)
    return gain, clipped_sigma(y - gain * x)


def _verdict(gain: float, lag: float, noise: float, rate_noise: float) -> tuple[str, str]:
    if abs(gain - 1.0) > GAIN_TOLERANCE:
        return "theta_rate", f"dtheta is {gain:.3f} times the slope of theta"
    if abs(lag) > LAG_STEPS:
        return "theta_rate", f"dtheta is {lag:.2f} samples late against theta"
    if noise > rate_noise:
        return "theta_rate", f"dtheta scatters by {noise:.3g} rad/s, the slope of theta by {rate_noise:.3g} rad/s"
    return "dtheta", f"dtheta agrees with the slope of theta to {noise:.3g} rad/s"
