"""The plant alone: the state is known exactly, nothing is late, nothing is in the way of the torque but its limit.

Rules of this file: hoop and ball are the rig's own, without board, wire, camera and filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hoopd.core.health import Thresholds
from hoopd.gym.hidden_physics import physics_of
from hoopd.gym.hoop_env import HoopEnv
from hoopd.gym.tasks import BOTTOM, Moment, task_of
from hoopd.sim.plant import RigPlant


class PlantEnv(HoopEnv):
    """A task over the plant alone.

    Parameters
    ----------
    task : str
        bottom, loop, throw or up.
    model : Path, optional
        A model file; a shipped one by its name; the task's own without.
    effects : mapping
        Physics beside the model's, by `slot.effect` with its numbers.
    spread : float
        Share by which the model's parameters are drawn off in every try.

    Examples
    --------
    >>> env = PlantEnv("bottom", effects={"hoop.coulomb_friction": {"Fc": 0.01}})
    >>> observation, info = env.reset(seed=0, options={"ball_rad": 0.5})
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample() * 0)
    >>> observation.shape, terminated, round(info["t"], 3)
    ((6,), False, 0.02)
    """

    def __init__(
        self,
        task: str = BOTTOM,
        *,
        model: Path | str | None = None,
        effects: Mapping[str, Mapping[str, float]] | None = None,
        spread: float = 0.0,
    ) -> None:
        physics = physics_of(model, effects, spread, task_of(task).model)
        file = physics.file()
        super().__init__(task, physics, file.device.torque_limit_nm, file.sample_time_s)
        self._fastest = Thresholds().hoop_speed_rad_s
        self._plant: RigPlant | None = None

    @property
    def plant(self) -> RigPlant:
        """Hoop and ball as they are."""
        assert self._plant is not None, "reset comes first"
        return self._plant

    def _begin(self, ball_rad: float) -> None:
        x0 = np.array([0.0, 0.0, ball_rad, 0.0])
        if self._plant is not None and self.physics.spread == 0.0:
            self._plant.restart(x0)
        else:
            self._plant = RigPlant(self.physics.drawn(self.np_random), x0)

    def _play(self, torque_nm: float) -> None:
        self.plant.advance(self.plant.t + self.tick_s, torque_nm)

    def _moment(self, torque_share: float) -> Moment:
        plant = self.plant
        _, hoop_speed, angle, speed = plant.state
        return Moment(plant.t, hoop_speed, angle, speed, plant.distance, torque_share, plant.ball_mode)

    def _stopped(self, moment: Moment) -> str:
        speed = moment.hoop_speed
        return f"the hoop turned at {speed:.0f} rad/s" if abs(speed) > self._fastest else ""
