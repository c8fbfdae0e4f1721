"""Is an input what its name says, with its sign and its scale? The model without any effect, with another one, says.

A cable that is plugged the other way round, or a share of one read as percent, is no missing physics; whatever is named
instead only stands for it.

Rules of this file: a sentence, never an act; only what gains alone a good part of what all names gain together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hoopd.plants.declaration import Input
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

# Of percent or of one: the other is a hundred times as much.
PERCENT = 100.0
# A share of one, a little beyond it.
SHARE = 1.05
# Of what the names gain; they stand for the sign, and for what is missing beside it.
LEAST_PART = 0.5


def input_doubts(nominal: HypothesisFit, base: HypothesisFit, final: HypothesisFit, threshold: float) -> list[str]:
    """One sentence where an input of another sign or scale gains alone a good part of what `final` gains with names.

    nominal: the model as given; base: its parameters fitted; `threshold`: nats.
    """
    stretches = [track.stretch for track in nominal.tracks]
    named = base.criterion - final.criterion
    largest = np.max([np.abs(one.inputs).max(axis=0) for one in stretches], axis=0)
    best, gain = "", max(threshold, LEAST_PART * named)
    for index, declared in enumerate(stretches[0].plant.inputs):
        for factor, words in _others(declared, largest[index]):
            changed = [_times(one, index, factor) for one in stretches]
            here = base.criterion - fit(changed, nominal.effects, nominal.values).criterion
            if here > gain:
                best, gain = _sentence(declared.name, words, here, named), here
    return [best] if best else []


def _others(declared: Input, largest: float) -> Iterator[tuple[float, str]]:
    """Factors, and how they are told to a command."""
    name = declared.name
    yield -1.0, f"{name} with its sign turned (--columns {name}=-COLUMN)"
    if declared.unit == "%" and largest <= SHARE:
        yield PERCENT, f"{name} read as a share of one (--columns {name}=COLUMN:-)"
    if declared.unit in ("-", "1", "") and SHARE < largest <= SHARE * PERCENT:
        yield 1.0 / PERCENT, f"{name} read as percent (--columns {name}=COLUMN:%)"


def _sentence(name: str, words: str, nats: float, named: float) -> str:
    beside = f", all that is named here by {named:.3g}" if named > 0.0 else ""
    return (
        f"{words} lets the model without any effect explain these readings better by {nats:.3g} nats{beside}: is {name}"
        " what the model takes it for?"
    )


def _times(stretch: Stretch, index: int, factor: float) -> Stretch:
    inputs, open_to = stretch.inputs, stretch.unresolved.copy()
    inputs[:, index] *= factor
    open_to[:, index] *= factor
    return replace(stretch, u=inputs[:, 0], others=inputs[:, 1:], unresolved=open_to)
