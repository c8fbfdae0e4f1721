"""A law for the linear model of any plant: linear-quadratic or by poles, with a stationary Kalman filter.

Rules of this file: python-control's systems and numpy's matrices in and out; nothing is read, written or drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.analysis import minimal
from hoopd.design.lqg import kalman_gain, lqr, observer_law
from hoopd.design.placement import place
from hoopd.plants.compiled import zero_order_hold

Array = NDArray[Any]

# Of the sizes that matter, what a reading scatters by, and what disturbances move a state by in a sample.
READING_SHARE, DISTURBANCE_SHARE = 1e-3, 1e-2


@dataclass(frozen=True)
class LinearLaw:
    """Gains about the operating point, u = u0 - K (x - x0) on the filter's state, and the loop."""

    feedback: Array  # K (inputs, nx)
    filter: Array  # M (nx, ny) of x += M (y - C x)
    model: control.StateSpace  # sampled, as seen in a tick
    loop: control.StateSpace  # broken at the inputs, negative feedback


def sampled(system: control.StateSpace, step_s: float) -> control.StateSpace:
    """The inputs held over a step, without states that no output sees or no input moves."""
    less = minimal(system).system
    a, b = zero_order_hold(np.asarray(less.A), np.asarray(less.B), step_s)
    labels = {"states": less.state_labels, "inputs": less.input_labels, "outputs": less.output_labels}
    return control.ss(a, b, less.C, less.D, step_s, name=less.name, **labels)


def quadratic(model: control.StateSpace, states: Array, inputs: Array) -> Array:
    """K (inputs, nx): deviations of these sizes (nx,), (inputs,) cost the same (Bryson's rule)."""
    return lqr(model.A, model.B, np.diag(1.0 / states**2), np.diag(1.0 / inputs**2))


def placed(model: control.StateSpace, poles: Sequence[complex]) -> Array:
    """K (1, nx) with poles (1/s) where they are wanted; ValueError: several inputs, or poles that cannot be had."""
    if model.ninputs != 1:
        raise ValueError("poles are placed with one input; lqg takes several")
    return place(model.A, model.B, [complex(np.exp(pole * model.dt)) for pole in poles])


def with_filter(model: control.StateSpace, feedback: Array, states: Array, outputs: Array) -> LinearLaw:
    """The gains with a filter for disturbances and readings that are a share of the sizes (nx,), (ny,)."""
    q, r = np.diag((DISTURBANCE_SHARE * states) ** 2), np.diag((READING_SHARE * outputs) ** 2)
    gain = kalman_gain(np.asarray(model.A), np.asarray(model.C), q, r)
    return LinearLaw(feedback, gain, model, observer_law(model, gain, feedback) * model)
