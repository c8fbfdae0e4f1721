"""The rig in lock-step: the agent stands where the daemon's control law stands, and sees what that would see.

The observation is the filter's estimate, carried on by the filter's model to the tick in which the action acts; what
the sensors bring in that very tick is seen a tick later. Instead of the ball's distance, which no sensor tells, its
last number is 1 where the newest picture shows a ball on the hoop, else 0. A try is judged by the rig's true state.

Rules of this file: a try is a run of its own, with its own seed; a fault that takes the drive away ends it.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.daemon.build import Texts, read_texts
from hoopd.daemon.stepped_rig import SteppedRig
from hoopd.gym.hidden_physics import physics_of
from hoopd.gym.hoop_env import Array, HoopEnv, observation
from hoopd.gym.tasks import BOTTOM, Moment, task_of
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.model_file import effects_of, parse_model
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.shell import config as configuration
from hoopd.shell.config import Config

SEEDS = 2**31


class RigEnv(HoopEnv):
    """A task over the rig: board, wire, late camera, filter, modes, faults and limits of the daemon.

    Parameters
    ----------
    task : str
        bottom, loop or throw.
    model, effects, spread
        As of `PlantEnv`: the rig's; the filter has the controller's model and does not know of them.
    config : Path, optional
        The daemon's configuration.
    sets : sequence of str
        SECTION.KEY=VALUE, as `--set`.

    Examples
    --------
    >>> env = RigEnv("bottom")
    >>> observation, info = env.reset(seed=0, options={"ball_rad": 0.4})
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample() * 0)
    >>> terminated, 0.2 < float(observation[1]) < 0.45
    (False, True)
    >>> env.close()
    """

    def __init__(
        self,
        task: str = BOTTOM,
        *,
        model: Path | str | None = None,
        effects: Mapping[str, Mapping[str, float]] | None = None,
        spread: float = 0.0,
        config: Path | None = None,
        sets: tuple[str, ...] = (),
    ) -> None:
        if not task_of(task).over_rig:
            raise ValueError(f"{task} is over the plant alone: over the rig an agent is not shown enough of it")
        physics = physics_of(model, effects, spread, task_of(task).model)
        quiet = ("telemetry.enabled=false", "commands.enabled=false")
        self._config: Config = configuration.load(config, sim=True, overrides=[*quiet, *sets])
        self._texts: Texts = read_texts(self._config, config)
        told = effects_of(parse_model(self._texts.model, "model"))
        self._ahead = NumericPlant(told.plant, told.effects(), told.values).filter_step.ahead
        self._rig: SteppedRig | None = None
        limit = min(physics.file().device.torque_limit_nm, self._config.limits.torque_nm)
        super().__init__(task, physics, limit, self._config.loop.period_s)

    @property
    def rig(self) -> SteppedRig:
        """The running one."""
        assert self._rig is not None, "reset comes first"
        return self._rig

    def close(self) -> None:
        """Take the rig away."""
        super().close()
        self._take_away()

    def _take_away(self) -> None:
        if self._rig is not None:
            self._rig.close()
            self._rig = None

    def _begin(self, ball_rad: float) -> None:
        self._take_away()
        plant = plant_arguments(self.physics.drawn(self.np_random), ball_rad)
        seed = int(self.np_random.integers(SEEDS))
        self._rig = SteppedRig(self._config, self._texts, plant, seed, self.task.suspends)
        self._began_t = self._rig.record.t

    def _play(self, torque_nm: float) -> None:
        self.rig.play(torque_nm)

    def _moment(self, torque_share: float) -> Moment:
        plant = self.rig.plant
        _, hoop_speed, angle, speed = plant.state
        return Moment(
            self.rig.record.t - self._began_t, hoop_speed, angle, speed, plant.distance, torque_share, plant.ball_mode
        )

    def _seen(self, moment: Moment) -> Array:
        """The estimate at the next tick."""
        record = self.rig.record
        _, hoop_speed, angle, speed = self._ahead(np.array(record.x_hat), record.u, self.tick_s).tolist()
        return observation(hoop_speed, angle, speed, float(isfinite(self.rig.seen_rad)))

    def _stopped(self, moment: Moment) -> str:
        if self.rig.acts:
            return ""
        return f"{self.rig.tick.mode}: {', '.join(self.rig.tick.faults) or 'no fault'}"

    def _info(self, moment: Moment) -> dict[str, Any]:
        rig, record = self.rig, self.rig.record
        ball = {"measured_ball_rad": rig.seen_rad, "measured_ball_t": record.psi_t}
        return {**super()._info(moment), "measured_hoop_rad_s": record.dtheta, **ball, "torque_nm": record.u}


def plant_arguments(found: FoundEffects, ball_rad: float) -> dict[str, Any]:
    """Of `hoopd.sim.plant.make_plant`: hands hold the ball until the drive acts."""
    effects = {one.name: dict(one.parameters) for one in found.entries}
    x0 = [0.0, 0.0, ball_rad, 0.0]
    return {"structure": found.structure, "parameters": dict(found.base), "x0": x0, "held": True, "effects": effects}
