"""The modes of a ball that may leave the hoop, as the filter needs them: from the declaration that the rig moves by.

A ball in the air is followed in its direction and distance alone: one that passes the axis is lost, as the rig's is not
(`effects.flight_motion`), and begun anew with the next pictures.

Rules of this file: guards and resets are those of `effects.contact_modes`, derivatives are exact; no equation is
written here. Functions are small and made with the filter: the tick waits for none.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.core.ball_modes import BallMode, BallModes, Passage
from hoopd.core.estimator import Step
from hoopd.plants.compiled import Call
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.contact_modes import AIR, INNER, ROLLING, ContactModes, on_track
from hoopd.plants.hoop.effects.inner_hoop import INNER_HOOP, RADIUS, inner_normal_force, inner_track
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.effects.normal_force import signed_normal_force
from hoopd.plants.hybrid_plant import Transition
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# Models whose functions are kept.
KEPT = 8
# Effects that say what becomes of a ball off its track.
OFF_TRACK = (LIFT_OFF, INNER_HOOP)
# Width (rad/s) of the smooth form of dry friction in the rates on both sides of a passage.
FRICTION_WIDTH = 0.5
# Of what a touch changes in the rates along the hoop, the deviation of what it really does: from a touch without grip
# to one after which the ball rolls at once.
UNKNOWN_SHARE = 0.5
# A guard that rises is not due: a ball that measurements place beyond its track and that moves inwards flies on.
RISING_S = 1e-3
# A passage that hardly crosses its guard has no time of its own.
LEAST_RATE = 1e-9
# No effect of a filter's follows the time.
UNTIMED = 0.0


def ball_modes(found: FoundEffects, inside: FoundEffects, rolling: Step) -> BallModes:
    """Modes of the filter's ball.

    Parameters
    ----------
    found : FoundEffects
        The model with its effects; `ball.lift_off` tells restitution and grip, where it is one of them.
    inside : FoundEffects
        Those that the filter's model has.
    rolling : callable
        The filter's own step of the rolling ball.
    """
    told = {LIFT_OFF: FoundEffect(LIFT_OFF, {})}
    told |= {one.name: one for one in found.entries if one.name in OFF_TRACK}
    entries = (*(one for one in inside.entries if one.name not in told), *told.values())
    numbers = tuple((one.name, tuple(one.parameters.items())) for one in entries)
    made = copy.deepcopy(_made(inside.structure, tuple(inside.base.items()), numbers, inside.limit_nm))
    return replace(made, modes={**made.modes, ROLLING: replace(made.modes[ROLLING], step=rolling)})


Numbers = tuple[tuple[str, float], ...]


@lru_cache(maxsize=KEPT)
def _made(structure: str, base: Numbers, entries: tuple[tuple[str, Numbers], ...], limit_nm: float) -> BallModes:
    """Of the same numbers they are written out once; who uses them copies them: buffers are of one filter."""
    found = tuple(FoundEffect(name, dict(numbers)) for name, numbers in entries)
    return _Made(FoundEffects(structure, dict(base), found, limit_nm)).modes()


class _Made:
    """Functions of a model's numbers."""

    def __init__(self, flying: FoundEffects) -> None:
        self._values = flying.values
        self._contact = ContactModes(flying.plant, flying.effects())
        self._composites = self._contact.hybrid.modes
        self._p = ca.SX(self._contact.rolling.vector(self._values))
        self._named = {name: self._p[k] for k, name in enumerate(self._contact.rolling.names)}

    def modes(self) -> BallModes:
        """All of them."""
        of, v = self._contact.hybrid.of, self._values
        made = {name: self._mode(name) for name in self._composites}
        tracks = {ROLLING: v["Ro"] - v["Rb"], **({INNER: v[RADIUS] + v["Rb"]} if INNER in made else {})}
        landing = next(one for one in of(AIR) if one.target == ROLLING)
        return BallModes(made, tracks, self._jump(of(ROLLING)[0], timed=False), self._jump(landing, timed=False))

    def _mode(self, name: str) -> BallMode:
        c = self._composites[name]
        step = NumericPlant(c.declared, c.effects, self._values).filter_step
        passages = tuple(map(self._passage, self._contact.hybrid.of(name)))
        return BallMode(step, passages, tuple(self._signs(name)))

    def _passage(self, transition: Transition) -> Passage:
        z = self._state(transition.source)
        value = self._guard(transition, z, ca.SX(0.0))
        applies = ca.SX(1.0) if transition.applies is None else transition.applies(z, self._p)
        guard, applying = (_Number(_function(z, one)) for one in (value, applies))
        return Passage(transition.target, guard, self._jump(transition, timed=True), applying)

    def _guard(self, transition: Transition, z: Any, u: Any) -> Any:
        value = transition.guard(z, self._p, UNTIMED)
        if transition.source != AIR:
            return value
        return ca.fmax(value, RISING_S * ca.jacobian(value, z) @ self._rate(AIR, z, u))

    def _jump(self, transition: Transition, *, timed: bool) -> _Jump:
        """(x, u) -> state after, saltation matrix, and what a touch leaves unknown."""
        z, u = self._state(transition.source), ca.SX.sym("u")
        after, guard = transition.reset(z, self._p), transition.guard(z, self._p, UNTIMED)
        by = ca.jacobian(after, z)
        if timed:
            slope, rate = ca.jacobian(guard, z), self._rate(transition.source, z, u)
            crossing = slope @ rate
            kept = by @ rate
            gap = self._rate(transition.target, after, u) - kept
            by = by + ca.if_else(ca.fabs(crossing) > LEAST_RATE, 1.0, 0.0) * (gap @ slope) / ca.if_else(
                ca.fabs(crossing) > LEAST_RATE, crossing, 1.0
            )
        unknown = ca.SX.zeros(after.numel())
        if transition.source == AIR:
            for row in (1, 3):  # dtheta, dpsi
                unknown[row] = UNKNOWN_SHARE * (after[row] - z[row])
        return _Jump(Call(ca.Function("jump", [z, u], [ca.densify(one) for one in (after, by, unknown)])))

    def _signs(self, mode: str) -> Iterator[_Signs]:
        """Pressed on its track; in the air of every track: not pressed on it, or off it."""
        z = self._state(mode)
        s = self._composites[mode].plant.point(z, self._named)
        for track in [one for one in self._composites if one != AIR] if mode == AIR else [mode]:
            pressed = signed_normal_force(s) if track == ROLLING else inner_normal_force(s)
            values = [pressed]
            if mode == AIR:
                off = on_track(s) - s.distance if track == ROLLING else s.distance - inner_track(s)
                values = [-pressed, off]
            rows = ca.vertcat(*(ca.horzcat(one, ca.jacobian(one, z)) for one in values))
            yield _Signs(Call(ca.Function("signs", [z], [ca.SX(0.0), ca.densify(rows)])))

    def _rate(self, mode: str, z: Any, u: Any) -> Any:
        c: Composite = self._composites[mode]
        return c.smooth_rate_expression(z, u, 0.0, self._named, FRICTION_WIDTH)

    def _state(self, mode: str) -> Any:
        return ca.SX.sym("z", self._composites[mode].nz)


def _function(z: Any, value: Any) -> Call:
    return Call(ca.Function("value", [z], [ca.densify(ca.SX(value))]))


@dataclass(frozen=True)
class _Number:
    """x -> a number."""

    call: Call

    def __call__(self, x: Array) -> float:
        return float(self.call.vector(x)[0])


@dataclass(frozen=True)
class _Jump:
    """As `core.ball_modes.Jump`."""

    call: Call

    def __call__(self, x: Array, torque_nm: float) -> tuple[Array, Array, Array]:
        return self.call.vector(x, torque_nm), self.call.matrix(1), self.call.matrix(2).ravel()


@dataclass(frozen=True)
class _Signs:
    """As one of `core.ball_modes.BallMode.signs`."""

    call: Call

    def __call__(self, x: Array) -> Array:
        self.call.vector(x)
        return self.call.matrix(1)
