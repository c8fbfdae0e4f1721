"""A fit of any declared plant to its recordings: parameters with intervals, and how well free runs repeat each channel.

Rules of this file: it chooses and composes; the mathematics is in the modules beside it; no files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.nrmse import nrmse_percent
from hoopd.plants.fits.output_error import Progress, Solution, fit_output_error
from hoopd.plants.fits.plant_runs import PlantSystem, prepare_runs, stretches_of
from hoopd.plants.fits.robust_least_squares import LOSSES
from hoopd.plants.fits.runs import Run
from hoopd.plants.fits.uncertainty import Uncertainty, intervals, uncertainty
from hoopd.plants.fits.undetermined import Direction, data_covariance
from hoopd.plants.likelihood.fitting import fit as fit_likelihood
from hoopd.plants.likelihood.reading_interval import spaced
from hoopd.plants.likelihood.stretch_scatter import half_widths
from hoopd.plants.likelihood.stretches import stretch_of
from hoopd.recording.board_limits import torque_slew
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]

METHODS = ("output", "prediction")
# A first fit in short runs, whose starts are known from the data, brings the long run's search near its end: so many
# of the plant's usual sample times, and no more than so many runs of a recording.
FIRST_WINDOW_SAMPLES, MOST_FIRST_RUNS = 100, 10
# Fits that only bring the next one near its end stop at a step that gains less than this share of the cost.
NEAR_GAIN = 1e-5
DIVERGED = "no finite result from these values; look at the plant's nominal values and bounds, or fix some parameters"


@dataclass(frozen=True)
class ChannelFit:
    """How well a free run repeats a channel of a recording; NaN where the measurement never changes."""

    nrmse_percent: float
    rmse: float  # in the channel's unit
    unit: str
    samples: int

    @classmethod
    def between(cls, measured: Array, simulated: Array, unit: str) -> ChannelFit:
        """Of values (k,) at the same instants."""
        rmse = float(np.sqrt(np.mean((measured - simulated) ** 2))) if len(measured) else float("nan")
        return cls(nrmse_percent(measured, simulated), rmse, unit, len(measured))


@dataclass(frozen=True)
class PlantFit:
    """A fitted plant: values, how well they are known, and what they were fitted to."""

    system: PlantSystem
    method: str
    names: tuple[str, ...]  # what was fitted
    values: Mapping[str, float]  # every parameter
    nominal: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]  # 95 %, of the fitted ones that are determined
    solution: Solution  # free runs at the values found
    uncertainty: Uncertainty | None  # of an output-error fit with parameters
    runs: tuple[Run, ...]

    @property
    def undetermined(self) -> list[Direction]:
        """Relative changes of the fitted parameters that the data of an output-error fit hardly notice."""
        if self.uncertainty is None:
            return []
        return data_covariance(self.solution, self.uncertainty).directions(self.names)

    @property
    def fitted(self) -> PlantSystem:
        """The plant at the values found."""
        return replace(self.system, changed=dict(self.values))

    @property
    def percent(self) -> dict[str, dict[str, ChannelFit]]:
        """Fit by recording and channel."""
        return channel_fits(self.system.plant, self.runs, self.solution)


def fit_plant(
    plant: Plant,
    recordings: Recording | Sequence[Recording],
    free: Sequence[str] | None = None,
    method: str = "output",
    *,
    effects: Sequence[Effect] = (),
    values: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
    channels: Sequence[str] = (),
    window_s: float | None = None,
    loss: str = "linear",
    progress: Progress = lambda text: None,
) -> PlantFit:
    """Parameters of a plant, and where each recording started.

    Parameters
    ----------
    plant
        Any declared plant.
    recordings
        One or several of it; inputs and channels carry the plant's names.
    free
        What is fitted; the plant's own choice without it; an empty one fits the starts alone.
    method
        "output": free runs; "prediction": the likelihood of a filter's innovations, with a disturbance on every
        coordinate, whose size is found along.
    effects
        What the plant has beside its equations; their parameters may be free, too.
    values
        Where parameters begin (or stay) in place of their nominal values.
    priors
        What is believed beforehand, by name; output-error fits only.
    channels
        What is compared; every channel that a recording has without it.
    window_s
        Runs of so many seconds with a start each, in place of one free run a stretch.
    loss
        linear, huber, soft_l1 or cauchy; output-error fits only.
    progress
        Is told a line a step of the work.

    Returns
    -------
    PlantFit

    Raises
    ------
    InputError
        A parameter that is none, a recording that holds nothing to fit, or numbers that leave every bound.

    Examples
    --------
    A mass with friction, pushed back and forth; its way is read with noise:

    >>> import numpy as np
    >>> from hoopd.plants.declaration import Channel, Input, Plant
    >>> from hoopd.plants.free_run import FreeRun
    >>> from hoopd.recording.recording import from_signals
    >>> plant = Plant(
    ...     name="slide", coordinates=("x",), accelerations=lambda s, force: (force - s.p["d"] * s.dx) / s.p["m"],
    ...     values={"m": 2.0, "d": 1.0}, free=("m", "d"), bounds={"m": (0.1, 100.0)},
    ...     inputs=(Input("F", "N", coordinate="x"),), channels={"x": Channel("x", "m")},
    ... )
    >>> t, rng = np.arange(0.0, 6.0, 0.02), np.random.default_rng(0)
    >>> F = np.sign(np.sin(2.0 * t))
    >>> true = FreeRun(plant, values={"m": 3.0, "d": 0.5})
    >>> x = true.run([], [0.1, 0.0], t, F[:-1]).readings[:, 0] + 1e-3 * rng.normal(size=len(t))
    >>> fit = fit_plant(plant, from_signals(t, {"F": F}, {"x": x}))
    >>> [low < truth < high for truth, (low, high) in zip((3.0, 0.5), fit.intervals.values())]
    [True, True]
    """
    together = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    compared = replace(plant, channels={n: c for n, c in plant.channels.items() if n in (channels or plant.channels)})
    system = PlantSystem(compared, tuple(effects), dict(values or {}))
    names = _free_names(system, free)
    for option, word, known in (("--method", method, METHODS), ("--loss", loss, LOSSES)):
        if word not in known:
            raise InputError(option, "", f"unknown {word!r}; known: {', '.join(known)}")
    runs = prepare_runs(compared, together, window_s)
    try:
        if method == "prediction" and names:
            found = _by_likelihood(system, names, together, runs, progress)
        else:
            found = _by_free_runs(system, names, together, system.begun(runs), priors or {}, loss, progress)
        return replace(found, system=replace(system, plant=plant))
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise InputError(plant.name, "", f"{DIVERGED} ({error})") from None


def fit_starts(system: PlantSystem, recording: Recording, window_s: float | None = None) -> tuple[list[Run], Solution]:
    """Free runs over a recording, each from the start that fits it best; nothing else is fitted."""
    runs = system.begun(prepare_runs(system.plant, [recording], window_s))
    return runs, fit_output_error(system, (), runs)


def channel_fits(plant: Plant, runs: Sequence[Run], solution: Solution) -> dict[str, dict[str, ChannelFit]]:
    """Fit of free runs by recording and channel."""
    out: dict[str, dict[str, ChannelFit]] = {}
    for source in dict.fromkeys(run.recording for run in runs):
        same = [(run, e) for run, e in zip(runs, solution.residuals, strict=True) if run.recording == source]
        for channel, declared in plant.channels.items():
            parts = [(run.series[channel].values, e[channel]) for run, e in same if channel in run.series]
            if parts:
                measured, errors = (np.concatenate(column) for column in zip(*parts, strict=True))
                fit = ChannelFit.between(measured, measured + errors, declared.unit)
                out.setdefault(source, {})[channel] = fit
    return out


def _free_names(system: PlantSystem, free: Sequence[str] | None) -> tuple[str, ...]:
    known = system.nominal
    for name in (*(free or ()), *system.changed):
        if name not in known:
            raise InputError(name, "", f"not a parameter of {system.plant.name}; known: {', '.join(known)}")
    return tuple(system.plant.free if free is None else free)


# ---------------------------------------------------------------------------------------------- methods


def _by_free_runs(
    system: PlantSystem, names: tuple[str, ...], recordings: Sequence[Recording], runs: list[Run],
    priors: Mapping[str, Prior], loss: str, progress: Progress,
) -> PlantFit:  # fmt: skip
    near = _near(system, names, recordings, runs, priors, progress)
    solution = fit_output_error(near, names, runs, priors=priors, loss=loss, progress=progress)
    if not all(np.isfinite(e @ e) for run in solution.residuals for e in run.values()):
        raise ArithmeticError("the free run leaves every bound")
    known = uncertainty(solution, loss) if names else None
    ends = intervals(solution, known) if known is not None else {}
    found = PlantFit(system, "output", names, solution.values, system.nominal, ends, solution, known, tuple(runs))
    untold = {name for direction in found.undetermined for name in direction.shown}
    return replace(found, intervals={name: one for name, one in ends.items() if name not in untold})


def _near(
    system: PlantSystem, names: tuple[str, ...], recordings: Sequence[Recording], runs: Sequence[Run],
    priors: Mapping[str, Prior], progress: Progress,
) -> PlantSystem:  # fmt: skip
    """The plant after a quick fit in short runs, from which a long one does not go astray."""
    longest = max(float(run.t[-1] - run.t[0]) for run in runs)
    window_s = max(FIRST_WINDOW_SAMPLES * system.plant.time_scale_s, longest / MOST_FIRST_RUNS)
    if not names or longest < 2.0 * window_s:
        return system
    short = system.begun(prepare_runs(system.plant, recordings, window_s))
    progress(f"first in {len(short)} runs of {window_s:g} s")
    found = fit_output_error(
        system, names, short, priors=priors, loss="soft_l1", rounds=1, smallest_gain=NEAR_GAIN, progress=progress
    )
    return replace(system, changed=found.values)


def _by_likelihood(
    system: PlantSystem, names: tuple[str, ...], recordings: Sequence[Recording], runs: list[Run], progress: Progress
) -> PlantFit:
    """The diagnosis's engine: parameters, trajectory and the sizes of noise and disturbances together."""
    stretches = [
        replace(
            spaced(stretch_of(f"{index}", system.plant, part.t, _inputs(part.u), part.channels)),
            slew=torque_slew(recording),
        )
        for index, recording in enumerate(recordings)
        for part in stretches_of(system.plant, recording)
    ]
    near = _near(system, names, recordings, runs, {}, progress)
    progress("likelihood of the innovations")
    found = fit_likelihood(stretches, system.effects, near.values, free=names)
    if not np.isfinite(found.criterion):
        raise ArithmeticError("the filter leaves every bound")
    values = {name: found.values.get(name, value) for name, value in system.values.items()}
    solution = fit_output_error(replace(system, changed=values), (), runs, progress=progress)
    widths = half_widths(found)
    ends = {name: _interval(values[name], widths[name], system.bounds.get(name)) for name in names}
    return PlantFit(system, "prediction", names, values, system.nominal, ends, solution, None, tuple(runs))


def _inputs(u: Array) -> Array:
    """One input, or none as one that is never there."""
    return np.zeros(len(u)) if u.ndim > 1 and u.shape[1] == 0 else u


def _interval(value: float, half: float, bounds: tuple[float, float] | None) -> tuple[float, float]:
    low, high = bounds or (-np.inf, np.inf)
    return max(value - half, low), min(value + half, high)
