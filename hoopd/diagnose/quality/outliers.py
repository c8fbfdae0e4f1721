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
# Where bends are those of the noise alone but for this factor, they are the noise's.
NOISY = 1.5
# The samples of one side foretell by a line, a parabola and a cubic through the nearest, in noise by a line alone. Nine
# in ten errors of the better side stay below this with a noise of 1, and what is more than so many times the usual is
# not foretold: noise does not hide what bends as far as it does.
LINE, SMOOTH = (1,), (1, 2, 3)
NOISE_ERROR, NOT_TOLD = 2.49, 2.0
# A sample that is off by d bends by 2 d, its neighbours by d.
MORE_THAN_BESIDE = 0.6
# Off by d it bends by 2 d and errs by d; a body that comes to rest exponentially errs by a quarter of its bend at most.
OFF_PART = 0.4
# False values with so few others between them are one run.
NEAR = 2


def jumping(false: Mask, values: Array, usable: Mask, noise: float, together: bool = True) -> Mask:
    """Those of samples held false (n,) that jump, of samples (n,) of which some are usable; `noise`: of a sample.

    What jumps bends, and the samples of neither side foretell it: where an input steps, a reading bends as much and
    lies on its course before. A run is false where any of it jumps, or where it leaves the course before it and the
    one after it: `together` all of it, or else what bends, near a jump.
    """
    rows = np.flatnonzero(usable)
    if len(rows) < WINDOW:
        return false & together
    bend = np.pad(np.abs(np.diff(values[rows], n=2)), 1)
    sharp = bend > MORE_THAN_BESIDE * np.maximum(np.r_[0.0, bend[:-1]], np.r_[bend[1:], 0.0])
    sharp &= bend > FAR * _usual(bend, NOISE_BEND, noise)
    jumps = sharp & _is_untold(values[rows], bend, noise)
    candidates = false[rows] if together else false[rows] & sharp
    runs = [(a, b, *_trimmed(np.arange(a, b), candidates)) for a, b in spans(_joined(candidates))]
    away, back = _edges(values[rows], noise)
    whole = []
    for a, b, first, last in runs:
        jumped = a + np.flatnonzero(jumps[a:b])
        if (together or last > first) and sharp[a:b].any() and away[first] and back[last]:
            whole.append((first, last))
        elif len(jumped):
            whole.append((first, last) if together else (max(int(jumped[0]) - NEAR, 0), int(jumped[-1]) + NEAR))
    found = np.zeros(len(false), dtype=bool)
    found[rows] = candidates & inside(len(rows), whole)
    return found


def _usual(sizes: Array, of_noise: float, noise: float) -> float:
    """What motion makes of the largest usual one of sizes (n,), of which a noise of 1 makes `of_noise`."""
    moved = float(np.sqrt(max(np.quantile(sizes, USUAL_PART) ** 2 - (of_noise * noise) ** 2, 0.0)))
    return max(moved, noise)


def _is_untold(x: Array, bend: Array, noise: float) -> Mask:
    """Samples (n,) that those of neither side foretell."""
    noisy = 1.0 / NOISY <= float(np.quantile(bend, USUAL_PART)) / (NOISE_BEND * noise) <= NOISY
    error = np.minimum(*_errors_by_sides(x, LINE if noisy else SMOOTH))
    far = (NOT_TOLD if noisy else FAR) * _usual(error, NOISE_ERROR, noise)
    return np.asarray(error > np.maximum(far, OFF_PART * (bend - NOISE_BEND * noise)))


def _edges(x: Array, noise: float) -> tuple[Mask, Mask]:
    """Samples (n,) with a jump before them, and after them: of both samples beside it neither is on the other's course.

    Where a course only bends one of them is on both.
    """
    leaves, enters = (one > FAR * _usual(one, NOISE_BEND, noise) for one in _errors_by_sides(x, SMOOTH))
    between = leaves[1:] & enters[:-1]
    return np.r_[True, between], np.r_[between, True]


def _errors_by_sides(x: Array, degrees: tuple[int, ...]) -> tuple[Array, Array]:
    """How far samples (n,) are from what those before them foretell, and those after, by the best of the degrees."""
    before, after = np.full(len(x), np.inf), np.full(len(x), np.inf)
    for degree in degrees:
        # |y_k - 2 y_k-1 + y_k-2|, |y_k - 3 y_k-1 + 3 y_k-2 - y_k-3|, ...; those after the same, from k on
        error, width = np.abs(np.diff(x, n=degree + 1)), degree + 1
        before[width:], after[:-width] = np.minimum(before[width:], error), np.minimum(after[:-width], error)
    return before, after


def _joined(false: Mask) -> Mask:
    """Samples (n,) that are false, or near to some that are."""
    return np.asarray(np.convolve(false.astype(int), np.ones(2 * NEAR + 1, dtype=int), "same") > 0)


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
