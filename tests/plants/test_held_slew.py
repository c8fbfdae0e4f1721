"""A torque that the board lets change so fast and no faster acts as if it changed somewhat later."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.plants.likelihood.stretches import Held
from hoopd.sim.torquestage import SLEW_NM_PER_MS, TorqueStage

T = np.array([0.0, 0.02, 0.04, 0.06])
U = np.array([0.1, -0.1, -0.03])


def owed_by_the_stage(before: float, after: float) -> float:
    """Impulse that the rig's torque stage still owes a step of the demand: its torque less the demand, N m s."""
    stage, t, owed = TorqueStage(SLEW_NM_PER_MS, None), 1.0, 0.0
    stage.go(0.0, before, True, "request")
    while np.isfinite(stage.deadline()):
        stage.step(stage.deadline())
    stage.go(t, after, True, "request")
    while np.isfinite(due := stage.deadline()):
        owed, t = owed + (stage.torque_nm - after) * (due - t), due
        stage.step(due)
    return owed


def test_the_impulse_is_that_of_the_rig_s_torque_stage() -> None:
    parts = Held(T, U, slew=1e3 * SLEW_NM_PER_MS).substeps(2)
    owed = (parts[:, 1].mean() - U[1]) * 0.02
    assert owed == pytest.approx(owed_by_the_stage(0.1, -0.1), rel=0.05) and owed > 1e-5
    # what is late is in the first part of the step, and a small change is at once
    assert parts[1, 1] == pytest.approx(U[1], abs=1e-12)
    assert parts[:, 2] == pytest.approx([U[2], U[2]], abs=1e-12)


def test_without_a_limit_torques_are_held_from_their_nodes() -> None:
    assert np.array_equal(Held(T, U).substeps(2), np.tile(U, (2, 1)))
