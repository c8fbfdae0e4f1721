"""`hoopd learn` with recordings made by hand: what is counted, how it is read, and what is to be recorded next."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands.played_campaign import options, played
from harness.told_diagnosis import said

from hoopd.commands import learn as command
from hoopd.diagnose.record import NextExperiment
from hoopd.files.reading import InputError


def by_hand(path: Path, input_hz: float, psi: float = 0.1, names: str = "t,u,theta,dtheta,psi") -> str:
    """A recording of the hoop that somebody has made."""
    t = np.arange(0.0, 12.0, 0.02)
    columns = [t, 0.01 * np.sin(input_hz * t), 0.1 * np.sin(t), 0.1 * np.cos(t), psi * np.cos(t)]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=names, comments="")
    return str(path)


def judged(folder: Path, *recordings: str, **more: Any) -> dict[str, Any]:
    return command.run(options(folder, sim=False, recordings=recordings, **more))


def test_another_recording_of_the_same_name_is_looked_at_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(), said())
    for k in range(2):
        day = by_hand(tmp_path / "day.csv", 1.0, 0.1 + 0.1 * k)
        for _ in range(2):
            judged(tmp_path, day)
        assert steps.commands == ["diagnose"] * (k + 1)


def test_one_recording_is_one_kind_of_signal_however_it_is_spelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = played(monkeypatch, said(), said())
    day = by_hand(tmp_path / "day.csv", 1.0)
    monkeypatch.chdir(tmp_path)
    for spelled in (day, "day.csv", "./day.csv"):
        assert "1 of 3 kinds" in judged(tmp_path, spelled)["ended_because"]
    assert steps.commands == ["diagnose"]
    # the same signal on two other days is no other kind
    more = [by_hand(tmp_path / f"day_{k}.csv", 1.0, 0.2 + 0.1 * k) for k in range(2)]
    assert "1 of 3 kinds" in judged(tmp_path, day, *more)["ended_because"]


def test_three_signals_in_one_call_are_three_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played(monkeypatch, said(), said())
    days = [by_hand(tmp_path / f"day_{k}.csv", 1.0 + k) for k in range(3)]
    assert "2 of 3 kinds" in judged(tmp_path, *days[:2])["ended_because"]
    result = judged(tmp_path, *days)
    assert result["settled"] and result["next"] == "" and "Nothing more" in result["kept_because"]
    page = (tmp_path / "campaign" / "story.html").read_text()
    assert "recording.mcap" not in page and 'href="run_01/diagnosis.json"' in page


def test_the_inputs_of_a_plant_are_what_is_proposed_where_no_signal_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = NextExperiment(
        signal="h1 over all that it can be", parameters={}, tells_apart=("h1.a", "h1.b"), expected_nats=None,
        reason="Signals are proposed for drives of a coordinate, and this plant has none: by hand.", apart_nats=1.0,
    )  # fmt: skip
    played(monkeypatch, said(), said(0.6, next_experiment=read))
    rows = np.column_stack([np.arange(60.0), 5e-5 * np.ones(60), 0.2 * np.ones(60), 0.2 * np.ones(60)])
    path = tmp_path / "tanks.csv"
    np.savetxt(path, rows, delimiter=",", header="t,q,h1,h2", comments="")
    first = judged(tmp_path, str(path), plant="tanks")
    assert "two laws" in first["kept_because"]
    np.savetxt(path, rows + 1e-3, delimiter=",", header="t,q,h1,h2", comments="")
    again = judged(tmp_path, str(path), plant="tanks")
    assert "Signals are proposed for drives of a coordinate" in again["kept_because"]
    for result in (first, again):
        assert result["next"].startswith("another kind of signal than these, as multisine of q (within ")
        assert "hoopd experiment multisine --plant tanks" in result["next"] and "h1" not in result["next"]


def test_the_file_of_another_laboratory_is_read_as_diagnose_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = played(monkeypatch, said())
    day = by_hand(tmp_path / "day.csv", 1.0, names="zeit,moment,winkel,rate,ball")
    with pytest.raises(InputError):
        judged(tmp_path, day)
    assert not (tmp_path / "campaign").exists()  # which can be asked with other columns then
    told = {"columns": "t=zeit,u=moment,theta=winkel,dtheta=rate,psi=ball", "age": "psi=0.03", "hold": "linear"}
    judged(tmp_path, day, **told)
    (words,) = steps.words
    assert {name: words[words.index(f"--{name}") + 1] for name in told} == told
    asked = json.loads((tmp_path / "campaign" / "learn.json").read_text())
    assert {name: asked[name] for name in told} == told
    with pytest.raises(InputError, match=r"age: was begun with psi=0\.03, not with none"):
        judged(tmp_path, day, **told | {"age": ""})
    with pytest.raises(InputError, match="--hold: only with --recording"):
        command.learn(options(tmp_path, hold="linear"))


def test_a_folder_that_an_earlier_version_has_begun_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = played(monkeypatch, said(), said())
    day = by_hand(tmp_path / "day.csv", 1.0)
    judged(tmp_path, day)
    folder = tmp_path / "campaign"
    for path, newer in (
        (folder / "learn.json", ("columns", "age", "hold")),
        (folder / "run_01" / "choice.json", ("inputs", "halved")),
    ):
        told = json.loads(path.read_text())
        path.write_text(json.dumps({name: value for name, value in told.items() if name not in newer}))
    assert "1 of 3 kinds" in judged(tmp_path, day)["ended_because"] and steps.commands == ["diagnose"]
