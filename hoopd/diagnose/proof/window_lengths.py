"""How long the windows are in which a model is simulated: some of the motion, and few of the growth of what falls.

A plant that moves away by itself is simulated for less than it takes to forget where it began: over many times of its
growth every model is as wrong as its start, and the one that simulates best is one that does not fall.

Rules of this file: declarations in, seconds and a sentence out.
"""

from __future__ import annotations

from collections.abc import Sequence

from hoopd.plants.declaration import Plant
from hoopd.plants.growth import growth
from hoopd.plants.scales import motion_scale

# Windows in which a model is simulated, of a plant whose motion is as fast as the hoop's.
WINDOW_S = 2.0
# Times of its growth for which a plant that moves away is simulated.
E_FOLDS = 3.0
# A plant that moves away more slowly than in so many windows does not.
SLOW = 10.0
# Usual steps of a window for each state: fewer readings say nothing beside the start that is fitted to them.
STEPS_A_STATE = 4.0


def growth_of(plant: Plant) -> float:
    """Of the fastest motion that grows within the time of a recording, 1/s; 0 where none does."""
    fastest = growth(plant)
    return fastest if fastest * SLOW * WINDOW_S * motion_scale(plant) > 1.0 else 0.0


def window_scale(plant: Plant) -> float:
    """Lengths of windows over those that the constants are written for: times of the motion, and no more than a few of
    its growth, as far as it is sampled finely enough for that."""
    usual, fastest = motion_scale(plant), growth_of(plant)
    if fastest == 0.0:
        return usual
    return min(usual, max(E_FOLDS / fastest, _least_s(plant)) / WINDOW_S)


def window_of(plants: Sequence[Plant]) -> float:
    """Seconds of a window of simulation: that of the fastest of several plants."""
    return WINDOW_S * min(map(window_scale, plants))


def growth_sentence(plants: Sequence[Plant]) -> str:
    """That a plant moves away by itself, and what follows; empty where none does."""
    fastest = max(map(growth_of, plants), default=0.0)
    if fastest == 0.0:
        return ""
    window_s = window_of(plants)
    rarely = (
        f" It is sampled too rarely for shorter ones: within one an error grows {fastest * window_s:.2g} times by e."
        if fastest * window_s > 1.01 * E_FOLDS
        else ""
    )
    return (
        f"left alone where it was recorded the plant moves away, e times as far every {1.0 / fastest:.2g} s: windows "
        f"of simulation last {window_s:.2g} s, and one run over a whole recording says little of a model.{rarely}"
    )


def _least_s(plant: Plant) -> float:
    return STEPS_A_STATE * len(plant.states) * plant.time_scale_s
