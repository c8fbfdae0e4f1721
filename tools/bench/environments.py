"""How fast are the Gymnasium environments? `python tools/bench/environments.py [--seconds 60] [--turns 3] [--profile]`.

Plays every task over the plant and one over the rig, in turns, with torques that keep the ball moving, and prints times
real time by the processor's time (the best of the turns: other work on the machine only takes away). Bounds: the plant
alone at least 1,000; of the rig 200 are aimed at and 30 are demanded. Exit code 1 below. `--profile`: where the rig's
time goes, by part of the tick.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
from rich.console import Console
from rich.table import Table

import hoopd.gym
from hoopd.gym.hoop_env import HoopEnv

LEAST, AIM = {"plant": 1000.0, "rig": 30.0}, {"plant": 1000.0, "rig": 200.0}
CASES = (*((task, "plant") for task in hoopd.gym.TASKS), ("bottom", "rig"))
# A twentieth of the virtual seconds: a tick of the rig costs some twenty of the plant.
RIG_SHARE = 0.05
# Of a try, that no task has ended by itself: the ball is kept near the bottom, and the loop's is never round.
LONGEST_S = 3.0
PARTS = ("core/estimator.py", "core/health.py", "sim/board.py", "sim/lockstep.py", "core/encoderchecks.py")


def actions(count: int) -> np.ndarray:
    """Torques of a moving ball that stays on the hoop."""
    return (0.02 * np.sin(0.3 * np.arange(count))).astype(np.float32)[:, None]


def play(env: HoopEnv, torques: np.ndarray) -> float:
    """Virtual seconds per second of the processor, tries included, their beginnings left out."""
    spent = 0.0
    for part in np.array_split(torques, max(1, round(len(torques) * env.tick_s / LONGEST_S))):
        env.reset(seed=1, options={"ball_rad": 0.0})
        begin = time.process_time()
        for torque in part:
            _, _, over, late, _ = env.step(torque)
            if over or late:  # done: on with another try
                spent += time.process_time() - begin
                env.reset(seed=1, options={"ball_rad": 0.0})
                begin = time.process_time()
        spent += time.process_time() - begin
    return len(torques) * env.tick_s / spent


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="virtual ones of a turn over the plant")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    factors: dict[tuple[str, str], list[float]] = {case: [] for case in CASES}
    for _ in range(options.turns):
        for task, over in CASES:
            env = hoopd.gym.make(task, over)
            ticks = round(options.seconds * (1.0 if over == "plant" else RIG_SHARE) / env.tick_s)
            factors[task, over].append(play(env, actions(ticks)))
            env.close()
    table = Table("environment", "times real time", "steps/s", "at least", "aim")
    worst = True
    for (task, over), found in factors.items():
        best = max(found)
        worst = worst and best >= LEAST[over]
        table.add_row(f"{task} over {over}", f"{best:.0f}", f"{best * 50:.0f}", f"{LEAST[over]:g}", f"{AIM[over]:g}")
    Console().print(table)
    if options.profile:
        profile(round(options.seconds * RIG_SHARE * 50))
    return 0 if worst else 1


def profile(ticks: int) -> None:
    """Shares of the rig's time by part."""
    env = hoopd.gym.make("bottom", "rig")
    env.reset(seed=1, options={"ball_rad": 0.0})
    watched = cProfile.Profile()
    watched.enable()
    for torque in actions(ticks):
        _, _, over, late, _ = env.step(torque)
        if over or late:
            watched.disable()
            env.reset(seed=1, options={"ball_rad": 0.0})
            watched.enable()
    watched.disable()
    env.close()
    pstats.Stats(watched).sort_stats("cumtime").print_stats("|".join(PARTS), 20)


if __name__ == "__main__":
    sys.exit(main())
