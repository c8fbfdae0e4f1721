"""What the environments over plant and rig share: spaces, tries, rewards.

    observation  hoop speed (rad/s), sine and cosine of the ball's angle, ball speed (rad/s), the bottom that it is
                 nearest to in whole turns, distance of the ball from the axis (1 on the hoop)
    action       torque in N m, within the device's limit, held for a tick

Rules of this file: everything random is drawn from the environment's generator: the same seed and actions give the
same observations. The limits are the device's own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import cos, isfinite, nan, pi, sin, tau
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hoopd.gym.hidden_physics import HiddenPhysics
from hoopd.gym.tasks import UP, Moment, TryJudge, task_of

Array = NDArray[np.float32]
Reset = tuple[Array, dict[str, Any]]
Step = tuple[Array, float, bool, bool, dict[str, Any]]

# Beyond what hoop and ball do within the limits of the device.
FASTEST_RAD_S, MOST_TURNS = 1e3, 1e4
HIGH = np.array([FASTEST_RAD_S, 1.0, 1.0, FASTEST_RAD_S, MOST_TURNS, 1.0], np.float32)
LOW = np.array([-FASTEST_RAD_S, -1.0, -1.0, -FASTEST_RAD_S, -MOST_TURNS, 0.0], np.float32)

# Kinds of arrays whose entries are real numbers.
REAL = "biuf"


class HoopEnv(gymnasium.Env[Array, Array], ABC):
    """One task over some hoop."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  Gymnasium's own form

    def __init__(self, task: str, physics: HiddenPhysics, torque_limit_nm: float, tick_s: float) -> None:
        self.task, self.physics = task_of(task), physics
        physics.check()
        if self.task.name == UP and physics.file().device.inner is None:
            raise ValueError(f"model: {physics.model} has no inner hoop (device.inner), which the task {UP} is about")
        self.torque_limit_nm, self.tick_s = torque_limit_nm, tick_s
        limit = np.float32(torque_limit_nm)
        self.action_space = spaces.Box(-limit, limit, (1,), np.float32)
        self.observation_space = spaces.Box(LOW, HIGH, dtype=np.float32)
        self._ticks = 0
        self._most_ticks = round(self.task.seconds / tick_s)
        self._judge: TryJudge | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Reset:
        """Begin a try; `options`: `ball_rad`, where the ball rests at its beginning."""
        super().reset(seed=seed)
        told = dict(options or {}) if isinstance(options, Mapping | None) else {"options": options}
        start = self.task.start_rad
        drawn = float(self.np_random.uniform(-start, start))
        ball_rad = _number_of(told.pop("ball_rad", drawn))
        if told or not abs(ball_rad) <= pi:
            raise ValueError(f"options of reset: ball_rad alone, a number of rad from -pi to pi, not {options}")
        self._ticks, self._judge = 0, self.task.judge(self.tick_s)
        self._begin(ball_rad)
        moment = self._moment(0.0)
        return self._seen(moment), self._info(moment)

    def step(self, action: Array) -> Step:
        """One tick."""
        if self._judge is None:
            raise gymnasium.error.ResetNeeded("reset comes before step")
        torque_nm = min(self.torque_limit_nm, max(-self.torque_limit_nm, _torque_of(action)))
        self._play(torque_nm)
        self._ticks += 1
        moment = self._moment(torque_nm / self.torque_limit_nm)
        verdict = self._judge.see(moment)
        stopped = self._stopped(moment)
        over, why = verdict.over or bool(stopped), verdict.why or stopped
        failed = over and not verdict.success
        reward = verdict.reward - (self.task.failure_cost(self._ticks * self.tick_s) if failed else 0.0)
        info = {**self._info(moment), "success": verdict.success, **({"ended": why} if over else {})}
        is_late = self._ticks >= self._most_ticks and not over
        if over or is_late:
            self._judge = None  # nothing is won after the end
        return self._seen(moment), float(reward), over, is_late, info

    def close(self) -> None:
        """No more steps."""
        self._judge = None

    @abstractmethod
    def _begin(self, ball_rad: float) -> None:
        """A try, with the ball at rest there."""

    @abstractmethod
    def _play(self, torque_nm: float) -> None:
        """One tick."""

    @abstractmethod
    def _moment(self, torque_share: float) -> Moment:
        """What is known of hoop and ball."""

    def _seen(self, moment: Moment) -> Array:
        """The observation."""
        return observation(moment.hoop_speed, moment.ball_angle, moment.ball_speed, min(moment.distance, 1.0))

    def _stopped(self, moment: Moment) -> str:
        """Why nothing can go on; empty: it can."""
        return ""

    def _info(self, moment: Moment) -> dict[str, Any]:
        return {"t": moment.t, "ball_angle_rad": moment.ball_angle}


def _number_of(value: Any) -> float:
    """NaN for what is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return nan


def _torque_of(action: Any) -> float:
    """N m; ValueError for anything but one finite number."""
    try:
        numbers = np.asarray(action)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (1,) or numbers.dtype.kind not in REAL or not isfinite(numbers[0]):
        raise ValueError(f"an action is an array with one torque in N m, not {action!r}")
    return float(numbers[0])


def observation(hoop_speed: float, ball_angle: float, ball_speed: float, last: float) -> Array:
    """As the head of the file has it."""
    hoop, ball = _inside(hoop_speed), _inside(ball_speed)
    return np.array((hoop, sin(ball_angle), cos(ball_angle), ball, round(ball_angle / tau), last), np.float32)


def _inside(speed: float) -> float:
    """Within the space's bounds, which nothing within the limits of the device reaches."""
    return min(FASTEST_RAD_S, max(-FASTEST_RAD_S, speed))
