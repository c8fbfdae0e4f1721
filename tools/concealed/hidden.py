"""What a table of effects is made of: neutral parameters, how the rest is drawn, and what the size is.

Rules of this file: a size is positive, 0 is neutral, information grows with it; `cap` is physical.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Values = dict[str, float]
Draw = Callable[[np.random.Generator], Values]


@dataclass(frozen=True)
class Law:
    """What is true of a mechanism that has no name in the library: all that a judge compares with."""

    slots: tuple[str, ...]  # where it sits; after the first those that no recording tells from it
    depends_on: tuple[str, ...]
    memory: str  # of what; empty when it has none
    formula: str
    source: str


@dataclass(frozen=True)
class Hidden:
    """One effect: `at(size, fixed)` gives its parameters; `drawn` sizes are not searched for a number of nats."""

    name: str
    neutral: Values
    fixed: Draw
    at: Callable[[float, Values], Values]
    first: float  # a size to start the search with
    cap: float
    drawn: tuple[float, float] | None = None  # log-uniform range instead of nats
    sized: tuple[str, ...] = ()  # parameters that the size moves: what a diagnosis must get right
    location: str = ""  # slot of an unknown effect
    phased: bool = False  # `phi` is another one in each recording
    law: Law | None = None  # of a mechanism outside the library

    @property
    def slot(self) -> str:
        """Where it sits."""
        if self.law:
            return self.law.slots[0]
        return self.location or self.name.split(".")[0]


def nothing(rng: np.random.Generator) -> Values:
    """Nothing is drawn beside the size."""
    return {}


def sign(rng: np.random.Generator) -> float:
    """One of two directions."""
    return float(rng.choice((-1.0, 1.0)))


def phase(rng: np.random.Generator) -> float:
    """An angle anywhere, rad."""
    return float(rng.uniform(-np.pi, np.pi))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose order of magnitude is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
