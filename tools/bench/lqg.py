"""Time per call of plant, filter and laws; margins of the default law; the search of its weights (--search).

python tools/bench/lqg.py [--search]
"""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hoopd.core.controllers import Lqg
from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.limits import Limiter
from hoopd.design.defaults import TICK_S
from hoopd.design.lqg import feedback, lqg_gains, lqg_loop
from hoopd.design.margins import margins
from hoopd.design.weights import Weights
from hoopd.files.controller import controller_of, estimator_of, limiter_of, load_controller
from hoopd.plants.hoop.loop.closed_loop import Scenario, simulate
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
PLANTS = {name: plant_of(load_model(CONFIG / "models" / f"{name}.yaml")) for name in ("hoop", "thesis")}


def best_us(call: Callable[[], object], calls: int = 3000) -> float:
    """Mean time of a call in the best of five runs, in us."""
    times = []
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(calls):
            call()
        times.append((time.perf_counter() - start) / calls)
    return 1e6 * min(times)


class Timed:
    """Passes calls of a method on and keeps their times."""

    def __init__(self, call: Callable[..., object]) -> None:
        self.call, self.times = call, list[float]()

    def __call__(self, *args: object, **keys: object) -> object:
        start = time.perf_counter()
        result = self.call(*args, **keys)
        self.times.append(time.perf_counter() - start)
        return result


def timing() -> None:
    """Calls on the default device."""
    plant, x = PLANTS["hoop"], np.array([1.0, 3.0, 0.3, 1.0])
    for name in ("derivative", "advance", "step_and_jacobian"):
        call = getattr(plant, name)
        arguments = (x, 0.1) if name == "derivative" else (x, 0.1, TICK_S)
        print(f"plant.{name:<18} {best_us(lambda c=call, a=arguments: c(*a)):7.1f} us")
    for name in ("lqg", "arx", "pid", "lead"):
        file = load_controller(CONFIG / "controllers" / f"{name}.yaml")
        law, ekf = controller_of(file), estimator_of(file, plant)
        ekf.update, law.update = Timed(ekf.update), Timed(law.update)  # type: ignore[method-assign]
        simulate(plant, law, ekf, limiter_of(file), Scenario(psi0_rad=0.4, phase_s=0.015))
        for what, timed in (("estimator", ekf.update), ("law", law.update)):
            times = 1e6 * np.array(timed.times)  # type: ignore[attr-defined, union-attr]
            print(f"{name} {what:<18} median {np.median(times):6.1f} p95 {np.percentile(times, 95):6.1f} us")


def report(weights: Weights, model: HoopPlant, delay_ticks: int) -> str:
    """Margins of gains made for `model`, and what they do."""
    cells = []
    for name, true in PLANTS.items():
        m = margins(
            lqg_loop(true, model, feedback(model, weights, TICK_S), EkfSettings(), h=TICK_S, delay_ticks=delay_ticks)
        )
        cells.append(
            f"{name}: phase {math.degrees(m.phase_rad):4.0f} deg, delay {1e3 * m.delay_s:4.0f} ms, "
            f"gain x{m.gain_up:5.2f} / x{m.gain_down:4.2f}, peak |S| {m.peak_sensitivity:4.2f}"
        )
    return " | ".join(cells)


def behaviour(weights: Weights, model: HoopPlant) -> str:
    """Settling on the default device, and the hoop speed of one degree of zero-angle error on the thesis's."""

    def run(true: HoopPlant, scenario: Scenario) -> object:
        law, ekf = Lqg(lqg_gains(model, weights, TICK_S)), DelayedEkf(model.step_and_jacobian)
        return simulate(true, law, ekf, Limiter(0.7, 1.4), scenario)

    free = run(PLANTS["hoop"], Scenario(psi0_rad=0.4))
    wrong = run(PLANTS["thesis"], Scenario(duration_s=8.0, delay_frames=1, angle_offset_rad=math.radians(1)))
    return (
        f"psi < 0.05 after {free.settled_s(free.psi, 0.05):4.2f} s, hoop < 1 rad/s after "  # type: ignore[attr-defined]
        f"{free.settled_s(free.dtheta, 1.0):4.2f} s, largest torque {np.abs(free.u).max():5.3f}, "  # type: ignore[attr-defined]
        f"torque noise {1e3 * free.u[-100:].std():4.1f} mN m, "  # type: ignore[attr-defined]
        f"1 deg: {wrong.dtheta[-100:].mean():5.2f} rad/s"  # type: ignore[attr-defined]
    )


def main() -> None:
    """Print."""
    timing()
    print(f"default {Weights()}")
    for delay in (1, 2, 3, 4, 5):
        print(f"  psi {delay} ticks old  {report(Weights(), PLANTS['hoop'], delay)}")
    print(" ", behaviour(Weights(), PLANTS["hoop"]))
    if "--search" in sys.argv:
        for values in itertools.product((3, 6, 12), (0.1, 0.2, 0.4), (0.6, 1.2, 5), (0.05, 0.1, 0.2)):
            weights = Weights(*values)
            print(values, report(weights, PLANTS["hoop"], 3), "|", behaviour(weights, PLANTS["hoop"]), flush=True)


if __name__ == "__main__":
    main()
