"""Versions of a loop that `hoopd heal` follows.

Rules of this file: thin over the folder that it keeps; a loop is followed by the command line alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.version_words import user_name
from hoopd.files.heal_versions import HealDecision, HealVersion, VersionFolder
from hoopd.files.reading import InputError
from hoopd.lab.controllers import Controller, controller
from hoopd.lab.models import Model, model


@dataclass(frozen=True, repr=False)
class LoopVersions:
    """What was found of a loop, and what became of it; read anew with every question."""

    folder: VersionFolder

    def __repr__(self) -> str:
        return f"LoopVersions({self.folder.folder}: version {self.acting} acts, {len(self.versions)} versions)"

    @property
    def acting(self) -> int:
        """Number of the version that acts."""
        return self.folder.loop().acting

    @property
    def is_followed(self) -> bool:
        """Whether a `hoopd heal` is at work."""
        return self.folder.is_watched

    @property
    def versions(self) -> list[HealVersion]:
        """All of them, with state, reason, evidence and history, the oldest first."""
        return list(self.folder.every())

    @property
    def waiting(self) -> list[int]:
        """Numbers of versions that wait for a person."""
        return self.folder.waiting()

    def model(self, number: int | None = None) -> Model:
        """Of a version, of the one that acts without a number."""
        return model(self._file(number, "model.yaml"))

    def controller(self, number: int | None = None) -> Controller:
        """Of a version, of the one that acts without a number."""
        return controller(self._file(number, "controller.yaml"))

    def accept(self, number: int) -> None:
        """Put a proposed version on trial: whoever follows the loop takes it up; ValueError for any other."""
        self._decide(number, accept=True)

    def leave(self, number: int) -> None:
        """Leave a proposed version; ValueError for any other."""
        self._decide(number, accept=False)

    def _decide(self, number: int, *, accept: bool) -> None:
        try:
            self.folder.decide(number, HealDecision(accept=accept, who=user_name()))
        except InputError as error:
            raise ValueError(str(error)) from None

    def _file(self, number: int | None, name: str) -> Path:
        path = self.folder.of(self.acting if number is None else number) / name
        if not path.exists():
            raise ValueError(f"{path}: this version has none")
        return path


def heal(folder: Path | str = "healed") -> LoopVersions:
    """Versions of a loop that `hoopd heal` follows, or followed.

    Parameters
    ----------
    folder : str or Path
        As `hoopd heal --out`.

    Returns
    -------
    LoopVersions
        Its `versions`, which one is `acting`, `model` and `controller` of each; `accept` and `leave` what waits.

    Raises
    ------
    ValueError
        For a folder that holds no versions.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.heal("healed").acting  # doctest: +SKIP
    1
    """
    loop = LoopVersions(VersionFolder(Path(folder)))
    try:
        loop.folder.loop()
    except InputError as error:
        raise ValueError(str(error)) from None
    return loop
