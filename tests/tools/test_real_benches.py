"""The arithmetic of the benches on real data, on made data: a known law, known percents, known intervals."""

from __future__ import annotations

import sys
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools" / "bench"))

import real_delays  # noqa: E402
from realdata import axisforce, delays, intervals, kept, pairs, starts  # noqa: E402

from hoopd.plants.effects.library import library  # noqa: E402
from hoopd.plants.plant_model import PlantModel, load_plant_model, nominal_model  # noqa: E402
from hoopd.plants.plant_with_effects import Composite  # noqa: E402

STEP_S, MASS_KG, VISCOUS, DRY_N = 1e-3, 95.0, 200.0, 20.0


def written(folder: Path, *effects: str, viscous: float = VISCOUS) -> PlantModel:
    """A model file of the axis, as `hoopd diagnose --write` leaves it."""
    path = folder / "axis.yaml"
    path.write_text(
        "schema: hoopd.model/1\nname: axis\nplant: axis\nsample_time_s: 0.001\nparameters:\n"
        f"  M: {{value: {MASS_KG}, unit: kg, ci95: [94, 96], nominal: 100}}\n"
        f"  Fv: {{value: {viscous}, unit: N s/m, ci95: null, nominal: 200}}\n"
        "  offset: {value: -3.0, unit: N, ci95: [-4, -2], nominal: 0}\n"
        f"effects: [{', '.join(effects)}]\n"
    )
    return load_plant_model(path)


def effect(name: str, **values: tuple[float, str]) -> str:
    numbers = ", ".join(f"{key}: {{value: {value}, unit: {unit}, ci95: null}}" for key, (value, unit) in values.items())
    return f"{{name: {name}, parameters: {{{numbers}}}}}"


def moved(late_s: float = 0.0, seconds: float = 9.0) -> axisforce.Motion:
    """A sine with the force that the law asks for; the force was demanded so much earlier."""
    t = np.arange(0.0, seconds, STEP_S)

    def law(t: np.ndarray) -> np.ndarray:
        rate = 0.1 * np.sin(4.0 * t)
        return MASS_KG * 0.4 * np.cos(4.0 * t) + VISCOUS * rate + DRY_N * np.sign(rate) - 3.0

    return axisforce.Motion(t, law(t + late_s), -0.025 * np.cos(4.0 * t))


DRY = effect("body.coulomb_friction", Fc=(DRY_N, "N"))


def test_the_law_that_made_the_force_leaves_next_to_nothing(tmp_path: Path) -> None:
    motion = moved()
    found = axisforce.residual_of(axisforce.force_error(written(tmp_path, DRY), motion), motion)
    assert max(found) < 0.003


def test_what_is_left_out_is_the_share_that_it_had(tmp_path: Path) -> None:
    motion = moved()
    error = axisforce.force_error(written(tmp_path), motion)
    part = slice(300, -300)
    # too much is what the friction would have taken
    assert error[part] == pytest.approx(DRY_N * np.sign(motion.rate[part]), abs=0.1)
    found = axisforce.residual_of(error, motion)
    assert found.all == pytest.approx(DRY_N / np.sqrt(np.mean(motion.force**2)), rel=0.02)
    assert found.held_out == pytest.approx(found.fitted, rel=0.1)


def test_a_late_drive_is_taken_back_and_one_that_is_not_late_is_seen(tmp_path: Path) -> None:
    motion, late = moved(0.01), effect("actuator.delay", d=(0.01, "s"))
    right, wrong = (axisforce.force_error(written(tmp_path, DRY, *extra), motion) for extra in ([late], []))
    assert axisforce.residual_of(right, motion).all < 0.003
    assert axisforce.residual_of(wrong, motion).all > 0.05


def test_a_lag_of_the_drive_is_carried_from_sample_to_sample(tmp_path: Path) -> None:
    motion, lag_s = moved(seconds=3.0), 0.01
    # T tau' = u - tau, the other way round
    demanded = motion._replace(
        force=motion.force + lag_s * np.gradient(axisforce.low_passed(motion.force, STEP_S), STEP_S)
    )
    right, wrong = (
        axisforce.force_error(written(tmp_path, DRY, *extra), demanded)
        for extra in ([effect("actuator.lag", T=(lag_s, "s"))], [])
    )
    assert axisforce.residual_of(right, demanded).all < 0.25 * axisforce.residual_of(wrong, demanded).all


def test_a_late_and_shifted_reading_is_put_back(tmp_path: Path) -> None:
    late_s, shift_m = 0.01, 0.05
    late, shifted = effect("encoder.latency", d=(late_s, "s")), effect("encoder.offset", d=(shift_m, "m"))
    motion = moved()
    read = motion._replace(x=-0.025 * np.cos(4.0 * (motion.t - late_s)) + shift_m)
    model = written(tmp_path, DRY, late, shifted)
    assert axisforce.residual_of(axisforce.force_error(model, read), read).all < 0.003
    composite = Composite(model.plant, [library(model.plant)["encoder.offset"]])
    assert axisforce.sensed(composite, model.values, read).x == pytest.approx(read.x - shift_m)


def test_least_squares_find_the_law() -> None:
    numbers, error = axisforce.with_dry_friction(moved())
    assert numbers == pytest.approx([MASS_KG, VISCOUS, DRY_N, -3.0], rel=0.01)
    assert axisforce.residual_of(error, moved()).all < 0.003


def test_a_mean_over_samples_keeps_what_is_slow() -> None:
    slow = axisforce.averaged(moved(), 10)
    assert slow.step_s == pytest.approx(0.01)
    assert slow.x == pytest.approx(-0.025 * np.cos(4.0 * slow.t), abs=1e-5)


@pytest.mark.parametrize(
    ("score", "gain", "worse"),
    [
        (pairs.Score(80.0, 85.0, 84.5), -0.5, False),
        (pairs.Score(90.0, 85.0, 88.9), -1.1, True),
        (pairs.Score(80.0, None, 88.0), 8.0, False),
        (pairs.Score(80.0, 85.0, None), -inf, True),
    ],
)
def test_names_are_held_against_the_better_of_both(score: pairs.Score, gain: float, worse: bool) -> None:
    assert score.gain == pytest.approx(gain)
    assert score.is_worse is worse


def test_a_pair_is_worse_if_any_channel_is_and_both_parts_of_a_recording_are_one() -> None:
    def row(fitted: str, on: str, named: float, channel: str = "psi") -> pairs.Row:
        return pairs.Row(fitted, on, "windows_2s", channel, pairs.Score(70.0, 80.0, named))

    rows = [
        row("a", "b", 90.0),
        row("a", "b", 70.0, "theta_rate"),
        row("b", "a", 79.5),
        row("b", "a", 95.0, "theta_rate"),
    ]
    rows += [row("a", "c@2:14", 90.0), row("a", "c@17:", 78.0), row("c", "a", 79.5)]
    assert pairs.counted(rows) == (2, 1, 4)


def test_intervals_of_two_models_are_compared_where_both_have_them(tmp_path: Path) -> None:
    def model(name: str, mass: str, ripple: int) -> dict[str, intervals.Estimate]:
        path = tmp_path / f"{name}.yaml"
        path.write_text(
            f"parameters: {{M: {{value: 95, ci95: {mass}}}, Fv: {{value: 1, ci95: null}}}}\n"
            "effects:\n  - {name: actuator.cogging, parameters: {A: {value: 2, ci95: [1, 3]}, "
            f"n: {{value: {ripple}, ci95: null}}, phi: {{value: 0, ci95: [0, 0]}}}}}}\n"
        )
        assert intervals.named(path) == ["actuator.cogging"]
        return intervals.estimates(path)

    models = {"a": model("a", "[94, 96]", 11), "b": model("b", "[96, 97]", 11), "c": model("c", "[97.1, 98]", 22)}
    rows = {(row.models, row.name): row.overlap for row in intervals.compared(models)}
    assert rows[("a", "b"), "M"] is True
    assert rows[("a", "c"), "M"] is False
    assert rows[("a", "b"), "Fv"] is None
    assert rows[("a", "b"), "actuator.cogging[n=11].A"] is True
    assert (("a", "c"), "actuator.cogging[n=11].A") not in rows  # twice as often a turn is another thing
    assert not any("phi" in name for _, name in rows)
    assert intervals.share([*intervals.compared(models)]) == (2, 4)


def test_a_place_on_the_hoops_angle_belongs_to_its_recording(tmp_path: Path) -> None:
    """Its zero is where the hoop stood; a place on the ball's angle is the device's."""
    path, number = tmp_path / "model.yaml", "{value: 1, ci95: [0, 2]}"
    laws = ("encoder.well_of_theta_in_theta", "ball.well_of_psi")
    effects = "\n".join(f"  - {{name: {law}, parameters: {{v0: {number}, w: {number}}}}}" for law in laws)
    path.write_text(f"parameters: {{}}\neffects:\n{effects}\n")
    assert {*intervals.estimates(path)} == {f"{laws[0]}.w", f"{laws[1]}.v0", f"{laws[1]}.w"}


def test_a_result_is_used_again_while_data_and_program_are_the_same(tmp_path: Path) -> None:
    tree, out, data = tmp_path / "tree", tmp_path / "out", tmp_path / "data.csv"
    (tree / "hoopd").mkdir(parents=True)
    main, count = tree / "hoopd" / "__main__.py", tmp_path / "count"
    main.write_text(
        "import sys\n"
        f"with open({str(count)!r}, 'a') as file: file.write('x')\n"
        "if 'bad' in sys.argv: sys.exit('hoopd: bad: is not known')\n"
        "open(sys.argv[sys.argv.index('--json') + 1], 'w').write('{\"a\": 1}')\n"
    )
    (tree / "hoopd" / "__init__.py").touch()
    data.write_text("t,x\n")

    def ran(*arguments: str | kept.Data) -> tuple[kept.Done, int]:
        return kept.Commands(out, tree).run(arguments), len(count.read_text())

    one = kept.Data(data, "@1:")
    assert ran("fit", one)[0].result == {"a": 1}
    assert ran("fit", one)[1] == 1
    assert ran("fit", kept.Data(data, "@2:"))[1] == 2
    data.write_text("t,x,y\n")
    assert ran("fit", one)[1] == 3
    done, times = ran("fit", "bad")
    assert (done.result, done.failure.endswith("bad: is not known"), times) == (None, True, 4)
    assert ran("fit", "bad")[1] == 4
    main.write_text(main.read_text() + "\n")
    assert ran("fit", one)[1] == 5
    assert not list(out.glob("running-*"))


def test_a_fit_of_free_runs_is_worse_where_its_errors_are_larger() -> None:
    def record(nominal: float, fitted: float, **other: float) -> dict[str, Any]:
        one = {"nominal": nominal, "fitted": fitted, "samples": 100}
        aside = {"nominal": 90.0, "fitted": 0.0, "samples": 100, **other}
        constant = {"nominal": None, "fitted": None, "samples": 0}
        train = {"a.csv": {"x": one, "column": aside, "still": constant}}
        return {"channels": ["x", "still"], "fit": {"train": train}}

    better, worse = starts.of_output(record(80.0, 90.0)), starts.of_output(record(80.0, 79.0))
    assert better.end_nats - better.start_nats == pytest.approx(-100.0 * np.log(2.0))  # half the error
    assert better.percent == {"x": (80.0, 90.0)}  # what was not compared does not count
    assert (better.is_worse, worse.is_worse) == (False, True)
    assert starts.Start(1.0, float("nan"), {}).is_worse


def test_the_base_of_a_diagnosis_is_judged_where_it_starts_and_ends(tmp_path: Path) -> None:
    plant, path = nominal_model("pendulum").plant, tmp_path / "swing.csv"
    w = plant.values
    t, rate = np.arange(0.0, 9.0, 0.02), np.sqrt(w["m"] * w["g"] * w["l"] / w["J"])
    alpha = 0.05 * np.exp(-w["c"] / (2 * w["J"]) * t) * np.cos(rate * t) + 1e-3 * np.random.default_rng(0).normal(
        size=t.size
    )
    np.savetxt(path, np.column_stack([t, alpha]), delimiter=",", header="t,alpha", comments="")
    near, far = (starts.of_base(str(path), plant, {"J": share * w["J"]}, None) for share in (1.0, 1.1))
    assert not near.is_worse
    assert far.start_nats > near.start_nats + 10.0
    assert far.end_nats == pytest.approx(near.end_nats, abs=5.0)


def test_a_late_drive_and_sensors_that_are_all_late_are_one_sum() -> None:
    one, two, ten = (intervals.Estimate(1e-3 * x, (1e-3 * x - 3e-4, 1e-3 * x + 3e-4)) for x in (1.0, 2.0, 10.0))
    drive = delays.sums({"actuator.delay.d": two, "camera.latency.d": ten})
    sensors = delays.sums({"encoder.latency.d": two, "camera.latency.d": intervals.Estimate(12e-3, (11.7e-3, 12.3e-3))})
    assert drive["hoop late by"].value == sensors["hoop late by"].value
    assert drive["ball late by"].value == pytest.approx(12e-3)
    low, high = drive["ball late by"].interval or (0.0, 0.0)
    assert high - low == pytest.approx(2 * 3e-4 * np.sqrt(2.0))
    assert real_delays.disagreeing({"a": drive, "b": sensors}) == []
    assert len(real_delays.disagreeing({"a": drive, "b": delays.sums({"encoder.latency.d": one})})) == 2
    assert len(real_delays.disagreeing({"a": drive, "camera alone": delays.sums({"camera.latency.d": ten})})) == 1
