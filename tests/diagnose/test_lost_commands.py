"""Demands that a drive does not hear: which, how many, and what else they are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnose.motor import SAMPLE_S, levels, sampled, turned
from diagnose.test_step_in_time import MOTOR, B, J

from hoopd.diagnose.search.candidates import Settings
from hoopd.diagnose.search.lost_commands import LostCommands, _without, as_heard
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of

THRESHOLD = Settings().threshold


def recorded(
    lost: Sequence[int] = (), *, late: int = 0, weak: float = 1.0, seed: int = 1
) -> tuple[Stretch, np.ndarray]:
    """Levels of a torque for 15 s; of the changes `lost` are not heard for a sample, all are `late` tenths of one and
    `weak`; with the starts of the samples that begin with a change, s."""
    random, n = np.random.default_rng(1), 1501
    t, u = np.arange(n) * SAMPLE_S, levels(random, [-0.06, -0.02, 0.02, 0.06], 10, n)
    changes = np.flatnonzero(np.diff(u)) + 1
    there = u.copy()
    for k in changes[list(lost)]:
        there[k] = there[k - 1]

    def moment(k: int, part: int, w: float) -> float:
        return float(weak * there[k - 1 if part < late and k else k] - B * w)

    shown = np.column_stack([sampled(one) for one in turned(n, moment, J)])
    shown += random.normal(size=shown.shape) * (1e-3, 0.1)
    rows = np.arange(n)
    readings = {"th": (rows, shown[:, 0]), "w": (rows, shown[:, 1])}
    return stretch_of("day1", MOTOR, t, u, readings), t[changes]


def refit(stretches: Sequence[Stretch]) -> HypothesisFit:
    return fit(stretches, (), MOTOR.values)


def heard(stretch: Stretch) -> tuple[list[Stretch], HypothesisFit, LostCommands]:
    return as_heard([stretch], refit([stretch]), refit, THRESHOLD)


@pytest.mark.parametrize("is_said", [True, False])
def test_each_command_that_was_lost_is_found_and_the_rest_is_as_without_them(is_said: bool) -> None:
    lost = [7, 30, 31, 64, 90]
    made, changes = recorded(lost)
    if not is_said:
        # as a plant file has it that does not say how often it is sampled
        made = replace(made, plant=replace(MOTOR, time_scale_s=0.02))
    (corrected,), found, told = heard(made)
    assert told.moments == {"day1": changes[lost].tolist()} and told.changes == len(changes)
    clean, _ = recorded()
    assert found.values["J"] == pytest.approx(refit([clean]).values["J"], rel=1e-3)
    same = np.flatnonzero(corrected.u != made.u)
    assert (corrected.t[same] == changes[lost]).all()
    fault = told.fault("actuator.lost_commands", THRESHOLD)
    assert fault is not None and fault.ci95[0] < 5 / len(changes) == fault.share < fault.ci95[1]
    assert told.sentence.startswith(f"5 of {len(changes)} changes of the input, at ") and "day1" in told.sentence
    assert "actuator.lost_commands" in library(MOTOR)


@pytest.mark.parametrize(
    ("late", "weak", "lost"), [(0, 1.0, []), (4, 1.0, []), (9, 1.0, []), (0, 0.8, []), (0, 1.0, [40])]
)
def test_a_drive_that_is_late_or_weak_hears_everything_and_one_is_left_to_others(
    late: int, weak: float, lost: list[int]
) -> None:
    made, _ = recorded(lost, late=late, weak=weak)
    (same,), _, told = heard(made)
    assert same is made and told.count == 0 and told.fault("actuator.lost_commands", THRESHOLD) is None


def test_commands_lost_one_after_the_other_leave_what_was_before_all_of_them() -> None:
    """The demand changes at every sample, so that the second one is not what the first one was to be."""
    made, _ = recorded()
    u = made.u.copy()
    u[500:504] = 0.06, -0.06, 0.02, -0.02
    given = replace(made, u=u)
    corrected = _without(given, {float(made.t[501]), float(made.t[502])})
    assert corrected.u[499:505].tolist() == [u[499], 0.06, 0.06, 0.06, -0.02, u[504]]
