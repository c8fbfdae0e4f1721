"""An encoder that lies: the torque is cut before the true hoop comes to anything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.runs import PERIOD_S, Run, run
from samples import sampled

from hoopd.core.encoderchecks import EQUAL_SPEEDS, NAMES
from hoopd.core.faulttable import BY_NAME, Action
from hoopd.daemon.replay import replay
from hoopd.sim.truth import read

AT_S = 4.0
HELD = [{"at_s": 2.5, "name": "reference", "value": 0.05}]
STEPS = [{"at_s": 2.5 + 2.0 * k, "name": "reference", "value": 0.15 * (-1) ** k} for k in range(9)]
NOISELESS_S = (EQUAL_SPEEDS + 2) * PERIOD_S


def lie(folder: Path, kind: str, commands: list[dict[str, Any]], **more: Any) -> Run:
    params = {"factor": more.pop("factor")} if "factor" in more else {}
    faults = [{"kind": kind, "at_s": AT_S, "params": params}]
    return run(folder, faults=faults, commands=commands, psi_rad=0.1, **more)


def cut_by(found: Run, names: set[str], within_s: float, top_rad_s: float) -> None:
    """One of the rows came, the torque went, and the true hoop was not too fast until then."""
    told = min(found.fault_at(name) for name in names)
    assert AT_S < told <= AT_S + within_s
    assert found.torque.max_abs(told + 0.1, 1e9) == 0.0
    assert found.mode_at(told + 0.1) == "FAULT"
    assert np.abs(read(found.folder / "truth.csv").dtheta).max() < top_rad_s
    assert all(replay(path)["equal"] for path in found.recordings)


@pytest.mark.parametrize("kind", sampled(["encoder_frozen", "encoder_coasts"], ["encoder_frozen"]))
@pytest.mark.parametrize("commands", [[], HELD, STEPS], ids=["rest", "held", "steps"])
def test_an_encoder_that_stopped_measuring(tmp_path: Path, kind: str, commands: list[dict[str, Any]]) -> None:
    found = lie(tmp_path, kind, commands)
    cut_by(found, {"speed_noiseless", "torque_without_motion"}, NOISELESS_S, 60.0)


@pytest.mark.parametrize("commands", [HELD, STEPS], ids=["held", "steps"])
def test_a_frozen_encoder_whose_speed_never_had_noise(tmp_path: Path, commands: list[dict[str, Any]]) -> None:
    """A board that counts: its speed at rest is zero, as when the encoder is dead. A fast hoop stops at once."""
    found = lie(tmp_path, "encoder_frozen", commands, dtheta_noise_rad_s=0.0)
    cut_by(found, {"torque_without_motion"} if commands == HELD else {"hoop_innovation"}, 0.4, 60.0)


@pytest.mark.parametrize("commands", [HELD, STEPS], ids=["held", "steps"])
def test_an_encoder_turned_round(tmp_path: Path, commands: list[dict[str, Any]]) -> None:
    cut_by(lie(tmp_path, "encoder_scale", commands, factor=-1.0), {"hoop_innovation"}, 0.06, 40.0)


@pytest.mark.parametrize("factor", [0.2, 2.0])
def test_a_scale_that_begins_while_the_hoop_turns(tmp_path: Path, factor: float) -> None:
    cut_by(lie(tmp_path, "encoder_scale", STEPS, factor=factor), {"hoop_innovation"}, 0.06, 40.0)


def test_it_goes_on_after_the_lie_when_the_operator_says_so(tmp_path: Path) -> None:
    faults = [{"kind": "encoder_coasts", "at_s": AT_S, "for_s": 1.0}]
    commands = [{"at_s": AT_S + 0.5, "name": "arm"}, {"at_s": AT_S + 3.0, "name": "arm"}]
    found = run(tmp_path, duration_s=AT_S + 4.5, faults=faults, commands=commands, psi_rad=0.1)
    assert found.modes(AT_S + 0.5, AT_S + 3.0) == {"FAULT"}
    assert found.mode_at(AT_S + 4.0) == "RUNNING"


def test_a_push_and_a_share_of_lost_answers_are_no_lie(tmp_path: Path) -> None:
    knock = {"name": "external.disturbance", "parameters": {"t0": 5.0, "t1": 5.1, "A": 0.1}}
    faults = [{"kind": "lost_frames", "at_s": 0.0, "params": {"rate": 0.025}}]
    found = run(tmp_path, duration_s=14.0, faults=faults, commands=STEPS, effects=[knock])
    assert found.mode_at(13.9) == "RUNNING"
    assert not [name for name in NAMES if found.fault_at(name) < np.inf]


def test_a_lie_of_the_encoder_cuts() -> None:
    assert {BY_NAME[name].action for name in NAMES} == {Action.CUT}
