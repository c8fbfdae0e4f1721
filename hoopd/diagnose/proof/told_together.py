"""Which parameters recordings tell only together: the ratios of an inertia, a friction and a motor's constant.

Each of them alone is seen well; all changed by the same share, nothing changes. Their intervals are then as wide as
what is believed, however good the recordings are, and so is that of every force beside them.

Rules of this file: a fit in, sentences out; nothing is fitted again.
"""

from __future__ import annotations

import numpy as np

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plots.number_format import listed

# As shares of the values: what is told no better together, of parameters each of which is told as well alone.
TOGETHER, ALONE = 0.5, 0.05
# Of a direction, the least part of one that belongs to it.
BELONGS = 0.2


def told_together(found: HypothesisFit) -> list[str]:
    """Names of the fit's free parameters that change together without a trace; none where there are no such."""
    rows = found.stacked()[:, 1:]
    # changes by shares of the values, and of each alone how well it is seen
    shares = rows * np.abs([found.values[name] for name in found.free])
    seen = [i for i, length in enumerate(np.linalg.norm(shares, axis=0)) if length * ALONE > 1.0]
    if len(seen) < 2:
        return []
    values, vectors = np.linalg.eigh(shares[:, seen].T @ shares[:, seen])
    if values[0] * TOGETHER**2 > 1.0:
        return []
    part = np.abs(vectors[:, 0])
    names = [found.free[i] for i, own in zip(seen, part, strict=True) if own > BELONGS * part.max()]
    return names if len(names) > 1 else []


def together_sentence(found: HypothesisFit) -> str:
    """What to do about it; empty where every one is told."""
    names = told_together(found)
    if not names:
        return ""
    return (
        f"these recordings tell {listed(names)} only together, each by what the others are: hold one of them that is "
        "known (held: true in the plant file), and all have intervals of their own."
    )
