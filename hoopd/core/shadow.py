"""Does another filter fit the device? It is fed what the acting one is fed, and its innovations are judged.

Rules of this file: a pure function of the ticks; a verdict, no action.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from hoopd.core.drift import CHANNELS, Level, LevelSums, beyond

# A filter that begins follows hoop and ball after some pictures.
BEGIN_S = 0.5
SHADOW_S = 2.0
# Of 75 samples and their 15 means of five a mean square of chance scatters by 16 % and 36 %. A level that is told is
# the mean of many seconds of a rig; of the real device it varies more (tools/bench/new_controller.py).
FACTOR = 2.5


class Shadow:
    """Innovations of a candidate and of the acting filter over the same ticks, for `SHADOW_S`."""

    def __init__(self, t: float, levels: Mapping[str, Level] | None) -> None:
        """`levels`: what is told to be normal of the candidate; what is not is that of the acting filter."""
        self._begun, self._told = t, levels or {}
        self._candidate = {name: LevelSums() for name in CHANNELS}
        self._acting = {name: LevelSums() for name in CHANNELS}

    def add(self, t: float, candidate: tuple[float, float, float], acting: tuple[float, float, float]) -> None:
        """Innovations of one tick, over what each filter expects of them."""
        if t - self._begun < BEGIN_S:
            return
        for sums, surprise in ((self._candidate, candidate), (self._acting, acting)):
            for name, e in zip(CHANNELS, surprise, strict=True):
                if isfinite(e):
                    sums[name].add(e)

    def misfit(self) -> str:
        """The first channel whose innovations are larger than chance allows, with the numbers; empty: it fits.

        Against what is told, they last longer and are larger, as `core.drift` has it; more noise alone is a sensor's,
        which the acting filter sees as well.
        """
        for name in CHANNELS:
            now, acting = self._candidate[name].level(), self._acting[name].level()
            if now is None or acting is None:
                return f"{name}: too few samples in {SHADOW_S - BEGIN_S:g} s"
            normal = self._told.get(name, acting)
            if beyond(now, normal, FACTOR):
                return f"innovations of {name} that last: {now.slow:.3g}, normal is {normal.slow:.3g}"
            most = max(normal.all, acting.all)
            if now.all > FACTOR * most:
                return f"innovations of {name}: {now.all:.3g}, normal is {most:.3g}"
        return ""
