"""An input that is plugged the other way round, or a share of one for percent: asked about before anything is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoopd.diagnose.quality.input_doubt import input_doubts
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch
from tests.commands.test_plant import hoopd
from tests.diagnose.test_slow_sensor import HEATER, heated, heated_stretch


def doubts(stretch: Stretch) -> list[str]:
    nominal = fit([stretch], (), HEATER.values, move=False)
    base = fit([stretch], (), HEATER.values, like=nominal, noise=nominal.noise)
    return input_doubts(nominal, base, base, 10.0)


def test_the_right_sign_and_scale_are_not_asked_about() -> None:
    assert doubts(heated_stretch(3)) == []


@pytest.mark.parametrize(
    ("factor", "words"), [(-1.0, "with its sign turned (--columns duty=-COLUMN)"), (0.01, "duty=COLUMN:-")]
)
def test_another_sign_or_scale_is_told_with_what_to_do(factor: float, words: str) -> None:
    right = heated_stretch(3)
    kept = replace(HEATER, bounds={**HEATER.bounds, "h": (0.1, 10.0)})  # else a heater of a hundredth does the same
    (doubt,) = doubts(replace(right, plant=kept, u=factor * right.u))
    assert words in doubt and doubt.endswith("?")


HEATER_FILE = """
schema: hoopd.plant/1
name: heater
states: {T: {unit: degC, usual: 50}}
inputs: {duty: {unit: "%", limit: 100}}
parameters:
  C: {value: 110, unit: J/K}
  h: {value: 0.85, unit: W/K}
  P: {value: 0.8, unit: W/%, held: true}
  Ta: {value: 22.5, unit: degC, held: true}
equations: {T: C*T' = P*duty - h*(T - Ta)}
sample_time_s: 4
"""


def test_a_command_asks_first_and_takes_the_turned_column(tmp_path: Path) -> None:
    t, duty, y = heated(3, 450, lag_s=0.1)
    day, plant = tmp_path / "day.csv", tmp_path / "heater.yaml"
    np.savetxt(day, np.column_stack([t, -duty, y]), "%.10g", ",", header="t,duty,temp", comments="")
    plant.write_text(HEATER_FILE)
    words = ["diagnose", str(day), "--plant", str(plant), "--columns"]
    asked = " ".join(hoopd(*words, "T=temp,duty=duty")[1].split())
    assert "Answer this first" in asked and "--columns duty=-COLUMN" in asked
    assert "Next: answer what is asked above" in asked
    turned = " ".join(hoopd(*words, "T=temp,duty=-duty")[1].split())
    assert "Next:" in turned and "its sign turned" not in turned
