"""Whether another filter fits: against what its file tells, and against the one that holds the ball."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.core.drift import CHANNELS, Level
from hoopd.core.shadow import SHADOW_S, Shadow

TOLD = {name: Level(0.05, 0.01) for name in CHANNELS}


def lasting(rng: np.random.Generator, offset: float) -> tuple[float, float, float]:
    """Innovations of one tick that have a mean of their own."""
    a, b, c = (offset + 0.05 * rng.standard_normal(3)).tolist()
    return a, b, c


@pytest.mark.parametrize(
    ("candidate", "acting", "fits"),
    [
        (0.0, 0.0, True),
        (0.3, 0.0, False),  # the acting one is right, the candidate is not
        (0.3, 0.4, True),  # it is not as its file tells, and still better than what holds the ball
        (0.4, 0.3, False),
    ],
)
def test_a_model_that_is_worse_than_the_acting_one_is_refused(candidate: float, acting: float, fits: bool) -> None:
    rng, shadow = np.random.default_rng(1), Shadow(0.0, TOLD)
    for k in range(int(SHADOW_S / 0.02)):
        shadow.add(0.02 * k, lasting(rng, candidate), lasting(rng, acting))
    assert (shadow.misfit() == "") is fits
