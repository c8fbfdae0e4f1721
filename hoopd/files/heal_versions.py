"""The versions of a loop: a folder each, with model, controller, and what was known when it was proposed.

    heal.json                 which device, the version that acts, and the daemon's folder of controllers
    0000/version.json         the loop as it was found, with controller.yaml and model.yaml
    0001/version.json         what became of the first change
    0001/evidence.mcap        the minutes that were diagnosed; fresh.mcap: those that prove it, which were not fitted
    0001/diagnosis.json       of `hoopd diagnose`, with report.html and found.yaml
    0001/model.yaml           what was found, without small corrections beside it
    0001/controller.yaml      of `hoopd design`, with design.json
    0001/memory.json          with `--memory`: what was known, and its diagnosis
    0001/decision.json        what a person decided

A step whose file is there is not repeated, and every file appears whole: whoever is killed goes on where it was.

Rules of this file: names and contents of files; nothing is decided here, and no version is ever changed into another
one or taken away.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal

import msgspec

from hoopd.files.folder_lock import alone_in, is_taken
from hoopd.files.json_files import read_json, write_json
from hoopd.files.reading import InputError
from hoopd.files.whole_files import begin_folder, file_bytes, replace_file

State = Literal[
    "diagnosing", "proving", "proposed", "trying", "accepted", "left", "refused", "went_back", "rolled_back"
]
# Of what nobody waits for any more.
OVER: tuple[State, ...] = ("accepted", "left", "refused", "went_back", "rolled_back")
MOST = 9999
DIGITS = 8  # of a copy's name
FOUND = "found"  # kind of a version that nobody learned: the loop as it was
DECISION = "decision.json"
LOCK, TAKEN = ".watched", "another hoopd heal is at work here"


class HealVersion(msgspec.Struct, kw_only=True):
    """`hoopd.version/1`: one version, or one attempt at one.

    Times are s since 1970, of a run in lock-step its run time; `from_s` and `to_s` are run time of the minutes that
    were diagnosed; `before`: the version that acted then; `restores`: an earlier one that explains them as well.
    """

    schema: Literal["hoopd.version/1"] = "hoopd.version/1"
    number: int
    state: State = "diagnosing"
    begun: float
    run: str = ""
    from_s: float = 0.0
    to_s: float = 0.0
    before: int = 0
    kind: str = ""
    reason: str = ""
    key: str = ""  # NAME.yaml@SHA256 in the daemon's folder of controllers
    copy: str = ""  # of a copy with its own model beside it, where `key` is a name that people write to
    sha256: dict[str, str] = {}  # of files beside it
    restores: int | None = None
    faults_s: dict[str, float] = {}
    evidence: dict[str, Any] = {}
    decided_by: str = ""
    accepted: float | None = None
    history: list[tuple[float, str]] = []

    @property
    def acts_as(self) -> int:
        """The version whose files act when this one does."""
        return self.number if self.restores is None else self.restores

    @property
    def keys(self) -> tuple[str, ...]:
        """Of its files in the daemon's folder, the one that nobody else writes to first."""
        return tuple(one for one in (self.copy, self.key) if one)


class HealedLoop(msgspec.Struct, kw_only=True):
    """`hoopd.heal/1`: the device, which version acts, and the daemon's folder of controllers as it was last."""

    schema: Literal["hoopd.heal/1"] = "hoopd.heal/1"
    device: str
    acting: int = 0
    controllers: str = ""


class HealDecision(msgspec.Struct, kw_only=True):
    """What a person decided about a version."""

    accept: bool
    who: str


class VersionFolder:
    """A folder of versions."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, device: str) -> HealedLoop:
        """Make the folder, or go on with the one of this device; InputError for any other."""
        path = self.folder / "heal.json"
        if path.exists():
            loop = self.loop()
            if loop.device != device:
                raise InputError(path, "device", f"is of {loop.device}, not {device}: another --out")
            return loop
        begin_folder(self.folder, "--out", "versions")
        return self._keep_loop(HealedLoop(device=device))

    def loop(self) -> HealedLoop:
        """The device and what acts; InputError for a folder that holds none."""
        path = self.folder / "heal.json"
        if not path.exists():
            raise InputError(self.folder, "--out", "holds no versions: hoopd heal has not been here")
        loop: HealedLoop = read_json(path, HealedLoop)
        return loop

    def takes_controllers_from(self, folder: Path) -> None:
        """Remember where the daemon's controllers lie, for whoever brings a version back."""
        loop = self.loop()
        loop.controllers = str(folder.resolve())
        self._keep_loop(loop)

    def watching(self) -> AbstractContextManager[None]:
        """Alone: two that follow one loop would undo each other's work."""
        return alone_in(self.folder, LOCK, TAKEN)

    @property
    def is_watched(self) -> bool:
        """Whether a process follows this loop now."""
        return is_taken(self.folder, LOCK)

    def of(self, number: int) -> Path:
        """A version's folder."""
        return self.folder / f"{number:04}"

    def numbers(self) -> list[int]:
        """Of all that there are."""
        return sorted(int(path.parent.name) for path in self.folder.glob("[0-9][0-9][0-9][0-9]/version.json"))

    def read(self, number: int) -> HealVersion:
        """One version; InputError when there is none."""
        path = self.of(number) / "version.json"
        if not path.exists():
            raise InputError(self.folder, str(number), "no such version; `hoopd heal list` has them")
        version: HealVersion = read_json(path, HealVersion)
        return version

    def every(self) -> Iterator[HealVersion]:
        """All of them, the oldest first."""
        return map(self.read, self.numbers())

    def first(self, key: str, controller: str, model: str, at: float, name: str) -> HealVersion:
        """The loop as it was found, or was changed by somebody else to: kept as a version that acts."""
        version = HealVersion(
            number=self._next(), state="accepted", begun=at, accepted=at, kind=FOUND, key=key, decided_by=name,
            reason="as the daemon had it",
        )  # fmt: skip
        folder = self.of(version.number)
        folder.mkdir(exist_ok=True)
        replace_file(folder / "controller.yaml", controller.encode())
        replace_file(folder / "model.yaml", model.encode())
        version.sha256 = self.hashes(version.number)
        self.keep(version, at, f"found: {key}")
        self.acts(version.number)
        return version

    def add(self, at: float, **told: Any) -> HealVersion:
        """A new attempt."""
        version = HealVersion(number=self._next(), begun=at, **told)
        self.of(version.number).mkdir(exist_ok=True)  # of one that was killed before it wrote a word
        self.keep(version, at, "begun")
        return version

    def keep(self, version: HealVersion, at: float, what: str = "") -> None:
        """Write a version down, with what happened to it."""
        if what:
            version.history = [*version.history, (at, what)]
        write_json(self.of(version.number) / "version.json", version)

    def decide(self, number: int, decision: HealDecision) -> None:
        """Lay a person's decision beside a version; InputError unless it is proposed, or a no is of one on trial.

        A yes is of the files that were proposed; a no may be the word about what became of them.
        """
        version = self.read(number)
        if version.state != "proposed" and (decision.accept or version.state != "trying"):
            raise InputError(self.folder, str(number), f"is {version.state.replace('_', ' ')}, not proposed")
        if decision.accept:
            self.check(number)
        write_json(self.of(number) / DECISION, decision)

    def decision(self, number: int) -> HealDecision | None:
        """What a person decided about a version, if any did."""
        path = self.of(number) / DECISION
        return read_json(path, HealDecision) if path.exists() else None

    def set_decision_aside(self, number: int) -> None:
        """A person has to decide anew; what was decided stays, as decision_1.json and so on."""
        path = self.of(number) / DECISION
        if path.exists():
            place = len([*path.parent.glob(f"{path.stem}_*{path.suffix}")]) + 1
            path.rename(path.with_stem(f"{path.stem}_{place}"))

    def waiting(self) -> list[int]:
        """Numbers of the versions of which a person has not decided yet."""
        return [one.number for one in self.every() if one.state == "proposed" and self.decision(one.number) is None]

    def acts(self, number: int) -> None:
        """Say which version acts."""
        loop = self.loop()
        loop.acting = number
        self._keep_loop(loop)

    def copy_name(self, number: int) -> str:
        """Of a version's copy in the daemon's folder: of its two files, and of no other version's or folder's."""
        told = self.hashes(number)
        digest = hashlib.sha256(f"{told['controller.yaml']} {told['model.yaml']}".encode()).hexdigest()
        return f"heal-{number}-{digest[:DIGITS]}"

    def hashes(self, number: int) -> dict[str, str]:
        """SHA-256 of a version's files by name."""
        names = ("evidence.mcap", "fresh.mcap", "diagnosis.json", "model.yaml", "controller.yaml", "design.json")
        found = {name: self.of(number) / name for name in names}
        return {name: hashlib.sha256(file_bytes(path)).hexdigest() for name, path in found.items() if path.exists()}

    def check(self, number: int) -> None:
        """InputError when a file of a version is another one than when it was proposed."""
        told, now = self.read(number).sha256, self.hashes(number)
        for name, digest in told.items():
            if now.get(name) != digest:
                raise InputError(self.of(number) / name, "", "was changed after it was proposed: its hash is another")

    def _next(self) -> int:
        numbers = self.numbers()
        if numbers and numbers[-1] >= MOST:
            raise InputError(self.folder, "--out", f"holds {MOST} versions: another folder")
        return numbers[-1] + 1 if numbers else 0

    def _keep_loop(self, loop: HealedLoop) -> HealedLoop:
        write_json(self.folder / "heal.json", loop)
        return loop
