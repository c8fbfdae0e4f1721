"""Times that are not in seconds: told before the plant is followed over millions of steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from inprocess import call

PLANT = """schema: hoopd.plant/1
name: slide
coordinates: {x: {unit: m, usual: 0.1, usual_rate: 1}}
inputs: {F: {unit: N, limit: 10}}
parameters:
  m: {value: 1, unit: kg}
  c: {value: 2, unit: N s/m}
equations:
  x: m*x'' = F - c*x'
channels: {x: {reads: x}}
sample_time_s: 0.02
"""


@pytest.mark.parametrize("command", ["diagnose", "fit"])
def test_times_in_milliseconds_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.chdir(tmp_path)
    t, u = 20.0 * np.arange(500), np.sign(np.sin(np.arange(500) / 9.0))
    np.savetxt("day.csv", np.column_stack([t, u, np.cumsum(u) / 100.0]), delimiter=",", header="t,F,x", comments="")
    (tmp_path / "slide.yaml").write_text(PLANT)
    code, _, errors = call((command, "day.csv", "--plant", "slide.yaml"))
    assert code == 2
    assert "day.csv: t: rows are 20 s apart" in errors and "seconds" in errors
