"""The plan of an alternating run: two laws take turns in blocks, in pairs of random order.

    A  the accepted law        B  the candidate

Two successive pairs are one AB and one BA in random order, so that whatever drifts slowly falls on both alike. Both
blocks of a pair have the same references; the next pair's may begin to the other side.

Rules of this file: the same plan gives the same blocks; no clock.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Literal, NamedTuple

Law = Literal["A", "B"]
LEAST_PAIRS, MOST_BLOCKS = 3, 200


class AlternationBlock(NamedTuple):
    """One law for a while."""

    pair: int  # from 0
    law: Law
    references: tuple[float, ...]  # rad, each held for the plan's `hold_s`


@dataclass(frozen=True)
class Alternation:
    """How the run goes; ValueError for numbers that give none."""

    blocks: int = 20  # at most: it ends sooner when the answer is clear
    settle_s: float = 2.0  # of each block, not counted: what the other law left dies away
    hold_s: float = 2.0  # of each reference
    amplitude_rad: float = 0.1  # of the references
    alpha: float = 0.05  # how often two equal laws may be called different
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what gives no comparison."""
        if self.blocks % 2 or not 2 * LEAST_PAIRS <= self.blocks <= MOST_BLOCKS:
            raise ValueError(f"blocks must be an even number from {2 * LEAST_PAIRS} to {MOST_BLOCKS}")
        for name, low, high in (("settle_s", 1.0, 60.0), ("hold_s", 0.5, 60.0), ("amplitude_rad", 0.0, 0.5)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} must be from {low:g} to {high:g}")
        if not 0.0 < self.alpha < 0.5:
            raise ValueError("alpha must be above 0 and below 0.5")

    @property
    def counted_s(self) -> float:
        """Seconds of each block that count."""
        return self.hold_s * len(_PROGRAMME)

    @property
    def longest_s(self) -> float:
        """Seconds that all blocks take, with the rests before a candidate acts and a watched filter."""
        return self.blocks * (self.settle_s + self.counted_s) + self.blocks / 2 * 5.5


# Up, back, down, back: parts of the amplitude.
_PROGRAMME = (1.0, 0.0, -1.0, 0.0)


def blocks_of(plan: Alternation) -> tuple[AlternationBlock, ...]:
    """All blocks in their order.

    Examples
    --------
    >>> [block.law for block in blocks_of(Alternation(blocks=8, seed=1))]
    ['B', 'A', 'A', 'B', 'B', 'A', 'A', 'B']
    """
    draw = random.Random(plan.seed)
    orders: list[tuple[Law, Law]] = []
    while len(orders) < plan.blocks // 2:
        two: list[tuple[Law, Law]] = [("A", "B"), ("B", "A")]
        draw.shuffle(two)
        orders += two
    made = []
    for pair, order in enumerate(orders[: plan.blocks // 2]):
        side = draw.choice((1.0, -1.0)) * plan.amplitude_rad
        references = tuple(side * part + 0.0 for part in _PROGRAMME)  # no -0
        made += [AlternationBlock(pair, law, references) for law in order]
    return tuple(made)
