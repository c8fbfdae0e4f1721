"""A hoop driven by hand: a set point that lasts only while somebody says so, inside what the law follows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from harness.smallrig import PERIOD_S, SmallRig, running

from hoopd.core.controllers import Log, Lqg, LqgGains, Measurement
from hoopd.core.operator import HAND_S, NO_SPEED
from hoopd.core.records import Command

GAINS = LqgGains(0.01, 0.2, 0.05, 0.33, -0.0005, 231.0, 0.8, 30.0)


class Follower:
    """A law that notes which speed is wanted."""

    speed_limit = 12.0

    def __init__(self) -> None:
        self.wanted: list[float] = []

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        self.wanted.append(measurement.speed)
        return 0.0, {}

    def reset(self) -> None: ...

    def tune(self, key: str, value: float) -> bool:
        return False


def follower() -> tuple[SmallRig, Follower]:
    rig, law = running(), Follower()
    succession = rig.tick.succession
    succession.acting = succession.accepted = replace(succession.acting, law=law)
    return rig, law


def speed(value: float) -> Command:
    return Command("speed", value)


def test_silence_ends_it_in_time_and_says_so_once() -> None:
    rig, law = follower()
    rig.step(speed(5.0))
    rig.run(40)
    driven = [one for one in law.wanted if one]
    assert set(driven) == {5.0} and len(driven) == round(HAND_S / PERIOD_S)
    assert [note.name for note in rig.notes].count("speed_ended") == 1


def test_it_lasts_as_long_as_it_is_said_and_zero_ends_it_at_once() -> None:
    rig, law = follower()
    for _ in range(10):
        rig.step(speed(-3.0))
        rig.run(9)
    assert law.wanted[-1] == -3.0 and not any(note.name == "speed_ended" for note in rig.notes)
    rig.step(speed(0.0))
    assert law.wanted[-1] == 0.0
    told = [note.level for note in rig.notes if note.name == "speed"]
    assert told.count("info") == 2  # its beginning and its end; what is between is recorded, not told


def test_it_is_cut_to_what_the_law_follows() -> None:
    rig, law = follower()
    rig.step(speed(99.0))
    assert law.wanted[-1] == Follower.speed_limit
    rig.step(speed(-math.inf))
    assert law.wanted[-1] == Follower.speed_limit and rig.refused() == [("speed", "not a finite number")]


def test_a_law_that_follows_no_speed_says_so() -> None:
    rig = running()
    rig.step(speed(1.0))
    assert rig.refused() == [("speed", NO_SPEED)] and rig.tick.operator.speed == 0.0


@pytest.mark.parametrize("name", ["disarm", "stop", "shutdown"])
@pytest.mark.parametrize("first", [True, False])
def test_what_switches_off_takes_it_back_in_any_order(name: str, first: bool) -> None:
    rig, _ = follower()
    both = (Command(name), speed(5.0))
    rig.step(*(both if first else both[::-1]))
    assert rig.tick.operator.speed == 0.0 and rig.mode != "RUNNING"
    rig.step(speed(5.0))
    assert rig.tick.operator.speed == 0.0 and rig.refused()[-1][0] == "speed"


def ask(law: Lqg, wanted: float, dtheta: float = 0.0, reference: float = 0.0) -> Log:
    x = np.array([0.0, dtheta, 0.0, 0.0])
    return law.update(Measurement(0.0, x, True, 0.0, True, dtheta, reference, 0.0, PERIOD_S, 0.0, wanted))[1]


def test_lqg_goes_to_the_speed_and_holds_it_with_the_angle_that_sustains_it() -> None:
    law = Lqg(GAINS)
    first = ask(law, 10.0)
    assert math.sin(first["reference_rad"]) == pytest.approx(2 * 10.0 / 231.0)
    seconds = next(k for k in range(1000) if ask(law, 10.0)["reference_speed_rad_s"] == 10.0) * PERIOD_S
    assert seconds == pytest.approx(math.log(2) / 0.8, abs=2 * PERIOD_S)
    assert math.sin(ask(law, 10.0)["reference_rad"]) == pytest.approx(10.0 / 231.0, rel=0.01)
    let_go = ask(law, 0.0, dtheta=10.0)
    assert let_go["reference_rad"] == pytest.approx(-0.06, abs=1e-4) and 9.0 < let_go["reference_speed_rad_s"] < 10.0
    slower = [ask(law, 3.0, dtheta=10.0) for _ in range(50)]
    assert all(one["reference_rad"] < 0.0 for one in slower if one["reference_speed_rad_s"] > 3.0)
    assert slower[-1]["reference_speed_rad_s"] == 3.0
    assert math.sin(ask(law, 3.0)["reference_rad"]) == pytest.approx(3.0 / 231.0, rel=0.02)
    stopping = [ask(law, 0.0)["reference_speed_rad_s"] for _ in range(50)]
    assert stopping[20] == 0.0 and stopping == sorted(stopping, reverse=True)
    assert ask(law, 0.0) == {"reference_rad": 0.0, "reference_speed_rad_s": 0.0, "hold_nm": 0.0}


def test_lqg_s_own_limit_holds_and_no_gains_for_it_mean_no_speed() -> None:
    law = Lqg(GAINS)
    assert law.speed_limit == 30.0
    for _ in range(2000):
        told = ask(law, 99.0)
    assert told["reference_speed_rad_s"] == 30.0
    assert Lqg(LqgGains(0.01, 0.2, 0.05)).speed_limit == 0.0
    assert ask(Lqg(LqgGains(0.01, 0.2, 0.05)), 5.0, reference=0.1)["reference_rad"] == 0.1
