"""Any declared plant near an equilibrium: where it stays under held inputs, and its linear model there.

Rules of this file: systems are python-control's `StateSpace` with the plant's names; nothing is read, written or drawn.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.numeric_plant import NumericPlant

Array = NDArray[np.float64]

# Rates below this share of a state's usual size a usual sample time are rest.
REST = 1e-9
TOLERANCE = 1e-14
# What is told with three digits may be off by so much, of itself or of the usual size.
ROUNDING = 5e-3


class EquilibriumNotFoundError(ValueError):
    """Nothing stays where it is under these inputs, or the search did not get there."""


class Equilibrium(NamedTuple):
    """A state that stays, and the inputs under which it does."""

    x: Array  # (nx,) in the plant's order
    u: Array  # (inputs,)


def equilibrium(
    plant: Plant,
    inputs: Mapping[str, float] | None = None,
    near: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
) -> Equilibrium:
    """Where a plant stays under held inputs.

    Parameters
    ----------
    plant : Plant
    inputs : mapping of str to float
        Inputs by name, in their units; zero where none is named.
    near : mapping of str to float
        States by name from which the search begins; zero where none is named. What nothing depends on stays there.
    effects, values
        Effects on the plant, and its parameters with theirs.

    Returns
    -------
    Equilibrium

    Raises
    ------
    NoEquilibriumError
        When no state near the start stays.

    Examples
    --------
    Water that runs into two tanks stands at the heights that let as much out:

    >>> from hoopd.plants.registry import plant_named
    >>> equilibrium(plant_named("tanks"), {"q": 5e-5}, {"h1": 0.1, "h2": 0.1}).x.round(4).tolist()
    [0.2039, 0.2039]
    """
    numeric = NumericPlant(plant, effects, values or plant.values)
    u = np.array([(inputs or {}).get(one.name, 0.0) for one in plant.inputs])
    start = np.array([(near or {}).get(name, 0.0) for name in plant.states])
    held = u if len(u) > 1 else float(u.sum())
    size = _sizes(plant)
    weight = plant.time_scale_s / size

    def rates(z: Array) -> Array:
        return np.asarray(numeric.derivative(z * size, held) * weight)

    def slopes(z: Array) -> Array:
        a, _ = numeric.linearize(z * size, held)
        return np.asarray(a * size * weight[:, None])

    with np.errstate(all="ignore"):
        if not np.isfinite(rates(start / size)).all():
            raise EquilibriumNotFoundError(f"{plant.name}: no finite rates at the start of the search")
        found = least_squares(
            rates, start / size, slopes, method="lm", ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE, max_nfev=500
        )
    if not _is_rest(found.fun, rates(start / size)):
        held_words = ", ".join(f"{one.name}={value:g}" for one, value in zip(plant.inputs, u, strict=True))
        raise EquilibriumNotFoundError(
            f"{plant.name} stays nowhere near the start{' under ' * bool(held_words)}{held_words}"
        )
    # to the last bits zero is meant, -0.0 is not
    return Equilibrium(np.asarray(found.x * size) + 0.0, u)


def _sizes(plant: Plant) -> Array:
    """Usual sizes of the states (nx,)."""
    return np.array([plant.scales.get(name, 1.0) for name in plant.states])


def _is_rest(rates: Array, at_start: Array) -> bool:
    """Whether scaled rates are those of rest; NaN are not."""
    most, first = (float(np.abs(one).max(initial=0.0)) for one in (rates, at_start))
    return most < max(REST, REST * first)


def is_there(plant: Plant, point: Equilibrium, states: Mapping[str, float]) -> bool:
    """Whether states by name are those of a point, to the rounding of what a person writes down."""
    at = dict(zip(plant.states, point.x, strict=True))
    return all(
        abs(at[name] - asked) <= ROUNDING * max(abs(asked), plant.scales.get(name, 1.0))
        for name, asked in states.items()
    )


def holding_inputs(
    plant: Plant,
    states: Mapping[str, float],
    free: Sequence[str],
    inputs: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
) -> dict[str, float] | None:
    """The inputs that hold a plant in given states.

    Parameters
    ----------
    plant : Plant
    states : mapping of str to float
        States by name, in their units; those that are not named come to rest where they will.
    free : sequence of str
        The inputs that are looked for.
    inputs : mapping of str to float
        The others, in their units; zero where none is named.
    effects, values
        Effects on the plant, and its parameters with theirs.

    Returns
    -------
    dict of str to float, or None
        The free inputs by name; None where none were found that hold it there.

    Examples
    --------
    What must run into two tanks that stand at 20 cm:

    >>> from hoopd.plants.registry import plant_named
    >>> found = holding_inputs(plant_named("tanks"), {"h1": 0.2, "h2": 0.2}, ["q"])
    >>> round(found["q"], 8)
    4.952e-05
    """
    numeric, size = NumericPlant(plant, effects, values or plant.values), _sizes(plant)
    names = [one.name for one in plant.inputs]
    moved = [k for k, name in enumerate(plant.states) if name not in states]
    looked_for = [names.index(name) for name in free]
    usual = np.array([plant.scales.get(name, 1.0) for name in free])
    weight = plant.time_scale_s / size
    x0 = np.array([states.get(name, 0.0) for name in plant.states])
    u0 = np.array([(inputs or {}).get(name, 0.0) for name in names])

    def at(z: Array) -> tuple[Array, Any]:
        x, u = x0.copy(), u0.copy()
        x[moved], u[looked_for] = z[: len(moved)] * size[moved], z[len(moved) :] * usual
        return x, u if len(u) > 1 else float(u.sum())

    def rates(z: Array) -> Array:
        return np.asarray(numeric.derivative(*at(z)) * weight)

    def slopes(z: Array) -> Array:
        a, b = numeric.linearize(*at(z))
        return np.asarray(np.hstack([a[:, moved] * size[moved], b[:, looked_for] * usual]) * weight[:, None])

    # a flow has no slope at an empty tank: the second start is away from zero
    for start in (np.zeros(len(moved)), np.ones(len(moved))):
        z = np.append(start, np.zeros(len(free)))
        with np.errstate(all="ignore"), contextlib.suppress(ValueError, np.linalg.LinAlgError):  # nothing finite there
            found = least_squares(rates, z, slopes, ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE, max_nfev=500)
            if _is_rest(found.fun, rates(z)):
                return dict(zip(free, map(float, found.x[len(moved) :] * usual), strict=True))
    return None


def linear_plant(
    plant: Plant,
    point: Equilibrium,
    outputs: Sequence[str] = (),
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
) -> control.StateSpace:
    """A, B, C, D for small deviations from a point, exact; outputs are channels (all of them where none is named).

    ValueError: an unknown channel, or one twice.
    """
    names = tuple(outputs) or tuple(plant.channels)
    if unknown := [name for name in names if name not in plant.channels]:
        raise ValueError(f"{plant.name} has no channel {unknown[0]!r}; it has {', '.join(plant.channels)}")
    if len(set(names)) != len(names):
        raise ValueError("an output is named twice")
    own = dict(values or plant.values)
    numeric = NumericPlant(plant, effects, own)
    held = point.u if len(point.u) > 1 else float(point.u.sum())
    a, b = numeric.linearize(point.x, held)
    c, d = _readings(plant, names, point, own)
    labels = {"states": list(plant.states), "outputs": list(names), "name": plant.name}
    if not plant.inputs:
        # python-control wants an input: one that moves nothing
        return control.ss(a, np.zeros((len(a), 1)), c, 0, inputs=["nothing"], **labels)
    return control.ss(a, b, c, d, inputs=[one.name for one in plant.inputs], **labels)


def _readings(
    plant: Plant, names: Sequence[str], point: Equilibrium, values: Mapping[str, float]
) -> tuple[Array, Array]:
    """Derivatives of channels by the state (ny, nx) and by the inputs (ny, inputs)."""
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", max(len(plant.inputs), 1))
    here = plant.point(x, values, u[0] if len(plant.inputs) == 1 else u)
    read = [plant.channels[name].reading for name in names]
    y = ca.vertcat(
        *(
            x[plant.states.index(plant.state_of(name))] if law is None else law(here)
            for name, law in zip(names, read, strict=True)
        )
    )
    slopes = ca.Function("slopes", [x, u], [ca.densify(ca.jacobian(y, x)), ca.densify(ca.jacobian(y, u))])
    by_x, by_u = slopes(point.x, point.u if len(point.u) else 0.0)
    return by_x.full(), by_u.full()
