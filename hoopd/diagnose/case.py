"""What is diagnosed: the recordings, the model that they are judged against, and what is looked for.

Rules of this file: data alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hoopd.diagnose.inputs import Source
from hoopd.diagnose.search.candidates import Settings
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.stretches import Stretch

Progress = Callable[[str], None]

LAST_SHARE = 1.0 / 3.0


@dataclass
class Case:
    """What is diagnosed."""

    model: str
    values: Mapping[str, float]
    train: Sequence[Source]
    heldout: Sequence[Source]
    library: Mapping[str, Effect]
    effects: Sequence[Effect] = ()  # that the judged model has already; their values are among `values`
    free_run: bool = True  # one run over each whole stretch too, the parameters refined on it
    choose_free_run: bool = False  # look for the effects that make that run better, too (minutes)
    whole: Sequence[Source] = ()  # recordings whose parts are fitted and held out
    seed: int = 0
    held_out_how: str = ""
    without: Collection[str] = ()  # names that are not looked for
    jobs: int = 1  # processes that share the work; the numbers are the same with any
    odds: Mapping[str, float] = field(default_factory=dict)  # nats by which names are likelier beforehand
    progress: Progress = lambda text: None
    settings: Settings = field(default_factory=Settings)


def last_third(sources: Sequence[Source]) -> tuple[list[Source], list[Source]]:
    """Training and held-out parts of each recording."""
    train, held = [], []
    for source in sources:
        first, last = source.stretches[0].t[0], source.stretches[-1].t[-1]
        cut = float(last - LAST_SHARE * (last - first))
        train.append(source.part(-np.inf, cut))
        held.append(source.part(cut, np.inf))
    return train, held


def stretches_of(sources: Sequence[Source]) -> list[Stretch]:
    """All stretches, recording by recording."""
    return [one for source in sources for one in source.stretches]
