"""A law on any declared plant: the controller that a program of one's own runs, and its closed loop, nonlinear.

Rules of this file: numbers and declarations in, numbers out; nothing is read, written or drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.design.linear_law import LinearLaw
from hoopd.files.plant_controller import PlantControllerFile
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# Of the sizes that matter, how far a plant is off where a run begins.
RELEASE_SHARE = 0.1
# A run lasts so many time constants of the slowest pole, within so many samples.
TIME_CONSTANTS, FEWEST, MOST = 6.0, 50, 5000


class StateFeedback:
    """The law of a controller file: from readings to inputs, sample by sample.

    Parameters
    ----------
    file : PlantControllerFile
        Matrices, limits and the operating point.

    Examples
    --------
    Half of what a level is off is pumped away in a sample, and never more than 0.3:

    >>> from hoopd.files.plant_controller import PlantGains
    >>> one = [[1.0]]
    >>> law = StateFeedback(PlantControllerFile(
    ...     schema="hoopd.controller/1", name="level", plant="tank.yaml", kind="state_feedback", sample_time_s=1.0,
    ...     states=["h"], inputs={"q": "m3/s"}, channels={"h": "m"}, operating_point={"q": 0.0, "h": 2.0},
    ...     gains=PlantGains(feedback=[[0.5]], filter=one, a=one, b=one, c=one), limits={"q": 0.3},
    ... ))
    >>> law.update({"h": 2.5}), law.update({"h": 3.0})
    ({'q': -0.25}, {'q': -0.3})
    """

    def __init__(self, file: PlantControllerFile) -> None:
        """Begin with nothing known but the operating point."""
        gains = file.gains
        self._k, self._m, self._a, self._b, self._c = (
            np.array(rows, float) for rows in (gains.feedback, gains.filter, gains.a, gains.b, gains.c)
        )
        self._inputs, self._channels = tuple(file.inputs), tuple(file.channels)
        self._u0, self._y0 = (
            np.array([file.operating_point[one] for one in names]) for names in (file.inputs, file.channels)
        )
        self._limits = np.array([file.limits.get(name, np.inf) for name in file.inputs])
        self._x = np.zeros(len(file.states))

    def update(self, readings: Mapping[str, float]) -> dict[str, float]:
        """Inputs for the next sample, from what was read at its beginning; a channel that is not there was not read.
        ValueError for a name that is no channel."""
        if strange := readings.keys() - set(self._channels):
            raise ValueError(f"no channel {min(strange)!r}; known: {', '.join(self._channels)}")
        y = np.array([readings.get(name, np.nan) for name in self._channels])
        off = np.where(np.isfinite(y), y - self._y0 - self._c @ self._x, 0.0)
        self._x = self._x + self._m @ off
        u = np.clip(self._u0 - self._k @ self._x, -self._limits, self._limits)
        self._x = self._a @ self._x + self._b @ (u - self._u0)
        return dict(zip(self._inputs, u.tolist(), strict=True))


@dataclass(frozen=True)
class PlantLoopRun:
    """A closed loop let go beside its operating point: samples (n,) s, channels and inputs by name."""

    t: Array
    nonlinear: Mapping[str, Array]
    linear: Mapping[str, Array]  # of the linear model, without limits

    @property
    def is_finite(self) -> bool:
        """Whether the plant stayed within all bounds."""
        return all(np.isfinite(one).all() for one in self.nonlinear.values())


def ticks_of(slowest: float) -> int:
    """Samples of a run whose slowest pole has this |z|."""
    constant = -1.0 / np.log(slowest) if 0.0 < slowest < 1.0 else MOST
    return int(np.clip(np.ceil(TIME_CONSTANTS * constant), FEWEST, MOST))


def closed_loop(
    plant: Plant,
    file: PlantControllerFile,
    law: LinearLaw,
    x0: ArrayLike,
    off: Mapping[str, float],
    ticks: int,
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
) -> PlantLoopRun:
    """Let the plant go and keep it with a law.

    Parameters
    ----------
    plant : Plant
        A declaration.
    file : PlantControllerFile
        The law.
    law : LinearLaw
        The same with its linear model.
    x0 : array_like, shape (nx,)
        The operating point's state in the plant's order.
    off : mapping of str to float
        By state, how far from it the run begins.
    ticks : int
        Samples.
    effects, values
        Effects on forces and inputs, and parameters with theirs.
    held : mapping of str to float
        Where the inputs stand that the law does not move.

    Returns
    -------
    PlantLoopRun
        What the sensors read and what was asked of the drives; the numbers are not finite where the run leaves all
        bounds.
    """
    h, known = file.sample_time_s, dict(values or plant.values)
    composite, numeric = Composite(plant, effects), NumericPlant(plant, effects, known)
    vector, controller = composite.vector(known), StateFeedback(file)
    rows = [composite.channels.index(name) for name in file.channels]
    start = np.asarray(x0, float) + np.array([off.get(name, 0.0) for name in plant.states])
    inputs = {one.name: (held or {}).get(one.name, 0.0) for one in plant.inputs} | {
        name: file.operating_point[name] for name in file.inputs
    }
    z = composite.beginning(start, next(iter(inputs.values())))
    signals = np.full((ticks, len(file.channels) + len(file.inputs)), np.nan)
    with np.errstate(all="ignore"):
        for k in range(ticks):
            y = np.asarray(composite.reading_function(z, k * h, vector)).ravel()[rows]
            u = controller.update(dict(zip(file.channels, y.tolist(), strict=True)))
            signals[k] = (*y, *u.values())
            if not np.isfinite(signals[k]).all():
                break
            acting = [*(inputs | u).values()]
            z = numeric.advance(z, acting if len(acting) > 1 else acting[0], h, k * h)
    names = (*file.channels, *file.inputs)
    linear = _linear(file, law, [off.get(name, 0.0) for name in law.model.state_labels], ticks)
    return PlantLoopRun(
        np.arange(ticks, dtype=np.float64) * h,
        dict(zip(names, signals.T, strict=True)),
        dict(zip(names, linear.T, strict=True)),
    )


def _linear(file: PlantControllerFile, law: LinearLaw, off: ArrayLike, ticks: int) -> Array:
    """The same of the linear model: readings and inputs (ticks, ny + nu)."""
    a, b, c = (np.asarray(one) for one in (law.model.A, law.model.B, law.model.C))
    x, seen, rows = np.asarray(off, float), np.zeros(len(a)), list[Array]()
    y0, u0 = (np.array([file.operating_point[name] for name in names]) for names in (file.channels, file.inputs))
    for _ in range(ticks):
        y = c @ x
        seen = seen + law.filter @ (y - c @ seen)
        u = -law.feedback @ seen
        rows.append(np.concatenate([y0 + y, u0 + u]))
        x, seen = a @ x + b @ u, a @ seen + b @ u
    return np.array(rows, dtype=np.float64)
