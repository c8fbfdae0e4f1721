"""Modes of the ball as the filter knows them: how each moves, what ends it, what begins then, and how sure that is.

    through a passage:  P -> X P X' + d d',   X = D_x R + (f_target(R) - D_x R f_source) D_x g / (D_x g f_source)

with guard g, reset R and rates f: the saltation matrix, by which an error of the time of the passage counts as well
(N. J. Kong, J. J. Payne, G. Council, A. M. Johnson: The Salted Kalman Filter: Kalman filtering on hybrid dynamical
systems. Automatica 131, 2021). d is what nobody knows of a touch (J. J. Payne, N. J. Kong, A. M. Johnson: The
Uncertainty Aware Salted Kalman Filter, arXiv:2202.12729, has it by the parameters of the reset).

Rules of this file: pure; the modes and their equations come as callables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import erfc, sqrt
from typing import NamedTuple

import numpy as np

from hoopd.core.estimator import Step, ahead_of
from hoopd.core.records import Vector

# (x, torque) -> state of the next mode, X, and d
Jump = Callable[[Vector, float], tuple[Vector, Vector, Vector]]

# Of a step of 20 ms: the time of a passage to a third of a microsecond.
BISECTIONS = 16
# Passages within one step; a ball that bounces loses its speed across the hoop in fewer.
MOST_PASSAGES = 8


@dataclass(frozen=True)
class Passage:
    """What ends a mode, and how the next one begins."""

    target: str
    guard: Callable[[Vector], float]  # above zero while the source lasts
    jump: Jump
    applies: Callable[[Vector], float]  # above zero: this one, where several share a guard


@dataclass(frozen=True)
class BallMode:
    """How the ball moves in one mode, and what says that it is in it."""

    step: Step
    passages: tuple[Passage, ...]
    # each x -> (rows, 1 + states): a value that is above zero in this mode, and its derivative by x; of each, one such
    # row is enough
    signs: tuple[Callable[[Vector], Vector], ...]


@dataclass(frozen=True)
class BallModes:
    """All of them."""

    modes: Mapping[str, BallMode]
    tracks_m: Mapping[str, float]  # by mode: radius of the path of the rolling ball's centre
    take_off: Jump  # from rolling, wherever it is
    landing: Jump  # from the air to rolling, wherever it is


class BallState(NamedTuple):
    """State, covariance and mode."""

    x: Vector
    p: Vector
    mode: str


def carried(modes: BallModes, now: BallState, torque_nm: float, densities: Mapping[str, Vector], h: float) -> BallState:
    """A step of h seconds, through the passages within it; `densities`: of the process noise, by mode."""
    for _ in range(MOST_PASSAGES):
        mode, density = modes.modes[now.mode], densities[now.mode]
        after = _stepped(mode.step, now, torque_nm, density, h)
        passage = next((one for one in mode.passages if one.guard(after.x) <= 0.0), None)
        if passage is None:
            return after
        until = _time_of(passage, mode.step, now.x, torque_nm, h)
        now = _through(mode, _stepped(mode.step, now, torque_nm, density, until), torque_nm)
        h -= until
    return _stepped(modes.modes[now.mode].step, now, torque_nm, densities[now.mode], h)


def jumped(jump: Jump, now: BallState, torque_nm: float, target: str) -> BallState:
    """Through a reset: P -> X P X' + d d'."""
    x, by, unknown = jump(now.x, torque_nm)
    p = by.dot(now.p).dot(by.T) + np.outer(unknown, unknown)
    return BallState(x, 0.5 * (p + p.T), target)


def probability(mode: BallMode, x: Vector, p: Vector) -> float:
    """How sure the mode is: Phi(value / deviation) of what says most, and of several signs the least."""
    return min(max(_above_zero(row[0], float(row[1:] @ p @ row[1:])) for row in sign(x)) for sign in mode.signs)


def _above_zero(value: float, variance: float) -> float:
    return 0.5 * erfc(-value / sqrt(2.0 * max(variance, 1e-30)))


def _stepped(step: Step, now: BallState, torque_nm: float, density: Vector, h: float) -> BallState:
    """P' = F P F' + q h."""
    if not h > 0.0:
        return now
    x, f = step(now.x, torque_nm, h)
    p = f.dot(now.p).dot(f.T)
    p = 0.5 * (p + p.T)
    p.ravel()[:: len(x) + 1] += density * h
    return BallState(x, p, now.mode)


def _time_of(passage: Passage, step: Step, x: Vector, torque_nm: float, h: float) -> float:
    """When the guard falls to zero; 0 where it has."""
    if passage.guard(x) <= 0.0:
        return 0.0
    early, late, ahead = 0.0, h, ahead_of(step)
    for _ in range(BISECTIONS):
        middle = (early + late) / 2
        if passage.guard(ahead(x, torque_nm, middle)) > 0.0:
            early = middle
        else:
            late = middle
    return late


def _through(mode: BallMode, now: BallState, torque_nm: float) -> BallState:
    """By the first passage that is due and applies."""
    due = [one for one in mode.passages if one.guard(now.x) <= 0.0 and one.applies(now.x) > 0.0]
    return jumped(due[0].jump, now, torque_nm, due[0].target) if due else now
