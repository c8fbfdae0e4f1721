"""Free runs of a model of any plant.

Rules of this file: `hoopd simulate` on recordings in memory; nothing is computed here.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.simulate import check_step, moved
from hoopd.commands.simulate_plant import asked_system
from hoopd.lab.models import Model, as_model, check_of_hoop, model_of
from hoopd.lab.pictures import Picture
from hoopd.lab.plant_fits import PlantRun
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.hoop.fitting.fit_percent import FitScore, score
from hoopd.plants.hoop.recordings.fit_data import was_measured
from hoopd.plants.hoop.recordings.recorded_runs import RUNAWAY_RAD_S, STATES, Subject, ran_away, simulated
from hoopd.plants.plant_model import PlantModel
from hoopd.plots.simulation import draw_simulation
from hoopd.recording.recording import Recording, from_columns, from_signals

Start = Mapping[str, float] | ArrayLike
Values = Callable[[float], float] | ArrayLike
Inputs = Recording | tuple[ArrayLike, Values | Mapping[str, Values]]


@dataclass(frozen=True, repr=False)
class Simulation:
    """A model's free run."""

    model: Model
    input: Recording
    score: FitScore

    def __repr__(self) -> str:
        fits = ", ".join(f"{name} {percent:.1f} %" for name, percent in self.fit.items())
        return f"Simulation({self.model.name} over {self.input.source}{': ' if fits else ''}{fits})"

    @property
    def t(self) -> NDArray[np.float64]:
        """Times (n,) in s."""
        return np.concatenate([run.part.t for run in self.score.runs])

    @property
    def states(self) -> NDArray[np.float64]:
        """States (n, 4): theta (rad), dtheta (rad/s), psi (rad), dpsi (rad/s)."""
        return np.vstack([run.states for run in self.score.runs])

    @property
    def fit(self) -> dict[str, float]:
        """Percent of fit per channel, 100 is perfect; empty where nothing was measured."""
        return self.score.nrmse_percent

    @property
    def recording(self) -> Recording:
        """The run as a recording: what the sensors would have shown."""
        return simulated(_subject(self.model), self.input, self.score.runs, self.score.moving)

    def plot(self) -> Picture:
        """Torque, hoop speed and ball angle, measured and simulated."""
        return Picture(draw_simulation(self.score, self.input, self.model.name))


def simulate(
    model: Model | PlantModel | Path | str | None = None,
    input: Inputs | None = None,
    x0: Start | None = None,
    *,
    plant: Plant | str | None = None,
    step: float | None = None,
    window: float | None = None,
    moving: str = "auto",
    without_effects: bool = False,
    torque: Inputs | None = None,
) -> Simulation | PlantRun:
    """Run the nonlinear model of any plant freely under its inputs.

    Parameters
    ----------
    model : Model, str or Path, optional
        A model, its name or its path; another plant's nominal values unless given.
    input : Recording or tuple
        A recording, or (t, u): times (n,) in s and the input (of the hoop the torque in N m) held from each to the next
        (n, or n - 1, or one number, or a function of t); of a plant with several inputs u is a mapping by name.
    x0 : mapping or array_like, shape (nx,), optional
        Start as {"psi": 0.4}, the rest 0, or all states in their order (of the hoop theta, dtheta, psi, dpsi);
        without it estimated from the recording, or rest.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the model's unless given.
    step : float, optional
        Longest integration step in s; 0.01, of another plant half of its usual sample time unless given.
    window : float, optional
        Of the hoop: start anew every so many seconds.
    moving : {"auto", "both", "hoop", "ball"}
        Of the hoop: what moves, where the recording shall not say it.
    without_effects : bool
        Leave the model's effects out.
    torque : Recording or tuple, optional
        The former name of `input`.

    Returns
    -------
    Simulation or PlantRun
        Of the hoop `states` (n, 4) at `t` (n,), and the `fit` in percent by channel where something was measured; of
        another plant what its sensors would have shown as `recorded`, and `percent` of fit by channel.

    Raises
    ------
    ValueError
        Times, inputs or a start that do not fit, and a run that leaves every bound.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> decay = lab.simulate("hoop", ([0, 0.1, 0.2], 0.0), x0={"psi": 1.0})
    >>> decay.states.shape, round(float(decay.states[-1, 2]), 3)
    ((3, 4), -0.075)
    >>> filled = lab.simulate(plant="tanks", input=(range(60), 5e-5))
    >>> bool(filled.recorded.channels["h1"].values[-1] > 0.05)
    True
    """
    if torque is not None:
        warnings.warn("simulate: torque is now input", DeprecationWarning, stacklevel=2)
    given = input if torque is None else torque
    asked = from_python(SimulateOptions, input="", step=step, moving=moving, without_effects=without_effects)
    if (other := model_of(plant, model)) is not None:
        if window is not None:
            raise ValueError("window is of the hoop")
        return _other_plant(other, given, x0, asked)
    if model is None or isinstance(model, PlantModel):
        raise ValueError("simulate takes a model, or another plant than the hoop: simulate(plant='axis', input=run)")
    check_step(asked.step_s)
    own = as_model(model)
    recording = given if isinstance(given, Recording) else _only_torque(*_pair(given))
    check_of_hoop([recording])
    start = ({} if not was_measured(recording) else None) if x0 is None else _named(x0, STATES)
    what = moved(recording, asked.moving, own.file.device.encoder_counts)
    subject = Subject(own.structure, own.parameters, step_s=asked.step_s)
    found = score(subject, recording, window_s=window, start=start, moving=what)
    if ran_away(found.runs):
        raise ValueError(f"the free run of {own.name} leaves every bound (above {RUNAWAY_RAD_S:g} rad/s)")
    return Simulation(own, recording, found)


def _other_plant(model: PlantModel, given: Inputs | None, x0: Start | None, asked: SimulateOptions) -> PlantRun:
    system, _ = asked_system(model, asked)
    plant = model.plant
    recording = given if isinstance(given, Recording) else _only_inputs(*_pair(given), plant)
    start = None if x0 is None else _named(x0, plant.states)
    return PlantRun(simulate_plant(system, recording, start), recording, plant.name)


def _subject(model: Model) -> Subject:
    return Subject(model.structure, model.parameters)


def _pair(given: Any) -> tuple[Any, Any]:
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise ValueError("simulate takes a recording or a pair (t, u)")
    return given[0], given[1]


def _only_torque(t: ArrayLike, u: Values) -> Recording:
    times = _times(t)
    return from_columns({"t": times, "u": _held(times, u, "torque")}, source="torque")


def _only_inputs(t: ArrayLike, u: Values | Mapping[str, Values], plant: Plant) -> Recording:
    names = [one.name for one in plant.inputs]
    given = u if isinstance(u, Mapping) else {names[0]: u} if len(names) == 1 else {}
    if given.keys() != set(names):
        raise ValueError(f"u of {plant.name} is a mapping of {', '.join(names) or 'nothing'}, not {u!r}")
    times = _times(t)
    return from_signals(times, {name: _held(times, one, name) for name, one in given.items()}, {}, source="inputs")


def _times(t: ArrayLike) -> NDArray[np.float64]:
    times = np.asarray(t, float)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise ValueError("the times must be one row of at least two that increase")
    return times


def _held(times: NDArray[np.float64], u: Values, name: str) -> NDArray[np.float64]:
    """A value for each of the times (n,)."""
    held = np.asarray([u(float(one)) for one in times] if callable(u) else u, float)
    if held.ndim == 1 and len(held) == len(times) - 1:
        held = np.append(held, held[-1])
    if held.shape not in ((), times.shape) or not np.isfinite(held).all():
        raise ValueError(f"expected one finite {name} for each of {len(times)} times, not {held.shape}")
    return np.broadcast_to(held, times.shape)


def _named(x0: Start, states: Sequence[str]) -> dict[str, float]:
    if isinstance(x0, Mapping):
        unknown = [str(name) for name in x0 if name not in states]
        if unknown:
            raise ValueError(f"x0: unknown {', '.join(unknown)}; known: {', '.join(states)}")
        return {str(name): float(value) for name, value in x0.items()}
    values = np.asarray(x0, float)
    if values.shape != (len(states),):
        raise ValueError(f"x0 must be ({', '.join(states)}), not of shape {values.shape}")
    return dict(zip(states, values.tolist(), strict=True))
