"""Two masses on one spring: what is missing between them is one law, not one on each of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.registry import plant_named

Array = NDArray[np.float64]

MASSES = parse_plant(
    """
schema: hoopd.plant/1
name: masses
coordinates: {x1: {unit: m, usual: 0.05, usual_rate: 0.4}, x2: {unit: m, usual: 0.05, usual_rate: 0.4}}
inputs: {F: {unit: N, limit: 20}}
parameters:
  m1: {value: 1.2, unit: kg, bounds: [0.1, 10]}
  m2: {value: 0.9, unit: kg, bounds: [0.1, 10]}
  k: {value: 290, unit: N/m, bounds: [10, 5000]}
  c: {value: 3, unit: N s/m, bounds: [0, .inf]}
  k0: {value: 100, unit: N/m, bounds: [0, 5000]}
equations:
  x1: m1*x1'' = F - k*(x1 - x2) - c*x1' - k0*x1
  x2: m2*x2'' = k*(x1 - x2) - c*x2'
channels: {x1: {reads: x1, sensor: first}, x2: {reads: x2, sensor: second}}
sample_time_s: 0.02
""",
    "masses.yaml",
)
HARDENS, NOISE, PARTS = 2.0e5, 2e-5, 20  # N/m^3, m
PAIR = "x1_body.cubic_of_x1_less_x2_pair"


def rates(x: Array, force: float) -> Array:
    stretched = x[0] - x[2]
    between = 300.0 * stretched + HARDENS * stretched**3
    return np.array([x[1], (force - between - 3.1 * x[1] - 95.0 * x[0]) / 1.28, x[3], (between - 3.1 * x[3]) / 0.86])


def recorded(seed: int) -> Stretch:
    """Forces of random levels, by the midpoint rule."""
    random, n = np.random.default_rng(seed), 601
    t, h = np.arange(n) * 0.02, 0.02 / PARTS
    u = np.repeat(random.uniform(-14.0, 14.0, n // 15 + 1), 15)[: n - 1]
    state, shown = np.zeros(4), np.zeros((n, 4))
    for k in range(n - 1):
        for _ in range(PARTS):
            state = state + h * rates(state + h / 2.0 * rates(state, u[k]), u[k])
        shown[k + 1] = state
    y = shown[:, ::2] + NOISE * random.normal(size=(n, 2))
    return stretch_of(f"day{seed}", MASSES, t, u, {"x1": (np.arange(n), y[:, 0]), "x2": (np.arange(n), y[:, 1])})


def test_a_coupling_that_hardens_is_one_force_between_both() -> None:
    train = [recorded(1), recorded(2)]
    base = fit(train, (), MASSES.values)
    found, every = Named(base, base, base), mechanisms(MASSES)
    near = [one for name, one in every.items() if "cubic" in name or "threshold" in name]
    name_mechanisms(found, Judge(train, {}, Settings()), near)
    assert found.final.names == (PAIR,)
    # A (x1 - x2)^3 on the first, the opposite on the second
    assert -found.final.values[f"{PAIR}.A"] == pytest.approx(HARDENS, rel=0.02)
    assert found.final.values["m1"] == pytest.approx(1.28, rel=0.02)


def test_a_ball_that_rolls_in_a_hoop_has_the_contact_s_laws_and_no_coupling_s() -> None:
    assert not any(name.startswith("hoop.") and name.endswith("_pair") for name in mechanisms(plant_named("hoop")))
