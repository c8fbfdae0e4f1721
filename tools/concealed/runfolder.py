"""A scored run on disk: what was asked, cases, answers, what was said. Every finished piece is a file.

Rules of this file: a file appears whole or not at all; what exists is not made again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from concealed import cases
from concealed.cases import Case
from concealed.families import FAMILIES, OUTSIDE_NATS
from concealed.recipes import Wish, numbered
from concealed.whole import put

import numpy as np  # isort: skip

CHUNK = 60  # cases that are made together


@dataclass(frozen=True)
class Asked:
    """What a run consists of."""

    seed: int
    singles: int
    nulls: int
    decoys: int
    confounded: int
    compounds: int
    unknown: int
    families: tuple[str, ...]
    left_out: int = 0
    outside: int = 0
    outside_nats: tuple[float, float] = OUTSIDE_NATS
    only: tuple[str, ...] = ()  # effects: other cases with an effect are left away
    library_only: bool = False  # `hoopd diagnose` is asked without the grammar

    def wishes(self) -> list[Wish]:
        """All cases of the run. A case is the same whichever families are asked beside it: it is numbered among all."""
        counts = {"single": self.singles, "null": self.nulls, "decoy": self.decoys, "confounded": self.confounded,
                  "compound": self.compounds, "unknown": self.unknown, "left_out": self.left_out,
                  "outside": self.outside}  # fmt: skip
        rng = np.random.default_rng([self.seed, 1])
        makers = {**FAMILIES, "outside": partial(FAMILIES["outside"], nats=self.outside_nats)}
        found = numbered([wish for family, make in makers.items() for wish in make(counts[family], rng)])
        return [wish for family in self.families for wish in found if wish.family == family and self._wanted(wish)]

    def _wanted(self, wish: Wish) -> bool:
        return not self.only or not wish.effects or bool(set(self.only) & set(wish.effects))


class FolderError(Exception):
    """A folder that is not what it was called: one line for who typed it."""


class RunFolder:
    """One run's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def asked(self) -> Asked:
        """What the run was started with; FolderError when this is no run's folder."""
        if not self._started():
            raise FolderError(f"{self.path}: no run.json, so there is no run in this folder")
        stored = json.loads((self.path / "run.json").read_text(encoding="utf-8"))
        lists = {name: tuple(stored[name]) for name in ("families", "only", "outside_nats") if name in stored}
        return Asked(**{**stored, **lists})

    def start(self, asked: Asked) -> None:
        """Makes the folder and notes what is asked; FolderError when it holds a run already."""
        if self._started():
            raise FolderError(f"{self.path}: holds a run already; --resume {self.path} goes on with it")
        self.path.mkdir(parents=True, exist_ok=True)
        self._put("run.json", asdict(asked))

    def versions(self) -> list[str]:
        """Of the code that has spoken, the first one first."""
        path = self.path / "versions.json"
        return list(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else []

    def speaks(self, version: str) -> None:
        """Notes that this code speaks from now on."""
        before = self.versions() or (["unknown"] if (self.path / "diagnoses").exists() else [])
        if version not in before:
            self._put("versions.json", [*before, version])

    def _started(self) -> bool:
        return (self.path / "run.json").exists()

    def chunks(self) -> list[tuple[int, Sequence[Wish]]]:
        """Number of the first case and wishes of what has not been made yet."""
        wishes = self.asked().wishes()
        pieces = [(first, wishes[first : first + CHUNK]) for first in range(0, len(wishes), CHUNK)]
        return [(first, piece) for first, piece in pieces if not (self.path / "made" / f"{first}.json").exists()]

    def keep(self, first: int, made: Sequence[Case]) -> None:
        """Stores the cases of one chunk."""
        cases.write(made, self.path / "cases", self.path / "answers")
        self._put(f"made/{first}.json", [case.identifier for case in made])

    def identifiers(self) -> list[str]:
        """Cases that have been made."""
        return sorted(path.stem for path in (self.path / "answers").glob("*.json"))

    def files(self, identifier: str) -> dict[str, bytes]:
        """Recordings of a case."""
        return {path.name: path.read_bytes() for path in sorted((self.path / "cases" / identifier).iterdir())}

    def answer(self, identifier: str) -> dict[str, Any]:
        """What is hidden in it."""
        return dict(json.loads((self.path / "answers" / f"{identifier}.json").read_text(encoding="utf-8")))

    def signals(self, identifier: str) -> dict[str, bytes]:
        """What a mechanism outside the library did in each recording of a case; nothing of other families."""
        folder = self.path / "answers" / "signals" / identifier
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())} if folder.exists() else {}

    def has(self, kind: str, identifier: str) -> bool:
        """Has this been said of the case already?"""
        return (self.path / kind / f"{identifier}.json").exists()

    def said(self, kind: str, identifier: str) -> dict[str, Any] | None:
        """What was said, None when nothing was."""
        path = self.path / kind / f"{identifier}.json"
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else None

    def say(self, kind: str, identifier: str, found: object) -> None:
        """Stores what was said of a case."""
        self._put(f"{kind}/{identifier}.json", found)

    def _put(self, name: str, content: object) -> None:
        put(self.path / name, (json.dumps(content, indent=1, sort_keys=True) + "\n").encode())
