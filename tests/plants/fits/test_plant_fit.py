"""Fits of any declared plant: parameters come back, starts alone are fitted, what is missing is said in a line."""

from __future__ import annotations

import doctest

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.files.reading import InputError
from hoopd.plants import free_run
from hoopd.plants.declaration import Channel, Input, Plant
from hoopd.plants.effects.library import library
from hoopd.plants.fits import plant_fit
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.plant_fit import METHODS, PlantFit, fit_plant
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.free_run import FreeRun
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.registry import plant_named
from hoopd.recording.recording import Recording, Signal, from_signals
from tests.shared import shared_path

Array = NDArray[np.float64]


def made(
    plant: Plant, true: dict[str, float], x0: list[float], t: Array, u: dict[str, Array], noise: float, seed: int = 0
) -> Recording:
    """What the sensors of a plant with other numbers would have shown."""
    held = np.column_stack([*u.values()])[:-1] if u else np.zeros((len(t) - 1, 0))
    readings = FreeRun(plant, values=true).run([], x0, t, held).readings
    y = readings + noise * np.random.default_rng(seed).normal(size=readings.shape)
    return from_signals(t, u, {name: y[:, i] for i, name in enumerate(plant.channels)}, source="made")


def recovered(found: PlantFit, true: dict[str, float]) -> None:
    """Every truth lies within twice the 95 % interval's half width, and the interval is not idle."""
    for name, value in true.items():
        low, high = found.intervals[name]
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(value - middle) < 2.0 * half, name
        assert half < 0.3 * max(abs(value), 1.0), name


def steps(t: Array, size: float, every: int, seed: int = 1) -> Array:
    draws = np.random.default_rng(seed).choice((-size, size), size=len(t) // every + 1)
    return np.repeat(draws, every)[: len(t)]


@pytest.mark.parametrize("module", [plant_fit, free_run])
def test_the_examples_hold(module: object) -> None:
    assert doctest.testmod(module).failed == 0  # type: ignore[arg-type]


@pytest.mark.parametrize("method", METHODS)
def test_an_axis_at_a_kilohertz_is_found_in_two_seconds(method: str) -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 2.0, 0.001)
    true = {"M": 80.0, "Fv": 300.0, "offset": 5.0}
    found = fit_plant(plant, made(plant, true, [0.0, 0.0], t, {"F": steps(t, 60.0, 100)}, 2e-6), method=method)
    assert found.solution.converged
    recovered(found, true)
    assert found.percent["made"]["x"].nrmse_percent > 99.0


def test_a_pendulum_without_any_input_is_found() -> None:
    plant, t = plant_named("pendulum"), np.arange(0.0, 6.0, 0.02)
    true = {"J": 1.5e-4, "c": 2e-5}
    found = fit_plant(plant, made(plant, true, [0.6, 0.0], t, {}, 1e-3))
    for name, value in true.items():
        low, high = found.intervals[name]
        assert low - (high - low) / 2 < value < high + (high - low) / 2
    assert found.solution.starts[0] == pytest.approx([0.6, 0.0], abs=0.01)


def test_two_tanks_in_first_order_states_are_found() -> None:
    plant, t = plant_named("tanks"), np.arange(0.0, 1200.0, 2.0)
    true = {"a1": 3e-5, "a2": 2e-5}
    pump = 5e-5 + steps(t, 2e-5, 50)
    found = fit_plant(plant, made(plant, true, [0.2, 0.3], t, {"q": pump}, 1e-3))
    for name, value in true.items():
        low, high = found.intervals[name]
        assert low - (high - low) / 2 < value < high + (high - low) / 2
        assert high - low < 0.1 * value


def test_a_fall_without_free_parameters_fits_the_start() -> None:
    plant, t = plant_named("falling"), np.arange(0.0, 2.0, 1.0 / 15.0)
    found = fit_plant(plant, made(plant, {}, [40.0, -1.0], t, {}, 0.02))
    assert found.names == () and found.intervals == {} and found.uncertainty is None
    assert found.solution.starts[0] == pytest.approx([40.0, -1.0], abs=0.05)
    assert found.percent["made"]["h"].nrmse_percent > 99.0


def two_masses() -> Plant:
    """Two carriages between springs, a force on each; one is read by its way, one by its speed and a force."""

    def accelerations(s: object, force: ca.SX) -> ca.SX:
        spring = s.p["k"] * (s.b - s.a)  # type: ignore[attr-defined]
        return ca.vertcat(
            (force[0] + spring - s.p["d"] * s.da) / 2.0,  # type: ignore[attr-defined]
            (force[1] - spring - s.p["d"] * s.db) / 3.0,  # type: ignore[attr-defined]
        )

    return Plant(
        name="carriages",
        coordinates=("a", "b"),
        accelerations=accelerations,
        values={"k": 20.0, "d": 2.0},
        free=("k", "d"),
        bounds={"k": (0.1, np.inf), "d": (0.0, np.inf)},
        inputs=(Input("f", "N", coordinate="a"), Input("g", "N", coordinate="b")),
        channels={"a": Channel("a", "m"), "speed": Channel("db", "m/s"), "load": Channel(unit="N", reading=_load)},
    )


def _load(s: object) -> ca.SX:
    return s.p["k"] * (s.b - s.a)  # type: ignore[attr-defined]


def test_several_inputs_and_a_channel_that_reads_an_expression() -> None:
    plant, t = two_masses(), np.arange(0.0, 8.0, 0.02)
    u = {"f": steps(t, 1.0, 30, seed=2), "g": steps(t, 1.0, 40, seed=3)}
    true = {"k": 30.0, "d": 1.0}
    found = fit_plant(plant, made(plant, true, [0.1, 0.0, 0.0, 0.2], t, u, 1e-3))
    recovered(found, true)
    assert set(found.percent["made"]) == {"a", "speed", "load"}


def test_channels_are_compared_at_times_of_their_own() -> None:
    """A way that was read 7 ms before its row."""
    plant, t = plant_named("axis"), np.arange(0.0, 3.0, 0.01)
    late, true = t - 0.007, {"M": 80.0, "Fv": 300.0, "offset": 5.0}
    force = steps(t, 60.0, 20)
    nodes = np.sort(np.concatenate([t, late[1:]]))
    held = force[np.clip(np.searchsorted(t, nodes[:-1] + 1e-9, side="right") - 1, 0, None)]
    x = FreeRun(plant, values=true).run([], [0.0, 0.0], nodes, held).readings[:, 0]
    seen = x[np.searchsorted(nodes, np.clip(late, 0.0, None) - 1e-9)] + 1e-6 * np.random.default_rng(5).normal(
        size=len(t)
    )
    good = from_signals(t, {"F": force}, {"x": Signal(seen, np.clip(late, 0.0, None), "m")}, source="own times")
    recovered(fit_plant(plant, good), true)


def test_an_effect_of_the_library_is_fitted_along() -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 2.0, 0.001)
    name = next(key for key in library(plant) if key.endswith("coulomb_friction"))
    effect = library(plant)[name]
    true = {"M": 80.0, "Fv": 300.0, "offset": 5.0, f"{name}.Fc": 8.0}
    values = {**true}
    force = steps(t, 60.0, 150)
    x = FreeRun(plant, [effect], values=values).run([], [0.0, 0.0], t, force[:-1]).readings[:, 0]
    run = from_signals(t, {"F": force}, {"x": x + 2e-6 * np.random.default_rng(7).normal(size=len(t))}, source="dry")
    found = fit_plant(plant, run, (*plant.free, f"{name}.Fc"), effects=[effect], values={f"{name}.Fc": 2.0})
    assert found.values[f"{name}.Fc"] == pytest.approx(8.0, abs=0.5)
    assert found.values["M"] == pytest.approx(80.0, rel=0.01)


def test_priors_bounds_and_held_values_are_kept() -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 1.0, 0.001)
    run = made(plant, {"M": 80.0, "Fv": 0.0, "offset": 0.0}, [0.0, 0.0], t, {"F": steps(t, 60.0, 100)}, 1e-5)
    found = fit_plant(plant, run, ("M", "Fv"), values={"offset": 0.0})
    assert found.values["offset"] == 0.0 and found.values["Fv"] >= 0.0
    assert found.values["M"] == pytest.approx(80.0, rel=0.01)
    believed = fit_plant(plant, run, ("M",), values={"Fv": 0.0}, priors={"M": Prior(120.0, 1e-6)})
    assert believed.values["M"] == pytest.approx(120.0, rel=1e-3)


@pytest.mark.parametrize(
    ("free", "values", "words"),
    [(("mass",), {}, "mass"), (None, {"Mass": 3.0}, "Mass")],
)
def test_an_unknown_parameter_is_named(free: tuple[str, ...] | None, values: dict[str, float], words: str) -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 1.0, 0.001)
    run = from_signals(t, {"F": np.ones(len(t))}, {"x": t})
    with pytest.raises(InputError, match=f"{words}.*known: M, Fv, offset"):
        fit_plant(plant, run, free, values=values)


def test_a_plant_whose_runs_leave_every_bound_is_refused() -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 1.0, 0.001)
    run = made(plant, {}, [0.0, 0.0], t, {"F": steps(t, 60.0, 100)}, 1e-5)
    with pytest.raises(InputError, match="leaves every bound"):
        fit_plant(plant, run, values={"Fv": 2e52})


def test_what_a_recording_lacks_is_named() -> None:
    plant, t = plant_named("axis"), np.arange(0.0, 1.0, 0.001)
    with pytest.raises(InputError, match=r"F.*axis has this input"):
        fit_plant(plant, from_signals(t, {}, {"x": t}, source="a.csv"))
    with pytest.raises(InputError, match=r"no channel of axis is there, but y"):
        fit_plant(plant, from_signals(t, {"F": t}, {"y": t}, source="a.csv"))
    with pytest.raises(InputError, match="no stretch of 10 samples"):
        fit_plant(plant, from_signals(t[:4], {"F": t[:4]}, {"x": t[:4]}, source="a.csv"))


def test_the_system_keeps_changed_values() -> None:
    system = PlantSystem(plant_named("axis"), changed={"M": 7.0})
    assert system.values["M"] == 7.0 and system.nominal["M"] == 100.0


# ---------------------------------------------------------------------------------------------- real recordings


def shared_run(name: str, inputs: tuple[str, ...], channel: str) -> Recording:
    columns = np.loadtxt(shared_path(f"plants/{name}.csv"), delimiter=",", skiprows=1).T
    signals = dict(zip(inputs, columns[1:-1], strict=True))
    return from_signals(columns[0], signals, {channel: columns[-1]}, source=name)


@pytest.mark.proof
def test_the_real_axis() -> None:
    """Its mass is known from a publication, with everything in the model: 95.1 kg."""
    run = shared_run("axis_1kHz", ("F",), "x")
    found = fit_plant(plant_named("axis"), run)
    assert found.solution.converged
    assert found.percent["axis_1kHz"]["x"].nrmse_percent > 90.0
    low, high = fit_plant(plant_named("axis"), run, method="prediction").intervals["M"]
    assert 90.0 < low < high < 100.0


@pytest.mark.parametrize("name", ["pendulum_decay_7", "pendulum_decay_11"])
def test_the_real_pendulum(name: str) -> None:
    found = fit_plant(plant_named("pendulum"), shared_run(name, (), "alpha"))
    assert found.solution.converged
    assert found.values["J"] == pytest.approx(1.56e-4, rel=0.01)
    assert found.percent[name]["alpha"].nrmse_percent > 94.0


def test_real_falls() -> None:
    percent = {}
    for ball in ("bowling", "tennis"):
        name = f"drop_{ball}_ball_1"
        percent[ball] = fit_plant(plant_named("falling"), shared_run(name, (), "h")).percent[name]["h"].nrmse_percent
    assert percent["bowling"] > percent["tennis"] > 80.0  # the air counts for the light one


DRIFTING = """
schema: hoopd.plant/1
name: drifting
states: {T: {unit: K, usual: 5}}
inputs: {P: {unit: W, limit: 50}}
parameters: {C: {value: 150, unit: J/K}, k: {value: 1, unit: W/K}, r: {value: 0.02, unit: W/s}}
equations: {T: "C*T' = P - k*T + r*t"}
sample_time_s: 5
"""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("begin_s", [0.0, 3600.0, 1.7e9])
def test_the_time_of_an_equation_begins_with_the_recording(begin_s: float, method: str) -> None:
    plant, true, t = parse_plant(DRIFTING, "drifting.yaml"), {"C": 100.0, "k": 1.0, "r": 0.01}, 5.0 * np.arange(300)
    u = {"P": np.repeat(np.random.default_rng(1).choice([0.0, 20.0, 40.0], 15), 20)}
    one = made(plant, true, [0.0], t, u, 0.01)
    late = from_signals(t + begin_s, u, {"T": one.column("T")}, source="late")
    found = fit_plant(plant, [late], ("C", "k", "r"), method)
    assert found.values == pytest.approx(true, rel=0.01)
    run = simulate_plant(PlantSystem(plant, changed=true), late)
    assert run.percent["T"].nrmse_percent > 99.5


LATE = """
schema: hoopd.plant/1
name: late
states: {T: {unit: K, usual: 5}}
inputs: {P: {unit: W, limit: 50}}
parameters: {C: {value: 100, unit: J/K, bounds: [1, 1.0e5]}, k: {value: 1, unit: W/K, bounds: [0, 100]}}
equations: {T: C*T' = P - k*T}
channels: {T: {reads: T, sensor: thermometer}}
sample_time_s: 5
"""


def test_a_search_that_stands_still_begins_again_from_what_was_given() -> None:
    plant, t = parse_plant(LATE, "late.yaml"), 5.0 * np.arange(400)
    late = library(plant)["thermometer.latency"]
    power = np.repeat(np.random.default_rng(1).choice([0.0, 20.0, 40.0], 20), 20)
    system = PlantSystem(plant, (late,), {"thermometer.latency.d": 3.0})
    quiet = from_signals(t, {"P": power}, {"T": np.zeros(400)})
    true = simulate_plant(system, quiet, {"T": 0.0}).simulated.column("T")
    noisy = from_signals(t, {"P": power}, {"T": true + 0.01 * np.random.default_rng(2).normal(size=400)}, source="late")
    found = fit_plant(plant, [noisy], ("C", "k", "thermometer.latency.d"), effects=(late,), values=dict(system.values))
    error = np.concatenate([part["T"] for part in found.solution.residuals])
    assert np.sqrt(np.mean(error**2)) < 0.0105
    assert found.values["thermometer.latency.d"] == pytest.approx(3.0, abs=0.2)
