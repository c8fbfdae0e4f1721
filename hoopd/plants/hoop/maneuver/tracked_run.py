"""A plan played on a plant that may be another one than the one it was planned on: what the feedback leaves.

The whole state is fed back, as it is: what camera and filter add is not part of it, the rig shows that.

Rules of this file: one run, and what it says of the contact and the end; nothing is planned here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.effects.contact_modes import INNER, ROLLING, ContactCourse, ContactModes
from hoopd.plants.hoop.effects.inner_hoop import RADIUS
from hoopd.plants.hoop.maneuver.judgement import weights_on
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel, flying_model
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]


class TrackedRun(NamedTuple):
    """What became of a plan.

    Attributes
    ----------
    states : ndarray, shape (n + 1, 4)
        At the edges of the ticks.
    inputs : ndarray, shape (n,)
        Torques that were asked for, N m.
    contact : float
        Least force between the ball and the hoop that it is on, in weights of the ball; below zero it would have flown,
        and of a ball that may, none counts of its flights and of what came before them.
    flown_s : float
        Of a ball that may leave the hoop: its longest flight; 0 of one that may not.
    """

    states: Array
    inputs: Array
    contact: float
    flown_s: float = 0.0


class PlanTracker:
    """Plays plans with their feedback on a model with any of its numbers changed."""

    def __init__(self, found: FoundEffects) -> None:
        """`found`: effects that act on the state are played as they are, dry friction included."""
        self._model = PlanningModel(found)
        effects = self._model.found.effects()
        self._composite = Composite(self._model.declared, effects)
        self._values = self._model.found.values if self._model.found else dict(found.base)
        self._model_flies = flying_model(self._model)

    @cached_property
    def _modes(self) -> ContactModes:
        return ContactModes(self._model_flies.plant, self._model_flies.effects())

    def thrown(
        self,
        states: Array,
        inputs: Array,
        gains: Array,
        tick_s: float,
        limit_nm: float,
        changes: Mapping[str, float] | None = None,
    ) -> TrackedRun:
        """Play a plan with a ball that leaves the hoop where nothing holds it; arguments as of `run`."""
        values = {**self._model_flies.values, **(changes or {})}
        course = ContactCourse(self._modes, values, self._modes.rolling.beginning(states[0]))
        seen, modes, asked = [course.seen()[:4]], [course.mode], []
        for k, (torque, gain) in enumerate(zip(inputs, gains, strict=True)):
            u = float(np.clip(torque - gain @ (seen[-1] - states[k]), -limit_nm, limit_nm))
            course.advance(u, tick_s, k * tick_s)
            seen.append(course.seen()[:4])
            modes.append(course.mode)
            asked.append(u)
        played = np.array(seen)
        flights = course.flights(len(inputs) * tick_s)
        flown = max((end - begin for begin, end in flights), default=0.0)
        # a run-up ends where nothing presses the ball on: what counts is what comes after, where there is such
        contact = contact_by_mode(played, modes, values)
        later = contact[tick_s * np.arange(len(contact)) > min((begin for begin, _ in flights), default=-1.0)]
        least = np.nanmin(later if np.isfinite(later).any() else contact)
        return TrackedRun(played, np.array(asked), float(least), flown)

    def run(
        self,
        states: Array,
        inputs: Array,
        gains: Array,
        tick_s: float,
        limit_nm: float,
        changes: Mapping[str, float] | None = None,
    ) -> TrackedRun:
        """Play a plan.

        Parameters
        ----------
        states, inputs, gains : ndarray, shapes (n + 1, 4), (n,), (n, 4)
            The plan and its feedback.
        tick_s : float
            Length of a tick in s.
        limit_nm : float
            The drive's limit, N m.
        changes : mapping of str to float, optional
            Parameters of the plant that is played on, where they are others.
        """
        values = {**self._values, **(changes or {})}
        c, p = self._composite, self._composite.vector(values)
        x, none = c.beginning(states[0]), np.zeros(c.nw)
        seen, asked = [x[:4]], []
        for k, (torque, gain) in enumerate(zip(inputs, gains, strict=True)):
            u = float(np.clip(torque - gain @ (x[:4] - states[k]), -limit_nm, limit_nm))
            x = c.step_function(x, np.full(c.substeps, u), none, tick_s, 0.0, p).full().ravel()
            seen.append(x[:4])
            asked.append(u)
        played = np.array(seen)
        return TrackedRun(played, np.array(asked), float(contact_along(played, values).min()))


def contact_by_mode(states: Array, modes: Sequence[str], values: Mapping[str, float]) -> Array:
    """N / (m g) of the hoop that the ball is on at each state (n, 4); NaN in the air.

    Examples
    --------
    At rest on the top of the inner hoop its whole weight presses it on:

    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.tracked_run import contact_by_mode
    >>> values = {"Ro": 0.0957, "Rb": 0.0104, "g": 9.81, "ball.inner_hoop.radius": 0.0445}
    >>> contact_by_mode(np.array([[0, 0, np.pi, 0]]), ["inner"], values).tolist()
    [1.0]
    """
    inner = -weights_on(states, values.get(RADIUS, 0.0) + values["Rb"], values["g"])
    kinds = np.array(modes)
    return np.where(kinds == ROLLING, contact_along(states, values), np.where(kinds == INNER, inner, np.nan))


def contact_along(states: Array, values: Mapping[str, float]) -> Array:
    """N / (m g) of the outer hoop along states (n, 4): ((Ro-Rb) psi'^2 + g cos psi) / g.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.tracked_run import contact_along
    >>> contact_along(np.zeros((1, 4)), {"Ro": 0.0957, "Rb": 0.0104, "g": 9.81}).tolist()
    [1.0]
    """
    return weights_on(states, values["Ro"] - values["Rb"], values["g"])
