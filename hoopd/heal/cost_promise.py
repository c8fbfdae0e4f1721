"""What a loop costs, and what it was promised to cost: the same references on the model that was found, in simulation.

The promise is of those very references, so that an operator may move the ball as he likes meanwhile.

Rules of this file: seeded; both are summed up by the yardstick of `hoopd compare`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hoopd.core.modes import Mode
from hoopd.design.yardstick import BlockFigures, HeldSpeed, TickSample, Yardstick, held_speed
from hoopd.files.controller import ControllerFile, load_controller
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.closed_loop import LateTorque, Moving, Scenario, picture_timing
from hoopd.plants.hoop.loop.trial import run
from hoopd.plants.hoop.loop.writeback import delays_of, filter_plant
from hoopd.plants.model_file import effects_of, load_model, plant_of
from hoopd.recording.recording import Recording

# A laboratory's picture on its arrival, as `hoopd design` takes it.
DELAY_S = 0.04


@dataclass(frozen=True)
class LoopCosts:
    """Of the same seconds: as measured, and by simulation on the found model with the law of before and the new one.

    `seconds`: of the recording in which the law acted, and of which pictures tell.
    """

    measured: float
    before: float
    new: float
    seconds: float


def loop_costs(recording: Recording, before: Path, new: Path, by: str) -> LoopCosts:
    """Costs of a recording's seconds; `before`, `new`: folders of versions, `by`: one of `design.comparison.MEASURES`.

    The law that acts in the recording is one of the two; both are simulated on the model of `new`.
    """
    file = load_controller(before / "controller.yaml")
    held = held_speed(file.gains)
    truth = effects_of(load_model(new / "model.yaml"))
    measured = _measured(recording, held)
    return LoopCosts(
        figure(measured, by),
        _simulated(recording, before, truth, held, by),
        _simulated(recording, new, truth, held, by),
        measured.ticks * file.sample_time_s if measured.pictures else 0.0,
    )


def _measured(recording: Recording, held: HeldSpeed | None) -> BlockFigures:
    mode, wanted = recording.extra["mode"], recording.extra["reference"]
    ball = recording.channels["psi"]
    rows = zip(
        recording.t.tolist(), mode.tolist(), recording.column("u").tolist(), recording.column("dtheta").tolist(),
        ball.values.tolist(), ball.t.tolist(), wanted.tolist(), strict=True,
    )  # fmt: skip
    return summed((TickSample(t, one == Mode.RUNNING, *rest) for t, one, *rest in rows), held)


def _simulated(recording: Recording, version: Path, truth: FoundEffects, held: HeldSpeed | None, by: str) -> float:
    """The law of a version on the model that was found, asked for what the recording was asked for."""
    file, model = load_controller(version / "controller.yaml"), load_model(version / "model.yaml")
    known, times, wanted = effects_of(model), recording.t - recording.t[0], recording.extra["reference"]

    def reference(t: float) -> float:
        return float(wanted[max(0, int(np.searchsorted(times, t + 1e-9, side="right")) - 1)])

    scenario = Scenario(
        duration_s=float(times[-1]),
        period_s=file.sample_time_s,
        latency_s=delays_of(truth).camera_s,
        reference=reference,
        **picture_timing(DELAY_S, file.sample_time_s),  # type: ignore[arg-type]
    )
    made = run(file, plant_of(model), _moving(truth, known), scenario, known=known or None)
    rows = zip(made.t.tolist(), made.u.tolist(), made.x.tolist(), strict=True)
    return figure(summed((TickSample(t, True, u, x[1], x[2], t, reference(t)) for t, u, x in rows), held), by)


def _moving(truth: FoundEffects, known: FoundEffects) -> Moving:
    """The plant as found; where the law knows of a late torque, its run delays it by itself."""
    plant, late_s = filter_plant(truth), delays_of(truth).torque_s
    return LateTorque(plant, late_s) if late_s > 0.0 and delays_of(known).torque_s <= 0.0 else plant


def summed(samples: Iterable[TickSample], held: HeldSpeed | None) -> BlockFigures:
    """Figures of some ticks."""
    yardstick = Yardstick(held=held)
    yardstick.begin()
    for sample in samples:
        yardstick.put(sample, counts=sample.running)
    return yardstick.figures


def figure(figures: BlockFigures, by: str) -> float:
    """What decides, of all figures."""
    return figures.cost if by == "cost" else figures.ball_rms_rad


def controller_kind(version: Path) -> str:
    """Which law a version has."""
    file: ControllerFile = load_controller(version / "controller.yaml")
    return file.kind
