"""What a filter's innovations are on a device that is exactly as its model says: the level that the daemon watches by.

Rules of this file: seeded; sensors are those of the simulated device (`closedloop.Scenario`).
"""

from __future__ import annotations

from collections.abc import Callable

from hoopd.core.controllers import Lqg
from hoopd.core.drift import BLOCK_S, CHANNELS, LEARNED_BLOCKS, SETTLE_S, Drift, Level
from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.limits import SLEW_NM_PER_TICK, TORQUE_LIMIT_NM, Limiter
from hoopd.design.lqg import lqg_gains
from hoopd.design.weights import Weights
from hoopd.plants.hoop.loop.closed_loop import Scenario, picture_timing, simulate
from hoopd.plants.hoop.plant import HoopPlant

# Steps of the reference, so that the hoop turns and the ball swings: +-0.03 rad every three seconds.
STEP_RAD, STEP_S = 0.03, 3.0
DIGITS = 3


def innovation_levels(plant: HoopPlant, settings: EkfSettings, delay_s: float, h: float) -> dict[str, list[float]]:
    """[all, slow] by channel (`core.drift`), whatever the law: the filter is told the torque.

    Of a hoop that dry friction holds the filter foretells the speed zero, and a sensor's noise is all that is left: of
    the same size, but not with the last one's sign changed. So what is normal there is the larger of motion and rest.
    """
    runs = [
        _levels(plant, settings, delay_s, h, reference)
        for reference in ((_steps, _rest) if plant.sticks else (_steps,))
    ]
    return {
        name: [_short(max(values)) for values in zip(*(run[name] for run in runs), strict=True)] for name in runs[0]
    }


def _levels(
    plant: HoopPlant, settings: EkfSettings, delay_s: float, h: float, reference: Callable[[float], float]
) -> dict[str, Level]:
    """Of one simulated run."""
    drift, duration = Drift(), SETTLE_S + (LEARNED_BLOCKS + 1) * BLOCK_S
    scenario = Scenario(duration_s=duration, period_s=h, reference=reference, **picture_timing(delay_s, h))  # type: ignore[arg-type]
    simulate(
        plant,
        Lqg(lqg_gains(plant, Weights(), h)),
        DelayedEkf(plant.step_and_jacobian, settings),
        Limiter(TORQUE_LIMIT_NM, SLEW_NM_PER_TICK),
        scenario,
        lambda t, estimate: drift.watch(t, estimate.surprise),
    )
    levels = {name: drift.level(name) for name in CHANNELS}
    return {name: level for name, level in levels.items() if level is not None}


def _steps(t: float) -> float:
    return STEP_RAD if int(t / STEP_S) % 2 else -STEP_RAD


def _rest(t: float) -> float:
    return 0.0


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
