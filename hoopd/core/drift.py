"""Does the device still move as the model says? The filter's innovations over tens of seconds against a known level.

Of each channel two numbers are followed, means over a block of seconds of e, the innovation over what the filter
expects of it: `all`, the mean of e^2, and `slow`, the same of the means of five samples in a row, times five. Noise of
a sensor raises both alike. A force that the model does not have, or a reading that is late, lasts: it raises `slow`.
A filter whose process noise is wider than the device's has a level below 1 in either, so what counts is what the two
are of a device that is as the model says: a level in the controller's file, or the run's own first minute.

Rules of this file: a pure function of the samples; nothing here stops anything.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from math import isfinite
from statistics import median
from typing import NamedTuple

CHANNELS = ("theta", "dtheta", "psi")
# A tenth of a second: longer than a sensor's noise, shorter than a swing of the ball or a cog at a turn a second.
SLOW_SAMPLES = 5
BLOCK_S = 5.0
# The median of six blocks: a push or two, or a burst of false pictures, is in less than half of them.
BLOCKS = 6
# After the law has begun, the filter still learns where the ball is.
SETTLE_S = 3.0
# Blocks of the own first minute, where no level is told.
LEARNED_BLOCKS = 12
# No single sample weighs more: the filter's gate, five sigma.
MOST = 5.0
# Blocks of a healthy rig scatter by 20 %, their median by a tenth; tools/bench/writeback.py counts false alarms.
FACTOR = 1.7
FEWEST_SAMPLES = 50


class Level(NamedTuple):
    """What is normal of one channel."""

    all: float
    slow: float


class LevelSums:
    """Sums over one block of one channel."""

    def __init__(self) -> None:
        self.count, self.squares, self.means, self.slow = 0, 0.0, 0, 0.0
        self._run, self._in_run = 0.0, 0

    def add(self, e: float) -> None:
        """One innovation over what the filter expects."""
        e = min(MOST, max(-MOST, e))
        self.count, self.squares = self.count + 1, self.squares + e * e
        self._run, self._in_run = self._run + e, self._in_run + 1
        if self._in_run == SLOW_SAMPLES:
            # n (mean of n)^2 = (sum of n)^2 / n
            self.means, self.slow = self.means + 1, self.slow + self._run * self._run / SLOW_SAMPLES
            self._run, self._in_run = 0.0, 0

    def level(self) -> Level | None:
        """None when the sensor was not there for most of it."""
        if self.count < FEWEST_SAMPLES:
            return None
        return Level(self.squares / self.count, self.slow / self.means)


def beyond(now: Level, normal: Level | None, factor: float) -> bool:
    """`slow` is larger, and its share of all: more noise alone is no other physics."""
    if normal is None:
        return False
    return now.slow > factor * normal.slow and now.slow * normal.all > factor * normal.slow * now.all


class Drift:
    """Watches one run while its law acts."""

    def __init__(self, levels: Mapping[str, Level] | None = None) -> None:
        """`levels`: by channel; those that are not told are learned from the first minute."""
        self._told = {name: level for name, level in (levels or {}).items() if name in CHANNELS}
        self._learned: dict[str, list[Level]] = {name: [] for name in CHANNELS if name not in self._told}
        self._recent: dict[str, deque[Level]] = {name: deque(maxlen=BLOCKS) for name in CHANNELS}
        self._blocks = {name: LevelSums() for name in CHANNELS}
        self._begun: float | None = None  # when the law began to act
        self._block_t = 0.0

    def watch(self, t: float, surprise: tuple[float, float, float]) -> tuple[str, ...]:
        """Take in the samples of one tick in which the law acts; at the end of a block the channels that drift."""
        if self._begun is None:
            self._begun = self._block_t = t
        if t - self._begun < SETTLE_S:
            self._block_t = t
            return ()
        closed = t - self._block_t >= BLOCK_S
        if closed:
            self._close(t)
        for name, e in zip(CHANNELS, surprise, strict=True):
            if isfinite(e):
                self._blocks[name].add(e)
        return self.drifted() if closed else ()

    def pause(self) -> None:
        """The law does not act: a hand may move the ball; the block that was begun is lost."""
        if self._begun is not None:
            self._begun = None
            self._blocks = {name: LevelSums() for name in CHANNELS}

    def reset(self) -> None:
        """A run begins: another ball, another hand on the screws. It is watched from the beginning; a level that was
        learned to the end stays what is normal, half of one does not."""
        self.pause()
        for blocks in self._recent.values():
            blocks.clear()
        for learned in self._learned.values():
            if len(learned) < LEARNED_BLOCKS:
                learned.clear()

    def latest(self) -> dict[str, Level]:
        """Median of the last blocks by channel, once there are enough of them."""
        full = {name: blocks for name, blocks in self._recent.items() if len(blocks) == BLOCKS}
        return {
            name: Level(median(one.all for one in blocks), median(one.slow for one in blocks))
            for name, blocks in full.items()
        }

    def drifted(self) -> tuple[str, ...]:
        """Channels whose innovations last longer and are larger than normal."""
        return tuple(name for name, now in self.latest().items() if beyond(now, self.level(name), FACTOR))

    def level(self, name: str) -> Level | None:
        """What counts as normal of a channel; None until it is known."""
        if name in self._told:
            return self._told[name]
        learned = self._learned[name]
        if len(learned) < LEARNED_BLOCKS:
            return None
        return Level(median(one.all for one in learned), median(one.slow for one in learned))

    def _close(self, t: float) -> None:
        """The end of a block."""
        for name, block in self._blocks.items():
            if (level := block.level()) is not None:
                learned = self._learned.get(name)
                if learned is not None and len(learned) < LEARNED_BLOCKS:
                    learned.append(level)
                self._recent[name].append(level)
        self._blocks = {name: LevelSums() for name in CHANNELS}
        self._block_t = t
