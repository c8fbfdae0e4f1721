"""Gymnasium environments of hoop and ball, so that controllers can be compared with ours.

    import gymnasium, hoopd.gym
    env = gymnasium.make("hoopd/Bottom-v0")             # the plant alone
    env = gymnasium.make("hoopd/Loop-v0", over="rig")   # the daemon's loop on the rig in lock-step

Tasks are in `tasks`, spaces in `hoop_env`. The extra `gym` installs what this needs: `pip install hoopd[gym]`.

Rules of this package: an agent has the limits of the device, and nothing that a control law could not know but where
its environment says so; the rest of hoopd imports nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("hoopd.gym needs Gymnasium: pip install hoopd[gym]", name="gymnasium") from error

from hoopd.gym.hoop_env import HoopEnv
from hoopd.gym.plant_env import PlantEnv
from hoopd.gym.rig_env import RigEnv
from hoopd.gym.tasks import TASKS

__all__ = ["TASKS", "HoopEnv", "PlantEnv", "RigEnv", "make"]

OVER: dict[str, Callable[..., HoopEnv]] = {"plant": PlantEnv, "rig": RigEnv}


def make(task: str, over: str = "plant", **options: Any) -> HoopEnv:
    """An environment of a task over the plant or the rig; `options` of `PlantEnv` and `RigEnv`. ValueError."""
    if over not in OVER:
        raise ValueError(f"over must be plant or rig, not {over!r}")
    return OVER[over](task, **options)


for _name in TASKS:
    gymnasium.register(f"hoopd/{_name.capitalize()}-v0", "hoopd.gym:make", kwargs={"task": _name})
