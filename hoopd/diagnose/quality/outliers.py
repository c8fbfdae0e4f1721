"""Single false values and bursts of them.

Rules of this file: a burst is denser than the recording's single ones can be by chance; it is an interval that is set
aside, no property of the sensor, and does not count in the sensor's share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.spans import spans

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A burst: most of 0.3 s at 50 Hz. With a fifth of all samples false 11 of 15 happen once in 80,000 rows.
WINDOW, DENSE = 15, 11
# Blocks for the share of false values that stand alone: 0.2 s at 50 Hz.
BLOCK = 10

# A counting sensor that tells a false value jumps: it bends by so many times what its body does in nine of ten samples.
# A body that speeds up bends, too, sample after sample, however far it is beyond the noise of a sensor of a micrometre.
USUAL_PART, FAR = 0.9, 4.0
# What nine in ten bends of a noise of 1 stay below: 1.645 times the root of 1 + 4 + 1.
NOISE_BEND = 4.03
# False values with so few others between them are one run.
NEAR = 2


def jumping(false: Mask, values: Array, usable: Mask, noise: float, together: bool = True) -> Mask:
    """Those of samples held false (n,) that jump, of samples (n,) of which some are usable; `noise`: of a sample.

    `together`: a run of false ones jumps as a whole, where any of it does.
    """
    rows = np.flatnonzero(usable)
    if len(rows) < WINDOW:
        return false & together
    bend = np.pad(np.abs(np.diff(values[rows], n=2)), 1)
    moved = float(np.sqrt(max(np.quantile(bend, USUAL_PART) ** 2 - (NOISE_BEND * noise) ** 2, 0.0)))
    far = FAR * max(moved, noise)
    # a sample that is off by d bends by 2 d, and its neighbours by d
    jumps = (bend > far) & (bend >= np.maximum(np.r_[0.0, bend[:-1]], np.r_[bend[1:], 0.0]) / 2.0)
    if together:
        joined = np.convolve(false[rows].astype(int), np.ones(2 * NEAR + 1, dtype=int), "same") > 0
        jumps = inside(len(rows), [(a, b - 1) for a, b in spans(joined) if jumps[a:b].any()])
    found = np.zeros(len(false), dtype=bool)
    found[rows] = false[rows] & jumps
    return found


def bursts(false: Mask, seen: Mask) -> list[tuple[int, int]]:
    """First and last row of stretches of samples seen (n,) that are mostly false (n,)."""
    rows = np.flatnonzero(seen)
    if len(rows) < WINDOW:
        return []
    dense = np.convolve(false[rows].astype(int), np.ones(WINDOW, dtype=int), "valid") >= DENSE
    covered = np.convolve(dense.astype(int), np.ones(WINDOW, dtype=int)) > 0
    return [_trimmed(rows[a:b], false) for a, b in spans(covered)]


def _trimmed(rows: NDArray[np.int64], false: Mask) -> tuple[int, int]:
    inside = rows[false[rows]]
    return int(inside[0]), int(inside[-1])


def spread_share(false: Mask, seen: Mask) -> float:
    """Share of false values among the samples seen, as the blocks without one tell: 1 - share = (empty)^(1/BLOCK).

    For values that are false here and there it is their share; ten in a row in one place count little more than one.
    """
    rows = np.flatnonzero(seen | false)
    blocks = len(rows) // BLOCK
    if not blocks:
        return 0.0
    empty = 1.0 - float(false[rows[: blocks * BLOCK]].reshape(blocks, BLOCK).any(axis=1).mean())
    return float(1.0 - max(empty, 0.5 / blocks) ** (1.0 / BLOCK))


def inside(n: int, stretches: list[tuple[int, int]]) -> Mask:
    """Rows (n,) within the stretches."""
    mask = np.zeros(n, dtype=bool)
    for first, last in stretches:
        mask[first : last + 1] = True
    return mask


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """First and last row of each stretch of a mask (n,)."""
    return [(a, b - 1) for a, b in spans(mask)]
