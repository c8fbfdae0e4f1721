"""The fuzz bench: cases come from the program's own types, by number, and what is unforeseen or too dear is told."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "tools" / "bench"))

import fuzz
from fuzzing import cases, inprocess, outcome, schema, sound
from fuzzing.outcome import Outcome


@pytest.fixture(scope="module")
def sounds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    sound.make(folder)
    return folder


def test_every_key_and_command_is_there() -> None:
    names = {key.name for key in schema.settings()}
    assert {"serial.baud", "vision.circle_px.radius", "sim.faults", "faults.hoop_speed_rad_s", "loop.period_s"} <= names
    assert {"", "fit", "diagnose", "calibrate", "tune"} <= schema.commands().keys()
    assert {"--window", "--fix"} <= {option.flag for option in schema.commands()["fit"]}


def test_a_case_is_made_by_its_number(sounds: Path, tmp_path: Path) -> None:
    made = []
    for name in ("a", "b"):
        folder = tmp_path / name
        folder.mkdir()
        case = cases.make("1", 7, sounds, folder, whole=False)
        files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        made.append((case.kind, [text.replace(str(folder), "") for text in case.arguments], files))
    assert made[0] == made[1]


def test_cases_of_one_kind_alone(sounds: Path, tmp_path: Path) -> None:
    contents = set()
    for number in range(5):
        folder = tmp_path / str(number)
        folder.mkdir()
        case = cases.make("1", number, sounds, folder, whole=False, kinds=("plant file",))
        assert case.kind == "plant file"
        contents |= {path.read_bytes() for path in folder.glob("spoiled*") if path.is_file()}
    assert len(contents) > 2


@pytest.mark.parametrize("kind", sound.EXTENSIONS)
def test_a_sound_file_is_accepted(
    kind: str, sounds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = sound.path_of(sounds, kind)
    for arguments in cases.readings(kind, str(path), sounds):
        if arguments[0] not in ("status", "diagnose"):  # one wants a daemon, the other takes minutes
            assert inprocess.run(arguments)[0] == outcome.ACCEPTED, arguments


def test_one_of_two_alarms_cuts_and_neither_kills_the_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(arguments: list[str]) -> tuple[str, str]:
        try:
            signal.raise_signal(signal.SIGPROF)
        finally:
            signal.raise_signal(signal.SIGPROF)
        return outcome.REFUSED, "no alarm"

    monkeypatch.setattr(inprocess, "run", twice)
    assert inprocess._tried(1, cases.Case("mat", [])).verdict == outcome.ACCEPTED


def test_who_reads_on_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inprocess, "_reading", lambda frame: "mat5.py:1")
    with inprocess._alarms(time.process_time()):
        end = time.process_time() + 5 * inprocess.WAITS_S
        while time.process_time() < end:
            pass
        signal.raise_signal(signal.SIGPROF)  # both of them come after one long call
        signal.raise_signal(signal.SIGALRM)


def test_bounds_are_judged() -> None:
    fine = Outcome(1, "mat", outcome.REFUSED, 0.1, 10.0, "a line")
    assert outcome.judged(fine, outcome.MAX_BYTES) == fine
    for dear in (fine._replace(seconds=6.0), fine._replace(megabytes=400.0)):
        assert outcome.judged(dear, outcome.MAX_BYTES).verdict == outcome.BEYOND
    assert outcome.judged(fine._replace(verdict=outcome.ACCEPTED, seconds=60.0), 1.0).verdict == outcome.ACCEPTED


def test_the_table_tells_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    found = [
        Outcome(1, "mat", outcome.REFUSED, 0.1, 10.0, "a line"),
        Outcome(2, "mat", outcome.UNFORESEEN, 0.1, 10.0, "KeyError: x"),
    ]
    fuzz.show("title", found, 1.0)
    out = capsys.readouterr().out
    assert "UNFORESEEN: 2 (mat): KeyError: x" in out and "2 cases, 1 unforeseen or beyond the bounds" in out
