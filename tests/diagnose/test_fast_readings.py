"""A current that follows its voltage within a few samples is on its course, and a false value of it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.diagnose.quality.recording_quality import assess
from hoopd.plants.plant_file import parse_plant
from hoopd.recording.recording import Recording, from_signals

COIL = parse_plant(
    """
schema: hoopd.plant/1
name: coil
states: {i: {unit: A, usual: 5}}
inputs: {V: {unit: V, limit: 12}}
parameters: {R: 1.2 ohm, L: {value: 0.004, unit: H}}
equations: {i: L*i' = V - R*i}
channels: {i: {reads: i, unit: A}}
sample_time_s: 0.001
""",
    Path("coil.yaml"),
)
STEP_S, ROWS, NOISE = 0.001, 3000, 0.003


def recorded(rows_per_step: int, time_constant_s: float, false: int = 0) -> tuple[Recording, np.ndarray]:
    """Steps of a voltage and the current after them; `false` of its samples are 1 A off. Also says which."""
    random = np.random.default_rng([rows_per_step, false])
    voltage = np.repeat(random.choice([-6.0, -2.0, 3.0, 6.0], ROWS // rows_per_step + 1), rows_per_step)[:ROWS]
    kept = np.exp(-STEP_S / time_constant_s)
    current = lfilter([0.0, 1.0 - kept], [1.0, -kept], voltage / 1.2) + random.normal(0.0, NOISE, ROWS)
    rows = np.sort(random.choice(np.arange(50, ROWS), false, replace=False))
    current[rows] += random.choice([-1.0, 1.0], false)
    return from_signals(np.arange(ROWS) * STEP_S, {"V": voltage}, {"i": current}), rows


@pytest.mark.parametrize("rows_per_step", [20, 200, 500])
@pytest.mark.parametrize("time_constant_s", [0.0005, 0.002, 0.008])
def test_the_answer_to_a_step_is_no_false_value(rows_per_step: int, time_constant_s: float) -> None:
    quality = assess(recorded(rows_per_step, time_constant_s)[0], COIL)
    assert quality.segments == []
    assert quality.channels["i"].counts.mean() > 0.998
    assert quality.channels["i"].sigma == pytest.approx(NOISE, rel=0.25)


def test_false_values_are_found_among_the_steps() -> None:
    recording, rows = recorded(200, 0.0035, false=40)
    found = np.flatnonzero(assess(recording, COIL).channels["i"].outliers)
    assert len(set(found) & set(rows)) >= 36
    assert len(set(found) - set(rows)) <= 10


SLOW = parse_plant(
    """
schema: hoopd.plant/1
name: slow
states: {x: {unit: K, usual: 5}}
inputs: {a: {unit: V, limit: 12}, b: {unit: V, limit: 12}, c: {unit: V, limit: 12}}
parameters: {T: 0.5 s, g: 1 K/V}
equations: {x: T*x' = g*(a + b + c) - x}
channels: {x: {reads: x, unit: K}}
sample_time_s: 0.001
""",
    Path("slow.yaml"),
)


@pytest.mark.parametrize("every", [10, 20])
def test_few_readings_beside_many_inputs_keep_their_noise(every: int) -> None:
    random = np.random.default_rng(every)
    inputs = {name: np.repeat(random.choice([-3.0, 3.0], ROWS // 3), 3) for name in "abc"}
    kept = np.exp(-STEP_S / 0.5)
    x = lfilter([0.0, 1.0 - kept], [1.0, -kept], sum(inputs.values())) + random.normal(0.0, NOISE, ROWS)
    x[np.arange(ROWS) % every > 0] = np.nan
    found = assess(from_signals(np.arange(ROWS) * STEP_S, inputs, {"x": x}), SLOW).channels["x"]
    assert found.sigma == pytest.approx(NOISE, rel=0.3)
