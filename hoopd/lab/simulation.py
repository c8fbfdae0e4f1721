"""Free runs of a model.

Rules of this file: thin over `hoopd.plants.hoop.recordings.recorded_runs` and `hoopd.plants.hoop.fitting.fit_percent`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.lab.models import Model, as_model
from hoopd.lab.pictures import Picture
from hoopd.plants.hoop.fitting.fit_percent import FitScore, score
from hoopd.plants.hoop.recordings.fit_data import moving_of, was_measured
from hoopd.plants.hoop.recordings.recorded_runs import RUNAWAY_RAD_S, STATES, Subject, ran_away, simulated
from hoopd.plots.simulation import draw_simulation
from hoopd.recording.recording import Recording, from_columns

Start = Mapping[str, float] | ArrayLike
Torque = Callable[[float], float] | ArrayLike


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
    model: Model | str,
    torque: Recording | tuple[ArrayLike, Torque],
    x0: Start | None = None,
    *,
    window: float | None = None,
    moving: str | None = None,
) -> Simulation:
    """Run the nonlinear model freely under a torque.

    Parameters
    ----------
    model : Model or str
        The plant, or a model by name or path.
    torque : Recording or tuple
        A recording, or (t, u): times (n,) in s and torques in N m held from each to the next (n, or n - 1, or one
        number, or a function of t).
    x0 : mapping or array_like, shape (4,), optional
        Start as {"psi": 0.4} or (theta, dtheta, psi, dpsi); without it estimated from the recording, or rest.
    window : float, optional
        Start anew every so many seconds.
    moving : {"both", "hoop", "ball"}, optional
        What moves, where the recording shall not say it.

    Returns
    -------
    Simulation
        `states` (n, 4) at `t` (n,), and the `fit` in percent by channel where something was measured.

    Raises
    ------
    ValueError
        Times, torques or a start that do not fit, and a run that leaves every bound.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> decay = lab.simulate("hoop", ([0, 0.1, 0.2], 0.0), x0={"psi": 1.0})
    >>> decay.states.shape, round(float(decay.states[-1, 2]), 3)
    ((3, 4), -0.075)
    """
    own = as_model(model)
    recording = torque if isinstance(torque, Recording) else _only_torque(*_pair(torque))
    measured = was_measured(recording)
    start = ({} if not measured else None) if x0 is None else _named(x0)
    what = moving or (moving_of(recording, own.file.device.encoder_counts) if measured else "both")
    found = score(_subject(own), recording, window_s=window, start=start, moving=what)
    if ran_away(found.runs):
        raise ValueError(f"the free run of {own.name} leaves every bound (above {RUNAWAY_RAD_S:g} rad/s)")
    return Simulation(own, recording, found)


def _subject(model: Model) -> Subject:
    return Subject(model.structure, model.parameters)


def _pair(torque: Any) -> tuple[ArrayLike, Torque]:
    if not isinstance(torque, tuple | list) or len(torque) != 2:
        raise ValueError("simulate takes a recording or a pair (t, u)")
    return torque[0], torque[1]


def _only_torque(t: ArrayLike, u: Torque) -> Recording:
    times = np.asarray(t, float)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise ValueError("the times must be one row of at least two that increase")
    held = np.asarray([u(float(one)) for one in times] if callable(u) else u, float)
    if held.ndim == 1 and len(held) == len(times) - 1:
        held = np.append(held, held[-1])
    if held.shape not in ((), times.shape) or not np.isfinite(held).all():
        raise ValueError(f"expected one finite torque for each of {len(times)} times, not {held.shape}")
    return from_columns({"t": times, "u": np.broadcast_to(held, times.shape)}, source="torque")


def _named(x0: Start) -> dict[str, float]:
    if isinstance(x0, Mapping):
        unknown = [str(name) for name in x0 if name not in STATES]
        if unknown:
            raise ValueError(f"x0: unknown {', '.join(unknown)}; known: {', '.join(STATES)}")
        return {str(name): float(value) for name, value in x0.items()}
    values = np.asarray(x0, float)
    if values.shape != (4,):
        raise ValueError(f"x0 must be (theta, dtheta, psi, dpsi), not of shape {values.shape}")
    return dict(zip(STATES, values.tolist(), strict=True))
