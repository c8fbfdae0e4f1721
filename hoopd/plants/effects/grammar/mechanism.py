"""A mechanism: a site, a variable, a shape or a memory, and what the whole multiplies, as an effect like all others.

    force, torque or reading += A shape(v) [factor]           `hoop.threshold_of_dtheta`, `actuator.square_of_t_on_u`
    force, torque or reading += A memory(v) [factor]          `ball.dahl_of_psi`, `actuator.heat_of_u_squared_on_u`

What takes energy from a motion has an amplitude that is not negative.

Rules of this file: laws come from `shapes` and `memories`; which there are says `mechanisms`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor, inf, log10
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.files.dimensions import product_text
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import DryFriction, Effect, EffectParameter, Point, phase
from hoopd.plants.effects.grammar.axes import TIME, Axis
from hoopd.plants.effects.grammar.memory_law import PARTS, MemoryLaw
from hoopd.plants.effects.grammar.shapes import ALWAYS, BEGAN, WAVE, ShapeLaw
from hoopd.plants.scales import usual_sizes

Array = NDArray[np.float64]

# Ways of acting.
FORCE, TORQUE, READING = "force", "torque", "reading"
# Of the demanded torque: after dead zone and limits, with ripple and gain.
TORQUE_ORDER = 3
# A memory follows its variable within a substep: so many are at least taken in a usual sample time.
MEMORY_SUBSTEPS = PARTS
# Usual size of a memory where a recording begins: known to be none.
NOTHING = 1e-6
# Its constants are looked for so far beyond those that a screen tries: further off the law is its own limit there.
BEYOND_TRIED = 10.0
# Shares of the least way of a memory that a reading's is tried at, too.
FINER, WAYS = (0.1, 0.3), ("dahl", "play")
# Shapes whose v0 is a place, with either sign.
PLACED = ("above", "below", "well", "detent", "bent", "lens", "step", "change")
# Each constant of a law costs evidence; a textbook's law costs what it is rarer than a library's name, one to seven.
NATS_A_CONSTANT, TEXTBOOK_COST_NATS = 1.5, 2.0


@dataclass(frozen=True)
class ActingPlace:
    """Where a mechanism acts: its slot, the way, and with which weight on which coordinate or channel."""

    slot: str
    acts: str
    on: Mapping[str, float]
    unit: str
    words: str = "a force"


@dataclass(frozen=True)
class Mechanism:
    """One law of the grammar.

    Attributes
    ----------
    site : ActingPlace
        Where it acts.
    axis : Axis
        The variable.
    shape : ShapeLaw, optional
        How it follows the variable; None where a memory does.
    memory : MemoryLaw, optional
        What it remembers of the variable.
    factor : Axis, optional
        What the whole multiplies.
    dissipates : bool
        It takes energy away: -A with A >= 0.
    dry : Axis, optional
        The rate that it opposes as dry friction, whose level it is; it sticks exactly.
    way : int
        Of dry friction, the only sign of the rate that it opposes; 0: both.
    textbook : bool
        A law that textbooks have for such a place: it is rarer than a library's name, whatever its constants.
    shortest_s : float
        No time of a memory is shorter in the plant that it is of.
    """

    site: ActingPlace
    axis: Axis
    shape: ShapeLaw | None = None
    memory: MemoryLaw | None = None
    factor: Axis | None = None
    dissipates: bool = False
    dry: Axis | None = None
    way: int = 0
    textbook: bool = False
    shortest_s: float = 0.0

    @property
    def _law(self) -> ShapeLaw | MemoryLaw:
        found = self.shape or self.memory
        assert found is not None
        return found

    @cached_property
    def name(self) -> str:
        """`slot.law_of_variable`, with `_on_factor` where it multiplies something."""
        sides = {0: "sign", 1: "forward", -1: "backward"}
        more = f"_on_{sides[self.way]}_{self.dry.name}" if self.dry else ""
        more = f"_on_{self.factor.name}" if self.factor else more
        channel = f"_in_{next(iter(self.site.on))}" if self.site.acts == READING and len(self.site.on) == 1 else ""
        return f"{self.site.slot}.{self._law.name}_of_{self.axis.name}{more}{channel}".lower()

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of those that are not proportional."""
        if self.shape is not None:
            return self.shape.constants
        assert self.memory is not None
        return tuple(name for name in (self.memory.constant, self.memory.second) if name)

    @property
    def formula(self) -> str:
        """With its amplitude, as a page shows it."""
        text = self._law.text.format(v=self.axis.text)
        law, _, where = text.partition(", ")
        times = f" {self.factor.text}" if self.factor else self._side
        sign = "-A" if self.dissipates else "A"
        body = f"{sign}{times} {law}" if law else f"{sign}{times}"
        return f"{body}, {where}" if where else body

    @property
    def _side(self) -> str:
        """Of dry friction, what its level is multiplied with."""
        if self.dry is None:
            return ""
        return {0: f" sign({self.dry.text})", 1: f" [{self.dry.text} > 0]", -1: f" [{self.dry.text} < 0] (-1)"}[
            self.way
        ]

    def side_of(self, rate: Array) -> Array:
        """(...,) of rates, the direction of dry friction: 0 where it opposes nothing."""
        found = np.sign(rate)
        return found if not self.way else np.where(found == self.way, found, 0.0)

    @property
    def unit(self) -> str:
        """Of the amplitude."""
        power = self.shape.power if self.shape is not None else int(bool(self.memory and self.memory.scaled))
        parts = [(self.site.unit, 1), (self.axis.unit, -int(power))]
        parts += [(self.factor.unit, -1)] if self.factor else []
        parts += [("s", 1)] if self.memory and self.memory.is_rate else []
        return product_text(*parts) + (f"/sqrt({self.axis.unit})" if power % 1 else "")

    def grid(self, v: Array, t: Array) -> list[dict[str, float]]:
        """Constants that a search tries, from samples v (n,) at t (n,)."""
        if self.shape is not None:
            return [dict(one) for one in self.shape.grid(self.axis, v)]
        assert self.memory is not None
        first, second, every = self.memory.constant, self.memory.second, self.memory.grid(v, t)
        if self.site.acts == READING and every and self.memory.name in WAYS:
            # a sensor shows what is far too small to move anything
            every = [*(share * min(every) for share in FINER), *every]
        if not second:
            return [{first: float(one)} for one in every]
        h = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        beside = self.memory.seconds(h)
        return [{first: float(one), second: value} for value, onward in beside for one in every[::onward]]

    def along(self, v: Array, way: Array, t: Array, constants: Mapping[str, float]) -> Array:
        """What is multiplied with amplitude and factor at samples, (n,); of a wave at phase zero."""
        if self.shape is not None:
            found = np.asarray(self.shape.of(np, v, constants))
        else:
            assert self.memory is not None
            found = self.memory.along(v, way, t, self._told(np, constants))
        return found if self.dry is None else np.maximum(found, 0.0)

    def screened(self, v: Array, t: Array, constants: Mapping[str, float]) -> Array:
        """(n,) the same as a screen takes it: of what has a phase, the sine that it begins with."""
        phased = self.shape is not None and self.shape.phased
        return np.sin(constants["n"] * v + constants["phi"]) if phased else self.along(v, v, t, constants)

    @property
    def sign(self) -> float:
        """Of the amplitude in the law."""
        return -1.0 if self.dissipates else 1.0

    # ------------------------------------------------------------------------------------------ the effect

    @cached_property
    def effect(self) -> Effect:
        """As an effect."""
        acts: dict[str, dict[str, Any]] = {
            FORCE: {"force": lambda s, e: self._spread(self._value(s, e))},
            TORQUE: {"torque": lambda s, e: s.u + self._value(s, e), "order": TORQUE_ORDER},
            READING: {"sensor": lambda s, e: self._spread(self._value(s, e))},
        }
        if self.dry is not None:
            acts[FORCE] = {"friction": DryFriction(self._level, lambda s: dict(self.site.on))}
        follows = [one.name for one in (self.axis, self.factor, self.dry) if one is not None]
        if self.shape is not None and self.shape.lasts and len(follows) > 1:
            follows = follows[1:]  # when it began is past: what it follows since is the rest
        return Effect(
            self.name,
            tuple(self._parameters()),
            **acts[self.site.acts],
            plant=self._with_memory if self.memory is not None else None,
            substeps=MEMORY_SUBSTEPS if self.memory is not None else 0,
            depends_on=tuple(follows),
            needs=tuple(dict.fromkeys(q for one in (self.axis, self.factor, self.dry) if one for q in one.coordinates)),
            statement=self.sentence,
            sign="A >= 0: it takes energy away" if self.dissipates else "either sign",
            write_back="feed forward the formula where its variable is known; the estimator knows it",
            best_experiment=self._best_experiment,
            formula=self.formula,
            cost_nats=TEXTBOOK_COST_NATS if self.textbook else NATS_A_CONSTANT * len(self.constants),
        )

    @property
    def _best_experiment(self) -> str:
        """What shows the law: all values of what it follows, or a long run."""
        each = [one for one in (self.axis, self.factor, self.dry) if one is not None]
        if any(one.kind == TIME for one in each):
            return "a long run with the same signal again and again"
        words = list(dict.fromkeys(one.words for one in each))
        return f"{' and '.join(words)} over all that {'they' if len(words) > 1 else 'it'} can be"

    def effect_near(self, tried: Sequence[Mapping[str, float]]) -> Effect:
        """As an effect whose constants lie about those that a screen of some recordings has tried."""
        found = {name: [one[name] for one in tried] for name in self.constants}
        own = tuple(_about(p, found[p.name]) if found.get(p.name) else p for p in self.effect.parameters)
        return replace(self.effect, parameters=own)

    @property
    def sentence(self) -> str:
        """In plain words."""
        if self.dry is not None:
            side = {0: "", 1: " against forward motion alone", -1: " against backward motion alone"}[self.way]
            return f"dry friction{side} whose level {self._law.words} {self.axis.words}"
        kind = "an error of the reading" if self.site.acts == READING else self.site.words
        times = f" in proportion to {self.factor.words}, with a factor" if self.factor is not None else ""
        return f"{kind}{times} that {self._law.words} {self.axis.words}"

    def _parameters(self) -> Iterator[EffectParameter]:
        low = 0.0 if self.dissipates or (self.shape is not None and self.shape.name == WAVE.name) else -inf
        yield EffectParameter("A", self.unit, 0.0, low, inf, grid=(1.0,))
        for name in self.constants:
            place = self.shape is not None and name == "v0" and self.shape.name in PLACED
            whole = name == "n" and self.axis.turning and not self.axis.scale_share
            whole = whole or (self.memory is not None and (self.memory.is_led or self.memory.is_chosen))
            unit = self._unit_of(name)
            yield EffectParameter(name, unit, 1.0, -inf if place else 1e-9, inf, "shape", (1.0,), discrete=whole)
        if self.shape is not None and self.shape.lasts:
            # where nobody says when it began, it has
            yield EffectParameter(BEGAN, "s", ALWAYS, -ALWAYS, ALWAYS, "shape", per_recording=True, discrete=True)
        if self.shape is not None and self.shape.phased:
            yield phase(per_recording=self.axis.turning or self.axis.kind == TIME)

    def _unit_of(self, name: str) -> str:
        if self.memory is not None:
            return {"zeta": "-", "w": "rad/s"}.get(name) or self.memory.unit(self.axis)
        if name == "e":
            return "-"
        if name == "n":
            return "-" if self.axis.turning else product_text(("rad", 1), (self.axis.unit, -1))
        return self.axis.unit

    def _spread(self, value: Any) -> dict[str, Any]:
        return {name: weight * value for name, weight in self.site.on.items()}

    def _law_at(self, s: Point, e: Any) -> Any:
        v = self.axis.of(s)
        if self.shape is not None:
            return self.shape.of(ca, v, e.__dict__)
        assert self.memory is not None
        # where the plant is without the memory it is at rest
        states = [getattr(s, name) if name in s else 0.0 for name in self._states]
        return self.memory.value(ca, states, v, self._told(ca, e.__dict__))

    def _told(self, ops: Any, constants: Mapping[str, Any]) -> Mapping[str, Any]:
        """Of what is divided by its own time, no shorter a time than its states have."""
        if self.memory is None or not self.memory.is_rate:
            return constants
        return {**constants, "T": ops.fmax(constants["T"], self.shortest_s)}

    def _level(self, s: Point, e: Any) -> Any:
        level = e.A * ca.fmax(self._law_at(s, e), 0.0)
        return level * (1.0 + ca.sign(self.way * self.dry.of(s))) / 2.0 if self.dry is not None and self.way else level

    def _value(self, s: Point, e: Any) -> Any:
        found = self.sign * e.A * self._law_at(s, e)
        return found if self.factor is None else found * self.factor.of(s)

    @property
    def _states(self) -> tuple[str, ...]:
        assert self.memory is not None
        stem = self.name.replace(".", "_")
        return tuple(f"{stem}_z{i}" for i in range(self.memory.states))

    def _with_memory(self, plant: Plant) -> Plant:
        """The plant with the memory's states as its last ones."""
        memory, names = self.memory, self._states
        assert memory is not None
        constants, shortest = self.constants, shortest_time_s(plant)

        def rates(s: Point) -> Any:
            own = {name: s.p[f"{self.name}.{name}"] for name in constants}
            v, dv = self.axis.of(s), self.axis.rate(s) if self.axis.rate is not None else 0.0
            found = memory.rates(ca, [getattr(s, name) for name in names], v, dv, own, shortest)
            return ca.vertcat(plant.rates(s), *found)

        sizes, begins = dict.fromkeys(names, NOTHING), dict.fromkeys(names, "")
        if memory.is_body:
            begins[names[-1]] = self.axis.name
        if memory.is_body and not memory.is_led:
            # nobody knows how it swings there; of every other memory, that there is nothing to remember
            usual = usual_sizes(plant)
            sizes = dict(zip(names, (usual[one] for one in (*self.axis.coordinates, self.axis.name)), strict=True))
        return replace(
            plant, first_order=(*plant.first_order, *names), rates=rates, scales={**plant.scales, **sizes},
            remembered={**plant.remembered, **begins}, led=(*plant.led, *(names if memory.is_led else ())),
        )  # fmt: skip


def shortest_time_s(plant: Plant) -> float:
    """As short a time as a memory's states can follow."""
    return plant.time_scale_s / MEMORY_SUBSTEPS


def _about(parameter: EffectParameter, tried: Sequence[float]) -> EffectParameter:
    """With a range of whole decades about values that are positive; a place, and a number of waves a turn, as it is."""
    if parameter.discrete or parameter.low < 0.0 or min(tried) <= 0.0:
        return parameter
    # equal for grids that differ little: models are built once for equal effects
    low, high = floor(log10(min(tried) / BEYOND_TRIED)), ceil(log10(max(tried) * BEYOND_TRIED))
    return replace(parameter, low=10.0**low, high=10.0**high)
