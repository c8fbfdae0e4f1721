"""What is remembered as a prior: joined, forgotten with age, contradicted, and each recording once."""

from __future__ import annotations

from datetime import date, timedelta
from math import exp, hypot, log, sqrt
from pathlib import Path

import msgspec
import numpy as np
import pytest
from harness.told_diagnosis import said

from hoopd.diagnose.memory import alone_of, contradictions, dated_later, remembered, remembered_prior
from hoopd.diagnose.proof.finding_standings import Asked
from hoopd.diagnose.proof.probabilities import Option, likely
from hoopd.diagnose.record import Base, Quantity, Visible
from hoopd.files.memory import Memory, RememberedDiagnosis, RememberedEffect, RememberedValue, load_memory, save_memory
from hoopd.files.reading import InputError

SUBJECT = "hoop rolling"
FRICTION = "hoop.coulomb_friction"


def told(recording: str, value: float = 7e-4, sd: float = 1e-5, date: str = "", **more: object) -> RememberedDiagnosis:
    values = {"bh": RememberedValue(value=value, sd=sd, unit="N m s")}
    return RememberedDiagnosis(recordings=[recording], parameters=values, date=date, **more)  # type: ignore[arg-type]


def prior(*diagnoses: RememberedDiagnosis, date: str = "", rate: float = 0.02) -> object:
    return remembered_prior(Memory(of=SUBJECT, diagnoses=list(diagnoses)), {"bh": 7e-4}, date, rate)


def test_two_diagnoses_are_joined_by_their_weights() -> None:
    found = prior(told("a", 7.0e-4, 1e-5), told("b", 7.2e-4, 2e-5))
    mean, sd = found.values["bh"]  # type: ignore[attr-defined]
    assert mean == pytest.approx((7.0e-4 * 4 + 7.2e-4) / 5) and sd == pytest.approx(1e-5 / sqrt(1.25))


def test_what_scatters_by_more_than_it_says_is_less_sure() -> None:
    """Of a device that changed: neither value is excluded by the other."""
    entries = [told(str(k), value) for k, value in enumerate((7e-4, 7e-4, 1.4e-3, 1.4e-3))]
    mean, sd = prior(*entries).values["bh"]  # type: ignore[attr-defined]
    assert mean == pytest.approx(1.05e-3) and sd == pytest.approx(3.5e-4 / sqrt(3.0))


def test_the_odds_of_a_name_are_not_counted_again_in_what_is_remembered_of_it() -> None:
    known = prior(told("a", effects={FRICTION: RememberedEffect(probability=0.9)}))
    nats = known.odds[FRICTION]  # type: ignore[attr-defined]
    surer = 0.6 * exp(nats) / (0.6 * exp(nats) + 0.4)  # of 60 % by the recordings alone
    kept = remembered(said(surer), ["b"], "", known).effects[FRICTION].probability  # type: ignore[arg-type]
    assert kept == pytest.approx(0.6)


def test_what_is_old_is_less_sure_and_what_is_new_counts_more() -> None:
    old, new = told("a", 7.0e-4, 1e-5, "2026-01-01"), told("b", 8.0e-4, 1e-5, "2026-04-11")
    mean, sd = prior(old, new, date="2026-04-11").values["bh"]  # type: ignore[attr-defined]
    grown = hypot(1e-5, 0.02 * 7e-4 * sqrt(100.0))
    assert sd == pytest.approx(1.0 / sqrt(1e10 + grown**-2)) and 7.9e-4 < mean < 8.0e-4
    same, _ = prior(old, new).values["bh"]  # type: ignore[attr-defined]
    assert same == pytest.approx(7.5e-4)  # without a date nothing is older


@pytest.mark.parametrize(("days_apart", "entries", "since"), [(0, 10, 365), (7, 26, 7), (-7, 26, -7)])
def test_a_device_that_walks_as_it_is_told_is_within_what_is_remembered(
    days_apart: int, entries: int, since: int
) -> None:
    """Ten entries of one day a year ago; one a week for half a year, before these recordings and after them."""
    random, beyond, rate = np.random.default_rng(8), 0, 0.02 * 7e-4
    for _ in range(300):
        steps = [since, *[days_apart] * (entries - 1)]
        walk = 7e-4 + np.cumsum(random.normal(size=entries) * rate * np.sqrt(np.abs(steps)))
        days = [date(2026, 1, 1) - timedelta(int(k)) for k in np.cumsum(steps)]
        told_then = [told(f"{k}", v, 1e-5, f"{d}") for k, (v, d) in enumerate(zip(walk, days, strict=True))]
        measured = [moved(one, random.normal() * 1e-5) for one in told_then]
        mean, sd = prior(*measured, date="2026-01-01").values["bh"]  # type: ignore[attr-defined]
        beyond += abs(mean - 7e-4) > 3.0 * sd
    assert beyond / 300 < 0.02


def moved(one: RememberedDiagnosis, by: float) -> RememberedDiagnosis:
    value = one.parameters["bh"]
    return msgspec.structs.replace(one, parameters={"bh": msgspec.structs.replace(value, value=value.value + by)})


@pytest.mark.parametrize("entries", [1, 10])
def test_a_year_is_one_walk_however_often_it_was_measured_before(entries: int) -> None:
    year = [told(str(k), date="2025-01-01") for k in range(entries)]
    _, sd = prior(*year, date="2026-01-01").values["bh"]  # type: ignore[attr-defined]
    assert sd / 7e-4 == pytest.approx(0.02 * sqrt(365.0), rel=1e-2)


def test_what_came_after_these_recordings_is_as_far_away_and_told() -> None:
    later = told("a", 9e-4, date="2031-01-01", effects={FRICTION: RememberedEffect(probability=0.9)})
    found = prior(later, date="2026-01-01")
    assert found.values["bh"] == (9e-4, pytest.approx(hypot(1e-5, 0.02 * 7e-4 * sqrt(1826.0))))  # type: ignore[attr-defined]
    assert found.odds[FRICTION] < 0.1  # type: ignore[attr-defined]
    memory = Memory(of=SUBJECT, diagnoses=[later, told("b", date="2025-12-31"), told("c")])
    assert dated_later(memory, "2026-01-01").startswith("1 entry is of a later day than these recordings (2031-01-01,")
    assert dated_later(memory, "") == "" and dated_later(memory, "2031-01-01") == ""


def test_a_confirmed_effect_raises_its_odds_and_one_not_seen_lowers_nothing() -> None:
    effect = {FRICTION: RememberedEffect(probability=0.9)}
    found = prior(told("a", date="2026-01-01", effects=effect), told("b"), date="2026-01-11")
    assert found.odds == {FRICTION: pytest.approx(log((0.05 + 0.9 * exp(-0.2)) / 0.05))}  # type: ignore[attr-defined]
    many = prior(*(told(str(k), effects=effect) for k in range(9)))
    assert many.odds[FRICTION] == 3.0  # type: ignore[attr-defined]


def test_names_that_were_confirmed_before_are_likelier_beside_their_rivals() -> None:
    asked = Asked(None, {}, [], None, None, None, 10.0, {FRICTION: 2.0})  # type: ignore[arg-type]
    options = [Option(FRICTION, 10.0), Option("hoop.quadratic_drag", 10.0)]
    before, after = likely(options).shares, likely(asked.believed(options)).shares
    assert before[FRICTION] == pytest.approx(0.5) and after[FRICTION] == pytest.approx(exp(2.0) / (1.0 + exp(2.0)))


def test_a_recording_counts_once() -> None:
    memory = Memory(of=SUBJECT, diagnoses=[told("a"), told("b")])
    both = RememberedDiagnosis(recordings=["b", "c"])
    assert [one.recordings for one in memory.with_diagnosis(both).diagnoses] == [["a"], ["b", "c"]]
    assert [one.recordings for one in memory.without(["a"]).diagnoses] == [["b"]]


def test_what_was_known_is_taken_out_of_an_estimate_again() -> None:
    # two of equal weight: 7.0 and 7.4 give 7.2, with a deviation smaller by sqrt 2
    half = 1.959964 * 1e-5 / sqrt(2.0)
    joined = Quantity(value=7.2e-4, unit="", ci95=(7.2e-4 - half, 7.2e-4 + half), nominal=None)
    alone = alone_of(joined, (7.0e-4, 1e-5))
    assert alone == (pytest.approx(7.4e-4), pytest.approx(1e-5, rel=1e-4))
    assert alone_of(joined, (7.2e-4, 1e-6)) is None  # the recordings say nothing of their own


def test_contradictions_are_said() -> None:
    effect = {FRICTION: RememberedEffect(probability=0.9, parameters={"Fc": RememberedValue(value=6e-3, sd=1e-4)})}
    known = prior(told("a", effects=effect))
    base = Base(
        model="hoop", parameters={"bh": Quantity(value=8e-4, unit="N m s", ci95=(7.8e-4, 8.2e-4), nominal=7e-4)}
    )
    power = {FRICTION: Visible(parameter="Fc", unit="N m", smallest=1e-3)}
    first, second = contradictions(said(base=base, power=power), known, prior())  # type: ignore[arg-type]
    assert first.startswith(
        "bh is 0.0008 ± 2e-05 N m s by these recordings, 0.0007 ± 2e-05 is remembered: 7.0 standard"
    )
    assert second == f"{FRICTION} is remembered (0.006 N m) and not seen, though 0.001 would have been"
    near = Base(model="hoop", parameters={"bh": Quantity(value=7.2e-4, unit="", ci95=(7e-4, 7.4e-4), nominal=7e-4)})
    assert contradictions(said(base=near), known, prior()) == []  # type: ignore[arg-type]


def test_only_what_was_confirmed_is_remembered() -> None:
    assert list(remembered(said(0.9), ["b", "a"], "", prior()).effects) == [FRICTION]  # type: ignore[arg-type]
    weak = remembered(said(0.9, "weak"), ["b", "a"], "2026-01-01", prior())  # type: ignore[arg-type]
    assert weak.effects == {} and weak.recordings == ["a", "b"] and weak.date == "2026-01-01"


def test_a_file_comes_back_and_what_is_none_is_one_line(tmp_path: Path) -> None:
    path, memory = tmp_path / "memory.json", Memory(of=SUBJECT, diagnoses=[told("a")])
    assert load_memory(path, SUBJECT) == (Memory(of=SUBJECT), "")
    save_memory(path, memory)
    again, sha256 = load_memory(path, SUBJECT)
    assert again == memory and len(sha256) == 64
    with pytest.raises(InputError, match="of: is of hoop rolling, not of pendulum"):
        load_memory(path, "pendulum")
    for spoiled, line in (
        (b"{}", "not a hoopd.memory/1"),
        (path.read_bytes().replace(b'"sd": ', b'"sd": -'), "a standard deviation is above 0"),
        (path.read_bytes().replace(b'"date": ""', b'"date": "May"'), "date: expected YYYY-MM-DD, not 'May'"),
    ):
        path.write_bytes(spoiled)
        with pytest.raises(InputError, match=line):
            load_memory(path, SUBJECT)
    assert msgspec.json.decode(msgspec.json.encode(memory), type=Memory) == memory
