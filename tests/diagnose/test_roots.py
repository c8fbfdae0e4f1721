"""Equations that have no slope at nothing: the textbook's tanks, whose outflow is the root of the level."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from inprocess import call

from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import first_states, stretch_of
from hoopd.plants.plant_file import parse_plant

TANKS = """
schema: hoopd.plant/1
name: tanks
states: {h1: {unit: m, usual: 0.2}, h2: {unit: m, usual: 0.2}}
inputs: {u1: {unit: V, limit: 12}}
parameters:
  A: {value: 0.0154, unit: m2, held: true}
  a1: {value: 6.6e-5, unit: m2, bounds: [0, 1]}
  a2: {value: 4.6e-5, unit: m2, bounds: [0, 1]}
  g: {value: 9.81, unit: m/s2, held: true}
  kp: {value: 2.2e-5, unit: m3/s/V, held: true}
equations:
  h1: A*h1' = kp*u1 - a1*sqrt(2*g*h1)
  h2: A*h2' = a1*sqrt(2*g*h1) - a2*sqrt(2*g*h2)
channels: {h1: {reads: h1, sensor: gauge1}, h2: {reads: h2, sensor: gauge2}}
sample_time_s: 4
"""
A1, A2, KP, AREA = 6.0e-5, 5.0e-5, 2.2e-5, 0.0154


def recorded(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), voltages (n-1,) and levels (n, 2), in small steps."""
    random, n = np.random.default_rng(seed), 600
    u = np.repeat(random.choice([3.0, 5.0, 7.0], n // 30), 30)[: n - 1]
    levels = np.full((n, 2), (0.15, 0.2))
    for k in range(n - 1):
        h = levels[k].copy()
        for _ in range(20):
            out1, out2 = A1 * np.sqrt(2 * 9.81 * h[0]), A2 * np.sqrt(2 * 9.81 * h[1])
            h += 0.2 / AREA * np.array([KP * u[k] - out1, out1 - out2])
        levels[k + 1] = h
    return np.arange(n) * 4.0, u, levels + 5e-4 * random.normal(size=levels.shape)


@pytest.mark.parametrize("late", [0, 30, 100])
def test_the_textbooks_tanks_are_fitted_as_they_stand(late: int) -> None:
    """Also where the second gauge begins so many rows later."""
    plant, (t, u, levels) = parse_plant(TANKS, "tanks.yaml"), recorded(1)
    rows = np.arange(len(t))
    made = stretch_of("day1", plant, t, u, {"h1": (rows, levels[:, 0]), "h2": (rows[late:], levels[late:, 1])})
    assert (first_states(made) > 0.05).all()
    found = fit([made], (), plant.values)
    assert found.values["a1"] == pytest.approx(A1, rel=0.01) and found.values["a2"] == pytest.approx(A2, rel=0.01)


def test_equations_that_are_no_numbers_along_a_recording_are_one_line(tmp_path: Path) -> None:
    """Nobody measures the second tank here, and an empty one has no slope."""
    model, file = tmp_path / "tanks.yaml", tmp_path / "day1.csv"
    model.write_text(TANKS.replace(", h2: {reads: h2, sensor: gauge2}}", "}"))
    t, u, levels = recorded(1)
    np.savetxt(
        file, np.column_stack([t, np.append(u, u[-1]), levels[:, 0]]), delimiter=",", header="t,u1,h1", comments=""
    )
    code, _, errors = call(["diagnose", str(file), "--plant", str(model), "--no-free-run"])
    assert code == 2 and errors.count("\n") == 1
    assert errors.startswith("hoopd: tanks: equations: no number, or no slope, along these recordings")
