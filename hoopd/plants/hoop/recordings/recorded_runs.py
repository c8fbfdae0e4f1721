"""Free runs of a model with the torque of a recording: where they start, and what the sensors would have seen.

Rules of this file: a start is given or estimated from the recording's own samples, never guessed silently; a
simulated value belongs to the instant at which the sensor was read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.plants.fits.arbitrary_zero import SHORT_SAMPLES, ZeroedModel, badness, fitted_zero, waves
from hoopd.plants.fits.output_error import Solution
from hoopd.plants.fits.runs import Run, RunModel
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.fitting.hoop_output_error import HoopSystem, fit_output_error
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.recordings.fit_data import STATES as COLUMNS, channels_of, pieces, run_of
from hoopd.plants.hoop.simulate import STEP_S, HoopModel
from hoopd.recording.recording import Recording
from hoopd.recording.timeline import SAME_S, TIMES, Timeline, begin_of, timelines

Array = NDArray[np.float64]

STATES = ("theta", "dtheta", "psi", "dpsi")
# What estimates a start: the column dtheta is data to be judged and gets no vote.
START_CHANNELS = ("theta_rate", "psi")
# Over so many seconds alone a start is found that a whole run, in which a ball goes round, leads astray.
BEGINNING_S = 2.0
# A model that swings off the ball's frequency fits no start near the data's own: others are tried on a ring of swings.
PHASES, AMPLITUDES = 8, (0.0, 0.5, 1.0, 2.0)

# Faster than any hoop of this device: what gets there has left the model's range.
RUNAWAY_RAD_S = 1e4


@dataclass(frozen=True)
class Subject:
    """What is simulated: a structure with numbers, and the longest integration step."""

    structure: str  # entries, rolling or published
    values: Mapping[str, float]
    extra_forces: tuple[ExtraForce, ...] = ()
    step_s: float = STEP_S
    effects: FoundEffects | None = None  # beside the base; what is simulated are then the sensors' readings
    zero: float | None = None  # of the recording's theta against that of the effects; None: not known yet

    def model(self, moving: str) -> RunModel:
        """Nothing left free; `moving`: both, hoop or ball."""
        model = HoopModel(
            self.structure, self.values, (), self.extra_forces, self.effects, moving=moving, step_s=self.step_s
        )
        return ZeroedModel(model, HoopSystem.THETA, self.zero, free=False) if self.zero else model

    def in_recording(self, recording: Recording, moving: str) -> Subject:
        """With the zero of its theta, where effects follow theta and the recording says something about it."""
        plant = hoop_plant(self.structure, self.values, moving)
        follows = waves(plant, self.effects.effects(plant), self.effects.values) if self.effects else {}
        if self.zero is not None or "theta" not in follows:
            return self
        channels = channels_of(moving, START_CHANNELS)
        found = [
            run_of(recording, part, moving, channels) for part in pieces(recording, SHORT_SAMPLES * plant.time_scale_s)
        ]
        runs = [run for run in found if run is not None]
        if not runs:
            return self
        system = HoopSystem(self.structure, self.values, self.extra_forces, self.effects)
        return replace(self, zero=fitted_zero(system, HoopSystem.THETA, follows["theta"], runs))


@dataclass(frozen=True)
class SimulatedStretch:
    """One stretch simulated from its start."""

    part: Timeline
    start: Array  # (4,)
    states: Array  # (n, 4) at the nodes part.t


def free_runs(
    subject: Subject,
    recording: Recording,
    moving: str,
    *,
    window_s: float | None = None,
    start: Mapping[str, float] | None = None,
) -> list[SimulatedStretch]:
    """Every stretch (or window) of the recording, each from an estimated start; `start` gives the states instead
    (those it does not name are 0, theta its first sample). InputError when there is nothing to run."""
    parts = pieces(recording, window_s)
    if start is not None:
        if len(parts) > 1:
            raise InputError(
                recording.source, "start", f"one start is given and there are {len(parts)} stretches: cut it"
            )
        return run_from(subject, parts, [given_start(parts[0], start)], moving, begin_of(recording))
    channels = channels_of(moving, START_CHANNELS)
    ready = [(part, run) for part in parts if (run := run_of(recording, part, moving, channels)) is not None]
    if not ready:
        raise InputError(recording.source, ", ".join(channels), "too few samples to estimate a start: give one")
    starts = estimated_starts(subject, [run for _, run in ready], search=window_s is None)
    runs = run_from(subject, [part for part, _ in ready], starts, moving, begin_of(recording))
    # a force may depend on theta: then a turned run would be another run
    return runs if subject.extra_forces or subject.effects else [_through_first_theta(run) for run in runs]


def _through_first_theta(run: SimulatedStretch) -> SimulatedStretch:
    """The run turned to meet the first theta: its rate says nothing of where the hoop stood."""
    nodes, values = run.part.channels["theta"]
    if len(nodes) == 0:
        return run
    turn = np.array([values[0] - run.states[nodes[0], 0], 0.0, 0.0, 0.0])
    return SimulatedStretch(run.part, run.start + turn, run.states + turn)


def given_start(part: Timeline, start: Mapping[str, float]) -> Array:
    """State (4,) of named components."""
    first = part.channels["theta"].values[:1]
    values = {"theta": float(first[0]) if len(first) else 0.0, **start}
    return np.array([values.get(name, 0.0) for name in STATES])


def run_from(
    subject: Subject, parts: Sequence[Timeline], starts: Sequence[Array], moving: str, begin_s: float
) -> list[SimulatedStretch]:
    """The stretches simulated from these states; `begin_s`: of their recording."""
    model = subject.model(moving)
    return [
        SimulatedStretch(part, start, model.run((), start, part.t - begin_s, part.u))
        for part, start in zip(parts, starts, strict=True)
    ]


def ran_away(runs: Sequence[SimulatedStretch]) -> bool:
    """Whether a state has left every bound."""
    states = np.vstack([run.states for run in runs])
    return not np.isfinite(states).all() or float(np.abs(states[:, [1, 3]]).max()) > RUNAWAY_RAD_S


# ---------------------------------------------------------------------------------------------- starts


def estimated_starts(subject: Subject, runs: Sequence[Run], *, search: bool = True) -> list[Array]:
    """Initial states (4,) that make the free runs fit best in least squares; `search`: from several first guesses."""
    guesses = [list(runs)]
    nearest = [_best_guess(subject, run) if search else run.start for run in runs]
    if any(found is not run.start for found, run in zip(nearest, runs, strict=True)):
        guesses.append([replace(run, start=found) for found, run in zip(nearest, runs, strict=True)])
    return min((_fitted(subject, guess) for guess in guesses), key=badness).starts


def _fitted(subject: Subject, runs: Sequence[Run]) -> Solution:
    return fit_output_error(
        subject.structure, subject.values, (), runs, extra_forces=subject.extra_forces, effects=subject.effects,
        zero=subject.zero or 0.0,
    )  # fmt: skip


def _best_guess(subject: Subject, run: Run) -> Array:
    """The data's own start, or the swing whose free run comes nearest."""
    if "psi" not in run.series or run.moving == "hoop":
        return run.start
    model, spread = subject.model(run.moving), float(np.std(run.series["psi"].values))
    swing_rad_s = _swing_rad_s(subject)
    swings = [(0.0, 0.0)] + [
        (a * spread * np.cos(phase), a * spread * swing_rad_s * np.sin(phase))
        for a in AMPLITUDES[1:]
        for phase in np.arange(PHASES) * 2.0 * np.pi / PHASES
    ]
    first = run.beginning(BEGINNING_S)
    soon = _fitted(subject, [first]).starts if "psi" in first.series else []
    guesses = [run.start, *soon, *(np.array([*run.start[:2], psi, dpsi]) for psi, dpsi in swings)]
    return min(guesses, key=lambda start: _misfit(model, run, start))


def _swing_rad_s(subject: Subject) -> float:
    """Frequency of the ball's small swings: sqrt(-d psi''/d psi)."""
    own = {name: subject.values[name] for name in PARAMETER_UNITS[subject.structure]}
    stiffness = -HoopPlant(subject.structure, own).linearize()[0][3, 2]
    return float(np.sqrt(max(stiffness, 1.0)))


def _misfit(model: RunModel, run: Run, start: Array) -> float:
    """Squared errors of all channels, each by the spread of its samples."""
    states = model.run((), start, run.t, run.u)
    parts = [
        float(np.mean((s.of(states[:, COLUMNS[s.name]]) - s.values) ** 2)) / max(float(np.var(s.values)), 1e-12)
        for s in run.series.values()
    ]
    return float(np.nan_to_num(sum(parts), nan=np.inf))


# ---------------------------------------------------------------------------------------------- as a recording


def simulated(subject: Subject, recording: Recording, runs: Sequence[SimulatedStretch], moving: str) -> Recording:
    """What the sensors would have shown: the recording's rows, times and torque with simulated theta, dtheta, psi.

    A sample without a time of its own is taken at its row's t; rows outside of the runs are missing.
    """
    whole = _with_every_sample(recording)
    starts = {round(run.part.t[0] / SAME_S): run.start for run in runs}
    parts = [part for part in timelines(whole) if round(part.t[0] / SAME_S) in starts]
    begun = [starts[round(part.t[0] / SAME_S)] for part in parts]
    again = run_from(subject, parts, begun, moving, begin_of(recording))
    theta, dtheta, psi = (_at(again, STATES.index(n), getattr(whole, TIMES[n])) for n in ("theta", "dtheta", "psi"))
    source = f"simulated from {recording.source}"
    return whole.replaced(
        theta=theta, dtheta=dtheta, psi=psi, current=_missing(whole), source=source, extra={}, lost=""
    )


def _with_every_sample(recording: Recording) -> Recording:
    """The same rows with nothing missing among angles and their times, so that each row has its node."""
    y_t, psi_t = (np.where(np.isfinite(t), t, recording.t) for t in (recording.y_t, recording.psi_t))
    nothing = np.zeros(len(recording))
    return recording.replaced(theta=nothing, dtheta=nothing, psi=nothing, y_t=y_t, psi_t=psi_t)


def _missing(recording: Recording) -> Array:
    return np.full(len(recording), np.nan)


def _at(runs: Sequence[SimulatedStretch], state: int, when: Array) -> Array:
    """One state at these times, NaN outside of the runs."""
    out = np.full(len(when), np.nan)
    for run in runs:
        t = run.part.t
        inside = (when >= t[0] - SAME_S) & (when <= t[-1] + SAME_S)
        out[inside] = run.states[np.searchsorted(t, when[inside] - SAME_S), state]
    return out
