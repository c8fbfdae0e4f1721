"""The equations of a plant file as CasADi graphs: linear in the highest derivatives, solved for them.

An equation of a coordinate says inertia times acceleration = forces: M(q) q'' = f(q, q', u, t). What an effect or a
drive adds is a generalised force beside f, so that it meets the right inertia. An equation of a first-order state is
linear in that state's derivative alone.

Rules of this file: whatever is wrong with an equation is one `InputError` with its key and column; no file is read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property
from itertools import combinations
from math import isclose
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from hoopd.files.dimensions import ENERGY, Unit, parse_unit, unit_of
from hoopd.files.expression_parser import parse_equation, parse_expression
from hoopd.files.expressions import (
    ARITHMETIC,
    Expression,
    ExpressionError,
    Name,
    Node,
    Operation,
    check_names,
    names_in,
    parts_of,
    value,
)
from hoopd.files.reading import InputError
from hoopd.plants.effects.base import Point

LAWS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt, "abs": ca.fabs, "sign": ca.sign, "tanh": ca.tanh, "exp": ca.exp,
        "min": lambda *all_of: _folded(ca.fmin, all_of), "max": lambda *all_of: _folded(ca.fmax, all_of),
    }
)  # fmt: skip
TIME = "t"
# Where an inertia's sign is looked at: so many points, always the same ones.
POINTS = 5


def _folded(law: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    first, *others = arguments
    for one in others:
        first = law(first, one)
    return first


def _outside_of_functions(node: Node) -> Iterator[Node]:
    """The node and what is below it, but for what stands in a sine, a root ..."""
    yield node
    if isinstance(node, Operation) and node.name in ARITHMETIC:
        for part in node.parts:
            yield from _outside_of_functions(part)


class Equations:
    """Names, units and equations of one plant; `parameters`: nominal values, `scales`: usual sizes of states."""

    def __init__(
        self,
        path: object,
        coordinates: Mapping[str, str],
        states: Mapping[str, str],
        inputs: Mapping[str, str],
        parameters: Mapping[str, tuple[float, str]],
        texts: Mapping[str, str],
        scales: Mapping[str, float],
    ) -> None:
        """Mappings name -> unit text; `texts`: equation by coordinate or state."""
        self.path, self.scales = path, dict(scales)
        self.coordinates, self.first_order, self.inputs = tuple(coordinates), tuple(states), tuple(inputs)
        self.values = {name: number for name, (number, _) in parameters.items()}
        self._units = {**coordinates, **states, **inputs, **{name: unit for name, (_, unit) in parameters.items()}}
        self.states = (*(name for q in self.coordinates for name in (q, f"d{q}")), *self.first_order)
        self._sides = {name: self._parsed(name, texts[name]) for name in (*coordinates, *states)}
        self._mass, self._force = self._mechanics()
        self.acting = self._acting()
        self._rates = self._first_order_rates()

    # ------------------------------------------------------------------------------------------ what a plant needs

    @property
    def accelerations(self) -> Callable[[Point, Any], Any]:
        """q'' at a point under generalised forces."""
        function = self._acceleration_function
        return lambda s, force: function(*self._arguments(s), force)

    @property
    def rates(self) -> Callable[[Point], Any]:
        """x' of the first-order states at a point."""
        function = ca.Function("rates", list(self._symbols.values()), [self._rates])
        return lambda s: function(*self._arguments(s))

    def reading(self, key: str, text: str) -> tuple[str, Callable[[Point], Any], Unit | None]:
        """Of what a channel or an energy reads: the state where it is one, the law, the unit."""
        known = {**dict.fromkeys(self.values, 0), **dict.fromkeys(self.first_order, 0), TIME: 0}
        known |= dict.fromkeys(self.coordinates, 1)
        expression = self._guarded(key, lambda: _checked(parse_expression(text), known))
        unit = self._guarded(key, lambda: unit_of(expression, self._unit))
        x, _, p, t = self._symbols.values()
        law = ca.Function("reading", [x, p, t], [ca.SX(self._value(expression))])
        root = expression.root
        state = f"{'d' * root.primes}{root.name}" if isinstance(root, Name) else ""
        return state if state in self.states else "", lambda s: law(self._state(s), self._parameters(s), s.t), unit

    def energy(self, text: str) -> Callable[[Point], Any]:
        """The law of a stored energy, J."""
        _, law, unit = self.reading("energy", text)
        if unit is not None and not unit.same(ENERGY):
            raise InputError(self.path, "energy", f"must be in J, not in {unit}")
        return law

    @property
    def usual_force(self) -> float:
        """What acts on the first coordinate where all states have their usual sizes, or one."""
        if not self.coordinates:
            return 1.0
        force = ca.Function("force", list(self._symbols.values()), [ca.fabs(self._force[0])])
        size = float(force(*self._near[1]))
        return size if 0.0 < size < np.inf else 1.0

    def ratios(self, held: Collection[str]) -> dict[tuple[str, str], float]:
        """(q, other) -> r where both equations have a difference q - r other as a factor, the innermost, if it is no
        plain one; `held`: parameters that no fit moves, of which r may be made."""
        pairs = combinations(self.coordinates, 2)
        every = {pair: [self._differences(name, *pair, held) for name in pair] for pair in pairs}
        common = {pair: [r for r in one if any(isclose(r, s) for s in other)] for pair, (one, other) in every.items()}
        return {pair: found[0] for pair, found in common.items() if found and not isclose(found[0], 1.0)}

    def _differences(self, equation: str, q: str, other: str, held: Collection[str]) -> list[float]:
        """r of all q - r other in an equation, the innermost first."""
        found, p = [], ca.vertcat(*self.values.values())
        x = ca.vertcat(*(self._by_name[name, 0] for name in (q, other)))
        for side in self._sides[equation]:
            for node in _outside_of_functions(side.root):
                inside = {(part.name, part.primes) for part in parts_of(node) if isinstance(part, Name)}
                moving = {name for name in inside if name[0] not in held}
                if not isinstance(node, Operation) or node.name not in "+-" or moving != {(q, 0), (other, 0)}:
                    continue
                slopes = ca.jacobian(ca.SX(self._value(Expression(side.text, node))), x)
                if not ca.depends_on(slopes, self._symbols["x"]):
                    a, b = ca.Function("slopes", [self._symbols["p"]], [ca.densify(slopes)])(p).full().ravel()
                    found += [(node.depth, -b / a)] if a and b else []
        return [float(r) for _, r in sorted(found)]

    def viscous(self, coordinate: str) -> str | None:
        """The parameter b of a friction -b q' in a coordinate's equation, where that is all that q' does to it."""
        index = self.coordinates.index(coordinate)
        slope = -ca.jacobian(self._force[index], self._symbols["x"][2 * index + 1])
        names = [name for i, name in enumerate(self.values) if ca.is_equal(slope, self._symbols["p"][i], 2)]
        return names[0] if names else None

    # ------------------------------------------------------------------------------------------ parsing

    def _parsed(self, name: str, text: str) -> tuple[Expression, Expression]:
        known = {**dict.fromkeys(self.values, 0), **dict.fromkeys(self.inputs, 0), TIME: 0}
        known |= dict.fromkeys(self.coordinates, 2 if name in self.coordinates else 1)
        known |= {state: int(state == name) for state in self.first_order}
        key = f"equations.{name}"
        left, right = self._guarded(key, lambda: parse_equation(text))
        self._guarded(key, lambda: (_checked(left, known), _checked(right, known)))
        self._check_units(name, left, right)
        return left, right

    def _check_units(self, name: str, left: Expression, right: Expression) -> None:
        key = f"equations.{name}"
        one, other = self._guarded(key, lambda: (unit_of(left, self._unit), unit_of(right, self._unit)))
        if one is not None and other is not None and not one.same(other):
            wrong = right.error(right.root.at, f"this is in {other}, the left side in {one}")
            raise InputError(self.path, key, str(wrong))
        unit, own = one or other, self._unit_of_name(name)
        if name not in self.coordinates or unit is None or own is None:
            return
        if not (unit * own).same_kind(ENERGY):
            wanted = "N" if self._units[name] == "m" else "N m"
            reason = f"its sides are in {unit}: write inertia times acceleration = forces, in {wanted}"
            raise InputError(self.path, key, reason)

    def _unit(self, name: Name) -> Unit | None:
        unit = parse_unit("s") if name.name == TIME else self._unit_of_name(name.name)
        return None if unit is None else unit / parse_unit("s") ** name.primes

    def _unit_of_name(self, name: str) -> Unit | None:
        text = self._units[name]
        return parse_unit(text) if text else None

    def _guarded(self, key: str, work: Callable[[], Any]) -> Any:
        try:
            return work()
        except ExpressionError as error:
            raise InputError(self.path, key, str(error)) from None

    # ------------------------------------------------------------------------------------------ graphs

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        sizes = {"x": len(self.states), "u": len(self.inputs), "p": len(self.values), "t": 1}
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _highest(self) -> Any:
        return ca.SX.sym("a", len(self.coordinates)), ca.SX.sym("r", len(self.first_order))

    @cached_property
    def _by_name(self) -> dict[tuple[str, int], Any]:
        s, (accelerations, rates) = self._symbols, self._highest
        found = {(TIME, 0): s["t"]}
        found |= {(name, 0): s["u"][i] for i, name in enumerate(self.inputs)}
        found |= {(name, 0): s["p"][i] for i, name in enumerate(self.values)}
        for i, q in enumerate(self.coordinates):
            found |= {(q, 0): s["x"][2 * i], (q, 1): s["x"][2 * i + 1], (q, 2): accelerations[i]}
        for i, name in enumerate(self.first_order):
            found |= {(name, 0): s["x"][2 * len(self.coordinates) + i], (name, 1): rates[i]}
        return found

    def _value(self, expression: Expression) -> Any:
        return value(expression, lambda name, primes: self._by_name[name, primes], LAWS)

    def _residual(self, name: str) -> Any:
        left, right = self._sides[name]
        return ca.SX(self._value(left) - self._value(right))

    def _mechanics(self) -> tuple[Any, Any]:
        """M and f of M q'' = f; an equation whose own inertia is negative is turned round."""
        highest, _ = self._highest
        residual = ca.vertcat(ca.SX(0, 1), *(self._residual(q) for q in self.coordinates))
        mass = ca.jacobian(residual, highest)
        for i, q in enumerate(self.coordinates):
            if not mass.sparsity().has_nz(i, i):
                raise InputError(self.path, f"equations.{q}", f"{q}'' does not stand in it")
            self._check_linear(q, mass[i, :], highest)
        force = -ca.substitute(residual, highest, ca.SX.zeros(highest.numel()))
        at = [
            ca.Function("m", list(self._symbols.values()), [ca.diag(mass)])(*one).full().ravel() for one in self._near
        ]
        sign = ca.diag(ca.SX([self._sign(q, [one[i] for one in at]) for i, q in enumerate(self.coordinates)]))
        return ca.mtimes(sign, mass), ca.mtimes(sign, force)

    def _sign(self, q: str, inertia: list[float]) -> float:
        if not (np.all(np.array(inertia) > 0.0) or np.all(np.array(inertia) < 0.0)):
            reason = (
                f"the factor of {q}'' is no inertia: it must have one sign, not {min(inertia):g} to {max(inertia):g}"
            )
            raise InputError(self.path, f"equations.{q}", reason)
        return float(np.sign(inertia[0]))

    def _check_linear(self, name: str, factor: Any, highest: Any) -> None:
        if ca.depends_on(factor, highest):
            raise InputError(self.path, f"equations.{name}", "must be linear in the highest derivatives")

    def _acting(self) -> dict[str, str]:
        """Input -> the coordinate that it is a generalised force on: in one equation, with the factor 1."""
        found = {}
        for j, name in enumerate(self.inputs):
            inside = [
                e for e, sides in self._sides.items() if any(n.name == name for side in sides for n in names_in(side))
            ]
            if not inside:
                raise InputError(self.path, f"inputs.{name}", "stands in no equation")
            slope = ca.jacobian(self._force, self._symbols["u"][j])
            if len(inside) == 1 and inside[0] in self.coordinates and slope[self.coordinates.index(inside[0])].is_one():
                found[name] = inside[0]
        return found

    def _first_order_rates(self) -> Any:
        _, rates = self._highest
        found = [ca.SX(0, 1)]
        for i, name in enumerate(self.first_order):
            residual = self._residual(name)
            factor = ca.jacobian(residual, rates[i])
            if not factor.nnz():
                raise InputError(self.path, f"equations.{name}", f"{name}' does not stand in it")
            self._check_linear(name, factor, rates)
            found.append(-ca.substitute(residual, rates, ca.SX.zeros(rates.numel())) / factor)
        return ca.densify(ca.vertcat(*found))

    @cached_property
    def _acceleration_function(self) -> ca.Function:
        """(x, u, p, t, force) -> q'', the inputs that are generalised forces among `force`."""
        s, more = self._symbols, ca.SX.sym("force", len(self.coordinates))
        acting = ca.vertcat(*(0.0 if name in self.acting else s["u"][i] for i, name in enumerate(self.inputs)))
        force = (ca.substitute(self._force, s["u"], acting) if self.inputs else self._force) + more
        solved = {0: lambda: force, 1: lambda: force / self._mass}
        found = solved.get(len(self.coordinates), lambda: ca.solve(self._mass, force))()
        return ca.Function("accelerations", [*s.values(), more], [ca.densify(found)])

    def _arguments(self, s: Point) -> tuple[Any, ...]:
        return self._state(s), ca.vertcat(*(getattr(s, name) for name in self.inputs)), self._parameters(s), s.t

    def _state(self, s: Point) -> Any:
        return ca.vertcat(*(getattr(s, name) for name in self.states))

    def _parameters(self, s: Point) -> Any:
        return ca.vertcat(*(s.p[name] for name in self.values))

    @property
    def _near(self) -> list[tuple[Any, ...]]:
        """Arguments of the functions at some points around the usual sizes of the states, at the nominal values."""
        random, sizes = np.random.default_rng(0), np.array([self.scales.get(name, 1.0) for name in self.states])
        around = [np.zeros(len(sizes)), sizes, *(sizes * random.uniform(-1.0, 1.0, len(sizes)) for _ in range(POINTS))]
        return [(x, np.zeros(len(self.inputs)), np.array([*self.values.values()]), 0.0) for x in around]


def _checked(expression: Expression, known: Mapping[str, int]) -> Expression:
    check_names(expression, known)
    return expression
