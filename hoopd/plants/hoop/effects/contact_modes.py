"""The modes of a ball that may leave the hoop, and what carries over from one to the next.

    rolling --N < 0--> air        spin and path go on as they are
    air --touches--> air          while the speed that comes back is one that flies: r' -> -e r'
    air --touches--> rolling      else: the speed across the hoop is lost
    inner --N < 0--> air, air --touches--> air or inner    the same on the inner hoop, where there is one

It touches where its distance from the axis comes back to Ro-Rb, or down to Ri+Rb. At every touch the impulse of
friction makes it roll, or as nearly as mu times the impulse across, m (1 + e) |r'|, allows: what slides on slides in
the air, or in a plant that slips. A plant that only rolls has the end of the sliding at once, with all the impulse that
it takes. With k = c1^2/Ih + c2^2/(m r^2) + 1/Ib an impulse G = -lambda s/k on a slide s = c1 theta' + c2 psi' - w
changes the energy by -(lambda - lambda^2/2) s^2/k, never above zero for lambda from 0 to 1, and the momentum about the
axis by (c1 + c2 - 1) G = 0. What runs on through all of it (the hoop and its friction, lags, sensors) does so by the
same effects.

Rules of this file: guards and resets; how each mode moves stands in its plant, when one ends `plants.hybrid_plant`
finds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.hoop.contact import Contact, ContactOf
from hoopd.plants.hoop.effects.flight_motion import FlyingComposite
from hoopd.plants.hoop.effects.flying_plant import FlyingPlant
from hoopd.plants.hoop.effects.inner_hoop import (
    INNER_HOOP,
    RADIUS,
    inner_contact,
    inner_normal_force,
    inner_track,
    on_the_inner_hoop,
)
from hoopd.plants.hybrid_plant import HybridCourse, HybridPlant, Transition
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

ROLLING, AIR, INNER = "rolling", "air", "inner"
# A ball that comes back slower than this (m/s) is on the hoop: it would fly for 2 ms, a tenth of a picture's time.
LEAST_REBOUND_M_S = 0.01
# Of a distance (m): a ball that has just left its track, by rounding, has not touched it again.
SAME_PLACE_M = 1e-9


class _Track(NamedTuple):
    """What the ball rolls on: the plant meanwhile, its contact, where its centre runs, what presses it on."""

    mode: str
    plant: Composite
    contact: ContactOf
    distance: Callable[[Point], Any]  # m
    normal_force: Callable[[Point], Any]  # N
    side: float  # 1: the ball is within, -1: outside


class ContactModes:
    """Rolling and flying plant with their effects, guards and resets."""

    def __init__(self, plant: Plant, effects: Sequence[Effect]) -> None:
        """`effects`: one of them lets the ball take off."""
        effect = next(one for one in effects if one.flight is not None)
        assert effect.flight is not None
        self._flying: FlyingPlant = effect.flight(plant)
        through = [one for one in effects if one.name not in self._flying.through_contact]
        self.rolling = Composite(plant, effects, substeps=1)
        free = [_at_track(_shaken(one, lambda s: s.distance)) for one in through]
        self.air = FlyingComposite(self._flying.plant, free, substeps=1)
        inner = any(one.name == INNER_HOOP for one in effects) and "theta" in plant.coordinates
        self.inner = self._on_inner(plant, effects) if inner else None
        slip = next((one.key("mu") for one in effects if one.name.endswith(".slip")), None)
        self._mu, self._restitution = slip or effect.key("grip"), effect.key("restitution")
        tracks = [_Track(ROLLING, self.rolling, self._flying.contact, on_track, self._flying.normal_force, 1.0)]
        if self.inner is not None:
            contact = inner_contact(self._flying.contact)
            tracks.append(_Track(INNER, self.inner, contact, inner_track, inner_normal_force, -1.0))
        modes = {AIR: self.air, **{one.mode: one.plant for one in tracks}}
        self.hybrid = HybridPlant(
            {ROLLING: self.rolling, **modes}, [one for track in tracks for one in self._transitions(track)]
        )
        self.normal = self.hybrid.of(ROLLING)[0].guard

    def _on_inner(self, plant: Plant, effects: Sequence[Effect]) -> Composite:
        """The plant of a ball on the inner hoop; what acts through the contact does so by that one's formulas."""
        own = {one.name: one for one in self._flying.on_inner}
        through = [own.get(one.name, one) for one in effects]
        acting = (one for one in through if one.name in own or one.name not in self._flying.through_contact)
        kept = [_shaken(one, inner_track) for one in acting]
        return Composite(on_the_inner_hoop(plant, self._flying.contact), kept, substeps=1)

    def _transitions(self, track: _Track) -> list[Transition]:
        """What ends on one track, and how a touch with it ends."""
        p, t = ca.SX.sym("p", len(self.rolling.names)), ca.SX.sym("t")
        named = {name: p[i] for i, name in enumerate(self.rolling.names)}
        z, air = ca.SX.sym("z", track.plant.nz), ca.SX.sym("air", self.air.nz)
        on, off = track.plant.plant.point(z, named), self.air.plant.point(air, named)
        e, mu = named[self._restitution], named[self._mu]

        def of(name: str, state: Any, value: Any, *more: Any) -> ca.Function:
            return ca.Function(name, [state, p, *more], [ca.densify(value)])

        # from within the outer track, from outside the inner one
        touching = of("touching", air, track.side * (track.distance(off) - off.distance) + SAME_PLACE_M, t)
        rebounds = of("rebounds", air, track.side * e * off.ddistance - LEAST_REBOUND_M_S)
        pressed = track.normal_force(track.plant.point_in_frame(z, named, t))
        lost, took_off = of("normal", z, pressed, t), of("off", z, self._took_off(z, on, track))
        bounced, landed = self._bounced(air, off, mu, e, track), self._landed(air, off, mu, track)
        return [
            Transition(track.mode, AIR, lost, took_off),
            Transition(AIR, AIR, touching, of("bounced", air, bounced), rebounds),
            Transition(AIR, track.mode, touching, of("landed", air, landed)),
        ]

    def _took_off(self, z: Any, s: Point, track: _Track) -> Any:
        c = track.contact(s)
        spin = c.by_theta * s.dtheta + c.by_psi * s.dpsi - (s.dslip if "slip" in s else 0.0)
        return ca.vertcat(z[: self.shared], 0.0, spin, track.distance(s), 0.0, z[track.plant.nx :])

    def _bounced(self, z: Any, s: Point, mu: Any, e: Any, track: _Track) -> Any:
        rates = self._touched(s, track.contact(s), mu * s.p["mb"] * (1.0 + e) * ca.fabs(s.ddistance))
        moved = {**{f"d{q}": rate for q, rate in rates.items() if q != "slip"}, "ddistance": -e * s.ddistance}
        moved["distance"] = track.distance(s)
        return ca.vertcat(*(moved.get(name, z[i]) for i, name in enumerate(self.air.plant.states)), z[self.air.nx :])

    def _landed(self, z: Any, s: Point, mu: Any, track: _Track) -> Any:
        own = track.plant.plant.coordinates
        most = mu * s.p["mb"] * ca.fabs(s.ddistance) if "slip" in own else ca.inf
        rates = self._touched(s, track.contact(s), most)
        state = [x for q in own for x in (0.0 if q == "slip" else getattr(s, q), rates[q])]
        return ca.vertcat(*state, z[self.air.nx :])

    def _touched(self, s: Point, c: Contact, most: Any) -> dict[str, Any]:
        """Rates of hoop, path, spin and slip after a touch whose impulse along is `most` at most, N s."""
        rb = s.p["Rb"]
        by_theta = c.by_theta / c.theta_inertia if "theta" in self.rolling.plant.coordinates else 0.0
        by_psi = c.by_psi / c.psi_inertia
        slide = c.by_theta * s.dtheta + c.by_psi * s.dpsi - s.dspin
        # the impulse P = G/Rb after which nothing slides, as far as it goes:  hoop, path and spin change by it
        free = (c.by_theta * by_theta + c.by_psi * by_psi + 1.0 / c.spin_inertia) * rb
        impulse = ca.fmin(ca.fmax(-slide / free, -most), most)
        return {
            "theta": s.dtheta + by_theta * rb * impulse,
            "psi": s.dpsi + by_psi * rb * impulse,
            "spin": s.dspin - rb * impulse / c.spin_inertia,
            "slip": slide + free * impulse,
        }

    @property
    def through_contact(self) -> tuple[str, ...]:
        """Names of what acts through a contact, and not in the air."""
        return self._flying.through_contact

    @property
    def shared(self) -> int:
        """States that rolling and flying plant begin with alike."""
        return self.air.nx - 4


def _shaken(effect: Effect, arm: Callable[[Point], Any]) -> Effect:
    """The effect on a ball at such a distance from the axis; itself where it does not shake."""
    shaking = effect.shaking
    if shaking is None:
        return effect

    def push(s: Point, e: Any) -> dict[str, Any]:
        # m a cos psi along the path, m a sin psi outwards where nothing holds the ball
        across = s.p["mb"] * shaking(s, e)
        along = {"psi": across * arm(s) * ca.cos(s.psi)}
        return {**along, "distance": across * ca.sin(s.psi)} if "distance" in s else along

    return replace(effect, force=push)


def _at_track(effect: Effect) -> Effect:
    """In the air what goes by psi' is what it is of a ball as fast on its track, and its torque has its lever there: a
    drag goes by the speed, not by how fast the direction turns, which near the axis has no bound."""
    force = effect.force
    if force is None or effect.shaking is not None:
        return effect

    def acts(s: Point, e: Any) -> Mapping[str, Any]:
        share = s.distance / on_track(s)
        given = force(s.replaced(dpsi=s.dpsi * share), e)
        return {**given, "psi": given["psi"] * share} if "psi" in given else given

    return replace(effect, force=acts)


def on_track(s: Point) -> Any:
    """Distance of the rolling ball's centre from the axis, m."""
    return s.p["Ro"] - s.p["Rb"]


class ContactCourse:
    """One run: the mode, its state and when modes changed."""

    def __init__(self, modes: ContactModes, values: Mapping[str, float], z: Array) -> None:
        self._o, self._course = modes, HybridCourse(modes.hybrid, values, ROLLING, z)
        told = {**modes.rolling.values, **values}
        self._track = told["Ro"] - told["Rb"]
        self._inner_track = told.get(RADIUS, 0.0) + told["Rb"]

    def restart(self, z: Array, mode: str = ROLLING) -> None:
        """Begin anew with a ball on the hoop, or on the inner one, whose states are alike."""
        self._course.restart(mode, z)

    @property
    def mode(self) -> str:
        """What the ball does."""
        return self._course.mode

    @property
    def flies(self) -> bool:
        """Whether the ball is off the hoop."""
        return self.mode == AIR

    @property
    def rolls(self) -> bool:
        """Whether the ball is on the (outer) hoop."""
        return self.mode == ROLLING

    @property
    def z(self) -> Array:
        """The state of the mode."""
        return self._course.z

    @z.setter
    def z(self, z: Array) -> None:
        self._course.z = z

    def seen(self) -> Array:
        """The state as the rolling plant has it."""
        if not self.flies:
            return self.z
        o = self._o
        rolling, mode = np.zeros(o.rolling.nz), o.hybrid.modes[self.mode]
        rolling[: o.shared], rolling[o.rolling.nx :] = self.z[: o.shared], self.z[mode.nx :]
        return rolling

    @property
    def distance(self) -> float:
        """Of the ball's centre from the axis, in shares of what it is on the hoop."""
        if self.flies:
            return float(self.z[self._o.air.nx - 2]) / self._track
        return 1.0 if self.rolls else self._inner_track / self._track

    def step(self, torque: float, d: float, t: float) -> None:
        """Go on by d seconds from t; a change of mode within them is found."""
        self._course.step(torque, d, t)

    def advance(self, torque: float, h: float, t: float) -> None:
        """The same over up to 20 ms at once."""
        self._course.advance(torque, h, t)

    def flights(self, end: float) -> list[tuple[float, float]]:
        """Begin and end of every flight, s; a bounce ends one and begins the next."""
        changes = self._course.changes
        times = [one.t for one in changes if one.target == AIR], [one.t for one in changes if one.source == AIR]
        return list(zip(times[0], [*times[1], end], strict=False))
