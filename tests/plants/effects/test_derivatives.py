"""The derivatives that filter and search take of a substep and its readings: finite, and those of the numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from harness.effectcases import NAMES, composite, effects, sizes

from hoopd.plants.plant_with_effects import BACK_STEPS, Composite

# Away from the kinks of limits and friction every effect is smooth.
X0 = np.array([0.3, 3.0, 0.5, -2.0])


def point(c: Composite, values: dict[str, float]) -> list[object]:
    return [c.beginning(X0, 0.05), 0.09, np.zeros(c.nq), 0.005, 0.31, c.vector(values)]


def by_parameters(step: ca.Function, c: Composite, values: dict[str, float]) -> np.ndarray:
    """(nz, free): the columns behind those by z, disturbance and torque."""
    return np.asarray(step(*point(c, values))[1].full()[:, c.nz + c.nq + 1 :])


def looked(c: Composite, values: dict[str, float]) -> list[object]:
    return [c.beginning(X0, 0.05), np.full((3, BACK_STEPS), 0.09), np.zeros(c.nq), 0.31, c.vector(values)]


def test_derivatives_are_finite_at_neutral_at_rest_and_at_size(structure: str = "entries") -> None:
    for name in NAMES:
        c = composite(structure, name)
        own = [key for key in c.names if key.startswith(name)]
        step, output = c.substep_derivatives(own), c.output_derivatives(own)
        for values in ({}, sizes(name)):
            for x in (X0, np.zeros(4)):
                at = point(c, values)
                at[0] = c.beginning(x)
                assert all(np.isfinite(part.full()).all() for part in step(*at)), name
                seen = looked(c, values)
                seen[0] = c.beginning(x)
                assert all(np.isfinite(part.full()).all() for part in output(*seen)), name


def test_derivatives_by_parameters_are_those_of_the_numbers(structure: str = "rolling") -> None:
    for name in NAMES:
        if effects(structure)[name].found_by == "quality":
            continue
        c = composite(structure, name, substeps=1)
        keys = [key for key in c.names if key.startswith(name)]
        step, output = c.substep_derivatives(keys), c.output_derivatives(keys)
        values = sizes(name)
        for by_p, f, at in (
            (by_parameters(step, c, values), c.step_function, lambda v, c=c: point(c, v)),
            (output(*looked(c, values))[2].full(), c.output_function, lambda v, c=c: looked(c, v)),
        ):
            for column, key in enumerate(keys):
                h = 1e-6 * max(abs(values[key]), 1e-3)
                more, less = (f(*at({**values, key: values[key] + sign * h})).full().ravel() for sign in (1, -1))
                assert by_p[:, column] == pytest.approx((more - less) / (2 * h), rel=1e-4, abs=1e-5), key


def test_derivatives_by_state_disturbance_and_torque_are_those_of_the_numbers() -> None:
    names = ("actuator.lag", "actuator.ripple", "hoop.imbalance", "encoder.speed_lag")
    c, values = composite("rolling", *names, substeps=1), sizes(*names)
    by = c.substep_derivatives([])(*point(c, values))[1].full()
    at = point(c, values)
    flat, h = np.concatenate([at[0], at[2], [at[1]]]), 1e-6
    for column in range(len(flat)):
        ends = []
        for sign in (1, -1):
            moved = flat + sign * h * (np.arange(len(flat)) == column)
            z, w, torque = moved[: c.nz], moved[c.nz : -1], moved[-1]
            ends.append(c.step_function(z, torque, w, *at[3:]).full().ravel())
        assert by[:, column] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-6)


def test_a_shape_that_vanishes_at_zero_has_its_column_there() -> None:
    # of a lag, a delay of a sensor or a sensor's lag the search may take the derivative at neutral itself
    for name, key in (("actuator.lag", "T"), ("encoder.speed_lag", "T"), ("camera.latency", "d")):
        c = composite("rolling", name)
        step, output = c.substep_derivatives([f"{name}.{key}"]), c.output_derivatives([f"{name}.{key}"])
        columns = [by_parameters(step, c, {}), output(*looked(c, {}))[2].full()]
        assert max(np.abs(column).max() for column in columns) > 1e-2, name
