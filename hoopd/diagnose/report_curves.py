"""Curves behind a diagnosis, for the report only: what the engine has and the JSON does not hold.

Rules of this file: plain arrays with their units beside them; every part may be missing, and what is missing is left
out of the page. Nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.record import Ignored

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One channel: measured, simulated by the re-fitted base (`before`) and with the effects (`after`), all (n,).

    NaN lifts the pen: between windows, or where a sample is missing.
    """

    name: str  # "theta_rate", "psi"
    unit: str
    t_s: Array
    measured: Array
    before: Array
    after: Array | None = None


@dataclass(frozen=True)
class Comparison:
    """Held-out data of one recording against the simulations."""

    recording: str
    traces: Sequence[Trace]
    how: str = "windows"  # "windows of 2 s", or "one free run"
    ignored: Sequence[Ignored] = ()


@dataclass(frozen=True)
class Binned:
    """Mean of the missing force in bins of its regressor with a 95 % band, all (n,)."""

    x: Array
    mean: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class LawCurve:
    """The named law as a curve over the regressor, (n,) each; NaN lifts the pen at a jump."""

    label: str  # "hoop.coulomb_friction"
    x: Array
    y: Array
    is_curve: bool = True  # False: it depends on more than the regressor, and these are its values at the samples


@dataclass(frozen=True)
class Regressor:
    """What the missing force is drawn against: values at the same instants as the force, (n,).

    The angle of a turning hoop belongs in one turn: whoever fills this wraps it.
    """

    name: str  # "dtheta"
    unit: str
    value: Array
    binned: Binned | None = None
    law: LawCurve | None = None
    turning: bool = False  # an angle in one turn


@dataclass(frozen=True)
class MissingForce:
    """Smoothed missing force (or sensor error) of one slot, (n,), with what it may depend on, the likeliest first."""

    slot: str
    unit: str
    t_s: Array
    value: Array
    regressors: Sequence[Regressor] = ()
    recording: str = ""
    reading: bool = False  # a sensor's error, no force


@dataclass(frozen=True)
class Strip:
    """Smoothed disturbance of one slot in one recording, or its readings' error, (n,), over what is usual with the
    effects."""

    recording: str
    slot: str
    t_s: Array
    strength: Array
    ignored: Sequence[Ignored] = ()


@dataclass(frozen=True)
class Harmonics:
    """Amplitudes (n,) of the missing force by order of the angle it depends on; `threshold`: what noise reaches."""

    slot: str
    angle: str  # "theta"
    unit: str
    order: Array
    amplitude: Array
    threshold: Array | None = None


@dataclass(frozen=True)
class Shown:
    """All that a report can show beyond the diagnosis itself."""

    comparisons: Sequence[Comparison] = ()
    forces: Sequence[MissingForce] = ()
    strips: Sequence[Strip] = ()
    harmonics: Sequence[Harmonics] = field(default=())
