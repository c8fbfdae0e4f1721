"""`hoopd diagnose --memory`: without it nothing changes; with it a recording counts once, and what was known counts."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from commands.devicerun import written
from commands.test_diagnose import LEFT_OUT, NAME
from harness.told_diagnosis import said
from inprocess import call

from hoopd.commands import diagnose as command
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import parse
from hoopd.files.memory import Memory, RememberedDiagnosis, load_memory, save_memory

QUICKLY = ("--library-only", "--no-free-run", "--without", ",".join(LEFT_OUT))
SUBJECT = "hoop entries"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of one device with dry friction."""
    place = tmp_path_factory.mktemp("remembered")
    for seed in (1, 2):
        written(place / f"run_{seed}.csv", seed, 8.0, 6e-3)
    return place


def diagnosed(folder: Path, recording: str, *words: str) -> tuple[bytes, Diagnosis, str]:
    """Bytes of the diagnosis, the diagnosis, and what was said."""
    told = folder / "told.json"
    code, out, errors = call(["diagnose", str(folder / recording), *QUICKLY, *words, "--json", str(told)])
    assert code == 0, errors
    return told.read_bytes(), parse(told.read_bytes(), told), out


def memory_in(folder: Path) -> Memory:
    return load_memory(folder / "memory.json", SUBJECT)[0]


@pytest.mark.proof
def test_a_memory_is_filled_counts_once_and_makes_the_next_one_surer(folder: Path) -> None:
    words = ("--memory", str(folder / "memory.json"))
    plain, alone, _ = diagnosed(folder, "run_2.csv")
    _, first, _ = diagnosed(folder, "run_1.csv", *words, "--date", "2026-03-01")
    assert first.memory is not None and first.memory.sha256 == "" and first.memory.parameters == {}
    assert NAME in memory_in(folder).diagnoses[0].effects and memory_in(folder).diagnoses[0].date == "2026-03-01"
    kept = (folder / "memory.json").read_bytes()

    # an empty memory changes nothing but what is told of it
    blank: Any = msgspec.json.decode(diagnosed(folder, "run_2.csv", "--memory", str(folder / "empty.json"))[0])
    assert blank.pop("memory")["sha256"] == "" and blank == msgspec.json.decode(plain)

    _, second, _ = diagnosed(folder, "run_2.csv", *words, "--date", "2026-03-02")
    used = second.memory
    assert used is not None and len(used.sha256) == 64 and used.recordings_again == 0
    assert used.odds_nats[NAME] > 1.0 and used.parameters and used.contradictions == []
    assert width(second, "L1") < width(alone, "L1")
    assert second.effects[0].name == alone.effects[0].name == NAME
    assert len(memory_in(folder).diagnoses) == 2

    # the same recording again: as if it had never been known
    (folder / "memory.json").write_bytes(kept)
    _, again, _ = diagnosed(folder, "run_1.csv", *words, "--date", "2026-03-01")
    assert again.memory is not None and again.memory.recordings_again == 1 and again.memory.parameters == {}
    assert (folder / "memory.json").read_bytes() == kept


def width(diagnosis: Diagnosis, name: str) -> float:
    low, high = diagnosis.base.parameters[name].ci95 or (None, None)
    assert low is not None and high is not None
    return high - low


@pytest.mark.proof
def test_what_contradicts_it_does_not_count_and_is_said(folder: Path) -> None:
    path = folder / "other.json"
    diagnosed(folder, "run_1.csv", "--memory", str(path))
    memory, _ = load_memory(path, SUBJECT)
    (one,) = memory.diagnoses
    known = one.parameters["L1"]
    moved = {**one.parameters, "L1": msgspec.structs.replace(known, value=1.5 * known.value)}
    save_memory(path, msgspec.structs.replace(memory, diagnoses=[msgspec.structs.replace(one, parameters=moved)]))
    _, found, out = diagnosed(folder, "run_2.csv", "--memory", str(path))
    assert found.memory is not None and "L1" in found.memory.left_out and "L1" not in found.memory.parameters
    assert any(line.startswith("L1 is ") for line in found.memory.contradictions)
    assert "is remembered" in " ".join(out.split())


def test_what_is_told_is_remembered_and_what_is_not_remembered_is_not_told(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever finds the diagnosis does not make it again: by then it is in the memory, in which it counts once."""
    told, path = tmp_path / "told.json", tmp_path / "memory.json"
    asked = DiagnoseOptions(recordings=(str(folder / "run_1.csv"),), memory=path, json_path=told)
    found = SimpleNamespace(diagnosis=said(0.9), memory=RememberedDiagnosis(recordings=["a"]))
    monkeypatch.setattr(command, "outcome_of", lambda *_, **__: found)
    with monkeypatch.context() as full:
        full.setattr(command, "add_to_memory", stopped)
        with pytest.raises(KeyboardInterrupt):
            command.run(asked)
    assert not told.exists() and not path.exists()
    with monkeypatch.context() as killed:
        killed.setattr(command, "replace_file", stopped)
        with pytest.raises(KeyboardInterrupt):
            command.run(asked)
    remembered = path.read_bytes()
    assert not told.exists() and [one.recordings for one in load_memory(path, SUBJECT)[0].diagnoses] == [["a"]]
    command.run(asked)
    assert told.exists() and path.read_bytes() == remembered


def stopped(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--memory", "/nowhere/memory.json"], "/nowhere/memory.json: --memory: no such folder"),
        (["--date", "1. March"], "--date: date: expected YYYY-MM-DD, not '1. March'"),
    ],
)
def test_what_cannot_be_remembered_is_one_line(words: list[str], line: str, folder: Path) -> None:
    code, _, errors = call(["diagnose", str(folder / "run_1.csv"), *words])
    assert code == 2 and errors == f"hoopd: {line}\n"
