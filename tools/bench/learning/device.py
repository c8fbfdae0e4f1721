"""A sealed device of the proof's generator: it plays a signal of `hoopd experiment` and hands back a recording.

A run ends where the daemon's law would end it: at its limits of speed and angle, the angle as late as pictures are.

Rules of this file: the plant shares no code with what learns; the signal alone is made by the command's own plan. Sizes
are nats of a fast two-level signal of 20 s, so that a campaign begins with what it hardly sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from concealed.batch import Column, columns_of
from concealed.cases import answer, csv_bytes, traces
from concealed.plant import PIECES, SAMPLE_S, Array
from concealed.recipes import TRAINING, Recipe, Wish, draw
from concealed.simulate import WARM, Trace, simulate
from concealed.sizing import find_sizes

from hoopd.core.excitation import BEYOND
from hoopd.core.records import PICTURE_AGE_S
from hoopd.files.controller import parse_controller
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.loop.experiment_plan import DURATION_S, DURATIONS_S, FinishedPlan, Plan, unit_table, write_score
from hoopd.recording import load, save

# The generator sizes over two recordings of 30 s, a campaign's first has 20 s.
OF_ONE_RUN = 20.0 / 60.0
FIRST_NM = 0.1
PLAYED = 2  # the recording of a case that has the length of a run
LIMITS = Plan("prbs")
PICTURE_AGE = ceil(PICTURE_AGE_S / SAMPLE_S)
COAST = 25  # samples that the daemon records while hoop and ball come to rest after a run that a limit ended
OPTIONS = {
    "--amplitude": ("amplitude_nm", float), "--duration": ("duration_s", float), "--clock": ("clock_ticks", int),
    "--low": ("low_hz", float), "--high": ("high_hz", float), "--hold": ("hold_s", float), "--kick": ("kick_s", float),
    "--rest": ("rest_s", float), "--use": ("use_share", float), "--model": ("model", Path),
}  # fmt: skip


@dataclass
class PlayedRecipe(Recipe):
    """A case whose recording is as long as the signal."""

    rows: int = 1000

    def samples(self, recording: int) -> int:
        """Rows of the played recording."""
        return self.rows if recording == PLAYED else super().samples(recording)


@dataclass(frozen=True)
class PlayedRun:
    """What a run did, for the judge alone."""

    most_angle_rad: float
    most_speed_rad_s: float
    most_torque_nm: float


class SealedDevice:
    """One device with what is hidden in it."""

    def __init__(self, effects: tuple[str, ...], nats: tuple[float, float], seed: tuple[int, ...]) -> None:
        family = "null" if not effects else "outside" if effects[0].startswith("outside.") else "single"
        low, high = (one / OF_ONE_RUN for one in nats)
        self.recipe = draw(Wish(family, effects, nats=(low, high)), seed)
        unit = np.concatenate((np.zeros(WARM), unit_table(Plan("prbs", 30.0), 0, SAMPLE_S)))
        for index in TRAINING:
            self.recipe.shapes[index], self.recipe.gains[index] = unit, FIRST_NM
            self.recipe.reached[index] = (0.5, 20.0, FIRST_NM)
        find_sizes([self.recipe])
        self.runs: list[PlayedRun] = []

    def answer(self) -> dict[str, Any]:
        """What is hidden, as the proof's judge reads it."""
        made = traces([self.recipe])
        return answer(self.recipe, [made[self.recipe.identifier, index] for index in range(3)])

    def record(self, words: Sequence[str], number: int, path: Path) -> dict[str, Any]:
        """Play the words of `hoopd experiment` from rest and write the recording; what the command would say of it."""
        score = score_of(words, number)
        torque = torque_of(score)
        trace = self._played(torque, number)
        if (end := stopped_at(trace.states[..., 0])) is not None:
            torque[end:] = 0.0
            torque = torque[: end + COAST]
            trace = _first(self._played(np.pad(torque, (0, len(trace.torque) - len(torque))), number), len(torque))
        table = path.with_suffix(".csv")
        table.write_bytes(csv_bytes(trace))
        save(load(table), path)
        table.unlink()
        states = np.abs(trace.states[..., 0])
        self.runs.append(PlayedRun(states[:, 2].max(), states[:, 1].max(), float(np.abs(torque).max())))
        seconds = float(len(torque) * SAMPLE_S)
        told = {"outcome": "done"} if end is None else {"outcome": f"hoop or ball{BEYOND}a limit"}
        return {**told, "limit_passed": end is not None, "ended_at_s": seconds, "amplitude_nm": score.amplitude_nm}

    def _played(self, torque: Array, number: int) -> Trace:
        told = {one.name: getattr(self.recipe, one.name) for one in fields(Recipe)}
        told["seed"] = (*self.recipe.seed, number)  # noise and disturbance of a run are its own
        recipe = PlayedRecipe(**told, rows=len(torque))
        recipe.shapes[PLAYED] = np.concatenate((np.zeros(WARM), torque))
        recipe.gains[PLAYED] = 1.0
        columns = columns_of([Column(recipe, PLAYED, recipe.sizes)])
        return simulate(replace(columns, start=np.zeros_like(columns.start)))


def stopped_at(states: Array) -> int | None:
    """The sample from which on the daemon's law has no torque; None where no limit is passed.

    states: true ones (samples, 4); the hoop's speed counts at once, the ball's angle as late as the daemon's pictures.
    """
    fast = np.abs(states[:, 1]) > LIMITS.speed_limit_rad_s
    far = np.abs(states[: len(states) - PICTURE_AGE, 2]) > LIMITS.angle_limit_rad
    beyond = np.flatnonzero(fast | np.pad(far, (PICTURE_AGE, 0)))
    return int(beyond[0]) if len(beyond) else None


def _first(trace: Trace, count: int) -> Trace:
    """The first so many samples."""
    history = trace.history[: PIECES * count + 1]
    return replace(trace, history=history, torque=trace.torque[:count], rows=trace.rows[:count])


def score_of(words: Sequence[str], seed: int) -> FinishedPlan:
    """A signal as the command would choose it."""
    told: dict[str, Any] = {"duration_s": DURATIONS_S.get(words[0], DURATION_S), "seed": seed}
    for name, value in zip(words[1::2], words[2::2], strict=True):
        field, kind = OPTIONS[name]
        told[field] = kind(value)
    folder, plan = defaults_folder(), Plan(words[0], **told)
    base = parse_controller((folder / "controllers" / "lqg.yaml").read_text(), "lqg")
    model = plan.model or folder / "models" / "hoop.yaml"
    return write_score(plan, base, model.read_text(), SAMPLE_S)


def torque_of(score: FinishedPlan) -> Array:
    """Torque in N m, a value a tick."""
    return np.array(parse_controller(score.text, "signal").gains["table_nm"], dtype=np.float64)
