"""How a plant with effects moves over a substep: its forces, its dry friction, Runge-Kutta's step.

Dry friction f acts along a direction a of the generalised forces against the rate a'q'. Where it can hold, it is over a
substep of d seconds f = -(a'q'/d + a'q'')/(a'M^-1 a), the constant force under which the rate ends at zero, clipped to
+-level at every stage of the step: what rests under less than the level gets exactly the force that holds it. Where it
cannot, it is the whole level against the motion, or the mean of both directions when the motion turns within the
substep. Frictions along several directions are solved together, by sweeps.

Rules of this file: nothing here knows a sensor, a delay or a lag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import DryFriction, Effect, Point

# No time in a denominator is shorter, s, of a plant whose usual time between samples is USUAL_S.
SHORTEST_S, USUAL_S = 1e-7, 0.02
# A force beyond any friction's level.
BEYOND = 1e9
# A rate below this is none, rad/s.
REST = 1e-30
# Two frictions of the hoop and its ball act on each other by a sixth: 0.16^8 = 4e-7 of a force is left.
SWEEPS = 8
# Width of the smooth form of dry friction on the way back, rad/s: there is no sticking to be exact about.
BACK_WIDTH = 0.02


class StageTorques(NamedTuple):
    """The inputs at the beginning, in the middle (which is their mean) and at the end of a step."""

    begin: Any
    middle: Any
    end: Any


class HoldingForces:
    """Forces of dry friction that hold, substep by substep, as symbols: a derivative takes them as given."""

    def __init__(self) -> None:
        self._forces: list[tuple[Any, Any]] = []

    def given(self, force: Any) -> Any:
        """A symbol in the place of a force."""
        symbol = ca.SX.sym(f"holding_{len(self._forces)}", force.size1())
        self._forces.append((symbol, force))
        return symbol

    def put_back(self, expression: Any) -> Any:
        """An expression with the forces themselves, the last first: each follows from those before it."""
        for symbol, force in reversed(self._forces):
            expression = ca.substitute(expression, symbol, force)
        return expression


class Motion:
    """A plant and its effects on forces; all parameters by `names`, expressions in and out."""

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[Effect],
        names: Sequence[str],
        *,
        inner_torque: bool,
        limited: bool = True,
        numbers: Mapping[str, float] | None = None,
    ) -> None:
        """`inner_torque`: maps of the torque follow the plant inside a substep (there is no lag behind them);
        `limited`: no input is larger than its limit; `numbers`: parameters that are constants of the functions."""
        self._plant, self._effects, self._names, self._inner = plant, effects, names, inner_torque
        self._limited, self._numbers = limited, numbers or {}
        self._nq, self._nx = len(plant.coordinates), len(plant.states)
        self._disturbed = plant.disturbed
        self.shortest_s = SHORTEST_S * (plant.time_scale_s / USUAL_S)
        self._maps = [one for one in sorted(effects, key=lambda one: one.order) if one.torque is not None]
        frictions = [(one, one.friction) for one in effects if one.friction is not None]
        # a contact that the accelerations hold sees what all others leave
        self._frictions = sorted(frictions, key=lambda one: one[1].needed is not None)

    @property
    def states(self) -> tuple[str, ...]:
        """Of the plant."""
        return self._plant.states

    # ------------------------------------------------------------------------------------------ steps

    def step(
        self,
        x: Any,
        torques: StageTorques,
        w: Any,
        d: Any,
        t: Any,
        p: Mapping[str, Any],
        holding: HoldingForces | None = None,
    ) -> Any:
        """State of the plant d seconds later, with the disturbance w held; `holding`: forces that hold are put there,
        and a symbol stands for them in what comes back."""
        values = self._vector(p)
        stops = self._held(x, torques, w, d, t, values, holding)
        after = runge_kutta(lambda y, at, stage: self._rate(y, torques[stage], w, at, values, stops), x, d, t)
        return self._ended(after, holding)

    def _held(
        self, x: Any, torques: StageTorques, w: Any, d: Any, t: Any, values: Any, holding: HoldingForces | None
    ) -> Any:
        """The forces of what frictions hold over a step from x, or the symbol that stands for them."""
        stops = self._stops(x, torques.middle, w, d, t, values) if self._frictions else ca.SX(0, 1)
        return stops if holding is None else holding.given(stops)

    def _ended(self, x: Any, holding: HoldingForces | None) -> Any:
        """The state after a step, at rest where a friction has stopped it."""
        return self._at_rest(x) if self._frictions and holding is None else x

    def _at_rest(self, x: Any) -> Any:
        """Rates of nothing are nothing: else what has stopped would go on through ever smaller, ever slower numbers."""
        rates = range(1, 2 * self._nq, 2)
        return ca.vertcat(
            *(ca.if_else(ca.fabs(x[i]) < REST, 0.0, x[i]) if i in rates else x[i] for i in range(self._nx))
        )

    def step_back(self, x: Any, torque: Any, w: Any, d: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """State of the plant d seconds earlier; dry friction in its smooth form."""
        values = self._vector(p)
        return runge_kutta(lambda y, at, _: self._smooth_rate(y, torque, w, at, values), x, -d, t)

    def rate(self, x: Any, torque: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """dx/dt without a disturbance; ValueError with dry friction, whose force belongs to a step."""
        if self._frictions:
            raise ValueError("dry friction has no rate of its own")
        return self._rate(x, torque, ca.SX.zeros(len(self._disturbed)), t, self._vector(p), ca.SX(0, 1))

    def smooth_rate(self, x: Any, torque: Any, t: Any, p: Mapping[str, Any], width: float) -> Any:
        """dx/dt without a disturbance; of dry friction the smooth curve that is steep within `width` of rest."""
        w = ca.SX.zeros(len(self._disturbed))
        return self._smoothed(width)(x, torque, w, t, self._vector(p))

    def drifted(self, x: Any, d: Any) -> Any:
        """The state d seconds later if no force acted."""
        moved = (one for i in range(self._nq) for one in (x[2 * i] + d * x[2 * i + 1], x[2 * i + 1]))
        return ca.vertcat(*moved, x[2 * self._nq :])

    def torque(self, x: Any, u: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """What limits and maps make of the demanded inputs; the maps are those of the first one's drive."""
        first, others = split_inputs(u, len(self._plant.inputs))
        if self._limited:
            limits = [one.limit for one in self._plant.inputs]
            first = _within(first, limits[0] if limits else None)
            others = [_within(one, limit) for one, limit in zip(others, limits[1:], strict=True)]
        for effect in self._maps:
            assert effect.torque is not None
            first = effect.torque(self._plant.point(x, p, joined(first, others), t), effect.values(p))
        return joined(first, others)

    # ------------------------------------------------------------------------------------------ functions, made once

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        inputs = max(1, len(self._plant.inputs))
        sizes = {"x": self._nx, "torque": inputs, "w": len(self._disturbed), "t": 1, "p": len(self._names)}
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _rate(self) -> ca.Function:
        """(x, torque, w, t, p, stops) -> dx/dt."""
        s, stops = self._symbols, ca.SX.sym("stops", len(self._frictions))
        p = self._named
        point, force, seen, torque, more = self._smooth_forces(s["x"], s["torque"], s["w"], s["t"], p)
        acceleration = self._accelerations(seen, force, torque, s["t"], s["p"])
        for index, (effect, friction) in enumerate(self._frictions):
            middle, level = self._middle_and_level(effect, friction, point, acceleration, p)
            f = ca.fmin(ca.fmax(stops[index], middle - level), middle + level)
            force += self._direction(friction, point) * f
            acceleration = self._accelerations(seen, force, torque, s["t"], s["p"])
        return ca.Function("rate", [*s.values(), stops], [self._joined(point, acceleration, more)], _CSE)

    def _joined(self, s: Point, acceleration: Any, more: Any) -> Any:
        """dx/dt from q'' and the rates of the first-order states, to which effects add."""
        rates = [getattr(s, f"d{q}") for q in self._plant.coordinates]
        second = (one for i, rate in enumerate(rates) for one in (rate, acceleration[i]))
        return ca.densify(ca.vertcat(*second, self._plant.rates(s) + more))

    @cached_property
    def _smooth_rate(self) -> ca.Function:
        """(x, torque, w, t, p) -> dx/dt with dry friction as a steep smooth curve."""
        return self._smoothed(BACK_WIDTH)

    def _smoothed(self, width: float) -> ca.Function:
        s, p = self._symbols, self._named
        point, force, seen, torque, more = self._smooth_forces(s["x"], s["torque"], s["w"], s["t"], p)
        acceleration = self._accelerations(seen, force, torque, s["t"], s["p"])
        for effect, friction in self._frictions:
            middle, most = self._middle_and_level(effect, friction, point, acceleration, p)
            direction = self._direction(friction, point)
            force += direction * _smooth_friction(
                friction, middle, most, ca.dot(direction, self._speeds(s["x"])), width
            )
            acceleration = self._accelerations(seen, force, torque, s["t"], s["p"])
        return ca.Function("smooth_rate", list(s.values()), [self._joined(point, acceleration, more)], _CSE)

    @cached_property
    def _stops(self) -> ca.Function:
        """(x, torque, w, d, t, p) -> for each dry friction the force that ends its rate within d, not yet clipped."""
        s, d, p = self._symbols, ca.SX.sym("d"), self._named
        point, force, seen, torque, _ = self._smooth_forces(s["x"], s["torque"], s["w"], s["t"], p)
        unforced = self._accelerations(seen, force, torque, s["t"], s["p"])
        mobility = self._mobility(seen, torque, s["t"], s["p"])
        directions = [self._direction(friction, point) for _, friction in self._frictions]
        pushes = [ca.mtimes(mobility, one) for one in directions]
        stops: list[Any] = [ca.SX(0)] * len(directions)
        forces: list[Any] = [ca.SX(0)] * len(directions)
        for _ in range(SWEEPS if len(directions) > 1 else 1):
            for i, (effect, friction) in enumerate(self._frictions):
                a = unforced + sum(pushes[j] * forces[j] for j in range(len(forces)) if j != i)
                middle, level = self._middle_and_level(effect, friction, point, a, p)
                rate, pull = ca.dot(directions[i], self._speeds(s["x"])), ca.dot(directions[i], a)
                stops[i] = _stop(
                    rate, pull, ca.dot(directions[i], pushes[i]), middle, level, ca.fmax(d, self.shortest_s)
                )
                forces[i] = ca.fmin(ca.fmax(stops[i], middle - level), middle + level)
        inputs = [s["x"], s["torque"], s["w"], d, s["t"], s["p"]]
        return ca.Function("stops", inputs, [ca.vertcat(*stops)], _CSE)

    @cached_property
    def _accelerations(self) -> ca.Function:
        """(x as gravity sees it, generalised forces, torque, t, p) -> q''."""
        s, force = self._symbols, ca.SX.sym("force", self._nq)
        a = self._plant.accelerations(self._plant.point(s["x"], self._named, s["torque"], s["t"]), force)
        return ca.Function("a", [s["x"], force, s["torque"], s["t"], s["p"]], [ca.densify(a)], _CSE)

    @cached_property
    def _mobility(self) -> ca.Function:
        """(x, torque, t, p) -> q'' per generalised force: M^-1."""
        s, force = self._symbols, ca.SX.sym("force", self._nq)
        by_force = ca.jacobian(self._accelerations(s["x"], force, s["torque"], s["t"], s["p"]), force)
        here = ca.densify(ca.substitute(by_force, force, ca.SX.zeros(self._nq)))
        return ca.Function("mobility", [s["x"], s["torque"], s["t"], s["p"]], [here], _CSE)

    # ------------------------------------------------------------------------------------------ parts

    @property
    def _named(self) -> dict[str, Any]:
        p, known = self._symbols["p"], self._numbers
        return {name: ca.SX(known[name]) if name in known else p[i] for i, name in enumerate(self._names)}

    def _vector(self, p: Mapping[str, Any]) -> Any:
        return ca.vertcat(*(p[name] for name in self._names))

    def _smooth_forces(self, x: Any, u: Any, w: Any, t: Any, p: Mapping[str, Any]) -> tuple[Point, Any, Any, Any, Any]:
        """The point, the generalised forces but for dry friction, the state as gravity sees it, the inputs behind
        their drives, and what is added to the rates of first-order states."""
        torque = self._torque_inside(x, u, t, p)
        s = self._plant.point(x, p, torque, t)
        s.demand = split_inputs(u, len(self._plant.inputs))[0]
        s = s.in_frame(self._effects, p)
        force = {q: w[i] for i, q in enumerate(self._disturbed)}
        for one in self._plant.inputs:
            if one.coordinate is not None:
                force[one.coordinate] += getattr(s, one.name)
        for effect in self._effects:
            if effect.force is not None:
                _add(force, effect.force(s, effect.values(p)))
        seen = dict(zip(self._plant.states, ca.vertsplit(x), strict=True))
        seen |= {q: s.to_gravity(q) for q in s.leant}
        forces, more = ([force[name] for name in names] for names in (self._plant.coordinates, self._plant.first_order))
        return s, _column(forces), ca.vertcat(*seen.values()), torque, _column(more)

    def _torque_inside(self, x: Any, u: Any, t: Any, p: Mapping[str, Any]) -> Any:
        return self.torque(x, u, t, p) if self._inner and self._plant.inputs else u

    def _speeds(self, x: Any) -> Any:
        return ca.vertcat(*(x[i] for i in range(1, 2 * self._nq, 2)))

    def _direction(self, friction: DryFriction, s: Point) -> Any:
        along = friction.along(s)
        return ca.vertcat(*(ca.SX(along.get(q, 0.0)) for q in self._plant.coordinates))

    def _middle_and_level(
        self, effect: Effect, friction: DryFriction, s: Point, a: Any, p: Mapping[str, Any]
    ) -> tuple[Any, Any]:
        """What a friction adds lies between -needed - level and -needed + level."""
        level = friction.level(s, effect.values(p))
        if friction.needed is None:
            return 0.0, level
        return -friction.needed(s, dict(zip(self._plant.coordinates, ca.vertsplit(a), strict=True))), level


_CSE = {"cse": True}


def runge_kutta(f: Callable[[Any, Any, int], Any], x: Any, d: Any, t: Any) -> Any:
    """x d seconds after t, by one classical step of fourth order; f is told where it is: begin, middle or end."""
    k1 = f(x, t, 0)
    k2 = f(x + d / 2 * k1, t + d / 2, 1)
    k3 = f(x + d / 2 * k2, t + d / 2, 1)
    k4 = f(x + d * k3, t + d, 2)
    return x + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _stop(rate: Any, pull: Any, mobility: Any, middle: Any, level: Any, d: Any) -> Any:
    """Friction over d seconds, before it is clipped to middle +- level; pull: the rate's derivative without it."""
    # what would hold it, measured from the middle
    hold = -pull / mobility - middle
    # it cannot: the level, first against what is left of a motion in the direction of `hold`, then in it
    way = ca.sign(hold)
    crossed = ca.fmin(ca.fmax(rate * way / ((ca.fabs(hold) + level) * mobility * d), 0.0), 1.0)
    turns = ca.logic_and(crossed > 0.0, crossed < 1.0)
    slides = middle + way * (1.0 - 2.0 * crossed) * ca.if_else(turns, level, BEYOND)
    return ca.if_else(ca.fabs(hold) <= level, -(rate / d + pull) / mobility, slides)


def _smooth_friction(friction: DryFriction, middle: Any, most: Any, rate: Any, width: float) -> Any:
    if friction.needed is None:
        return -most * ca.tanh(rate / width)
    # a contact that holds stays as it is
    return ca.if_else(ca.fabs(rate) > width, middle - most * ca.sign(rate), 0.0)


def split_inputs(u: Any, count: int) -> tuple[Any, list[Any]]:
    """The first of the inputs, and the others."""
    return (u, []) if count < 2 else (u[0], [u[i] for i in range(1, count)])


def joined(first: Any, others: Sequence[Any]) -> Any:
    """The inputs in one column again."""
    return ca.vertcat(first, *others) if others else first


def _column(parts: Sequence[Any]) -> Any:
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def _within(u: Any, limit: float | None) -> Any:
    return u if limit is None or limit == inf else ca.fmin(ca.fmax(u, -limit), limit)


def _add(total: dict[str, Any], more: Mapping[str, Any]) -> None:
    for name, value in more.items():
        if name in total:
            total[name] = total[name] + value
