"""A phase over a coordinate belongs to the zero of its recording: another recording is judged at its own."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.library import library
from hoopd.plants.fits.arbitrary_zero import waves
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.free_run import FreeRun
from hoopd.plants.hoop.fitting.fit_percent import score
from hoopd.plants.hoop.fitting.solver_comparison import two_level_torque
from hoopd.plants.hoop.recordings.recorded_runs import Subject
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_file import load_plant
from hoopd.recording.recording import Recording, from_columns, from_signals

COGGING = {"actuator.cogging.A": 0.002, "actuator.cogging.n": 7.0, "actuator.cogging.phi": 0.5}
# Where the sensor was switched on in another recording.
BEGUN = 1.9
DEVICE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml").values()


def _effects(*entries: FoundEffect) -> FoundEffects:
    return FoundEffects("rolling", DEVICE, entries)


HARMONIC = FoundEffect("encoder.harmonic", {"a": 0.02, "n": 2.0, "phi": -1.0, "follows": 0.0})
WAVE = FoundEffect("actuator.cogging", {"A": 0.008, "n": 7.0, "phi": 0.5})


def hoop_recording(found: FoundEffects, zero: float) -> Recording:
    """Of the bare hoop, whose encoder was switched on at `zero`; readings are rounded to its counts."""
    t, u = 0.02 * np.arange(500), 0.1 * np.sign(two_level_torque(500, 3))
    x = Subject("rolling", DEVICE, effects=found, zero=zero).model("hoop").run((), [0.0, 0.5, 0.0, 0.0], t, u[:-1])
    theta = np.round(x[:, 0] * 4096 / (2 * pi)) * 2 * pi / 4096
    columns = {"t": t, "u": u, "theta": theta, "dtheta": x[:, 1], "psi": np.zeros(len(t))}
    return from_columns(columns, source="elsewhere.csv")


def test_a_recording_that_was_begun_elsewhere_is_simulated_at_its_own_zero() -> None:
    found = _effects(WAVE, HARMONIC)
    recording = hoop_recording(found, BEGUN)
    at_own = score(Subject("rolling", DEVICE, effects=found), recording, window_s=0.5)
    as_written = score(Subject("rolling", DEVICE, effects=found, zero=0.0), recording, window_s=0.5)
    assert at_own.zero == pytest.approx(BEGUN, abs=0.03)
    assert at_own.nrmse_percent["theta_rate"] > max(96.0, as_written.nrmse_percent["theta_rate"] + 2.0)


def test_the_recording_of_the_model_keeps_its_zero() -> None:
    found = _effects(WAVE)
    assert score(Subject("rolling", DEVICE, effects=found), hoop_recording(found, 0.0)).zero == pytest.approx(
        0, abs=0.02
    )


def test_a_start_that_is_given_is_one_of_the_model() -> None:
    found = _effects(WAVE)
    recording = hoop_recording(found, BEGUN)
    assert score(Subject("rolling", DEVICE, effects=found), recording, start={"dtheta": 0.5}).zero is None


def test_what_follows_no_angle_fits_no_zero() -> None:
    found = _effects(FoundEffect("hoop.coulomb_friction", {"Fc": 0.005}))
    assert score(Subject("rolling", DEVICE, effects=found), hoop_recording(_effects(), 0.0)).zero is None


# ---------------------------------------------------------------------------------------------- any plant


def disc(*, arbitrary: bool = True) -> Plant:
    return Plant(
        "disc", ("a",), lambda s, force: (force - s.p["b"] * s.da) / s.p["J"], inputs=(Input("u", "N m", 0.7, "a"),),
        values={"J": 1.5e-3, "b": 7e-4}, free=("J", "b"), units={"a": "rad"},
        channels={"a": Channel("a", "rad", "encoder", arbitrary_zero=arbitrary)},
        slots={"actuator": Slot("actuator", "a"), "body": Slot("body", "a", turns=True)},
    )  # fmt: skip


def disc_recording(values: dict[str, float], zero: float) -> Recording:
    plant = disc()
    t, u = 0.02 * np.arange(500), 0.1 * np.sign(two_level_torque(500, 3))
    run = FreeRun(plant, [library(plant)["actuator.cogging"]], values=values)
    a = run.run([], [zero, 0.5], t, u[:-1]).readings[:, 0] - zero
    return from_signals(t, {"u": u}, {"a": a}, source="disc.csv")


def test_any_plant_says_which_coordinate_counts_from_where_it_was_switched_on() -> None:
    effect, recording = library(disc())["actuator.cogging"], disc_recording(COGGING, BEGUN)
    turned = simulate_plant(PlantSystem(disc(), (effect,), COGGING), recording)
    fixed = simulate_plant(PlantSystem(disc(arbitrary=False), (effect,), COGGING), recording)
    # seven waves a turn: the zeros of a seventh of a turn are one
    off = (turned.zeros["a"] - BEGUN + pi / 7) % (2 * pi / 7) - pi / 7
    assert off == pytest.approx(0.0, abs=0.01) and not fixed.zeros
    assert turned.percent["a"].nrmse_percent > 95.0


def test_all_that_follows_a_coordinate_turns_by_one_number() -> None:
    cogging = library(disc())["actuator.cogging"]
    other = replace(cogging, name="actuator.other")
    both = {**COGGING, "actuator.other.n": 14.0}
    assert waves(disc(), [cogging, other], both)["a"].period == pytest.approx(2 * pi / 7)
    assert waves(disc(), [cogging, other], {**both, "actuator.other.n": 4.0})["a"].period == pytest.approx(2 * pi)
    assert waves(disc(arbitrary=False), [cogging], COGGING) == {}


def test_a_zero_is_of_a_coordinate_alone() -> None:
    speed = Channel("da", "rad/s", arbitrary_zero=True)
    law = Channel(unit="-", reading=lambda s: ca.cos(s.a), arbitrary_zero=True)
    assert replace(disc(), channels={"da": speed, "c": law}).arbitrary_zeros == ()


def test_a_plant_s_file_says_so_of_a_coordinate_alone(tmp_path: Path) -> None:
    text = """
schema: hoopd.plant/1
name: disc
coordinates: {a: {unit: rad}}
inputs: {T: {unit: N m}}
parameters: {J: {value: 0.0015, unit: kg m2}}
equations: {a: "J*a'' = T"}
channels: {a: {reads: a, zero: arbitrary}}
"""
    path = tmp_path / "disc.yaml"
    path.write_text(text, encoding="utf-8")
    assert load_plant(path).arbitrary_zeros == ("a",)
    path.write_text(text.replace("reads: a,", "reads: a',"), encoding="utf-8")
    with pytest.raises(InputError, match="only what reads a coordinate"):
        load_plant(path)
