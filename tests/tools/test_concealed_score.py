"""The scorer of concealed cases: its arithmetic on made-up diagnoses, its rivals, its workers, its folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import baselines, cases, cli, metrics, recipes, report, runfolder, score, seeds, worker  # noqa: E402
from concealed.metrics import Judged  # noqa: E402
from concealed.recipes import Wish  # noqa: E402


def effect(name: str, nats: float = 100.0, **values: float) -> dict[str, Any]:
    return {"name": name, "slot": name.split(".", maxsplit=1)[0], "nats": nats, "target": nats, "capped": False,
            "parameters": values, "as_seen": values, "sized": [key for key in values if key != "phi"]}  # fmt: skip


def hidden(family: str, *effects: dict[str, Any]) -> dict[str, Any]:
    return {"family": family, "effects": list(effects), "entries": {"J11": -0.5}, "flags": {"closed_loop": False},
            "disturbance": {"rms_nm": [2e-3, 5e-4]}}  # fmt: skip


def said(verdict: str, *names: str, **parameters: dict[str, Any]) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "location": {"slot": names[0].split(".")[0]} if names else None,
        "effects": [{"name": name, "parameters": parameters} for name in names],
    }


def test_clopper_pearson_is_exact() -> None:
    # no hit in n: 1 - 0.025^(1/n); all hits: 0.025^(1/n)
    assert metrics.clopper_pearson(0, 60) == pytest.approx([0.0, 1 - 0.025 ** (1 / 60)])
    assert metrics.clopper_pearson(10, 10) == pytest.approx([0.025**0.1, 1.0])
    assert metrics.clopper_pearson(5, 20) == pytest.approx([0.0866, 0.4910], abs=1e-4)
    assert metrics.rate([])["rate"] is None


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
    assert metrics.covered([one])["effects"]["k"] == 1
    assert metrics.relative_errors(one) == pytest.approx([0.05 / 1.2])
    base = {"parameters": {"J11": {"value": -0.6, "ci95": [-0.7, -0.55]}}}
    null = Judged(hidden("null"), {**said("parameters"), "base": base})
    assert metrics.covered([null])["base"]["k"] == 0


def test_an_amplitude_beside_a_phase_has_no_sign() -> None:
    told = said("missing_physics", "hoop.imbalance", A={"value": -2e-3, "ci95": [-3e-3, -1e-3]})
    one = Judged(hidden("single", effect("hoop.imbalance", A=2.2e-3, phi=0.3)), told)
    assert metrics.covered([one])["effects"]["k"] == 1
    assert metrics.relative_errors(one) == pytest.approx([0.2 / 2.2])


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
    assert metrics.oracle_shares(found) == {"n": 3, "median": pytest.approx(0.9)}
    assert metrics.oracle_shares(found[:1])["median"] == pytest.approx(0.9)


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


def test_score_seeds_are_drawn_and_never_typed() -> None:
    drawn = {seeds.score_seed() for _ in range(50)}
    assert len(drawn) == 50
    assert not any(seeds.is_tuning(seed) for seed in drawn)
    assert all(seeds.is_tuning(seed) for seed in seeds.TUNING)
    with pytest.raises(SystemExit):
        cli.main(["generate", "nowhere", "--seed", str(min(drawn))])


FAKE = """
import json, os, sys
files = sorted(os.listdir())
json.dump({"verdict": "consistent", "effects": [], "files": files, "argv": sys.argv[1:]}, open("diagnosis.json", "w"))
"""


def test_a_worker_sees_the_recordings_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "command", lambda seed: [sys.executable, "-c", FAKE, str(seed)])
    done = worker.diagnose({"train_1.csv": b"1", "train_2.csv": b"2", "holdout.csv": b"3"}, 7)
    assert done["diagnosis"]["files"] == ["holdout.csv", "train_1.csv", "train_2.csv"]
    assert done["diagnosis"]["argv"] == ["7"]
    assert (done["code"], done["error"]) == (0, "")


def test_a_worker_survives_a_failure_and_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        worker, "command", lambda seed: [sys.executable, "-c", "import sys; sys.exit('no such column')"]
    )
    failed = worker.diagnose({}, 1)
    assert (failed["diagnosis"], failed["code"], failed["error"].strip()) == (None, 1, "no such column")
    monkeypatch.setattr(worker, "command", lambda seed: [sys.executable, "-c", "import time; time.sleep(60)"])
    hung = worker.diagnose({}, 1, limit_s=0.5)
    assert (hung["diagnosis"], hung["code"]) == (None, None)
    assert "0.5 s" in hung["error"]


def test_command_line_of_a_case() -> None:
    words = worker.command(3)[1:]
    assert words[:3] == ["-m", "hoopd", "diagnose"]
    assert words[3:] == [
        "train_1.csv",
        "train_2.csv",
        "--holdout",
        "holdout.csv",
        "--json",
        "diagnosis.json",
        "--seed",
        "3",
        "--no-free-run",
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[runfolder.RunFolder]:
    """A run with two short nulls that are made already."""
    asked = runfolder.Asked(1, 0, 2, 0, 0, 0, 0, ("null",))
    made = runfolder.RunFolder(tmp_path_factory.mktemp("concealed") / "run")
    made.start(asked)
    ((first, wishes),) = made.chunks()
    with pytest.MonkeyPatch.context() as patch:
        for name in recipes.RECORDINGS:
            patch.setitem(recipes.LENGTH_S, name, 5.0)
        made.keep(first, cases.make(wishes, asked.seed, first))
    yield made


def test_what_is_made_is_not_made_again(folder: runfolder.RunFolder) -> None:
    assert folder.chunks() == []
    assert len(folder.identifiers()) == 2
    assert [wish.family for wish in folder.asked().wishes()] == ["null"] * 2
    assert {path.parent.name for path in folder.path.rglob("*.csv")} == set(folder.identifiers())


def test_families_alone_have_the_same_cases_as_among_the_others() -> None:
    together = runfolder.Asked(4, 1, 2, 0, 0, 3, 0, ("single", "null", "compound")).wishes()
    alone = runfolder.Asked(4, 1, 2, 0, 0, 3, 0, ("compound",)).wishes()
    assert together[-3:] == alone


def test_rivals_say_what_they_are_known_for(folder: runfolder.RunFolder) -> None:
    files = folder.files(folder.identifiers()[0])
    found = {name: rival(files) for name, rival in baselines.RIVALS.items()}
    assert found["nominal"]["verdict"] == "consistent"
    assert found["re-fit"]["verdict"] == "parameters"
    assert {one["verdict"] for one in found.values()} <= {"consistent", "parameters", "missing_physics"}


def test_bic_finds_what_is_plain_to_see(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, name, 5.0)
    recipe = recipes.draw(Wish("single", ("camera.center_offset",), calm=True), (2, 0))
    recipe.fixed["camera.center_offset"]["angle"] = np.pi / 2
    recipe.sizes["camera.center_offset"] = 0.2
    for recording in range(3):
        cases.scale_inputs([recipe], recording)
    made = cases.traces([recipe])
    files = {f"{n}.csv": cases.csv_bytes(made[recipe.identifier, i]) for i, n in enumerate(recipes.RECORDINGS)}
    assert "camera.center_offset" in [one["name"] for one in baselines.bic(files)["effects"]]


def test_a_diagnosis_that_failed_is_an_answer(folder: runfolder.RunFolder) -> None:
    answers: dict[str, Any] = {"failed": {"diagnosis": None}, "done": {"diagnosis": said("parameters")}}
    kind = score.DIAGNOSES
    for name, answer in answers.items():
        folder.say(kind, name, answer)
    told = {(name, retry): score._done(folder, kind, name, retry) for name in answers for retry in (False, True)}
    assert told == {("failed", False): True, ("failed", True): False, ("done", False): True, ("done", True): True}
    assert not score._done(folder, kind, "nobody", False)


@pytest.mark.timeout(300)
def test_a_run_on_dask_is_diagnosed_judged_and_can_go_on(
    folder: runfolder.RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    console = Console(file=sys.stdout, width=100)
    done, left = folder.identifiers()
    folder.say(score.DIAGNOSES, done, {"diagnosis": said("parameters"), "seconds": 2.0, "code": 0, "error": ""})
    folder.say(score.DIAGNOSES, left, {"diagnosis": None, "seconds": 0.1, "code": 1, "error": "broken off"})
    before = (folder.path / score.DIAGNOSES / f"{done}.json").read_bytes()
    with score.cluster(None, 1) as client:
        score.run(folder, client, console, retry=True)
    assert (folder.path / score.DIAGNOSES / f"{done}.json").read_bytes() == before
    found = folder.said(score.DIAGNOSES, left)
    assert found is not None
    assert found["code"] == 0, found["error"]
    assert found["diagnosis"]["schema"] == "hoopd.diagnosis/1"
    assert found["diagnosis"]["verdict"] in (*metrics.SILENT, *metrics.ALARMS)
    result = score.publish(folder, console)
    assert result["rates"]["false_alarms"]["n"] == 2
    assert result["baselines"]["re-fit"]["false_alarms"]["k"] == 0
    assert result["baselines"]["nominal"]["false_alarms"]["n"] == 2
    assert json.loads((folder.path / "report.json").read_text())["cases"] == 2
    assert "false alarms" in capsys.readouterr().out
