"""A state-space model with the slow disturbance of each output as a state: what comes back slowly, or never.

    d+ = p d + g e,   y = C x + d + D u + e
No input reaches d; a start holds the offset of a record, and the predictor follows with the gain g what wanders with
the pole p (of offset-free control with p = 1: Pannocchia & Rawlings, AIChE J. 49, 2003).

Rules of this file: outputs are in units of their noise, so that one gain does for all; nothing is estimated here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from hoopd.ident.models import Innovations
from hoopd.ident.statespace.linear import radius

# Memories of ten samples to a hundred thousand, which is stable and the same as for ever over any record.
POLES, GAINS = (0.9, 0.97, 0.99, 0.997, 1.0 - 1e-5), (0.03, 0.1)
# A predictor beyond it does not forget its start.
EDGE = 1.0 - 1e-6


@dataclass(frozen=True)
class SlowDisturbance:
    """Pole p and gain g of the disturbance of every output."""

    pole: float
    gain: float

    def __str__(self) -> str:
        return f"a slow disturbance of each output (pole {self.pole:g}, gain {self.gain:g})"


def disturbances() -> Iterator[SlowDisturbance]:
    """Those that are looked at."""
    for pole in POLES:
        for gain in GAINS:
            yield SlowDisturbance(pole, gain)


def with_disturbance(model: Innovations, disturbance: SlowDisturbance) -> Innovations:
    """The model with a state for the disturbance of each output, after its own."""
    none, one = np.zeros((model.ny, model.nu)), np.eye(model.ny)
    return replace(
        model, a=block_diag(model.a, disturbance.pole * one), b=np.vstack([model.b, none]),
        c=np.hstack([model.c, one]), k=np.vstack([model.k, disturbance.gain * one]), q=None, s=None,
        x0=None if model.x0 is None else np.concatenate([model.x0, np.zeros(model.ny)]),
    )  # fmt: skip


def predicts(model: Innovations) -> bool:
    """Whether the predictor forgets its start."""
    return radius(model.a - model.k @ model.c) < EDGE
