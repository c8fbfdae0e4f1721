"""Data of a plant whose truth is known, for examples: they look as real ones do.

Rules of this file: seeded; the truth stands in the docstring.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata


def example_data(n: int = 1000, seed: int = 0) -> Data:
    """Simulate a blower that heats the air in a tube: its heater's voltage, and the temperature at the outlet.

    Deviations from 5 V and 48 degrees. With a step of 0.08 s and the voltage held between two levels,
    y = (0.006 q^-3 + 0.058 q^-4) / (1 - 1.31 q^-1 + 0.43 q^-2) u + (1 + 0.3 q^-1) / (1 - 0.92 q^-1) e,
    white e with a standard deviation of 0.02: a dead time of two samples beside the hold's, and air that drifts.

    Parameters
    ----------
    n : int
        Samples.
    seed : int
        Of voltage and noise.

    Returns
    -------
    Data
        Input "heater" in V, output "outlet" in degrees.

    Examples
    --------
    >>> from hoopd.ident import example_data
    >>> example_data(500)
    Data(500 samples, step 0.08 s from 0 s; outputs outlet; inputs heater)
    """
    rng = np.random.default_rng(seed)
    lengths = rng.integers(2, 16, n)
    u = np.repeat(rng.choice([-1.5, 1.5], n), lengths)[:n]
    answer = lfilter([0.0, 0.0, 0.0, 0.006, 0.058], [1.0, -1.31, 0.43], u)
    noise = lfilter([1.0, 0.3], [1.0, -0.92], 0.02 * rng.standard_normal(n))
    return iddata(answer + noise, u, 0.08, outputs=["outlet"], inputs=["heater"])
