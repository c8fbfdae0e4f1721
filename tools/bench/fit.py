"""A fit our way and the way of the thesis, side by side in one run; ends with 1 when a bound is missed.

python tools/bench/fit.py [--runs 9] [--only 2] [--limit 60] [--json FILE]

Both estimate the eight entries and the initial state from one recording (../shared or $HOOPD_SHARED; a simulated one
of the same shape where that is absent), from the same start, the entries as printed. The way of the thesis: an
adaptive solver over the whole run, the torque looked up by time, and L-BFGS with finite differences; it is told the
weights of the two channels, which ours has to find. After --limit seconds of processor time it is stopped and the
cost it had reached counts. Costs are those of one and the same free run, integrated from sample to sample: half the
sum of squared errors in units of sigma.

Every way is one thread of arithmetic, so its processor time is its duration on a free core: the bounds are judged by
that, and the clock's time, in which a busy machine is inside, stands beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices of 12: threads only wait for each other

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from hoopd.plants.fits.output_error import Solution  # noqa: E402
from hoopd.plants.fits.robust_least_squares import Array  # noqa: E402
from hoopd.plants.fits.runs import Run  # noqa: E402
from hoopd.plants.hoop.fitting.fit import FittedParameters, fit  # noqa: E402
from hoopd.plants.hoop.fitting.free_parameters import scale_of  # noqa: E402
from hoopd.plants.hoop.fitting.hoop_output_error import fit_output_error, hoop_problem  # noqa: E402
from hoopd.plants.hoop.fitting.solver_comparison import ATOL, RTOL, two_level_torque  # noqa: E402
from hoopd.plants.hoop.recordings.fit_data import STATES, prepare  # noqa: E402
from hoopd.plants.hoop.simulate import HoopModel  # noqa: E402
from hoopd.plants.model_file import load_model  # noqa: E402
from hoopd.recording import load  # noqa: E402
from hoopd.recording.recording import Recording, from_columns  # noqa: E402

MODELS = ROOT / "config" / "models"
NAME = "recordings/meas_hoopAndBall2_01.mat"
NAMES = ("J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2")
SAMPLES, TICK_S, COUNT_RAD = 1001, 0.02, math.tau / 4096
LEAST_RATIO, MOST_S = 100.0, 1.0
# Costs that differ by less are the same: the weights settle to 1 %, and the search to 1e-9.
SAME = 1.0 + 1e-4


class Solver(NamedTuple):
    """How the slow way integrates and differentiates."""

    method: str
    rtol: float
    difference: float  # of a variable in units of its nominal size: above what the solver's error hides

    def __str__(self) -> str:
        return f"{self.method} rtol {self.rtol:g} across the jumps, L-BFGS"


# First as the thesis called it, with default tolerances; then so tight that differences see the cost's slope.
SOLVERS = (Solver("Radau", RTOL, 1e-4), Solver("LSODA", RTOL, 1e-4), Solver("LSODA", 1e-8, 1e-6))


@dataclass(frozen=True)
class Row:
    """One way's result."""

    how: str
    cpu_s: float  # median
    clock_s: float  # median
    runs: int
    simulations: int
    cost: float
    note: str = ""
    stopped: bool = False  # by the limit


class TimeIsUpError(Exception):
    """The bound of a slow way is reached."""


def recording() -> tuple[Recording, str]:
    """The real recording, or one of the same shape from the shipped model with noise and a drifting push."""
    path = Path(os.environ.get("HOOPD_SHARED", ROOT.parent / "shared")) / NAME
    if path.exists():
        return load(path), path.name
    rng, values = np.random.default_rng(0), load_model(MODELS / "hoop.yaml").values()
    t, u = TICK_S * np.arange(SAMPLES), two_level_torque(SAMPLES)
    push = 0.0005 * np.cumsum(rng.normal(size=SAMPLES)) * math.sqrt(TICK_S)
    x = HoopModel("rolling", values).run((), np.zeros(4), t, (u + push)[:-1])
    theta, psi = COUNT_RAD * np.floor(x[:, 0] / COUNT_RAD), x[:, 2] + 0.002 * rng.normal(size=SAMPLES)
    columns = {"t": t, "u": u, "theta": theta, "dtheta": x[:, 1], "psi": psi}
    return from_columns(columns, source="simulated"), f"simulated (no {path}; set HOOPD_SHARED)"


class Judge:
    """The one cost of all ways: fixed weights, integrated from sample to sample."""

    def __init__(self, run: Run, values: dict[str, float], sigma: dict[str, float]) -> None:
        self.run, self.sigma = run, sigma
        self.problem = hoop_problem("entries", values, [run], scale_of("entries", NAMES, values))
        self.problem.sigma = dict(sigma)

    def cost(self, values: dict[str, float], start: Array) -> float:
        """Half the sum of squared errors in units of sigma; start (4,)."""
        z = self.problem.scale.coordinates(np.array([values[name] for name in NAMES]))
        (e,) = self.problem.residuals(z, [start[self.problem.free[0]]])
        return float(e @ e) / 2

    def of(self, found: Solution) -> float:
        """Cost of a fit of ours."""
        return self.cost(found.values, found.starts[0])


class ThesisWay:
    """The cost as an adaptive solver sees it, told the torque by time; counts runs, keeps the best, stops in time."""

    def __init__(self, judge: Judge, nominal: Array, solver: Solver, limit_s: float) -> None:
        self.judge, self.run, self.nominal, self.solver = judge, judge.run, nominal, solver
        self.simulations, self.end = 0, time.process_time() + limit_s
        self.best, self.best_cost = np.zeros(len(nominal) + 3), math.inf
        self.times, self.torques = self.run.t.tolist(), self.run.u.tolist()

    def parameters(self, z: Array) -> tuple[Array, Array]:
        """Entries (8,) and initial state (4,) of scaled variables z (11,)."""
        return self.nominal * (1.0 + z[:8]), self.run.start + np.concatenate([[0.0], z[8:]])

    def cost(self, z: Array) -> float:
        """Half the sum of squared errors in units of sigma, by one adaptive run."""
        if time.process_time() > self.end:
            raise TimeIsUpError
        self.simulations += 1
        x = self.states(*self.parameters(z))
        parts = [
            (one.of(x[:, STATES[name]]) - one.values) / self.judge.sigma[name] for name, one in self.run.series.items()
        ]
        cost = sum(float(e @ e) for e in parts) / 2
        if cost < self.best_cost:
            self.best, self.best_cost = z.copy(), cost
        return cost

    def states(self, p: Array, x0: Array) -> Array:
        """(n, 4) by one call of the solver."""
        t, (method, rtol, _) = self.run.t, self.solver
        # as fast as Python allows: a compiled call for every derivative costs more than the arithmetic
        rate = _rate(p.tolist(), self.times, self.torques)
        found = solve_ivp(rate, (t[0], t[-1]), x0, method, t_eval=t, rtol=rtol, atol=rtol * ATOL / RTOL)
        return np.asarray(found.y.T)


def _rate(p: list[float], times: list[float], torques: list[float]) -> Callable[[float, Array], list[float]]:
    """Equations 3.16 to 3.19 of the thesis with the entries p."""
    j11, j12, k1, l1, j21, j22, k2, l2 = p
    last = len(torques) - 1

    def rate(now: float, x: Array) -> list[float]:
        _, dtheta, psi, dpsi = x.tolist()
        u, s = torques[min(max(bisect_right(times, now) - 1, 0), last)], math.sin(psi)
        return [dtheta, j11 * dtheta + j12 * dpsi + k1 * s + l1 * u, dpsi, j21 * dtheta + j22 * dpsi + k2 * s + l2 * u]

    return rate


def thesis_way(judge: Judge, values: dict[str, float], solver: Solver, limit_s: float) -> Row:
    """One fit, stopped at the limit."""
    way = ThesisWay(judge, np.array([values[name] for name in NAMES]), solver, limit_s)
    options = {"eps": solver.difference, "maxiter": 10000, "maxfun": 10**7}
    begin = clocks()
    try:
        note = f"ended by itself: {minimize(way.cost, way.best, method='L-BFGS-B', options=options).message}"
    except TimeIsUpError:
        note = f"stopped after {limit_s:g} s"
    cpu_s, clock_s = (clocks() - begin).tolist()
    p, x0 = way.parameters(way.best)
    cost = judge.cost(dict(zip(NAMES, p.tolist(), strict=True)), x0)
    return Row(str(solver), cpu_s, clock_s, 1, way.simulations, cost, note, note.startswith("stopped"))


class Counted:
    """Counts the free runs of all models while it is entered, and the samples in them."""

    def __enter__(self) -> Counted:
        self.runs, self.samples, self._four = 0, 0, HoopModel._four

        def four(model: HoopModel, p: Any, x0: Array, t: Any, u: Any, *, derivatives: bool) -> Any:
            self.runs += 1
            self.samples += len(u)
            return self._four(model, p, x0, t, u, derivatives=derivatives)

        HoopModel._four = four  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        HoopModel._four = self._four  # type: ignore[method-assign]


def clocks() -> Array:
    """Processor time and the clock's, in s."""
    return np.array([time.process_time(), time.perf_counter()])


def timed(call: Callable[[], object], runs: int) -> list[Array]:
    """Seconds (2,) of each call."""
    out = []
    for _ in range(runs):
        begin = clocks()
        call()
        out.append(clocks() - begin)
    return out


def measure(rec: Recording, runs: int, solvers: Sequence[Solver], limit_s: float) -> tuple[list[Row], FittedParameters]:
    """All ways, ours before and after each slow one, so that a busy machine slows both."""
    values = load_model(MODELS / "thesis.yaml").values()
    prepared = prepare([rec], ("theta_rate", "psi"))
    first = fit([rec], values)
    judge = Judge(prepared[0], values, {n: first.solution.sigma[n] for n in first.solution.sigma if n in STATES})
    ours: dict[str, Callable[[], Solution]] = {
        "hoopd, fit with its defaults and intervals": lambda: fit([rec], values).solution,
        "hoopd, one output-error fit": lambda: fit_output_error("entries", values, NAMES, prepared),
    }
    times: dict[str, list[Array]] = {name: [] for name in ours}
    slow = []
    for solver in [*solvers, None]:
        for name, call in ours.items():
            times[name] += timed(call, runs)
        slow += [thesis_way(judge, values, solver, limit_s)] if solver else []
    rows = []
    for name, call in ours.items():
        with Counted() as counted:
            found = call()
        (cpu_s, clock_s), count = np.median(times[name], axis=0).tolist(), len(times[name])
        rows.append(Row(name, cpu_s, clock_s, count, counted.runs, judge.of(found), f"{found.steps} steps"))
    return rows + slow, first


def missed(rows: list[Row]) -> list[str]:
    """Bounds that were not kept, in words; a way that gave up above our cost says nothing about speed."""
    ours, slow = rows[0], rows[2:]
    out = [] if ours.cpu_s < MOST_S else [f"{ours.cpu_s:.2f} s, the bound is {MOST_S:g} s"]
    for row in slow:
        ratio, gave_up = row.cpu_s / ours.cpu_s, not row.stopped and row.cost > ours.cost * SAME
        if ratio < LEAST_RATIO and not gave_up:
            out.append(f"{ratio:.0f} times as fast as {row.how}, the bound is {LEAST_RATIO:g}")
        if ours.cost > row.cost * SAME:
            out.append(f"cost {ours.cost:.6g} is above {row.cost:.6g} of {row.how}")
    return out


def main() -> int:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=9, help="fits of ours before and after each slow way")
    parser.add_argument("--only", type=int, choices=range(len(SOLVERS)), help="one of the slow ways, by its number")
    parser.add_argument("--limit", type=float, default=60.0, help="processor time in s given to each slow way")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    solvers = SOLVERS if options.only is None else SOLVERS[options.only :][:1]
    rec, name = recording()
    rows, found = measure(rec, options.runs, solvers, options.limit)
    print(f"{name}: {len(rec)} samples, {len(NAMES)} entries and initial state, {found.runs[0].samples} measurements")
    print(f"{'way':<48} {'CPU s':>9} {'clock s':>8} {'ratio':>7} {'runs':>5} {'simulations':>11} {'cost':>10}")
    for row in rows:
        ratio = row.cpu_s / rows[0].cpu_s
        figures = f"{row.cpu_s:9.3f} {row.clock_s:8.3f} {ratio:7.1f} {row.runs:5} {row.simulations:11} {row.cost:10.3f}"
        print(f"{row.how:<48} {figures}  {row.note}")
    failures = missed(rows)
    for failure in failures:
        print(f"MISSED: {failure}")
    if options.json is not None:
        result = {"recording": name, "rows": [vars(row) for row in rows], "missed": failures}
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
