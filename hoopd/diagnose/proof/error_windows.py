"""The window that carries the error of a simulation, or most of what a second one loses against the first.

Rules of this file: simulations in, times out; squared errors as `worse_channels` counts them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.fit_tables import Played, series, spread_of
from hoopd.diagnose.proof.worse_channels import squared_errors
from hoopd.diagnose.record import ErrorWindow

# A window carries a loss when no less than this share of it is in it alone.
MOST_OF_IT = 0.5


def error_windows(one: Played) -> dict[str, dict[str, ErrorWindow]]:
    """By recording and channel, the window with the most squared error."""
    found: dict[str, dict[str, ErrorWindow]] = {}
    for recording, channel, times, sums in _by_window(one):
        total = float(sums.sum())
        if total > 0.0:
            k = int(np.argmax(sums))
            window = ErrorWindow(t0=times[k][0], t1=times[k][1], share=float(sums[k]) / total, windows=len(sums))
            found.setdefault(recording, {})[channel] = window
    return found


def window_of_the_loss(before: Played, after: Played, channel: str) -> tuple[str, float, float] | None:
    """Recording, start and end of the window that carries most of what a channel loses; None where none does."""
    places, grown = [], list[float]()
    for first, second in zip(_by_window(before), _by_window(after), strict=True):
        if first[1] == channel:
            places += [(first[0], *time) for time in first[2]]
            grown += [float(value) for value in second[3] - first[3]]
    total = sum(grown)
    if len(grown) < 2 or total <= 0.0 or max(grown) < MOST_OF_IT * total:
        return None
    return places[int(np.argmax(grown))]


Times = list[tuple[float, float]]


def _by_window(one: Played) -> Iterator[tuple[str, str, Times, NDArray[np.float64]]]:
    """Recording, channel, windows that have a reading, and the squared errors of each over |y - mean y|^2."""
    for recording, runs in one.by_recording().items():
        for channel, windows in series(runs).items():
            own = [window for window in windows if len(window[0])]
            spread = spread_of(np.concatenate([window[1] for window in own])) if own else 0.0
            if spread > 0.0:
                times = [(float(t[0]), float(t[-1])) for t, _, _ in own]
                sums = [float(squared_errors(window, spread).sum()) for window in own]
                yield recording, channel, times, np.array(sums)
