"""The commands of a campaign, played: what they write is told beforehand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from hoopd.commands import learn as command
from hoopd.commands.options.learn import LearnOptions
from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import to_json_bytes


class Played:
    """Stands for the commands of a campaign: writes what they would, and counts them."""

    def __init__(self, diagnoses: Sequence[Diagnosis], verdict: str = "better") -> None:
        self.diagnoses, self.verdict, self.words = list(diagnoses), verdict, list[list[str]]()
        self.fails, self.early, self.writes_models = "", list[dict[str, Any]](), False

    def __call__(self, words: Sequence[Any]) -> int:
        text = [str(one) for one in words]
        self.words.append(text)
        if text[0] == self.fails:
            raise command.StepError("hoopd experiment: killed")
        told = Path(text[text.index("--json") + 1])
        content: dict[str, Any] = {"ended_at_s": 21.0, "outcome": "done"}
        if text[0] == "experiment":
            Path(text[text.index("--out") + 1]).write_bytes(b"recording")
            content = self.early.pop(0) if self.early else content
        if text[0] == "diagnose":
            if self.writes_models:
                Path(text[text.index("--write") + 1]).write_text("a model")
            told.write_bytes(to_json_bytes(self.diagnoses.pop(0)))
            return 0
        if text[0] == "compare":
            content = {
                "verdict": self.verdict, "reason": "clear after 4 pairs", "pairs": [], "judged_by": "ball",
                "ball_rms_rad": {"intervals_percent": [], "change_percent": None},
            }  # fmt: skip
        told.write_text(json.dumps(content))
        return 0

    @property
    def commands(self) -> list[str]:
        return [one[0] for one in self.words]


def played(monkeypatch: pytest.MonkeyPatch, *diagnoses: Diagnosis, verdict: str = "better") -> Played:
    found = Played(diagnoses, verdict)
    monkeypatch.setattr(command.Steps, "command", lambda self, words, log, accepted=(0,), seen=False: found(words))
    return found


def options(folder: Path, **more: Any) -> LearnOptions:
    return LearnOptions(**({"sim": True, "out": folder / "campaign", "budget": "3min"} | more))
