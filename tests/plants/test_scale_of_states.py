"""A circuit of which only the capacitor's voltage is read: half the capacity with half the charge shows the same."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.proof.told_together import together_sentence, told_together
from hoopd.diagnose.search.bounded_disturbance import far_beyond, usual_noise
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_fit import fit_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.level_directions import freed_of_levels
from hoopd.plants.likelihood.noise_tuning import first_noise
from hoopd.plants.likelihood.stretch_scatter import half_widths
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant
from hoopd.recording.recording import from_signals

CIRCUIT = """
schema: hoopd.plant/1
name: circuit
states: {q: {unit: C, usual: 1.0e-3}, i: {unit: A, usual: 0.7}}
inputs: {V: {unit: V, limit: 12}}
parameters:
  L: {value: 0.011, unit: H, bounds: [1.0e-4, 1]}
  R: {value: 2.7, unit: ohm, bounds: [0, .inf]}
  C: {value: 0.9e-4, unit: F, bounds: [1.0e-6, 1]}
equations:
  q: q' = i
  i: L*i' = V - R*i - q/C
channels: {vc: {reads: q/C, unit: V, sensor: scope}}
sample_time_s: 5.0e-5
"""
L, R, C, PARTS = 0.010, 3.0, 1.0e-4, 10


def recorded(seed: int = 1, n: int = 1500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), voltages (n-1,) of two levels and readings (n,), with a disturbance of the voltage that lasts."""
    random, h = np.random.default_rng(seed), 5.0e-5
    u = np.repeat(random.choice([-8.0, 8.0], n // 20 + 1), 20)[: n - 1]
    q = i = pushed = 0.0
    shown = np.zeros(n)
    for k in range(n - 1):
        pushed += (random.normal() * 0.3 - pushed) * 0.05
        for _ in range(PARTS):
            i += h / PARTS * (u[k] + pushed - R * i - q / C) / L
            q += h / PARTS * i
        shown[k + 1] = q / C
    return np.arange(n) * h, u, shown + 0.005 * random.normal(size=n)


def stretch(plant: Plant) -> Stretch:
    t, u, shown = recorded()
    return stretch_of("day1", plant, t, u, {"vc": (np.arange(len(t)), shown)})


def found(text: str) -> HypothesisFit:
    plant = parse_plant(text, "circuit.yaml")
    return fit([stretch(plant)], (), plant.values)


def test_levels_of_disturbances_alone_tell_no_scale() -> None:
    free = found(CIRCUIT)
    together = told_together(free)
    assert together is not None and set(together.names) == {"L", "R", "C"} and together.ways == 1
    assert "only together" in together_sentence(free)
    widths = half_widths(free)
    assert all(widths[name] > 0.5 * free.values[name] for name in "LRC")


@pytest.mark.parametrize(
    ("more", "into"),
    [
        # an input that is never used
        ("  kw: {value: 1.0, unit: V/A, bounds: [0, 10]}\n", "V - R*i - q/C + kw*idle"),
        # a resistance twice
        ("  Ra: {value: 0.5, unit: ohm, bounds: [0, .inf]}\n", "V - (R + Ra)*i - q/C"),
    ],
)
def test_what_is_not_seen_at_all_beside_it_changes_nothing(more: str, into: str) -> None:
    text = CIRCUIT.replace("equations:", f"{more}equations:").replace("V - R*i - q/C", into)
    if "idle" in into:
        text = text.replace("inputs: {V", "inputs: {idle: {unit: A, limit: 1}, V")
    plant, (t, u, shown) = parse_plant(text, "circuit.yaml"), recorded()
    inputs = np.column_stack([np.zeros_like(u), u]) if "idle" in into else u
    free = fit([stretch_of("day1", plant, t, inputs, {"vc": (np.arange(len(t)), shown)})], (), plant.values)
    together = told_together(free)
    assert together is not None and {"L", "C"} <= set(together.names)
    widths = half_widths(free)
    assert all(widths[name] > 0.5 * free.values[name] for name in "LC")


def test_with_one_of_them_known_the_others_are_told_as_they_were() -> None:
    held = found(
        CIRCUIT.replace("C: {value: 0.9e-4, unit: F, bounds", "C: {value: 1.0e-4, held: true, unit: F, bounds")
    )
    assert told_together(held) is None
    widths = half_widths(held)
    assert freed_of_levels(held) is None
    assert widths["L"] < 0.005 * L and held.values["L"] == pytest.approx(L, rel=0.005)


def test_a_fit_of_free_runs_gives_no_interval_to_what_has_none() -> None:
    t, u, shown = recorded()
    made = from_signals(t, {"V": np.append(u, u[-1])}, {"vc": shown}, source="day1")
    done = fit_plant(parse_plant(CIRCUIT, "circuit.yaml"), made)
    assert [set(one.shown) for one in done.undetermined] == [{"L", "R", "C"}] and done.intervals == {}


MAGNET = """
schema: hoopd.plant/1
name: magnet
coordinates: {z: {unit: m, usual: 0.012, usual_rate: 0.05}}
inputs: {i: {unit: A, limit: 4}}
parameters:
  m: {value: 0.068, unit: kg, held: true}
  g: {value: 9.81, unit: m/s2, held: true}
  K: {value: 7.2e-5, unit: N m2/A2, bounds: [1.0e-6, 1.0e-2]}
  z0: {value: 0.0022, unit: m, held: true}
equations:
  z: m*z'' = m*g - K*i^2/(z + z0)^2
channels: {z: {reads: z, sensor: hall}}
sample_time_s: 0.004
"""


def test_a_share_of_the_weight_that_a_coil_holds_is_usual_however_slowly_it_moves() -> None:
    """In closed loop, in small steps; what disturbs is 0.6 % of the weight, and 28 times what moves it as it usually
    moves."""
    random, n, h = np.random.default_rng(1), 1500, 0.004
    z, v, pushed, level = 0.012, 0.0, 0.0, 0.012
    u, shown = np.zeros(n - 1), np.full(n, z)
    for k in range(n - 1):
        level = 0.012 + 0.0015 * random.choice([-1.0, 1.0]) if k % 60 == 0 else level
        u[k] = np.sqrt(max(0.068 * (9.81 + 900.0 * (z - level) + 40.0 * v), 0.0) / 7.0e-5) * (z + 0.0022)
        pushed += (random.normal() * 0.02 - pushed) * 0.04
        for _ in range(PARTS):
            v += h / PARTS * (9.81 + pushed / 0.068 - 7.0e-5 * u[k] ** 2 / (0.068 * (z + 0.0022) ** 2))
            z += h / PARTS * v
        shown[k + 1] = z
    plant, t = parse_plant(MAGNET, "magnet.yaml"), np.arange(n) * h
    made = stretch_of("day1", plant, t, u, {"z": (np.arange(n), shown + 1e-5 * random.normal(size=n))})
    base = fit([made], (), plant.values)
    slow, usual = first_noise(base.tracks, base.values)["day1"].force, usual_noise(base)["day1"].force
    assert base.noise["day1"].force > 3.0 * slow and not far_beyond(base)
    assert usual == pytest.approx(0.01 * 0.068 * 9.81, rel=0.1)
