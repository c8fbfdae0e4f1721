"""What an effect is: a physical mechanism that a model may leave out, declared once for simulator, filter and search.

An effect sits at a slot of the plant and acts in one or more of these ways, in the order of the signal path:

    delay, torque (a static map of the demanded torque, by `order`), lag  ->  force, friction, shift  ->
    sensor (a map of a reading), latency, sensor_lag

Its functions get the point of the plant (`s.theta`, `s.dtheta`, `s.u`, `s.t`, `s.p["mb"]` ...) and the effect's own
parameters (`e.Fc`), all CasADi symbols; `plants.plant_with_effects` puts any set of them together with the plant.

Rules of this file: declarations only; nothing here knows a plant or a search.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isclose, pi
from types import SimpleNamespace
from typing import Any

# Parameters of an effect by their names.
Values = SimpleNamespace
# How a parameter enters: proportionally; as the phase of an amplitude; not proportionally (tried on its grid).
ROLES = ("amplitude", "phase", "shape")
# A range holds what is usual; where a recording asks for more, its end moves out by this once: room for a device that
# is several times as bad as others, not for a number of another order, which no longer is this effect.
WIDER = 4.0
# As near as this to an end, as a share of its size, is on it.
ON_END = 1e-9


class Point:
    """Named view of where the plant is: states and inputs by name, `u` (first input), `t` (s), parameters `p`.

    `demand` is the first input as demanded; where effects of its drive have changed it, `u` is what they made of it.
    `leant` is what a frame that leans adds to coordinates as gravity sees them, `shaken` the acceleration (m/s2) across
    of one that shakes.
    """

    def __init__(
        self, names: Mapping[str, Any], p: Mapping[str, Any], u: Any = 0.0, t: Any = 0.0, first_input: str = ""
    ) -> None:
        """`first_input`: the name under which `names` has `u`, too."""
        self._names, self.p, self.u, self.t, self._first_input = dict(names), p, u, t, first_input
        self.demand = u
        self.leant: dict[str, Any] = {}
        self.shaken: Any = None

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["_names"][name]
        except KeyError:
            raise AttributeError(f"the plant has no {name!r}: it has {', '.join(self.__dict__['_names'])}") from None

    def __contains__(self, name: str) -> bool:
        return name in self._names

    def replaced(self, u: Any = None, **names: Any) -> Point:
        """The same point with some names changed."""
        if u is not None and self._first_input:
            names = {self._first_input: u, **names}
        found = Point({**self._names, **names}, self.p, self.u if u is None else u, self.t, self._first_input)
        found.demand, found.leant, found.shaken = self.demand, self.leant, self.shaken
        return found

    def to_gravity(self, q: str) -> Any:
        """A coordinate as gravity sees it."""
        return getattr(self, q) + self.leant[q] if q in self.leant else getattr(self, q)

    def in_frame(self, effects: Sequence[Effect], p: Mapping[str, Any]) -> Point:
        """The same point in a frame that effects lean and shake."""
        leant: dict[str, Any] = {}
        shaken = None
        for effect in effects:
            if effect.shift is not None:
                for q, added in effect.shift(self, effect.values(p)).items():
                    leant[q] = leant[q] + added if q in leant else added
            if effect.shaking is not None:
                across = effect.shaking(self, effect.values(p))
                shaken = across if shaken is None else shaken + across
        found = self.replaced()
        found.leant, found.shaken = leant, shaken
        return found


@dataclass(frozen=True)
class EffectParameter:
    """A number of an effect: its unit, the value at which the effect vanishes, its range and how it enters."""

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    role: str = "amplitude"
    grid: tuple[float, ...] = ()  # what a search tries; of an amplitude, its usual size alone
    per_recording: bool = False  # a phase or a time that no other recording shares
    discrete: bool = False  # only the values of the grid make sense: never refined between them
    # of a limit: its value that the plant just touches at a point, so that a search tries those that the data reach
    touched: Callable[[Point], Any] | None = None
    # what it can be at all, beside the sign that its range keeps: a wider range stays inside
    least: float = -inf
    most: float = inf
    usual: tuple[float, float] | None = None  # its range before it was widened

    def __post_init__(self) -> None:
        if self.role not in ROLES or not self.low <= self.high:
            raise ValueError(f"{self.name}: role {self.role!r}, range {self.low} to {self.high}")

    @property
    def size(self) -> float:
        """Usual distance from neutral: first of the grid, else a tenth of the range."""
        low, high = self.usual or (self.low, self.high)
        return self.grid[0] if self.grid else (high - max(low, 0.0)) / 10.0

    def widened(self, value: float) -> EffectParameter:
        """With the end of its range that a value has reached further out; itself where it stays or may not, or was."""
        if self.usual is not None or value == self.neutral or not self.has_range:
            return self
        low, high = self.low, self.high
        if value <= low or isclose(value, low, rel_tol=ON_END):
            low = max(self.least, _outwards(low, -1.0))
        if value >= high or isclose(value, high, rel_tol=ON_END):
            high = min(self.most, _outwards(high, 1.0))
        if (low, high) == (self.low, self.high):
            return self
        return replace(self, low=low, high=high, usual=(self.low, self.high))

    @property
    def has_range(self) -> bool:
        """Whether its range is one of usual sizes: a phase goes round, a choice is one of its grid, a share is 0..1."""
        is_share = self.unit == "-" and (self.low, self.high) == (0.0, 1.0)
        return self.role != "phase" and not self.discrete and not is_share

    @property
    def widest(self) -> tuple[float, float]:
        """Its range with both ends out."""
        return self.widened(self.low).low, self.widened(self.high).high


def _outwards(end: float, sign: float) -> float:
    """An end of a range further out, on the same side of zero."""
    return end * WIDER if end * sign > 0.0 else end / WIDER


def geometric(low: float, high: float, count: int) -> tuple[float, ...]:
    """A grid of so many values from low to high in equal ratios, to three digits."""
    ratio = (high / low) ** (1.0 / (count - 1))
    return tuple(float(f"{low * ratio**i:.3g}") for i in range(count))


def phase(name: str = "phi", *, per_recording: bool = False) -> EffectParameter:
    """The phase of a periodic effect, rad."""
    return EffectParameter(name, "rad", 0.0, -pi, pi, "phase", per_recording=per_recording)


@dataclass(frozen=True)
class DryFriction:
    """A friction that opposes a rate and sticks exactly: |f| <= level, along a direction of the generalised forces.

    The rate is sum(along[q] q'); the friction f along it is the one that stops it, clipped to the level. Of a contact
    that the plant's accelerations hold already, `needed` is the force that holds it: the sum of both is clipped.
    """

    level: Callable[[Point, Values], Any]  # N m (of a coordinate in m: N), never negative
    along: Callable[[Point], Mapping[str, Any]]
    needed: Callable[[Point, Mapping[str, Any]], Any] | None = None  # from the accelerations by coordinate


@dataclass(frozen=True)
class Effect:
    """One effect; see the head of the file."""

    name: str  # slot.effect
    parameters: tuple[EffectParameter, ...]
    delay: str | None = None  # the parameter (s) by which the demanded torque is late
    torque: Callable[[Point, Values], Any] | None = None  # s.u -> torque
    undo: Callable[[Point, Values], Any] | None = None  # the inverse of that map: s.u wanted -> torque to demand
    order: int = 0  # among the maps of the torque: dead zone 1, limits 2, ripple and gain 3, bias and cogging 4
    lag: str | None = None  # the parameter (s) of T tau' = u - tau
    force: Callable[[Point, Values], Mapping[str, Any]] | None = None  # generalised forces by coordinate
    friction: DryFriction | None = None
    shift: Callable[[Point, Values], Mapping[str, Any]] | None = None  # added to a coordinate as gravity sees it
    # of a force by which the frame moves: the acceleration (m/s2) across that everything in it feels
    shaking: Callable[[Point, Values], Any] | None = None
    plant: Callable[[Any], Any] | None = None  # another plant in its place (one with a state more)
    flight: Callable[[Any], Any] | None = None  # the plant while its contact is lost
    free_run: Callable[..., Any] | None = None  # in place of `FreeRun`, where it changes modes
    sensor: Callable[[Point, Values], Mapping[str, Any]] | None = None  # added to the readings, by channel
    latency: Mapping[str, str] = field(default_factory=dict)  # channel -> the parameter (s)
    sensor_lag: Mapping[str, str] = field(default_factory=dict)  # channel -> the parameter (s)
    substeps: int = 0  # at least so many integration steps between two nodes (20 ms); 0: no wish
    # screen, scan (a search of its own), quality (from the recording alone), base (parameters), switch (on or off)
    found_by: str = "screen"
    as_parameters: bool = False  # where a plant's parameters are free they may do the same
    depends_on: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()  # coordinates without which a plant cannot have it, beside those of its slot
    contains: tuple[str, ...] = ()  # simpler effects that are a case of this one
    same_as: tuple[str, ...] = ()  # never told apart
    near: tuple[str, ...] = ()  # told apart by rich data only
    statement: str = ""  # what it is, in plain words
    signature: str = ""  # what gives it away
    sign: str = ""  # the rule its parameters obey
    best_experiment: str = ""
    write_back: str = ""
    formula: str = ""  # its law, as a page shows it
    cost_nats: float = 0.0  # evidence that it costs beside the names of the library: what takes longer to say

    @property
    def slot(self) -> str:
        """Where it sits."""
        return self.name.split(".")[0]

    def fits(self, plant: Any) -> bool:
        """Whether a declared plant has its slot, and what it needs."""
        return self.slot in plant.slots and all(q in plant.coordinates for q in self.needs)

    @property
    def is_simulated(self) -> bool:
        """Whether a free run has it: faults of single samples are counted, a lost contact is no smooth map."""
        return self.found_by not in ("quality", "switch")

    @property
    def acts_now(self) -> bool:
        """A force, a friction, a map of the torque or a lean that depends on the state, and on nothing else."""
        acts = self.force or self.friction or self.torque or self.shift
        return acts is not None and self.plant is None and "t" not in self.depends_on

    def neutral(self) -> dict[str, float]:
        """Parameters at which it vanishes."""
        return {one.name: one.neutral for one in self.parameters}

    def holding(self, values: Mapping[str, float]) -> Effect:
        """With every range widened that values of a whole model have reached the end of; itself where there is none."""
        keys = {one.name: self.key(one.name) for one in self.parameters if not one.per_recording}
        every = tuple(
            one.widened(values[keys[one.name]]) if keys.get(one.name) in values else one for one in self.parameters
        )
        return self if every == self.parameters else replace(self, parameters=every)

    def key(self, parameter: str) -> str:
        """Name of a parameter among those of a whole model."""
        return f"{self.name}.{parameter}"

    def values(self, everything: Mapping[str, Any]) -> Values:
        """Its own parameters from those of a whole model; the neutral ones where there is none."""
        return Values(**{one.name: everything.get(self.key(one.name), one.neutral) for one in self.parameters})

    def parameter(self, name: str) -> EffectParameter:
        """One by its name; KeyError."""
        for one in self.parameters:
            if one.name == name:
                return one
        raise KeyError(f"{self.name} has no parameter {name!r}")


def ranges_of(effects: Iterable[Effect]) -> dict[str, tuple[float, float]]:
    """Least and largest value of each parameter, by a whole model's names; phases go round."""
    return {e.key(p.name): (p.low, p.high) for e in effects for p in e.parameters if p.role != "phase"}


NO_LIMIT = inf
