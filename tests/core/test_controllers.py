"""The laws one by one, without a plant."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from hoopd.core.controllers import LinearGains, Lqg, LqgGains, LqgLinear, Measurement, TransferFunctionController

GAINS = LqgGains(0.01, 0.2, 0.05, 0.33, -0.0005, 231.0, 0.8, 30.0)


def measurement(
    x: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    *,
    psi: float = 0.0,
    dtheta: float = 0.0,
    fresh: bool = True,
    ready: bool = True,
    reference: float = 0.0,
    previous: float = 0.0,
) -> Measurement:
    return Measurement(0.0, np.array(x), ready, psi, fresh, dtheta, reference, previous, 0.02)


def test_lqg_is_state_feedback_without_theta() -> None:
    law = Lqg(GAINS)
    assert law.update(measurement((99.0, 2.0, 0.1, -1.0)))[0] == pytest.approx(-0.02 - 0.02 + 0.05)
    assert law.update(measurement((0, 0, 0.1 + 2 * math.tau, 0)))[0] == pytest.approx(-0.02)
    assert law.update(measurement((0, 9, 9, 9), ready=False)) == (0.0, {})


def test_a_held_reference_asks_for_the_speed_that_the_plant_demands() -> None:
    law = Lqg(GAINS)
    first = law.update(measurement(reference=0.1))[1]
    assert first["reference_rad"] == 0.1
    assert first["reference_speed_rad_s"] == pytest.approx(231 * math.sin(0.1) * (1 - math.exp(-0.016)))
    for _ in range(1000):
        log = law.update(measurement(reference=0.1))[1]
    assert log["reference_speed_rad_s"] == pytest.approx(231 * math.sin(0.1), rel=1e-3)


def test_back_at_the_bottom_the_speed_goes_down_as_the_plant_slows_down() -> None:
    law = Lqg(GAINS)
    for _ in range(1000):
        before = law.update(measurement(reference=0.1))[1]["reference_speed_rad_s"]
    speeds = []
    for _ in range(1000):
        log = law.update(measurement(reference=0.0))[1]
        assert log["reference_rad"] == 0.0
        speeds.append(log["reference_speed_rad_s"])
    assert speeds[:100] == pytest.approx([before * math.exp(-0.016 * (k + 1)) for k in range(100)])
    assert speeds[-1] == 0.0


def test_where_it_takes_over_at_the_bottom_the_hoop_is_braked() -> None:
    law = Lqg(GAINS)
    assert law.follow(measurement((0.0, 20.0, 0.0, 0.0), reference=0.0))[1]["reference_speed_rad_s"] == 0.0
    law.follow(measurement((0.0, 20.0, 0.0, 0.0), reference=0.05))
    assert law.update(measurement((0.0, 20.0, 0.0, 0.0), reference=0.05))[1]["reference_speed_rad_s"] == pytest.approx(
        20.0, 0.05
    )


def test_a_hoop_beyond_the_speed_limit_slows_down_before_the_angle_is_held() -> None:
    law = Lqg(GAINS)
    law.follow(measurement((0.0, 45.0, 0.0, 0.0), reference=0.05))
    for _ in range(100):
        log = law.update(measurement((0.0, 45.0, 0.0, 0.0), reference=0.05))[1]
        beyond = log["reference_speed_rad_s"] > 30.0
        assert log["reference_rad"] == (0.0 if beyond else 0.05) or log["reference_speed_rad_s"] == 30.0
        assert abs(log["reference_rad"]) <= 0.05


def test_an_angle_beyond_the_hoop_speed_limit_is_held_for_a_while_only() -> None:
    law, angles = Lqg(GAINS), []
    for _ in range(600):
        log = law.update(measurement(reference=-0.3))[1]
        assert -30.0 <= log["reference_speed_rad_s"] <= 0.0
        angles.append(log["reference_rad"])
    assert angles[0] == -0.3
    assert angles[-1] == pytest.approx(-30 / 231, rel=0.03)


def test_from_one_reference_to_another_the_speed_goes_on_through_zero() -> None:
    law = Lqg(GAINS)
    for _ in range(600):
        before = law.update(measurement(reference=-0.1))[1]["reference_speed_rad_s"]
    speeds = [law.update(measurement(reference=0.05))[1] for _ in range(600)]
    assert all(one["reference_rad"] == 0.05 for one in speeds)
    courses = [before, *(one["reference_speed_rad_s"] for one in speeds)]
    assert before < -20.0 and courses == sorted(courses)
    assert max(now - last for last, now in pairwise(courses)) < 1.0
    assert courses[-1] == pytest.approx(231 * math.sin(0.05), rel=1e-3)


def test_a_hoop_that_turns_the_other_way_at_its_limit_does_not_turn_the_reference_round() -> None:
    law = Lqg(GAINS)
    for _ in range(600):
        law.update(measurement(reference=-0.3))
    assert law.update(measurement(reference=0.3))[1]["reference_rad"] == 0.3


def test_lqg_is_tuned_by_name() -> None:
    law = Lqg(GAINS)
    assert law.tune("k_psi", 0.3) and law.gains.k_psi == 0.3
    assert not law.tune("k_phi", 0.3) and not law.tune("k_psi", math.nan) and not law.tune("hoop_speed_limit", -1.0)


def test_transfer_function_is_its_difference_equation() -> None:
    from scipy.signal import lfilter

    b, a = [2.0, -3.8, 1.84], [1.0, -1.45, 0.45]
    law, previous = TransferFunctionController(b, a), 0.0
    psi = np.random.default_rng(0).normal(size=50) * 0.01
    for value, want in zip(psi, lfilter(b, a, 0.1 - psi), strict=True):
        previous, _ = law.update(measurement(psi=value, reference=0.1, previous=previous))
        assert previous == pytest.approx(want, abs=1e-12)


def test_a_saturated_integrator_does_not_wind_up() -> None:
    law, previous = TransferFunctionController([0.1, 0.0], [1.0, -1.0]), 0.0
    for _ in range(500):
        wanted, _ = law.update(measurement(psi=-1.0, previous=previous))
        previous = min(0.7, wanted)
    assert wanted < 0.9
    wanted, _ = law.update(measurement(psi=1.0, previous=previous))
    assert wanted < 0.7  # leaves the limit at once


def test_without_a_new_angle_the_last_error_stays() -> None:
    law = TransferFunctionController([2.0], [1.0])
    assert law.update(measurement(psi=0.1))[0] == pytest.approx(-0.2)
    assert law.update(measurement(psi=math.nan))[0] == pytest.approx(-0.2)
    assert law.update(measurement(psi=0.5, fresh=False))[0] == pytest.approx(-0.2)
    law.reset()
    assert law.update(measurement(psi=math.nan))[0] == 0.0


def test_a_shorter_numerator_is_a_delayed_one() -> None:
    law = TransferFunctionController([1.0], [1.0, 0.0])
    assert law.update(measurement(psi=-0.3))[0] == 0.0
    assert law.update(measurement(psi=0.0))[0] == pytest.approx(0.3)


@pytest.mark.parametrize(("b", "a"), [([1.0], []), ([1.0], [0.0, 1.0]), ([1.0, 2.0], [1.0]), ([math.nan], [1.0])])
def test_improper_transfer_functions_are_refused(b: list[float], a: list[float]) -> None:
    with pytest.raises(ValueError, match="transfer function"):
        TransferFunctionController(b, a)


LINEAR = LinearGains(
    np.array([[0.9, 0.0], [0.0, 0.8]]), np.array([1.0, 0.5]), np.eye(2), np.eye(2), np.array([0.1, 0.2]), 2.0
)


def test_linear_law_filters_predicts_and_feeds_forward() -> None:
    law = LqgLinear(LINEAR)
    assert law.update(measurement(psi=0.1, dtheta=1.0))[0] == pytest.approx(-0.12)
    # nothing new: x = A x + B u
    torque, _ = law.update(measurement(psi=math.nan, dtheta=math.nan, previous=0.2, reference=0.3))
    assert torque == pytest.approx(0.6 - (0.1 * (0.9 + 0.2) + 0.2 * (0.08 + 0.1)))
    law.reset()
    assert law.update(measurement(psi=math.nan, dtheta=math.inf))[0] == 0.0
    assert law.tune("feedforward", 1.0) and not law.tune("a", 1.0)


def test_linear_law_takes_the_nearest_turn_and_only_plausible_angles() -> None:
    law = LqgLinear(LINEAR)
    assert law.update(measurement(psi=0.1 + math.tau, dtheta=0.0))[0] == pytest.approx(-0.02)
    law.reset()
    assert law.update(measurement(psi=0.1, dtheta=0.0, fresh=False))[0] == 0.0
