"""Which parameters recordings tell only together: the ratios of an inertia, a friction and a motor's constant.

Each of them alone is seen well; all changed by the same share, nothing changes. Their intervals are then as wide as
what is believed, however good the recordings are, and so is that of every force beside them.

Rules of this file: a fit in, sentences out; nothing is fitted again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.level_directions import freed_of_levels, told_alone
from hoopd.plots.number_format import listed

# As shares of the values: what is told no better together, of parameters each of which is told as well alone.
TOGETHER, ALONE = 0.5, 0.05
# Of a direction, the least part of one that belongs to it.
BELONGS = 0.2


class Together(NamedTuple):
    """What recordings do not tell apart."""

    names: list[str]  # of free parameters
    ways: int  # in which they can change without a trace: so many have to be known


def told_together(found: HypothesisFit) -> Together | None:
    """Free parameters that change together without a trace.

    Parameters
    ----------
    found : HypothesisFit
        A fit with its whitened rows.

    Returns
    -------
    Together, optional
        None where each is told by itself.
    """
    seen = told_alone(found, ALONE)
    if len(seen) < 2:
        return None
    size = np.abs([found.values[name] for name in found.free])
    rows, freed = found.stacked()[:, 1:], freed_of_levels(found)
    # by shares of the values
    shares = (rows.T @ rows if freed is None else freed) * np.outer(size, size)
    values, vectors = np.linalg.eigh(shares[np.ix_(seen, seen)])
    untold = values * TOGETHER**2 <= 1.0
    part = np.linalg.norm(vectors[:, untold], axis=1)
    names = [found.free[i] for i, own in zip(seen, part, strict=True) if own > BELONGS * part.max()]
    return Together(names, int(np.count_nonzero(untold))) if untold.any() and len(names) > 1 else None


def together_sentence(found: HypothesisFit) -> str:
    """What to do about it; empty where every one is told."""
    together = told_together(found)
    if together is None:
        return ""
    told = f"these recordings tell {listed(together.names)} only together, each by what the others are"
    base = [name for name in together.names if name in found.tracks[0].stretch.plant.free]
    if len(base) < together.ways:
        return f"{told}."
    some = {1: "one", 2: "two"}.get(together.ways, str(together.ways))
    of_them = "of them" if len(base) == len(together.names) else f"of {listed(base)}"
    what = "that is known" if together.ways == 1 else "that are known"
    held = listed(base) if len(base) == together.ways else f"{some} {of_them} {what}"
    rest = ", and the others have intervals of their own" if len(together.names) > together.ways else ""
    return f"{told}: hold {held} (held: true in a plant file){rest}."
