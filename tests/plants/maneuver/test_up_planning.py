"""Up: what its report says of the contact, and what may be asked of it."""

from __future__ import annotations

from functools import cache

import msgspec
import pytest

from hoopd.files.model import EffectEntry, InnerHoop, Parameter
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, plan_trajectory, report_of, trajectory_file
from hoopd.plants.hoop.maneuver.up_planning import CATCH_CONTACT
from hoopd.plants.model_file import load_model

HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
INNER = msgspec.structs.replace(HOOP, device=msgspec.structs.replace(HOOP.device, inner=InnerHoop(0.0445)))
LIMITS = MotionLimits(0.45, 40.0, 0.5, 0.6)


@cache
def up() -> PlannedTrajectory:
    return plan_trajectory(INNER, ManeuverQuestion("up", LIMITS, hold_s=1.0))


def test_the_contact_that_is_told_is_of_the_hoop_that_the_ball_is_on() -> None:
    """Played without an error it is the plan's, which ends on the top with its whole weight on the inner hoop."""
    planned, report = up(), report_of(up())
    after = planned.contact[(planned.flight_ticks or (0, 0))[1] :]
    assert after[-1] == pytest.approx(1.0)
    assert planned.nominal.contact == pytest.approx(after.min(), abs=0.02)
    told = [row["least_contact"] for row in report["sensitivity"].values()]
    assert min(told) > CATCH_CONTACT / 2 and report["sampled_least_contact"] > CATCH_CONTACT / 2


def test_the_contact_that_is_reported_is_the_one_that_was_kept() -> None:
    planned = up()
    kept = trajectory_file(planned, "inner.yaml", "ab", "up").limits.contact
    after = planned.contact[(planned.flight_ticks or (0, 0))[1] :]
    assert kept == CATCH_CONTACT == 0.2 and after.min() >= kept - 1e-6


@pytest.mark.parametrize("hold_s", [0.0, 0.2, 0.99, 8.1])
def test_a_hold_that_is_no_success_is_no_question(hold_s: float) -> None:
    with pytest.raises(ValueError, match="hold must be 1 to 8 s"):
        ManeuverQuestion("up", LIMITS, hold_s=hold_s)
    assert ManeuverQuestion("loop", LIMITS, hold_s=hold_s).hold_s == hold_s


def test_feedback_holds_a_ball_on_the_top_whose_contact_has_dry_friction() -> None:
    """Not with gains for the damping that the friction's smooth form has at rest."""
    rubs = EffectEntry(name="ball.coulomb_friction", parameters={"Fc": Parameter(value=1e-4, unit="N m")})
    model = msgspec.structs.replace(INNER, effects=[rubs])
    planned = plan_trajectory(model, ManeuverQuestion("up", LIMITS, hold_s=1.0))
    assert planned.gains[-1] == pytest.approx(up().gains[-1], rel=1e-9)
    assert sum(one.arrived for one in planned.sampled) >= 38
