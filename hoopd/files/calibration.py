"""Versions of a device's calibration: a folder of files NNNN.yaml, of which the one with the largest number is in
force.

Rules of this file: a version is added and never changed, replaced or taken away: an earlier one comes back as a new
one. Each has a hash of its content and of the version before it, so that a change by hand is noticed (not one by
somebody who writes the hash anew). It may set the keys of `KEYS` and no others. All that is wrong is one `InputError`.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from hoopd.files.reading import InputError, parse_yaml, read_bytes, read_text, to_struct
from hoopd.files.records import Strict
from hoopd.files.whole_files import new_file
from hoopd.files.yaml_text import text_of

# What a calibration may say: where the hoop is in the picture, what counts as ball, how old a picture without time is,
# and the torque of a current, by which the current is judged.
KEYS: Mapping[str, tuple[str, ...]] = {
    "vision": ("weights", "threshold", "circle_px", "zero_angle_rad", "ball_radius_px", "band_px"),
    "camera": ("delay_s",),
    "faults": ("torque_constant_nm_per_a",),
}
MOST = 9999
TRIES = 5  # for a number that somebody else takes meanwhile
EVIDENCE_BYTES = 2**21
CHANGED = "was changed after it was accepted (its hash is another)"
_NUMBERED = re.compile(r"(\d{4})\.yaml")
_EVIDENCE = re.compile(r"[a-z_]{1,20}\.(svg|jpg|json)")
Text = Annotated[str, Meta(max_length=300)]
Part = dict[str, dict[str, Any]]


class StepJudgement(Strict, frozen=True, kw_only=True):
    """What one step of a calibration found."""

    good: bool
    why: Text
    values: dict[str, Any] = msgspec.field(default_factory=dict)


class AcceptedCalibration(Strict, frozen=True, kw_only=True):
    """One version."""

    schema: Literal["hoopd.calibration/1"] = "hoopd.calibration/1"
    number: Annotated[int, Meta(ge=1, le=MOST)]
    device: Annotated[str, Meta(max_length=64)]
    date: Annotated[str, Meta(max_length=40)]
    who: Annotated[str, Meta(max_length=64)]
    why: Text
    configuration: Part
    steps: dict[str, StepJudgement] = msgspec.field(default_factory=dict)
    # file beside it, and the SHA-256 of its bytes
    evidence: dict[str, str] = msgspec.field(default_factory=dict)
    before: str = ""  # hash of the version before
    sha256: str = ""  # of all that stands above


class Change(NamedTuple):
    """One key that differs from the version before; None: not set."""

    key: str
    before: Any
    now: Any


class ListedCalibration(NamedTuple):
    """One version of a folder, or why it is none."""

    number: int
    calibration: AcceptedCalibration | None
    wrong: str = ""
    changes: tuple[Change, ...] = ()


class Calibrations:
    """A folder of versions."""

    def __init__(self, folder: Path) -> None:
        """InputError when there is none."""
        if not folder.is_dir():
            raise InputError(folder, "calibration.folder", "no such folder")
        self.folder = folder
        self._seen: tuple[tuple[str, int, int, int], ...] = ()
        self._known: list[ListedCalibration] = []

    def numbers(self) -> list[int]:
        """Of the versions that are there."""
        found = (_NUMBERED.fullmatch(path.name) for path in self.folder.iterdir())
        return sorted(int(match[1]) for match in found if match)

    def read(self, number: int) -> AcceptedCalibration:
        """A version that is as it was accepted; InputError for any other."""
        path = self._path(number)
        if path.is_symlink():
            raise InputError(path, "", "is a link: no version")
        version = to_struct(parse_yaml(read_text(path), path), AcceptedCalibration, path)
        _check_keys(version.configuration, path)
        if version.number != number:
            raise InputError(path, "number", f"{version.number} is not that of the file's name")
        if version.sha256 != _hash(version):
            raise InputError(path, "sha256", CHANGED)
        return version

    def in_force(self) -> AcceptedCalibration | None:
        """The newest; None in an empty folder. InputError when the newest cannot be used: nothing is guessed."""
        numbers = self.numbers()
        if not numbers:
            return None
        try:
            return self.read(numbers[-1])
        except InputError as error:
            advice = "`hoopd calibration restore NUMBER` takes an earlier one"
            raise InputError(error.path, error.key, f"{_reason(error)}; {advice}") from None

    def listed(self) -> list[ListedCalibration]:
        """All, oldest first, each with what it changed, or with what is wrong with it.

        They are read and hashed anew when a file of the folder is another one: a page asks every few seconds.
        """
        if (seen := self._files()) != self._seen:
            self._known, self._seen = list(self._listed()), seen
        return list(self._known)

    def _files(self) -> tuple[tuple[str, int, int, int], ...]:
        """Name, size and times of every file; whatever is written to one, the last of them is another."""
        found = []
        for path in self.folder.iterdir():
            with contextlib.suppress(FileNotFoundError):  # gone since it was listed, as what `new_file` writes to
                stat = path.lstat()
                found.append((path.name, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns))
        return tuple(sorted(found))

    def _listed(self) -> Iterator[ListedCalibration]:
        before: AcceptedCalibration | None = None
        for number in self.numbers():
            try:
                version = self.read(number)
            except InputError as error:
                yield ListedCalibration(number, None, ": ".join(filter(None, (error.key, _reason(error)))))
                before = None
                continue
            follows = version.before == (before.sha256 if before else "")
            wrong = "" if follows else "the version before it is missing, or is another one than it was"
            yield ListedCalibration(number, version, wrong or self._spoiled(version), differences(before, version))
            before = version

    def _spoiled(self, version: AcceptedCalibration) -> str:
        for name in version.evidence:
            try:
                self.evidence(version, name)
            except InputError as error:
                return f"{name}: {_reason(error)}"
        return ""

    def evidence(self, version: AcceptedCalibration, name: str) -> bytes:
        """A file of a version's evidence, as it was accepted; InputError for another one."""
        if name not in version.evidence or "/" in name or name.startswith("."):
            raise InputError(name[:60], "", "no such evidence")
        data = read_bytes(self.folder / name, EVIDENCE_BYTES)
        if hashlib.sha256(data).hexdigest() != version.evidence[name]:
            raise InputError(name, "", CHANGED)
        return data

    def add(
        self,
        part: Part,
        *,
        device: str,
        who: str,
        why: str,
        steps: Mapping[str, StepJudgement] | None = None,
        evidence: Mapping[str, bytes] | None = None,
    ) -> AcceptedCalibration:
        """A new version: what was in force with this part laid over it.

        Parameters
        ----------
        part : sections of the configuration, with keys of `KEYS`
        device, who, why : whose it is, who accepted it, on which occasion
        steps : what the steps found that led here
        evidence : pictures and numbers of them, by names such as circle.jpg
        """
        _check_keys(part, "calibration")
        for name, data in (evidence or {}).items():
            if not _EVIDENCE.fullmatch(name) or len(data) > EVIDENCE_BYTES:
                raise InputError(name[:60], "", f"no name of evidence, or more than {EVIDENCE_BYTES} bytes")
        before = self.in_force()
        whole = _laid_over(before.configuration if before else {}, part)
        return self._write(
            whole, device, who, why, {**(before.steps if before else {}), **(steps or {})}, before, evidence or {}
        )

    def restore(self, number: int, who: str) -> AcceptedCalibration:
        """What an earlier version said, as a new one."""
        earlier, newest = self.read(number), self._last_sound()
        why = f"restored from {number}"
        return self._write(
            earlier.configuration, earlier.device, who, why, earlier.steps, newest, {}, kept=earlier.evidence
        )

    def _last_sound(self) -> AcceptedCalibration | None:
        """The newest, when it can be read."""
        numbers = self.numbers()
        try:
            return self.read(numbers[-1]) if numbers else None
        except InputError:
            return None

    def _write(
        self, whole: Part, device: str, who: str, why: str, steps: Mapping[str, StepJudgement],
        before: AcceptedCalibration | None, evidence: Mapping[str, bytes], kept: Mapping[str, str] | None = None,
    ) -> AcceptedCalibration:  # fmt: skip
        date = datetime.now(UTC).isoformat(timespec="seconds")
        for _ in range(TRIES):
            number = (self.numbers() or [0])[-1] + 1
            if number > MOST:
                raise InputError(self.folder, "calibration", f"{MOST} versions are there already")
            named = {f"{number:04}-{name}": data for name, data in evidence.items()}
            hashes = {name: hashlib.sha256(data).hexdigest() for name, data in named.items()}
            version = AcceptedCalibration(
                number=number, device=device, date=date, who=who[:64], why=why[:300], configuration=whole,
                steps=dict(steps), evidence={**(kept or {}), **hashes}, before=before.sha256 if before else "",
            )  # fmt: skip
            version = msgspec.structs.replace(version, sha256=_hash(version))
            try:
                for name, data in named.items():
                    new_file(self.folder / name, data)
                new_file(self._path(number), text_of(msgspec.to_builtins(version)).encode())
            except FileExistsError:
                continue
            return version
        raise InputError(self.folder, "calibration", "somebody else writes versions at the same time: try again")

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:04}.yaml"


def differences(before: AcceptedCalibration | None, now: AcceptedCalibration) -> tuple[Change, ...]:
    """Keys that one version has other than another."""
    old, new = _flat(before.configuration if before else {}), _flat(now.configuration)
    return tuple(Change(key, old.get(key), new.get(key)) for key in {**old, **new} if old.get(key) != new.get(key))


def _flat(part: Part) -> dict[str, Any]:
    return {f"{section}.{key}": value for section, keys in part.items() for key, value in keys.items()}


def _laid_over(below: Part, above: Part) -> Part:
    return {name: {**below.get(name, {}), **above.get(name, {})} for name in {**below, **above}}


def _check_keys(part: Part, source: object) -> None:
    for section, keys in part.items():
        for key in keys:
            if key not in KEYS.get(section, ()):
                raise InputError(source, f"configuration.{section}.{key}"[:100], "no key that a calibration may set")
    if part.get("faults", {}).get("torque_constant_nm_per_a") == 0.0:
        raise InputError(source, "faults.torque_constant_nm_per_a", "must be above 0, which would switch a check off")


def _hash(version: AcceptedCalibration) -> str:
    content = msgspec.to_builtins(msgspec.structs.replace(version, sha256=""))
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _reason(error: InputError) -> str:
    """What is wrong, without the file's name and key."""
    return str(error).removeprefix(f"{error.path}: ").removeprefix(f"{error.key}: ")
