"""How long does a nonlinear predictive controller think? `python tools/bench/nmpc.py [--ticks 500] [--horizon 30]`.

The hoop's planning model holds the ball from 1 rad off the bottom again and again: every tick the whole optimal control
problem (multiple shooting over the horizon, torque limit, quadratic cost) is solved to convergence, begun from the last
answer moved on by a tick, by FATROP and by IPOPT on the same states in turns; FATROP's torque is played. Printed: solve
times by clock and processor (p50, p99, largest), iterations, and how the ball ended. A controller in the tick
has 20 ms less the rest of the tick (execution p99 below 4 ms). Exit code 1 when the ball was not held.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.model_file import effects_of, load_model

Array = NDArray[np.float64]
TRY_TICKS = 100  # two seconds: then the ball is let go again
START_RAD = 1.0
# What costs the same: deviations of hoop speed, ball angle, ball speed, and a torque.
SIZES = {"dtheta": 10.0, "psi": 0.2, "dpsi": 2.0, "u": 0.3}
HELD_RAD = 0.1
OPTIONS: dict[str, dict[str, Any]] = {
    "fatrop": {"print_time": False, "structure_detection": "auto", "fatrop.print_level": 0, "error_on_fail": False},
    "ipopt": {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "error_on_fail": False},
}


class Problem(NamedTuple):
    """The optimal control problem, its variables in stages (x0, u0, x1, u1, ... xN)."""

    solvers: dict[str, Any]
    horizon: int
    limit_nm: float


def problem(horizon: int) -> tuple[Problem, ca.Function]:
    """The problem over so many ticks, and a tick's step (x, u) -> x."""
    model = load_model(defaults_folder() / "models" / "hoop.yaml")
    step, limit = PlanningModel(effects_of(model)).step(model.sample_time_s), model.device.torque_limit_nm
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    after = ca.Function("after", [x, u], [step(x, u)[0]])
    weights = [0.0, SIZES["dtheta"] ** -2, SIZES["psi"] ** -2, SIZES["dpsi"] ** -2]
    cost = ca.Function("cost", [x, u], [ca.dot(ca.DM(weights), x**2) + (u / SIZES["u"]) ** 2])
    variables, constraints, total, x0 = [], [], ca.MX(0.0), ca.MX.sym("x0", 4)
    states = [ca.MX.sym(f"x{k}", 4) for k in range(horizon + 1)]
    inputs = [ca.MX.sym(f"u{k}") for k in range(horizon)]
    for k in range(horizon):
        variables += [states[k], inputs[k]]
        constraints.append(states[k + 1] - after(states[k], inputs[k]))
        if k == 0:
            constraints.append(states[0] - x0)
        total += cost(states[k], inputs[k])
    total += 10.0 * cost(states[-1], 0.0)
    g = ca.vertcat(*constraints)
    told = {"x": ca.vertcat(*variables, states[-1]), "f": total, "g": g, "p": x0}
    equal = {"fatrop": {"equality": [True] * g.numel()}, "ipopt": {}}
    solvers = {name: ca.nlpsol(name, name, told, {**OPTIONS[name], **equal[name]}) for name in OPTIONS}
    return Problem(solvers, horizon, limit), after


def bounds(of: Problem) -> tuple[Array, Array]:
    """Of the variables."""
    low = np.tile([-np.inf] * 4 + [-of.limit_nm], of.horizon)
    return np.concatenate([low, [-np.inf] * 4]), -np.concatenate([low, [-np.inf] * 4])


def moved_on(answer: Array) -> Array:
    """The last answer a tick later: its last stage twice."""
    return np.concatenate([answer[5:-4], answer[-9:-4], answer[-4:]])


def run(ticks: int, horizon: int) -> tuple[dict[str, Array], float]:
    """Rows (clock s, processor s, iterations, solved) by solver, and the largest angle at the end of a try."""
    of, after = problem(horizon)
    low, high = bounds(of)
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in of.solvers}
    worst, rng = 0.0, np.random.default_rng(0)
    x, guesses = np.zeros(4), {name: np.zeros(5 * horizon + 4) for name in of.solvers}
    for k in range(ticks):
        if k % TRY_TICKS == 0:
            worst = max(worst, abs(float(x[2]))) if k else worst
            x = np.array([0.0, 0.0, START_RAD * float(rng.choice((-1.0, 1.0))), 0.0])
            guesses = {name: np.tile(np.concatenate([x, [0.0]]), horizon + 1)[:-1] for name in of.solvers}
        torque = 0.0
        for name, solver in of.solvers.items():
            clock, processor = time.perf_counter(), time.process_time()
            found = solver(x0=guesses[name], p=x, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
            spent = time.perf_counter() - clock, time.process_time() - processor
            stats, answer = solver.stats(), found["x"].full().ravel()
            rows[name].append((*spent, float(stats["iter_count"]), float(stats["success"])))
            guesses[name] = moved_on(answer)
            torque = float(answer[4]) if name == "fatrop" else torque
        x = after(x, np.clip(torque, -of.limit_nm, of.limit_nm)).full().ravel()
    return {name: np.array(told) for name, told in rows.items()}, max(worst, abs(float(x[2])))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=500)
    parser.add_argument("--horizon", type=int, default=30)
    options = parser.parse_args()
    rows, end_rad = run(options.ticks, options.horizon)
    table = Table("solver", "", "p50 ms", "p99 ms", "largest ms", "iterations", "solved")
    for name, told in rows.items():
        for row, what in ((0, "clock"), (1, "processor")):
            times = [f"{1e3 * float(np.quantile(told[:, row], q)):.2f}" for q in (0.5, 0.99, 1.0)]
            counts = f"{np.median(told[:, 2]):.0f}, at most {told[:, 2].max():.0f}"
            table.add_row(name, what, *times, counts, f"{int(told[:, 3].sum())} of {len(told)}")
    Console().print(table)
    print(f"at the ends of the tries the ball was at most {end_rad:.3f} rad off the bottom")
    return 0 if end_rad < HELD_RAD else 1


if __name__ == "__main__":
    sys.exit(main())
