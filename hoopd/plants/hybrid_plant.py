"""A plant with several modes: each moves by equations of its own, guards end it, resets begin the next one.

    mode --(guard falls to zero, at a time that is found)--> the transition that applies --(reset)--> its target

Rules of this file: generic; a mode's equations are a composite, guards and resets are expressions of state and
parameters; what they mean stands where they are declared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.compiled import Call
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# A leap (20 ms of a rig) is so many steps, each looked at by the guards.
LEAP_STEPS = 10
BISECTIONS = 40  # of a step of a millisecond: the time of a transition to a femtosecond
# Transitions within one step: a ball that rattles loses its speed in a dozen; more are a declaration that never rests.
MOST_TRANSITIONS = 60


@dataclass(frozen=True)
class Transition:
    """How one mode ends and another begins; functions of (state z of `source`, parameters p of the hybrid plant), the
    guard of the time t (s), too."""

    source: str
    target: str
    guard: ca.Function  # above zero while the source lasts
    reset: ca.Function  # -> state of the target
    applies: ca.Function | None = None  # above zero: this one, where several share a guard; None: always


class _ModeSteps:
    """What moves a mode: a step of its states under a held input, and a leap of several, looked at by its guards."""

    def __init__(self, composite: Composite, names: Sequence[str], guards: Sequence[ca.Function]) -> None:
        c = composite
        z, given = ca.SX.sym("z", c.nz), ca.SX.sym("given", 2 + c.nu + len(names))
        d, t, u, numbers = given[0], given[1], given[2 : 2 + c.nu], given[2 + c.nu :]
        named = {name: numbers[i] for i, name in enumerate(names)}
        after = ca.densify(c.step_expression(z, [u], ca.SX.zeros(c.nw), d, t, named))
        least = ca.mmin(ca.vertcat(*(guard(after, numbers, t + d) for guard in guards))) if guards else ca.SX(1.0)
        function = ca.Function("step", [z, given], [ca.densify(ca.vertcat(least, after))], {"cse": True})
        self._step, self._leap = Call(function), Call(_repeated(function, LEAP_STEPS))

    def step(self, z: Array, given: Array) -> tuple[float, Array]:
        """Least guard after one step, and the state; `given`: its length (s), the time, inputs, parameters."""
        found = self._step.vector(z, given)
        return float(found[0]), found[1:]

    def leap(self, z: Array, given: Array) -> tuple[float, Array]:
        """The same over `LEAP_STEPS` such steps together; the least guard after any of them."""
        found = self._leap.vector(z, given)
        return float(found[0]), found[1:]


def _repeated(step: ca.Function, count: int) -> ca.Function:
    """So many steps, and the least of their guards; written out, so that what they share is computed once."""
    z, given = ca.SX.sym("z", step.size1_in(0)), ca.SX.sym("given", step.size1_in(1))
    d, t, rest = given[0], given[1], given[2:]
    least, after = ca.SX(np.inf), z
    for k in range(count):
        found = step(after, ca.vertcat(d, t + k * d, rest))
        least, after = ca.fmin(least, found[0]), found[1:]
    return ca.Function("leap", [z, given], [ca.densify(ca.vertcat(least, after))], {"cse": True})


class HybridPlant:
    """Modes by name, and the transitions between them.

    Parameters
    ----------
    modes : mapping of str to Composite
        Each with its own states and effects; the first one has the parameters of all.
    transitions : sequence of Transition
        Those of one mode in the order in which they are asked.

    Examples
    --------
    A ball dropped from 1 m comes back with half of its speed:

    >>> import casadi as ca
    >>> from hoopd.plants.declaration import Plant
    >>> fall = Plant("fall", ("y",), lambda s, force: -s.p["g"] + 0 * force, values={"g": 9.81})
    >>> z, p, t = ca.SX.sym("z", 2), ca.SX.sym("p", 1), ca.SX.sym("t")
    >>> floor = Transition("air", "air", ca.Function("guard", [z, p, t], [z[0]]),
    ...     ca.Function("reset", [z, p], [ca.vertcat(0.0, -0.5 * z[1])]))
    >>> course = HybridCourse(HybridPlant({"air": Composite(fall, substeps=1)}, [floor]), {}, "air", [1.0, 0.0])
    >>> course.advance(0.0, 0.5, 0.0)
    >>> round(course.changes[0].t, 6), float(course.z[1].round(3))
    (0.451524, 1.739)
    """

    def __init__(self, modes: Mapping[str, Composite], transitions: Sequence[Transition]) -> None:
        self.modes, self.transitions = dict(modes), tuple(transitions)
        self._steps: dict[str, _ModeSteps] = {}
        for one in self.transitions:
            if unknown := {one.source, one.target} - set(self.modes):
                raise ValueError(f"a transition from or to {unknown.pop()!r}, which is no mode")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters of all modes."""
        return next(iter(self.modes.values())).names

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameters in the order of `names`."""
        return next(iter(self.modes.values())).vector(values)

    def steps(self, mode: str) -> _ModeSteps:
        """What moves a mode; made once, for every run."""
        if mode not in self._steps:
            guards = list(dict.fromkeys(one.guard for one in self.of(mode)))
            self._steps[mode] = _ModeSteps(self.modes[mode], self.names, guards)
        return self._steps[mode]

    def of(self, mode: str) -> tuple[Transition, ...]:
        """Transitions that end a mode."""
        return tuple(one for one in self.transitions if one.source == mode)


@dataclass(frozen=True)
class ModeChange:
    """One transition of a run."""

    t: float  # s
    source: str
    target: str
    z: Array  # of the target, right after it


class HybridCourse:
    """One run of a hybrid plant: its mode, its state, and the changes so far."""

    def __init__(self, plant: HybridPlant, values: Mapping[str, float], mode: str, z: Any) -> None:
        self.plant, self.mode, self.z = plant, mode, np.asarray(z, float)
        self.p = plant.vector(values)
        self.changes: list[ModeChange] = []
        inputs = next(iter(plant.modes.values())).nu
        self._given, self._inputs = np.concatenate([np.zeros(2 + inputs), self.p]), slice(2, 2 + inputs)

    def restart(self, mode: str, z: Any) -> None:
        """Begin anew."""
        self.mode, self.z, self.changes = mode, np.asarray(z, float), []

    def advance(self, u: Any, h: float, t: float) -> None:
        """Go on by `h` seconds from `t`, at most a leap of the plant's usual sample time."""
        least, after = self.plant.steps(self.mode).leap(self.z, self._told(u, h / LEAP_STEPS, t))
        if least > 0.0:
            self.z = after
            return
        for k in range(LEAP_STEPS):
            self.step(u, h / LEAP_STEPS, t + k * h / LEAP_STEPS)

    def step(self, u: Any, d: float, t: float) -> None:
        """Go on by `d` seconds from `t` in one step; transitions within it are found."""
        for _ in range(MOST_TRANSITIONS):
            if self._after(u, d, t)[0] > 0.0:
                break
            until = self._first(u, d, t)
            self._change(self._after(u, until, t)[1], t + until)
            t, d = t + until, d - until
        self.z = self._after(u, d, t)[1]

    def _first(self, u: Any, d: float, t: float) -> float:
        """When a guard is below zero for the first time, s from `t`."""
        early, late = 0.0, d
        for _ in range(BISECTIONS):
            middle = (early + late) / 2
            if self._after(u, middle, t)[0] > 0.0:
                early = middle
            else:
                late = middle
        return late

    def _change(self, z: Array, t: float) -> None:
        """By the first transition whose guard is over and that applies."""
        for one in self.plant.of(self.mode):
            over = float(one.guard(z, self.p, t)) <= 0.0
            if over and (one.applies is None or float(one.applies(z, self.p)) > 0.0):
                self.mode, self.z = one.target, one.reset(z, self.p).full().ravel()
                self.changes.append(ModeChange(t, one.source, one.target, self.z))
                return
        self.z = z

    def _after(self, u: Any, d: float, t: float) -> tuple[float, Array]:
        return self.plant.steps(self.mode).step(self.z, self._told(u, d, t))

    def _told(self, u: Any, d: float, t: float) -> Array:
        self._given[0], self._given[1], self._given[self._inputs] = d, t, u
        return self._given
