"""A test signal written down for a daemon that runs, instead of played."""

from __future__ import annotations

from pathlib import Path

from inprocess import call

from hoopd.core.excitation import Excitation
from hoopd.files.controller import controller_of, load_controller
from hoopd.files.shipped import defaults_folder

LQG = defaults_folder() / "controllers" / "lqg.yaml"


def test_it_is_a_controller_around_the_law_that_acts_on_its_model(tmp_path: Path) -> None:
    path = tmp_path / "signal.yaml"
    code, out, errors = call(
        ["experiment", "steps", "--duration", "4", "--around", str(LQG), "--signal-out", str(path)]
    )
    assert code == 0 and "hoopd controller --experiment" in out, errors
    file, base = load_controller(path), load_controller(LQG)
    law = controller_of(file)
    assert isinstance(law, Excitation) and len(law.torques_nm) == 200
    assert (file.model, file.estimator) == (base.model, base.estimator)
    assert file.limits.torque_nm <= base.limits.torque_nm


def test_without_a_law_to_go_back_to_it_is_refused(tmp_path: Path) -> None:
    code, _, errors = call(["experiment", "prbs", "--signal-out", str(tmp_path / "signal.yaml")])
    assert code == 2 and "goes with --around" in errors
