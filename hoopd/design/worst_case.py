"""Margins of one law around every model that the data of an identification leave open.

Rules of this file: one input and one output between law and model, negative feedback; what is worst is worst of the
models that were asked, which a number of them says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.margins import Margins, margins
from hoopd.ident.uncertain import possible_models, surface

Array = NDArray[np.float64]
LETTERS = ("a", "b", "c", "d")


@dataclass(frozen=True)
class WorstCase:
    """Margins of the estimate, the worst of each over all models, the share of models that the law keeps stable.

    `phase_rad`, `delay_s`, `gain_up`, `gain_down` and `peak_sensitivity` are each the worst of its own model, of the
    stable ones; `models` were asked, which lie on the ellipsoid that holds the true one with probability `level`.
    """

    nominal: Margins
    phase_rad: float
    delay_s: float
    gain_up: float
    gain_down: float
    peak_sensitivity: float
    stable_share: float
    models: int
    level: float

    @property
    def stable(self) -> bool:
        """Whether every model that was asked is kept stable."""
        return self.stable_share == 1.0


def worst_case(
    model: Any, law: Any, *, delay_s: float = 0.0, count: int = 100, level: float = 0.95, seed: int = 0
) -> WorstCase:  # fmt: skip
    """Give the worst margins of a law over the ellipsoid of an identified model.

    Parameters
    ----------
    model : any model
        A result of `hoopd.ident` of one input and one output, with a covariance.
    law : control.StateSpace, control.TransferFunction or float
        From the model's output to its input under negative feedback, of the model's step.
    delay_s : float
        A pure delay in the loop that neither holds.
    count : int
        Models on the ellipsoid that are asked beside the estimate.
    level : float
        Probability with which the ellipsoid holds the true model.
    seed : int
        Of the models at random.

    Returns
    -------
    WorstCase
        Nominal and worst margins, and the share of models that the law keeps stable.

    Raises
    ------
    ValueError
        A model without a covariance.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.design.worst_case import worst_case
    >>> from hoopd.ident import arx, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 300))
    >>> y = lfilter([0.0, 0.2], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.2 * e)
    >>> found = worst_case(arx(iddata(y, u, 0.1), 1, 1), law=4.0)
    >>> found.stable, bool(found.gain_up < found.nominal.gain_up)
    (True, True)
    """
    systems = [one.system for one in possible_models(model, count, level=level, seed=seed)]
    return worst_of([_loop(one, law) for one in systems], delay_s=delay_s, level=level)


def worst_of(loops: Sequence[control.StateSpace], *, delay_s: float = 0.0, level: float = 0.95) -> WorstCase:
    """Give the worst margins of several loops (each plant times law, one input and output), the estimate's first."""
    each = [margins(one, delay_s) for one in loops]
    stable = [one for one in each if one.stable]
    return WorstCase(
        each[0],
        min((one.phase_rad for one in stable), default=np.nan), min((one.delay_s for one in stable), default=np.nan),
        min((one.gain_up for one in stable), default=np.nan), max((one.gain_down for one in stable), default=np.nan),
        max((one.peak_sensitivity for one in stable), default=np.nan), len(stable) / len(each), len(each), level,
    )  # fmt: skip


def models_about(
    parts: Mapping[str, Array], moves: Sequence[Mapping[str, Array]], step_s: float, count: int = 100, *,
    level: float = 0.95, seed: int = 0,
) -> list[control.StateSpace]:  # fmt: skip
    """Give the models from u to y that a file of an identified model leaves open: its own first, then `count` others.

    Parameters
    ----------
    parts : mapping of ndarray
        a, b, c and d.
    moves : sequence of mapping of ndarray
        What they change by, a standard deviation along each axis of the ellipsoid.
    step_s : float
        Sample time.
    count, level, seed
        As of `worst_case`.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.design.worst_case import models_about
    >>> a, one, none = np.array([[0.5]]), np.ones((1, 1)), np.zeros((1, 1))
    >>> parts = {"a": a, "b": one, "c": one, "d": none}
    >>> moves = [{"a": 0.01 * one, "b": none, "c": none, "d": none}]
    >>> [round(float(each.A[0, 0]), 4) for each in models_about(parts, moves, 0.1, count=2)]
    [0.5, 0.5196, 0.4804]
    """
    made = [control.ss(*(parts[name] for name in LETTERS), step_s)]
    for point in surface(len(moves), count, level, seed) if moves else ():
        moved = [parts[name] + sum(by * one[name] for by, one in zip(point, moves, strict=True)) for name in LETTERS]
        made.append(control.ss(*moved, step_s))
    return made


def _loop(system: control.StateSpace, law: Any) -> control.StateSpace:
    if (system.ninputs, system.noutputs) != (1, 1):
        raise ValueError(f"one input and one output are wanted, not {system.ninputs} and {system.noutputs}")
    own = control.StateSpace(system.A, system.B, system.C, system.D, system.dt)
    return control.ss(own * law)
