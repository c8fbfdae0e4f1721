"""The arithmetic of the scorer on made-up diagnoses: names, classes, intervals, shares, and the report."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import baselines, classes, coverage, metrics, naming, proportions, report  # noqa: E402
from concealed.effects import SINGLES  # noqa: E402
from concealed.judged import Judged  # noqa: E402


def effect(name: str, nats: float = 100.0, **values: float) -> dict[str, Any]:
    return {"name": name, "slot": name.split(".", maxsplit=1)[0], "nats": nats, "target": nats, "capped": False,
            "parameters": values, "as_seen": values, "sized": [key for key in values if key != "phi"]}  # fmt: skip


def hidden(family: str, *effects: dict[str, Any]) -> dict[str, Any]:
    return {"family": family, "effects": list(effects), "entries": {"J11": -0.5}, "flags": {"closed_loop": False},
            "disturbance": {"rms_nm": [2e-3, 5e-4]}}  # fmt: skip


def said(verdict: str, *names: str, **parameters: dict[str, Any]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "location": {"slot": names[0].removeprefix("unknown.").split(".")[0]} if names else None,
        "effects": [{"name": name, "parameters": parameters} for name in names],
    }


def test_clopper_pearson_is_exact() -> None:
    # no hit in n: 1 - 0.025^(1/n); all hits: 0.025^(1/n)
    assert proportions.clopper_pearson(0, 60) == pytest.approx([0.0, 1 - 0.025 ** (1 / 60)])
    assert proportions.shown([True] * 3 + [False]) == "3/4 (19 to 99 %)" and proportions.shown([]) == "-"
    assert proportions.clopper_pearson(10, 10) == pytest.approx([0.025**0.1, 1.0])
    assert proportions.clopper_pearson(5, 20) == pytest.approx([0.0866, 0.4910], abs=1e-4)
    assert proportions.rate([])["rate"] is None


def test_rates_of_made_up_diagnoses() -> None:
    found = [
        Judged(hidden("null"), said("parameters")),
        Judged(hidden("null"), said("missing_physics", "hoop.coulomb_friction")),
        Judged(hidden("decoy"), said("consistent")),
        Judged(hidden("single", effect("hoop.coulomb_friction")), said("missing_physics", "hoop.coulomb_friction")),
        Judged(hidden("single", effect("frame.tilt")), said("missing_physics", "camera.angle_offset")),
        Judged(hidden("single", effect("actuator.lag")), said("missing_physics", "actuator.delay")),
        Judged(hidden("single", effect("ball.slip")), said("unknown_physics", "unknown.ball")),
        Judged(hidden("single", effect("actuator.torque_gain")), said("parameters")),
        Judged(hidden("unknown", effect("unknown.cable")), said("unknown_physics", "unknown.hoop")),
        Judged(
            hidden("compound", effect("frame.tilt"), effect("actuator.lag")),
            said("missing_physics", "actuator.lag", "camera.angle_offset"),
        ),
        Judged(
            hidden("compound", effect("frame.tilt"), effect("hoop.imbalance")), said("missing_physics", "frame.tilt")
        ),
    ]
    rates = {name: (one["k"], one["n"]) for name, one in metrics.rates(found).items()}
    assert rates["false_alarms"] == (1, 3)
    assert rates["first_name"] == (2, 4)  # the offset of the camera is the tilt; the gain is no effect
    assert rates["first_class"] == (3, 4)
    assert rates["gain_is_parameters"] == (1, 1)
    assert rates["unknown_declared"] == (1, 1)
    assert rates["known_declared_unknown"] == (1, 4)
    assert rates["pair_both"] == (1, 2)
    assert rates["pair_one"] == (2, 2)


def test_a_failed_diagnosis_is_never_to_the_tool_s_credit() -> None:
    found = [Judged(hidden("null"), None), Judged(hidden("single", effect("frame.tilt")), None)]
    rates = metrics.rates(found)
    assert rates["false_alarms"]["k"] == 1
    assert rates["first_name"]["k"] == 0
    assert rates["failed"]["k"] == 2
    assert metrics.by_effect(found)[0]["nothing"] == 0


def test_coverage_compares_what_the_tool_could_see() -> None:
    truth = effect("ball.coulomb_friction", Fc=1e-4)
    truth["as_seen"] = {"Fc": 1.2e-4}
    told = said("missing_physics", "ball.coulomb_friction", Fc={"value": 1.25e-4, "ci95": [1.1e-4, 1.4e-4]})
    one = Judged(hidden("single", truth), told)
    assert coverage.covered([one])["effects"]["k"] == 1
    assert coverage.relative_errors(one) == pytest.approx([0.05 / 1.2])
    base = {"parameters": {"J11": {"value": -0.6, "ci95": [-0.7, -0.55]}}}
    null = Judged(hidden("null"), {**said("parameters"), "base": base})
    assert coverage.covered([null])["base"]["k"] == 0


def test_an_amplitude_beside_a_phase_has_no_sign() -> None:
    told = said("missing_physics", "hoop.imbalance", A={"value": -2e-3, "ci95": [-3e-3, -1e-3]})
    one = Judged(hidden("single", effect("hoop.imbalance", A=2.2e-3, phi=0.3)), told)
    assert coverage.covered([one])["effects"]["k"] == 1
    assert coverage.relative_errors(one) == pytest.approx([0.2 / 2.2])


def fit(base: float, found: float) -> dict[str, Any]:
    return {"fit": {"heldout": {"holdout.csv": {"psi": {"base_refit": base, "with_effects": found}}}}}


def test_share_of_the_oracle_s_gain() -> None:
    answer = hidden("single", effect("frame.tilt"))
    found = [
        Judged(answer, {**said("missing_physics", "frame.tilt"), **fit(80.0, 89.0)}, oracle=fit(80.0, 90.0)),
        Judged(answer, {**said("parameters"), **fit(80.0, 80.0)}, oracle=fit(80.0, 90.0)),
        Judged(answer, {**said("missing_physics", "frame.tilt"), **fit(80.0, 90.0)}, oracle=fit(80.0, 90.0)),
        # an oracle that gains nothing says nothing
        Judged(answer, {**said("parameters"), **fit(80.0, 80.0)}, oracle=fit(80.0, 80.05)),
    ]
    shares = coverage.oracle_shares(found)
    assert shares == {"asked": 4, "n": 3, "too_little": 1, "errors": 0, "median": pytest.approx(0.9)}
    assert coverage.oracle_shares(found[:1])["median"] == pytest.approx(0.9)


def test_a_diagnosis_that_failed_gains_nothing_and_an_oracle_that_failed_is_counted() -> None:
    answer = hidden("single", effect("frame.tilt"))
    found = [Judged(answer, None, oracle=fit(80.0, 90.0)), Judged(answer, None, oracle={"error": "broken"})]
    shares = coverage.oracle_shares(found)
    assert shares == {"asked": 2, "n": 1, "too_little": 0, "errors": 1, "median": 0.0}
    text = report.markdown(metrics.summary(found, {}), "made up")
    assert "| 0 (n = 1; 0 gain too little, 1 oracles failed) |" in text


def test_report_and_power_curve(tmp_path: Path) -> None:
    found = [
        Judged(hidden("single", effect("frame.tilt", nats)), said("missing_physics", "frame.tilt"), 3.0)
        for nats in (30.0, 70.0, 150.0, 300.0, 410.0)
    ]
    result = metrics.summary(found, {"re-fit": [Judged(case.answer, said("parameters")) for case in found]})
    json.dumps(result, allow_nan=False)
    assert [row["nats"] for row in result["power"]] == ["25-50", "50-100", "100-200", "200-400", "400-"]
    text = report.markdown(result, "made up")
    assert "| right name first (singles) | 100 % (5/5, 48-100) | 0 % (0/5, 0-52) |" in text
    assert "not measured: no oracle" in text
    report.draw_power(result, tmp_path / "power.png")
    assert (tmp_path / "power.png").stat().st_size > 5000


def test_a_failed_diagnosis_holds_no_truth() -> None:
    single = Judged(hidden("single", effect("hoop.stribeck_friction", Fc=1e-3, Fs=2e-3)), None)
    found = coverage.covered([single, Judged(hidden("null"), None)])
    assert (found["effects"]["k"], found["effects"]["n"]) == (0, 2)
    assert (found["base"]["k"], found["base"]["n"]) == (0, 2)


def test_entries_of_one_case_are_not_taken_for_independent() -> None:
    # 20 cases of eight flags: all eight or none; as many hits as 160 independent flags would have
    found = proportions.by_case([[index % 10 != 0] * 8 for index in range(20)])
    assert (found["k"], found["n"], found["cases"]) == (144, 160, 20)
    low, high = found["interval"]
    alone = proportions.clopper_pearson(18, 20)
    assert alone is not None
    assert low == pytest.approx(alone[0], abs=0.1) and high == pytest.approx(alone[1], abs=0.03)
    flags = proportions.clopper_pearson(144, 160)
    assert flags is not None and low < flags[0] - 0.05
    # without spread the case is the unit
    assert proportions.by_case([[True] * 8] * 10 + [[]])["interval"] == pytest.approx([0.025**0.1, 1.0])
    assert proportions.by_case([[]])["rate"] is None


def test_names_that_are_not_there_are_counted() -> None:
    pair = hidden("compound", effect("frame.tilt"), effect("actuator.lag"))
    found = [
        Judged(pair, said("missing_physics", "frame.tilt", "actuator.delay", "hoop.imbalance")),
        Judged(hidden("null"), said("missing_physics", "ball.slip")),
        Judged(hidden("decoy"), said("consistent")),
        Judged(hidden("single", effect("hoop.imbalance")), said("unknown_physics", "hoop.imbalance", "unknown.hoop")),
        Judged(hidden("single", effect("actuator.torque_gain")), said("missing_physics", "actuator.torque_gain")),
        Judged(hidden("confounded", effect("actuator.lag")), said("missing_physics", "ball.slip")),
    ]
    rates = naming.names(found, ())
    # hoop.imbalance beside the pair, ball.slip in a null, and what has no name; the lag's class is its delay
    assert (rates["spurious"]["k"], rates["spurious"]["n"]) == (3, 7)
    assert (rates["spurious_cases"]["k"], rates["spurious_cases"]["n"]) == (3, 5)
    # tilt of {tilt, lag} among three names; the null has no set
    assert naming.f1(found[0]) == pytest.approx(2 / 5)
    assert naming.f1(found[3]) == pytest.approx(2 / 3)
    assert naming.set_f1(found)["single+compound"]["mean"] == pytest.approx((2 / 5 + 2 / 3) / 2)
    assert naming.f1(Judged(pair, said("missing_physics", "actuator.lag", "camera.angle_offset"))) == 1.0


def test_first_three_and_no_answer() -> None:
    lag = hidden("single", effect("actuator.lag"))
    late = said("missing_physics", "actuator.delay", "camera.latency")
    late["effects"][0]["not_excluded"] = ["encoder.latency", "actuator.lag"]
    fourth = said("missing_physics", "actuator.delay", "ball.slip", "hoop.imbalance", "actuator.lag")
    found = [
        Judged(lag, {**late, "effects": late["effects"][:1]}),
        Judged(lag, fourth),
        Judged(lag, said("unknown_physics", "unknown.actuator")),
        Judged(lag, said("parameters")),
        Judged(lag, said("missing_physics", "actuator.lag")),
        Judged(lag, None),
    ]
    assert found[0].offered == ["actuator.delay", "encoder.latency", "actuator.lag"]
    rates = {name: (one["k"], one["n"]) for name, one in naming.names(found, ("actuator.lag",)).items()}
    assert rates["first_three"] == (2, 6)
    assert rates["abstained"] == (2, 6)  # a diagnosis that failed is no abstention
    assert rates["right_if_answered"] == (1, 4)
    assert rates["first_name_known"] == (1, 6)
    assert naming.names(found, ("ball.slip",))["first_name_known"]["n"] == 0


def test_what_the_rivals_can_say() -> None:
    assert {name: len(known) for name, known in baselines.KNOWN.items()} == {
        "nominal": 0, "re-fit": 0, "iid BIC": 16, "sparse": 12,
    }  # fmt: skip
    assert set(baselines.KNOWN) == set(baselines.RIVALS)
    assert len(SINGLES) == 29
    assert set(baselines.KNOWN["iid BIC"]) <= set(SINGLES)


def classed(truth: str, name: str, levels: tuple[float, float] = (0.1, 0.1), **flags: bool) -> tuple[bool, bool]:
    answer = hidden("single", effect(truth))
    answer["flags"] |= flags
    answer["reach"] = {f"train_{i}": {"u_nm": level} for i, level in enumerate(levels, start=1)}
    one = Judged(answer, said("missing_physics", name))
    return one.in_class, one.in_wide_class


def test_classes_hold_where_the_case_cannot_tell() -> None:
    assert classed("actuator.deadzone", "actuator.saturation") == (False, False)
    assert classed("actuator.deadzone", "actuator.saturation", two_level=True) == (True, True)
    # two levels, but another |u| in each recording: the contract leaves it open
    assert classed("actuator.deadzone", "actuator.saturation", (0.1, 0.2), two_level=True) == (False, True)
    assert classed("camera.center_offset", "frame.tilt") == (False, True)
    assert classed("camera.center_offset", "frame.tilt", small_angles=True) == (True, True)
    assert classed("actuator.lag", "actuator.delay") == (True, True)
    assert classed("frame.tilt", "camera.angle_offset") == (True, True)
    assert classed("frame.tilt", "ball.slip", small_angles=True) == (False, False)
    assert classes.partners("actuator.lag") == {"actuator.delay"}
    assert classes.partners("ball.slip") == set()


def test_what_the_library_lacks_is_unknown_or_a_partner() -> None:
    bias, tilt, lag = (hidden("left_out", effect(n)) for n in ("actuator.torque_bias", "frame.tilt", "actuator.lag"))
    found = [
        Judged(bias, said("unknown_physics", "unknown.actuator")),
        Judged(bias, said("unknown_physics", "unknown.hoop", "hoop.imbalance")),
        Judged(bias, said("missing_physics", "hoop.imbalance")),
        Judged(bias, None),
        Judged(tilt, said("missing_physics", "camera.angle_offset")),
        Judged(lag, said("missing_physics", "actuator.delay", "ball.slip")),
    ]
    rates = {name: (one["k"], one["n"]) for name, one in metrics.rates(found).items()}
    assert rates["left_out_declared"] == (4, 6)
    assert rates["left_out_alone"] == (2, 6)
    assert rates["left_out_slot"] == (3, 6)
    assert rates["first_name"] == (0, 0)
    text = report.markdown(metrics.summary(found, {}), "made up")
    assert "| left out of the library: declared unknown | 67 % (4/6" in text
    assert "| Effects left out of the library |" in text
