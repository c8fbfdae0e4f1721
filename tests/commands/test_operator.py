"""`hoopd controller`: which file is asked for, and a supervisor who watches a trial to its end."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from inprocess import call

from hoopd.commands import operator
from hoopd.shell.operator import CommandError


class Answers:
    """A daemon that takes everything, and ends a trial after so many words of its supervisor."""

    def __init__(self, alive: int = 2, interrupt: bool = False) -> None:
        self.asked: list[dict[str, Any]] = []
        self._alive, self._interrupt = alive, interrupt

    def __call__(self, request: dict[str, Any], config: object, sets: object) -> dict[str, Any]:
        self.asked.append(request)
        if request["command"] == "alive":
            self._alive -= 1
            if self._alive < 0 and self._interrupt:
                raise KeyboardInterrupt
            if self._alive < 0:
                raise CommandError("alive: refused: there is no trial")
        told = {"file": "mine.yaml", "sha256": "ab" * 32, "since": 12.5}
        return {"mode": "RUNNING", "key": request.get("key", ""), "reference": 0.0, "status": {"controller": told}}

    @property
    def names(self) -> list[str]:
        return [request["command"] for request in self.asked]


def answering(patch: pytest.MonkeyPatch, answers: Answers) -> Answers:
    patch.setattr(operator, "ask", answers)
    patch.setattr(operator, "ALIVE_S", 0.0)
    return answers


def test_the_file_that_is_seen_is_the_one_that_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = answering(monkeypatch, Answers())
    file = tmp_path / "mine.yaml"
    file.write_text("schema: x\n")
    key = f"mine.yaml@{hashlib.sha256(file.read_bytes()).hexdigest()}"
    for options, name in (((), "controller"), (("--experiment",), "experiment")):
        code, out, _ = call(("controller", str(file), *options))
        assert code == 0 and key in out and answers.asked[-1] == {"command": name, "key": key}
    assert call(("controller", "mine.yaml@0123456789ab"))[0] == 0
    assert answers.asked[-1]["key"] == "mine.yaml@0123456789ab"


def test_a_trial_is_watched_until_it_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = answering(monkeypatch, Answers(alive=2))
    code, out, _ = call(("controller", "mine.yaml@0123456789ab", "--trial"))
    assert code == 0 and answers.names == ["trial", "alive", "alive", "alive", "status"]
    assert "there is no trial; in force: mine.yaml@abababababab since 12.50 s" in out


def test_a_supervisor_who_is_interrupted_takes_the_trial_back(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = answering(monkeypatch, Answers(alive=1, interrupt=True))
    code, out, _ = call(("controller", "mine.yaml@0123456789ab", "--trial"))
    assert code == 0 and answers.names[-1] == "revert" and "the accepted controller is back" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("none.yaml",), "no such file"),
        (("law.py",), "code is never loaded"),
        (("mine.yaml@0123456789ab", "--trial", "--experiment"), "not with --experiment"),
    ],
)
def test_what_cannot_be_asked_for_is_one_line(
    words: tuple[str, ...], says: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    answers = answering(monkeypatch, Answers())
    monkeypatch.chdir(tmp_path)
    code, _, errors = call(("controller", *words))
    assert code == 2 and says in errors and errors.count("\n") == 1 and not answers.asked
