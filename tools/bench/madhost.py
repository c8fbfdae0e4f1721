"""What a host gone mad reaches on the rig before its board ends it: `python tools/bench/madhost.py [--seconds 5]`.

Good requests every millisecond demand the largest torque: for ever; turned round every half period, beginning with a
whole half period (the hoop's speed swings between nothing and its most) or with half of one (it swings about nothing);
or with sight of the rig, to keep the hoop just below the board's limit. The board has nothing but what
docs/reference/board.md demands of it. Exit code 1 when the hoop passes the limit or a constant torque is not ended.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from hoopd.core.frames import DEFAULT_LAYOUT, encode_request  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.plants.model_file import load_model  # noqa: E402
from hoopd.sim.board import BoardConfig, DriverBoard  # noqa: E402
from hoopd.sim.guards import LOOK_S  # noqa: E402
from hoopd.sim.plant import make_plant  # noqa: E402
from hoopd.sim.torque_log import TorqueRow  # noqa: E402

ASK_S = 0.001  # faster than a daemon's 20 ms: a mad host need not keep to it
PERIODS_S = (0.05, 0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.6, 0.73, 1.0)
# 0.7 N m give less than this; what is added while the board looks (every millisecond) is the bound's slack.
ACCELERATION_RAD_S2 = 500.0
GRAVITY_M_S2 = 9.81
CONSTANTS = BoardConfig()
LIMIT_NM, LIMIT_RAD_S = CONSTANTS.torque_limit_nm, CONSTANTS.overspeed_rad_s

State = tuple[float, float, float, float]
Host = Callable[[float, State], float]  # run time and true state to the torque that is demanded


class Reached(NamedTuple):
    """The most of a run."""

    host: str
    cut_s: float  # inf: never
    speed_rad_s: float
    angle_rad: float
    ball_angle_rad: float
    ball_speed_rad_s: float
    leaves: bool  # the track cannot hold the ball: g cos psi + (Ro - Rb) psi'^2 < 0 somewhere


def alternating(period_s: float, lead_s: float = 0.0) -> Host:
    """A square wave; `lead_s`: how far into its period it begins."""
    return lambda t, state: -LIMIT_NM if (t + lead_s) % period_s >= 0.5 * period_s else LIMIT_NM


def hosts() -> dict[str, Host]:
    """Every madness by its name; the first one is constant."""
    found: dict[str, Host] = {"constant": lambda t, state: LIMIT_NM}
    found |= {f"{period:.2f} s": alternating(period) for period in PERIODS_S}
    found |= {f"{period:.2f} s, about nothing": alternating(period, 0.25 * period) for period in PERIODS_S}
    found["keeps below the limit"] = lambda t, state: LIMIT_NM if state[1] < 0.98 * LIMIT_RAD_S else -LIMIT_NM
    return found


def run(name: str, host: Host, seconds: float) -> Reached:
    """One madness from rest."""
    model = load_model(defaults_folder() / "models" / "hoop.yaml")
    values = model.values()
    plant = make_plant(model.structure, values, [0.0, 0.0, 0.0, 0.0])
    rows: list[TorqueRow] = []
    board = DriverBoard(plant, np.random.default_rng(1), sink=rows.append)
    most, leaves, radius = np.zeros(4), False, values["Ro"] - values["Rb"]
    for k in range(1, round(seconds / ASK_S) + 1):
        t = k * ASK_S
        board.receive(t, encode_request(DEFAULT_LAYOUT, k, True, False, host(t, plant.state)))
        board.outgoing(t)
        most = np.maximum(most, np.abs(plant.state))
        _, _, psi, dpsi = plant.state
        leaves = leaves or GRAVITY_M_S2 * math.cos(psi) + radius * dpsi**2 < 0.0
    angle, speed, ball_angle, ball_speed = most.tolist()
    cut = next((row.t for row in rows if row.reason == "fault"), math.inf)
    return Reached(name, cut, speed, angle, ball_angle, ball_speed, leaves)


def show(found: list[Reached], seconds: float) -> None:
    """The table."""
    print(f"{'host':<22} {'cut':>8} {'hoop':>12} {'turned':>10} {'ball':>9} {'ball':>12}  track")
    for one in found:
        cut = f"{one.cut_s:.3f} s" if math.isfinite(one.cut_s) else "-"
        print(
            f"{one.host:<22} {cut:>8} {one.speed_rad_s:>6.1f} rad/s {one.angle_rad:>6.1f} rad"
            f" {one.ball_angle_rad:>5.1f} rad {one.ball_speed_rad_s:>6.1f} rad/s  {'leaves' if one.leaves else 'holds'}"
        )
    print(f"the most within {seconds:g} s, from rest; ball: of the rig's model, which keeps it on the track")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0)
    seconds = parser.parse_args().seconds
    found = [run(name, host, seconds) for name, host in hosts().items()]
    show(found, seconds)
    limit = LIMIT_RAD_S + ACCELERATION_RAD_S2 * LOOK_S
    wrong = [one for one in found if one.speed_rad_s > limit] + [one for one in found[:1] if math.isinf(one.cut_s)]
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
