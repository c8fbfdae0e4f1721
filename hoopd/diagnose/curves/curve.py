"""Curves: unknown forces, torque maps and sensor maps that depend on one variable, as effects made on the fly.

A curve adds g(s) sum_i c_i hat_i(x(s)) at a slot: x is the variable it depends on, g is 1 or, for a coefficient that
follows x (friction that changes with the angle, a gain that changes with the speed), the rate or the torque it
multiplies. Every c_i is an amplitude, so that screen, fit, free run and held-out test take a curve like any effect.

Rules of this file: slots, states and channels come from the declared plant, no name of a hoop stands here; knots come
from the fit's smoothed reference.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve_sites import CurveVariable, Factor, Site, Wanted, reads, wanted
from hoopd.diagnose.curves.hats import curve_expression, spread_knots, turn_knots
from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, EffectParameter, Point
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Knots of a coarse and a fine curve: a smooth law needs few columns, a local one (a detent) needs narrow hats.
COARSE, FINE = 6, 16
TURN_COARSE, TURN_FINE = 8, 20
# Of a curve over time, one knot in so many seconds: slower than any disturbance's correlation time.
SECONDS_A_KNOT = 3.0
# ... and at most so many: columns of a recording of ten minutes would fill the memory.
MOST_OVER_TIME = 40
# Fewer knots than this are a line, which the base's parameters are already.
FEWEST = 3
# Maps of the torque: after dead zone and limits, with ripple and gain (`effects.base`).
TORQUE_ORDER = 3


@dataclass(frozen=True)
class UnnamedCurve:
    """One curve; amplitudes are the values at its knots, or with a `basis` (m, k) those of its columns."""

    site: Site
    variable: CurveVariable
    knots: Array
    factor: Factor | None = None
    per_recording: bool = False
    basis: Array | None = None
    reads: tuple[str, ...] = ()  # coordinates that its variable and its factor are made of

    @property
    def slot(self) -> str:
        """Where it sits."""
        return self.site.slot

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variable, and what it multiplies."""
        return (self.variable.name,) if self.factor is None else (self.factor.name, self.variable.name)

    @property
    def place(self) -> tuple[str, ...]:
        """Slot, way of acting, variables and the channels of a reading: equal for curves of one kind."""
        channels = self.site.on if self.site.acts == "reading" else ()
        return (self.slot, self.site.acts, *self.depends_on, *channels)

    @property
    def unit(self) -> str:
        """Of the values at the knots."""
        return self.site.unit if self.factor is None else f"{self.site.unit} / ({self.factor.unit})"

    @cached_property
    def name(self) -> str:
        """Of its effect; equal for equal curves only."""
        parts = [self.knots.tobytes(), b"" if self.basis is None else self.basis.tobytes()]
        parts += [repr((self.site, self.variable[:2], self.variable.period, self.per_recording)).encode()]
        mark = hashlib.sha256(b"|".join(parts)).hexdigest()[:8]
        return f"{self.slot}.curve_{'_'.join(self.depends_on)}_{mark}"

    @cached_property
    def effect(self) -> Effect:
        """The curve as an effect."""
        acts: dict[str, dict[str, Any]] = {
            "force": {"force": lambda s, e: self._spread(self._value(s, e))},
            "torque": {"torque": lambda s, e: s.u + self._value(s, e), "order": TORQUE_ORDER},
            "reading": {"sensor": lambda s, e: self._spread(self._value(s, e))},
        }
        count = len(self.knots) if self.basis is None else self.basis.shape[1]
        return Effect(
            self.name,
            tuple(self._parameter(i) for i in range(count)),
            **acts[self.site.acts],
            depends_on=self.depends_on,
            needs=self.reads,
            statement=f"a force or error that follows {' and '.join(self.depends_on)}, by no law of the library",
        )

    def _parameter(self, index: int) -> EffectParameter:
        unit, size = (self.unit, 0.01) if self.basis is None else ("-", 1.0)
        return EffectParameter(
            f"c{index}", unit, 0.0, -1e4 * size, 1e4 * size, grid=(size,), per_recording=self.per_recording
        )

    def _value(self, s: Point, e: Any) -> Any:
        amplitudes = ca.vertcat(*(getattr(e, f"c{i}") for i in range(len(e.__dict__))))
        values = amplitudes if self.basis is None else ca.mtimes(ca.DM(self.basis), amplitudes)
        found = curve_expression(self.variable.of(s), self.knots, values, self.variable.period)
        return found if self.factor is None else found * self.factor.of(s)

    def _spread(self, value: Any) -> dict[str, Any]:
        return {name: weight * value for name, weight in self.site.on.items()}

    def with_basis(self, basis: Array) -> UnnamedCurve:
        """The same with the columns of a basis (m, k) for amplitudes."""
        return replace(self, basis=basis)

    def fits(self, plant: Plant) -> bool:
        """Whether a plant has its slot, and what it is made of moves there."""
        return self.effect.fits(plant)


def curves(fit: HypothesisFit) -> list[UnnamedCurve]:
    """All that the slots of the plants suggest, of those in which most moves first; knots from the reference."""
    found: dict[tuple[str, ...], list[UnnamedCurve]] = {}
    for plant in sorted(_plants(fit), key=lambda one: -len(one.coordinates)):
        for want in wanted(plant):
            made = _made(want, plant, fit)
            if made:
                found.setdefault((*made[0].place, str(want[1].period)), made)
    return [curve for made in found.values() for curve in made]


def _plants(fit: HypothesisFit) -> list[Plant]:
    return list({track.stretch.plant.coordinates: track.stretch.plant for track in fit.tracks}.values())


def _made(want: Wanted, plant: Plant, fit: HypothesisFit) -> list[UnnamedCurve]:
    """Coarse and fine, for all recordings and for each by itself."""
    site, variable, factor = want
    first = UnnamedCurve(site, variable, np.zeros(1), factor, reads=reads(want, plant))
    tracks = [track for track in fit.tracks if first.fits(track.stretch.plant)]
    several = len({track.stretch.recording for track in tracks}) > 1
    x = np.concatenate([np.ravel(variable.of(at_nodes(track, fit))) for track in tracks])
    own = (False, True) if several and variable.own_zero else (several and variable.name == "t",)
    return [
        replace(first, knots=knots, per_recording=per_recording)
        for knots in _knot_sets(variable, x, motion_scale(plant)) for per_recording in own
    ]  # fmt: skip


def _knot_sets(variable: CurveVariable, x: Array, slower: float = 1.0) -> list[Array]:
    if variable.name == "t":
        count = min(max(4, 1 + round(float(np.ptp(x)) / (SECONDS_A_KNOT * slower))), MOST_OVER_TIME)
        found = [np.linspace(x.min(), x.max(), count)]
    elif variable.period is not None:
        found = [turn_knots(count, variable.period) for count in (TURN_COARSE, TURN_FINE)]
    else:
        found = [spread_knots(x, count) for count in (COARSE, FINE)]
    return [knots for i, knots in enumerate(found) if len(knots) >= FEWEST and (i == 0 or len(knots) > len(found[0]))]
