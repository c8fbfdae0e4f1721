"""What `hoopd experiment` simulates has no noise: nothing in it is called false, and a spike is found all the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hoopd.commands.inputs import read_recording
from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.quality.outliers import jumping
from hoopd.diagnose.quality.recording_quality import Quality
from hoopd.plants.registry import plant_named
from hoopd.recording.recording import Recording
from tests.commands.test_plant import hoopd

KINDS = {
    "prbs": ("prbs",),
    "slow prbs": ("prbs", "--clock", "25"),
    "steps": ("steps",),
    "chirp": ("chirp",),
    "decay": ("decay",),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def played(plant: str, kind: str) -> Recording:
    code, _, error = hoopd("experiment", *KINDS[kind], "--plant", plant, "--out", "run.csv")
    assert code == 0, error
    return read_recording("run.csv", plant=plant_named(plant))


def quality_of(recording: Recording, plant: str) -> Quality:
    return source_of("run.csv", recording, plant_named(plant)).quality


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("plant", ["tanks", "drives", "circuit"])
def test_no_sample_is_false(plant: str, kind: str) -> None:
    quality = quality_of(played(plant, kind), plant)
    assert quality.segments == []
    assert {name: one.numbers["outliers"] for name, one in quality.channels.items()} == dict.fromkeys(
        quality.channels, 0
    )


@pytest.mark.parametrize(("plant", "channel"), [("tanks", "h1"), ("drives", "speed"), ("circuit", "v")])
def test_a_spike_is_found(plant: str, channel: str) -> None:
    recording, rows = played(plant, "steps"), [333, 620, 777]
    values = recording.column(channel).copy()
    values[rows] += 0.3 * np.ptp(values) * np.array([1.0, -1.0, 1.0])
    judged = quality_of(recording.replaced(**{channel: values}), plant).channels[channel]
    assert np.flatnonzero(judged.outliers).tolist() == rows


@pytest.mark.parametrize(
    ("plant", "kind"),
    [
        pytest.param("tanks", "prbs", marks=pytest.mark.proof),
        pytest.param("drives", "steps", marks=pytest.mark.proof),
        ("circuit", "decay"),
    ],
)
def test_the_model_explains_what_it_simulated(plant: str, kind: str) -> None:
    played(plant, kind)
    assert hoopd("diagnose", "--plant", plant, "run.csv", "--no-free-run", "--json", "found.json")[0] == 0
    found = json.loads(Path("found.json").read_text())
    assert found["verdict"] in ("consistent", "parameters") and found["effects"] == []
    assert found["data_quality"]["segments_ignored"] == [] and found["data_quality"]["outliers"] == 0


def test_a_reading_that_jumps_away_and_back_is_false_and_one_that_bends_there_and_back_is_not() -> None:
    place = np.linspace(0.0, 3.0, 300) ** 2
    false, whole = np.zeros(300, dtype=bool), np.ones(300, dtype=bool)
    false[100:110] = True
    away, pushed = place + 0.5 * false, place + np.cumsum(0.05 * false)
    assert (jumping(false, away, whole, 1e-6) == false).all()
    assert not jumping(false, pushed, whole, 1e-6).any()
