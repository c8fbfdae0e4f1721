"""A hypothesis on the held-out recordings: parameters frozen, phases and noise levels of each recording fitted.

What holds for every recording stays as it was fitted. A curve that each recording has for itself (over the time, over
an angle whose zero is another one each time) is fitted again to a recording that is new.

Rules of this file: every hypothesis is run once, however many tables show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hoopd.diagnose.proof.fit_tables import Played, run_windows
from hoopd.diagnose.search.candidates import free_of_recordings
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch


class HeldOut:
    """The held-out stretches and what was run on them."""

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        self.stretches = list(stretches)
        # with the fits themselves: the address of one that is gone is soon another's
        self._runs: dict[int, tuple[HypothesisFit, HypothesisFit]] = {}
        self._played: dict[int, Played] = {}

    def of(self, found: HypothesisFit) -> HypothesisFit | None:
        """A fit's hypothesis on them; None when nothing is held out."""
        if not self.stretches:
            return None
        if id(found) not in self._runs:
            own = free_of_recordings(found.effects, self.stretches)
            self._runs[id(found)] = found, fit(self.stretches, found.effects, found.values, free=own)
        return self._runs[id(found)][1]

    def played(self, runs: Mapping[str, HypothesisFit]) -> dict[str, Played]:
        """Fits of the held-out stretches with their free runs over windows, each simulated once."""
        for one in runs.values():
            if id(one) not in self._played:
                self._played[id(one)] = Played(one, run_windows(one))
        return {name: self._played[id(one)] for name, one in runs.items()}

    def played_of(self, found: HypothesisFit) -> Played | None:
        """Of one hypothesis; None when nothing is held out."""
        run = self.of(found)
        return None if run is None else self.played({"": run})[""]


def on_heldout(joint: HypothesisFit, heldout: Sequence[Stretch], beside: HypothesisFit) -> tuple[HypothesisFit, int]:
    """A fit with curves on the held-out stretches, and how many values of curves were fitted again."""
    known, new = set(joint.recordings), dict.fromkeys(one.recording for one in heldout)
    own = [p for e in joint.effects if e.name not in beside.names for p in _own(e.name, joint)]
    again = [f"{name}@{recording}" for recording in new if recording not in known for name in own]
    free = (*free_of_recordings(beside.effects, heldout), *again)
    return fit(heldout, joint.effects, joint.values, free=free), len(again)


def _own(name: str, joint: HypothesisFit) -> list[str]:
    effect = next(one for one in joint.effects if one.name == name)
    return [effect.key(p.name) for p in effect.parameters if p.per_recording]
