"""The diagnosis as data: the published keys, never NaN, the same bytes, effects in order, and what is refused."""

from __future__ import annotations

import json
from math import inf, nan
from typing import Any

import msgspec
import numpy as np
import pytest
from diagnose.examples import EXAMPLES, coulomb

from hoopd.diagnose.record import Diagnosis, Evidence, Location, Quantity
from hoopd.diagnose.record_file import canonical, parse, to_json_bytes
from hoopd.files.reading import InputError

# From the published description of `hoopd.diagnosis/1`.
KEYS = {
    "schema", "verdict", "base", "location", "effects", "fit", "unexplained", "next_experiment", "data_quality", "seed"
}  # fmt: skip
QUANTITY = {"value", "unit", "ci95", "nominal"}
EFFECT = {
    "name", "slot", "parameters", "evidence", "not_excluded", "statement", "probability", "formula", "nearest",
    "explained",
}  # fmt: skip


def written(diagnosis: Diagnosis) -> dict[str, Any]:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    data: dict[str, Any] = json.loads(to_json_bytes(diagnosis), parse_constant=refuse)
    return data


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_kind_has_the_published_keys_and_reads_back_as_it_was(name: str) -> None:
    diagnosis, _ = EXAMPLES[name]()
    data = written(diagnosis)
    assert data.keys() >= KEYS
    assert data["base"].keys() == {"model", "parameters"}
    assert data["location"].keys() == {"slot", "channel", "segments", "depends_on", "evidence"}
    assert data["data_quality"].keys() >= {"missing", "late_frames", "outliers", "segments_ignored"}
    assert all(one.keys() == QUANTITY for one in data["base"]["parameters"].values())
    for effect in data["effects"]:
        assert effect.keys() >= EFFECT and all(one.keys() == QUANTITY for one in effect["parameters"].values())
        assert effect["evidence"].keys() == {"log_likelihood_gain", "threshold", "heldout_gain_percent"}
    for part in ("train", "heldout"):
        fits = [fit for channels in data["fit"][part].values() for fit in channels.values()]
        assert fits and all(fit.keys() == {"nominal", "base_refit", "with_effects", "noise_floor"} for fit in fits)
    assert parse(to_json_bytes(diagnosis), name) == canonical(diagnosis)


def test_what_is_not_determined_is_null_and_numpy_s_numbers_are_numbers() -> None:
    diagnosis, _ = coulomb()
    odd = {"a": Quantity(value=nan, unit="-", ci95=(-inf, inf), nominal=np.float64(2.0))}
    base = msgspec.structs.replace(diagnosis.base, parameters=odd)
    location = Location.nowhere({"hoop": np.float64(nan)})
    data = written(msgspec.structs.replace(diagnosis, base=base, location=location))
    assert data["base"]["parameters"]["a"] == {"value": None, "unit": "-", "ci95": [None, None], "nominal": 2.0}
    assert data["location"] == {
        "slot": None, "channel": None, "segments": None, "depends_on": [], "evidence": {"hoop": None}
    }  # fmt: skip


def test_effects_and_candidates_are_written_strongest_first_and_undetermined_last() -> None:
    diagnosis, _ = coulomb()

    def strong(name: str, gain: float | None) -> Any:
        evidence = Evidence(log_likelihood_gain=gain, threshold=31.0, heldout_gain_percent=None)
        return msgspec.structs.replace(diagnosis.effects[0], name=name, evidence=evidence)

    effects = [strong("e.none", None), strong("b.weak", 40.0), strong("d.nan", nan), strong("c.strong", 900.0)]
    effects.append(strong("a.weak", 40.0))
    data = written(msgspec.structs.replace(diagnosis, effects=effects, candidates=diagnosis.candidates[::-1]))
    assert [one["name"] for one in data["effects"]] == ["c.strong", "a.weak", "b.weak", "d.nan", "e.none"]
    gains = [one["log_likelihood_gain"] for one in data["candidates"]]
    assert len(gains) > 3 and gains == sorted(gains, reverse=True)


@pytest.mark.parametrize("verdict", ["consistent", "parameters"])
def test_a_verdict_without_missing_physics_names_none(verdict: str) -> None:
    diagnosis, _ = coulomb()
    with pytest.raises(ValueError, match=verdict):
        to_json_bytes(msgspec.structs.replace(diagnosis, verdict=verdict))


@pytest.mark.parametrize("verdict", ["missing_physics", "unknown_physics"])
def test_a_verdict_of_missing_physics_names_it(verdict: str) -> None:
    diagnosis, _ = coulomb()
    with pytest.raises(ValueError, match=verdict):
        to_json_bytes(msgspec.structs.replace(diagnosis, verdict=verdict, effects=[]))


def test_bytes_do_not_depend_on_the_order_in_which_a_mapping_was_filled() -> None:
    diagnosis, _ = coulomb()
    turned = dict(reversed(diagnosis.base.parameters.items()))
    other = msgspec.structs.replace(diagnosis, base=msgspec.structs.replace(diagnosis.base, parameters=turned))
    assert to_json_bytes(other) == to_json_bytes(diagnosis) == to_json_bytes(coulomb()[0])


def test_a_file_name_that_is_no_text_is_still_written() -> None:
    diagnosis, _ = coulomb()
    heldout = {"torn\udcff.mcap": next(iter(diagnosis.fit.heldout.values()))}
    fit = msgspec.structs.replace(diagnosis.fit, heldout=heldout)
    assert list(written(msgspec.structs.replace(diagnosis, fit=fit))["fit"]["heldout"]) == ["torn\\udcff.mcap"]


def test_what_nobody_filled_in_is_not_written() -> None:
    diagnosis, _ = coulomb()
    bare = msgspec.structs.replace(diagnosis, power={}, candidates=[], notes=[])
    assert written(bare).keys() == KEYS


@pytest.mark.parametrize("data", [b"", b"{}", b"\xff", b'{"schema": "hoopd.model/1"}', b"[" * 100_000])
def test_what_is_no_diagnosis_is_one_clear_line(data: bytes) -> None:
    with pytest.raises(InputError, match=r"^found\.json: not a hoopd\.diagnosis/1: ") as caught:
        parse(data, "found.json")
    assert "\n" not in str(caught.value)


def test_keys_of_a_later_version_are_left_alone() -> None:
    diagnosis, _ = coulomb()
    data = written(diagnosis) | {"later": 1}
    assert parse(json.dumps(data).encode(), "later.json") == canonical(diagnosis)
