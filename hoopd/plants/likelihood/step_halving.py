"""What the integration step is worth: the same model at half the step, in the units of the evidence.

Rules of this file: a fit is looked at, never changed.
"""

from __future__ import annotations

import numpy as np

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import whitened

# An error of the solver above this is no longer small beside what names are accepted by.
LARGEST_NATS = 1.0


def step_nats(found: HypothesisFit) -> float:
    """Nats by which a fit would notice that its one-step maps were computed with half the step: |P (F_h/2 - F_h)|^2/2.

    As an effect of this size would be seen: whitened by the fit's own filter, its free parameters not adapted.
    """
    total = 0.0
    for track, columns, gains in zip(found.tracks, found.columns, found.gains, strict=True):
        twice = 2 * track.composite.substeps
        change = track.after(found.values, substeps=twice) - track.after(found.values)
        nothing = np.zeros((*track.stretch.y.shape, 1))
        total += float(np.sum(whitened(columns.model, gains, change[:, :, None], nothing) ** 2)) / 2.0
    return total


def step_sentence(nats: float) -> str:
    """For the notes of a diagnosis."""
    if nats > LARGEST_NATS:
        return f"half the solver's step would change the evidence by {nats:.1f} nats: small effects may be the solver's"
    return f"half the solver's step changes the evidence by {nats:.1g} nats"
