"""Whether probabilities are kept: what counts as right, and bins that tell honest ones from boasting."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed.cli import main  # noqa: E402
from concealed.judged import Judged  # noqa: E402
from concealed.reliability import markdown, reliability, statements  # noqa: E402


def case(hidden: str | None, found: dict[str, float], family: str = "single", **others: float) -> Judged:
    truth = [] if hidden is None else [{"name": hidden, "slot": hidden.split(".")[0], "nats": 50.0}]
    said = {
        "effects": [{"name": name, "probability": p} for name, p in found.items()],
        "candidates": [{"name": name.replace("__", "."), "probability": p} for name, p in others.items()],
    }
    return Judged({"family": family, "effects": truth, "flags": {}}, said)


def test_a_name_is_right_by_its_class_and_what_has_none_by_its_slot() -> None:
    assert [*statements(case("hoop.coulomb_friction", {"hoop.stribeck_friction": 0.9}))] == [(0.9, True)]
    assert [*statements(case("hoop.coulomb_friction", {"camera.latency": 0.6}))] == [(0.6, False)]
    assert [*statements(case("hoop.coulomb_friction", {"hoop.dahl_of_theta": 0.6}))] == [(0.6, False)]
    strange = case("outside.dahl", {"outside.dahl_of_theta": 0.8, "hoop.coulomb_friction": 0.2}, "outside")
    assert [*statements(strange)] == [(0.8, True), (0.2, False)]
    # of a name that the library was made to lack a slot and a formula are right, as they are not where it has the name
    for family, right in (("left_out", True), ("single", False)):
        assert [*statements(case("hoop.coulomb_friction", {"unknown.hoop": 0.8}, family))] == [(0.8, right)]
        assert [*statements(case("hoop.coulomb_friction", {"hoop.dahl_of_theta": 0.8}, family))] == [(0.8, right)]
    assert [*statements(case("hoop.coulomb_friction", {"unknown.camera": 0.8}, "left_out"))] == [(0.8, False)]


def test_candidates_count_that_are_no_findings_and_nothing_has_names_of_its_own() -> None:
    told = [*statements(case(None, {}, "null", parameters=0.9, hoop__coulomb_friction=0.09, camera__latency=0.001))]
    assert told == [(0.9, True), (0.09, False)]
    both = case("frame.tilt", {"frame.tilt": 0.7}, frame__tilt=0.35, camera__angle_offset=0.35)
    assert [*statements(both)] == [(0.7, True)]
    unsaid = case("outside.dahl", {"hoop.coulomb_friction": 0.3}, "outside")
    unsaid.said["candidates"].append({"name": "none of these", "probability": 0.7})  # type: ignore[index]
    assert [*statements(unsaid)] == [(0.3, False), (0.7, True)]


def made(told: float, share: float, count: int = 400) -> list[Judged]:
    right = np.random.default_rng(5).random(count) < share
    return [case("hoop.imbalance" if one else "camera.latency", {"hoop.imbalance": told}) for one in right]


def test_honest_probabilities_err_as_chance_does_and_boasting_ones_more() -> None:
    honest, boasting = reliability([*made(0.9, 0.9), *made(0.3, 0.3)]), reliability(made(0.95, 0.6))
    assert honest["n"] == 800 and len(honest["bins"]) == 10 and {row["n"] for row in honest["bins"]} == {80}
    assert honest["error"] < honest["by_chance"][1]
    assert boasting["error"] == pytest.approx(0.35, abs=0.05) and boasting["error"] > 5.0 * boasting["by_chance"][1]
    assert "800 probabilities" in markdown(honest) and reliability([])["n"] == 0


def test_a_folder_is_read_and_an_empty_one_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = made(0.9, 1.0, 1)[0]
    parts: list[tuple[str, Any]] = [("answers", one.answer), ("diagnoses", one.said)]
    for kind, data in parts:
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "a.json").write_text(json.dumps(data))
    main(["reliability", str(tmp_path)])
    assert "1 probabilities" in capsys.readouterr().out
    with pytest.raises(SystemExit) as caught:
        main(["reliability", str(tmp_path / "none")])
    assert caught.value.code == 2 and capsys.readouterr().err.count("\n") == 1
