"""What can be wrong with a plant though its file can be read: inertia, energy, derivatives, a free run, its effects.

Every check is made at some points around the usual sizes of the states, always the same ones, at nominal values.

Rules of this file: judges and says why; nothing here knows a file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.free_run import FreeRun
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

POINTS = 12
# Of a state whose usual size nobody said.
USUAL_SIZE = 0.3
# A free run has so many samples; halving its step may move no state by more than this share of its range.
SAMPLES, HALVED = 200, 1e-2
# Derivatives by central differences: step and tolerance, as shares of the sizes.
DIFFERENCE, AGREES = 1e-6, 1e-4
# Of a usual size, what is little.
FEW = 1e-3
# Rounding, as a share of what is compared.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Check:
    """An answer: yes, no or does not apply; and why, in a line."""

    name: str
    good: bool | None
    reason: str


def checks(plant: Plant) -> Iterator[Check]:
    """All of them, the quick ones first."""
    yield _inertia(plant)
    yield _passive(plant)
    if plant.energy is not None:
        yield _stored(plant)
    yield _derivatives(plant)
    yield _run(plant)


def usual_state(plant: Plant) -> Array:
    """Usual sizes of the states, where a free run begins; rates at rest."""
    rates = {f"d{q}" for q in plant.coordinates}
    return np.array([0.0 if name in rates else plant.scales.get(name, USUAL_SIZE) for name in plant.states])


def state_rate(plant: Plant) -> ca.Function:
    """(x, u, p) -> x', of a plant without effects."""
    x, u, p = (ca.SX.sym(name, size) for name, size in _sizes(plant).items())
    named = {name: p[i] for i, name in enumerate(plant.values)}
    return ca.Function("rate", [x, u, p], [ca.densify(Composite(plant).rate_expression(x, u, ca.SX(0), named))])


def free_run(plant: Plant, step_s: float | None = None) -> tuple[Array, Array]:
    """Times (n,) s and states (n, nx) from the usual sizes, the inputs held at a tenth of theirs."""
    t: Array = np.linspace(0.0, SAMPLES * plant.time_scale_s, SAMPLES + 1)
    run = FreeRun(plant, step_s=step_s).run([], usual_state(plant), t, np.tile(_inputs(plant), (SAMPLES, 1)))
    return t, run.states


# ---------------------------------------------------------------------------------------------- checks


def _inertia(plant: Plant) -> Check:
    """M, the inverse of what generalised forces do to the accelerations, is symmetric and positive."""
    if not plant.coordinates:
        return Check("inertia", None, "no coordinates")
    mobility = _mechanics(plant, lambda m: m.mobility)
    for x in _points(plant):
        inverse = mobility(x)
        size = np.abs(inverse).max()
        if not np.isfinite(size):
            return Check("inertia", False, f"not finite {_at(plant, x)}")
        if np.abs(inverse - inverse.T).max() > ROUNDING * size:
            reason = "the inertia matrix is not symmetric: no such body, or an equation that is scaled"
            return Check("inertia", False, f"{reason}, {_at(plant, x)}")
        if np.linalg.eigvalsh(inverse).min() <= 0.0:
            return Check("inertia", False, f"the inertia is not positive {_at(plant, x)}")
    return Check("inertia", True, "symmetric and positive")


def _passive(plant: Plant) -> Check:
    """With the inputs at rest the rates' forces give no power: q'(f(q, q') - f(q, 0)) + q' dM/dt q'/2 <= 0."""
    if not plant.coordinates:
        return Check("power", None, "no coordinates")
    power = _mechanics(plant, lambda m: ca.vertcat(m.power, m.size))
    lost = False
    for x in _points(plant):
        gain, size = power(x).ravel()
        if not np.isfinite(gain):
            return Check("power", False, f"not finite {_at(plant, x)}")
        if gain > ROUNDING * size:
            reason = f"forces of the rates put {gain:.3g} W in: a friction with the wrong sign?"
            return Check("power", False, f"{reason} {_at(plant, x)}")
        lost = lost or gain < -ROUNDING * size
    return Check("power", True, "friction takes energy away" if lost else "no force of the rates does work")


def _stored(plant: Plant) -> Check:
    """The energy of the file changes at the power of the forces of the rates; of a plant with states of first order,
    which give and take some, it never grows."""
    if plant.first_order:
        return _never_gained(plant)
    found = _mechanics(plant, lambda m: ca.vertcat(m.stored - m.power, ca.fabs(m.stored) + m.size))
    for x in _points(plant):
        off, size = found(x).ravel()
        if not abs(off) <= ROUNDING * size:
            return Check(
                "energy", False, f"is not that of the equations: {off:.3g} W come from nowhere {_at(plant, x)}"
            )
    return Check("energy", True, "that of the equations")


def _never_gained(plant: Plant) -> Check:
    """E' = dE/dx x' with the inputs at 0 is no gain; not to be told of what its surroundings drive."""
    x, u, p = (ca.SX.sym(name, size) for name, size in _sizes(plant).items())
    assert plant.energy is not None
    slope = ca.densify(ca.gradient(plant.energy(_point(plant, x, u, p)), x))
    parts = ca.Function("parts", [x, u, p], [slope * state_rate(plant)(x, u, p)])
    # what gives hides behind a loss that is as large as itself: each kind of state beside much less of the other
    first = np.isin(plant.states, plant.first_order)
    shares = [np.where(first, one, other) for one, other in ((1.0, 1.0), (FEW, 1.0), (1.0, FEW))]
    still = state_rate(plant)(np.zeros(x.shape[0]), np.zeros(u.shape[0]), _values(plant)).full()
    if still.any():
        return Check("energy", None, "what surrounds the plant drives it, with its states and inputs at 0")
    for here in (share * point for point in _points(plant) for share in shares):
        each = parts(here, np.zeros(len(plant.inputs)), _values(plant)).full()
        if not each.sum() <= ROUNDING * np.abs(each).sum():
            return Check("energy", False, f"grows by {each.sum():.3g} W with nothing driven {_at(plant, here)}")
    return Check("energy", True, "never grows with nothing driven")


def _derivatives(plant: Plant) -> Check:
    rate = state_rate(plant)
    arguments = rate.sx_in()
    slopes = ca.Function("slopes", arguments, [ca.densify(ca.jacobian(rate(*arguments), ca.vertcat(*arguments)))])
    u, p = _inputs(plant), _values(plant)
    for x in _points(plant):
        here = np.concatenate([x, u, p])
        exact = slopes(x, u, p).full()
        by_differences = _differences(rate, here, len(x), len(u))
        size = np.abs(rate(x, u, p).full().ravel()).max()
        # of a column: what the rate changes by when its argument changes by its own size
        off = np.abs(exact - by_differences) * np.maximum(np.abs(here), DIFFERENCE)
        scale = np.maximum(np.abs(exact * here).max(axis=1, keepdims=True), size)
        if not (off <= AGREES * scale).all():
            row, column = np.unravel_index(np.argmax(np.nan_to_num(off / scale, nan=np.inf)), off.shape)
            names = [*plant.states, *(one.name for one in plant.inputs), *plant.values]
            reason = f"d({plant.states[row]}')/d({names[column]}) is not what differences give"
            return Check("derivatives", False, f"{reason} {_at(plant, x)}")
    return Check("derivatives", True, f"as by differences at {POINTS} points")


def _differences(rate: ca.Function, here: Array, states: int, inputs: int) -> Array:
    columns = []
    for i, one in enumerate(here):
        step = DIFFERENCE * max(abs(one), 1e-3)
        ends = []
        for sign in (1.0, -1.0):
            moved = here.copy()
            moved[i] += sign * step
            ends.append(rate(moved[:states], moved[states : states + inputs], moved[states + inputs :]).full().ravel())
        with np.errstate(invalid="ignore"):  # of what is not finite
            columns.append((ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T


def _run(plant: Plant) -> Check:
    t, coarse = free_run(plant)
    if not np.isfinite(coarse).all():
        row = int(np.argmin(np.isfinite(coarse).all(axis=1)))
        return Check("free run", False, f"leaves every number at {t[row]:.3g} s, from {_at(plant, coarse[0])}")
    fine = free_run(plant, plant.time_scale_s / 8.0)[1]
    span = np.maximum(np.ptp(fine, axis=0), ROUNDING * np.abs(fine).max(axis=0) + np.finfo(float).tiny)
    off = float((np.abs(coarse - fine).max(axis=0) / span).max())
    if not off <= HALVED:
        reason = f"half the step changes it by {100 * off:.2g} %: sample_time_s is too long for this plant"
        return Check("free run", False, reason)
    return Check("free run", True, f"{t[-1]:g} s; half the step changes it by {100 * off:.2g} %")


# ---------------------------------------------------------------------------------------------- mechanics


class _Mechanics:
    """Inertia, power of the rates' forces and change of the stored energy, as graphs over the state."""

    def __init__(self, plant: Plant) -> None:
        n = len(plant.coordinates)
        self.x, u, p = (ca.SX.sym(name, size) for name, size in _sizes(plant).items())
        still, values = ca.vertcat(*(0.0 for _ in plant.inputs)), ca.DM(_values(plant))
        force = ca.SX.sym("force", n)
        a = ca.substitute(plant.accelerations(_point(plant, self.x, u, p), force), u, still)
        free = ca.substitute(ca.substitute(a, p, values), force, ca.SX.zeros(n))
        self.mobility = ca.densify(
            ca.substitute(ca.substitute(ca.jacobian(a, force), p, values), force, ca.SX.zeros(n))
        )
        inertia = ca.solve(self.mobility, ca.SX.eye(n)) if n > 1 else 1 / self.mobility
        speeds = ca.vertcat(*(self.x[2 * i + 1] for i in range(n)))
        moved = ca.vertcat(*(part for i in range(n) for part in (speeds[i], 0.0)), *(0.0 for _ in plant.first_order))
        f = ca.mtimes(inertia, free)
        at_rest = ca.substitute(f, speeds, ca.SX.zeros(n))
        turning = ca.reshape(ca.jtimes(ca.vec(inertia), self.x, moved), n, n)
        self.power = ca.dot(speeds, f - at_rest) + ca.dot(speeds, ca.mtimes(turning, speeds)) / 2
        self.size = ca.dot(ca.fabs(speeds), ca.fabs(f) + ca.fabs(at_rest))
        self.stored = ca.SX(0)
        if plant.energy is not None and not plant.first_order:
            energy = ca.substitute(plant.energy(_point(plant, self.x, u, p)), p, values)
            change = ca.vertcat(*(part for i in range(n) for part in (speeds[i], free[i])))
            self.stored = ca.jtimes(energy, self.x, change)


def _mechanics(plant: Plant, of: Any) -> Any:
    mechanics = _Mechanics(plant)
    function = ca.Function("mechanics", [mechanics.x], [ca.densify(of(mechanics))])
    return lambda x: function(x).full()


def _sizes(plant: Plant) -> dict[str, int]:
    return {"x": len(plant.states), "u": len(plant.inputs), "p": len(plant.values)}


def _point(plant: Plant, x: Any, u: Any, p: Any) -> Any:
    first = u if len(plant.inputs) > 1 else u[0] if plant.inputs else 0.0
    return plant.point(x, {name: p[i] for i, name in enumerate(plant.values)}, first, 0.0)


def _values(plant: Plant) -> Array:
    return np.array([*plant.values.values()], dtype=float)


def _inputs(plant: Plant) -> Array:
    """A tenth of their usual sizes: no zero, at which a law may have a corner."""
    return np.array([0.1 * plant.scales.get(one.name, one.limit or 1.0) for one in plant.inputs])


def _points(plant: Plant) -> list[Array]:
    """First-order states keep their sign: a level below zero is none."""
    random, n = np.random.default_rng(0), len(plant.states) - len(plant.first_order)
    sizes = np.array([plant.scales.get(name, USUAL_SIZE) for name in plant.states])
    low = np.concatenate([np.full(n, -1.0), np.full(len(plant.first_order), 0.2)])
    return [sizes * random.uniform(low, 1.0) for _ in range(POINTS)]


def _at(plant: Plant, x: Array) -> str:
    return "at " + ", ".join(f"{name} = {value:.3g}" for name, value in zip(plant.states, x, strict=True))
