"""What a policy lets pass: of what is new, and of what the model has already and changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoopd.files.heal_policy import HealPolicy, load_policy

FRICTION = "hoop.coulomb_friction.Fc"
POLICY = HealPolicy(
    schema="hoopd.policy/1", effects=["hoop.*"], parameter_change=0.3, largest={FRICTION: 0.02, "bh": 2e-3}
)


@pytest.mark.parametrize(
    ("name", "share", "value", "why"),
    [
        (FRICTION, 49.0, 0.5, f"{FRICTION} is 0.5, the policy's largest is 0.02"),
        (FRICTION, 0.5, 0.015, ""),
        ("bh", 2.0, 2.1e-3, "bh is 0.0021, the policy's largest is 0.002"),
        ("Ih", 0.5, 2.2e-3, "Ih changed by +50%, the policy lets a parameter change by 30%"),
        ("Ih", -0.2, 1.2e-3, ""),
    ],
)
def test_a_parameter_of_the_model_is_held_by_its_size_or_else_by_its_share(
    name: str, share: float, value: float, why: str
) -> None:
    assert POLICY.objection({}, {}, {name: share}, {name: value}) == why


def test_a_change_whose_size_nobody_told_is_held_by_its_share() -> None:
    assert "changed by +50%" in POLICY.objection({}, {}, {FRICTION: 0.5}, {})


def test_what_was_0_is_held_by_its_size_alone() -> None:
    told = POLICY.objection({}, {}, {"Ih": None, FRICTION: None}, {"Ih": 1e-9, FRICTION: 0.01})
    assert told == "Ih was 0, of which no share is small: the policy has no largest size of it"
    assert POLICY.objection({}, {}, {FRICTION: None}, {FRICTION: 0.01}) == ""


def test_a_limit_may_be_of_a_parameter_of_the_plant(tmp_path: Path) -> None:
    path = tmp_path / "policy.yaml"
    path.write_text("schema: hoopd.policy/1\nlargest: {bh: 0.002}\n")
    assert load_policy(path).largest == {"bh": 0.002}


def test_a_largest_size_is_kept_by_small_changes_too() -> None:
    assert "largest is 0.02" in POLICY.objection({}, {}, {}, {FRICTION: 0.0201})


def test_a_clock_that_was_set_back_is_told_and_counts_once() -> None:
    assert POLICY.too_often([1000.0, 6000.0], 1000.0) == (
        "the last version was accepted at a time to come: the clock was set back by 5000 s or more"
    )
    # a person has accepted one since then: dates of another year limit no day
    assert POLICY.too_often([1e9] * 10 + [0.0], 1000.0) == ""
    assert POLICY.too_often([], 0.0) == ""
