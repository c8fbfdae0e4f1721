"""What was chosen by prediction of data held back, as a record and in words.

Rules of this file: plain numbers and words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StructureChoice:
    """Structure of a state-space estimate and why it was taken.

    `fits`: fit percent on the data held back by horizon (infinity: simulation), mean over the outputs; empty where too
    few samples were there to hold any back. `looked`: candidates that were fitted, `equal`: those that no other beats
    by more than chance, of which the likeliest was taken.
    """

    order: int
    horizon: int
    weighting: str
    direct: bool
    steps: int
    fits: Mapping[float, float]
    looked: int = 0
    equal: int = 0
    disturbance: str | None = None

    def __str__(self) -> str:
        """In a sentence."""
        said = (
            f"order {self.order}, horizon {self.horizon}, {self.weighting}, {'a' if self.direct else 'no'} direct term"
        )
        if self.steps:
            said += f", {self.steps} step{'s' if self.steps > 1 else ''} of refinement"
        if self.disturbance is not None:
            said += f", {self.disturbance}"
        if not self.fits:
            return f"{said}: nothing held back to compare by"
        fits = ", ".join(f"{fit:.1f} % {_horizon(h)}" for h, fit in self.fits.items())
        return (
            f"{said}: of {self.looked} candidates {self.equal} foretell the thirds that were held back equally well "
            f"but for chance ({fits}), and this is the likeliest of them on the whole record"
        )


def _horizon(h: float) -> str:
    return "simulated" if h == np.inf else f"{h:g} step{'s' if h > 1 else ''} ahead"
