"""An effect with a time acts when a recording's first row says so, whatever the file's clock shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from inprocess import call

from hoopd.files.shipped import defaults_folder

PUSH = (
    "effects: [{name: external.disturbance, parameters: {A: {value: 0.02, unit: N m}, "
    "t0: {value: 3.0, unit: s}, t1: {value: 5.0, unit: s}}}]"
)


@pytest.mark.parametrize("begin_s", [0.0, 100.0])
def test_a_push_comes_after_three_seconds_of_any_clock(begin_s: float, tmp_path: Path) -> None:
    model = (defaults_folder() / "models" / "hoop.yaml").read_text().replace("effects: []", PUSH)
    (tmp_path / "push.yaml").write_text(model)
    t, rest = 0.02 * np.arange(400), np.zeros(400)
    table = np.column_stack([t + begin_s, rest, rest, rest, rest])
    np.savetxt(tmp_path / "rest.csv", table, delimiter=",", header="t,u,theta,dtheta,psi", comments="")
    out = str(tmp_path / "out.csv")
    words = (
        "--model",
        str(tmp_path / "push.yaml"),
        "--input",
        str(tmp_path / "rest.csv"),
        "--x0",
        "theta=0",
        "--out",
        out,
    )
    code, _, errors = call(("simulate", *words, "--json", str(tmp_path / "out.json")))
    assert code == 0, errors
    assert json.loads((tmp_path / "out.json").read_text())
    speed = np.genfromtxt(out, delimiter=",", names=True)["dtheta"]
    assert np.abs(speed[t < 2.99]).max() < 1e-9
    assert np.abs(speed[(t > 4.0) & (t < 5.0)]).min() > 5.0
