"""The folder of a campaign: what was asked, and of each run the files of the ordinary commands.

    learn.json                what was asked for
    run_01/choice.json        what is recorded and why
    run_01/recording.mcap     of `hoopd experiment`, with experiment.json; early_1.mcap and .json what ended at once
    run_01/given_up_1.json    the choice before, which a limit has ended at once however small it was
    run_01/diagnosis.json     of `hoopd diagnose` on all recordings so far, with report.html and model.yaml
    controller.yaml           of `hoopd design`, with design.json
    comparison.json           of `hoopd compare`, with comparison.png
    progress.json, story.html what is done now and believed so far
    result.json               what became of it

A step is done when its last file is there, and every file appears whole: whoever is killed goes on where it was.

Rules of this file: names and contents of files; nothing is run.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import parse
from hoopd.files.campaign_progress import read_progress, write_progress
from hoopd.files.json_files import read_json, write_json
from hoopd.files.reading import InputError
from hoopd.files.whole_files import begin_folder, file_bytes
from hoopd.learn.belief import Belief, belief_of
from hoopd.learn.choice import ChosenRun, first_but, next_choice

SCHEMA = "hoopd.learn/1"


class CampaignRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What a campaign was asked for; who goes on with it asks for the same."""

    schema: str = SCHEMA
    budget_s: float
    confidence: float
    seed: int
    sim: bool
    config: str | None
    sets: tuple[str, ...]
    plant: str | None = None
    columns: str | None = None
    age: str = ""
    hold: str = "zero"


def _words(value: Any) -> str:
    """What was asked, as it is given."""
    if value in (None, "", ()):
        return "none"
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)


class RecordedTry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What `hoopd experiment` says of a run, as far as a campaign asks."""

    ended_at_s: float | None
    outcome: str = ""
    limit_passed: bool = False
    amplitude_nm: float | None = None


@dataclass(frozen=True)
class RunFiles:
    """Files of one recording and of what was thought after it."""

    folder: Path

    @property
    def choice(self) -> Path:
        """What is recorded and why."""
        return self.folder / "choice.json"

    @property
    def recording(self) -> Path:
        """Of `hoopd experiment`."""
        return self.folder / "recording.mcap"

    @property
    def experiment(self) -> Path:
        """What `hoopd experiment` said."""
        return self.folder / "experiment.json"

    @property
    def early(self) -> list[Path]:
        """What `hoopd experiment` said of tries that ended before anything was learned."""
        return sorted(self.folder.glob("early_*.json"))

    @property
    def diagnosis(self) -> Path:
        """Of all recordings so far."""
        return self.folder / "diagnosis.json"

    @property
    def report(self) -> Path:
        """Its page."""
        return self.folder / "report.html"

    @property
    def model(self) -> Path:
        """The model with what was found."""
        return self.folder / "model.yaml"


@dataclass(frozen=True)
class DiagnosedRun:
    """A run that was recorded and diagnosed."""

    files: RunFiles
    choice: ChosenRun
    seconds: float
    diagnosis: Diagnosis
    belief: Belief
    recordings: frozenset[str]  # that were diagnosed


class Campaign:
    """A folder and what is in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, asked: CampaignRequest) -> None:
        """Make the folder, or go on with one that was asked the same; InputError where it was not."""
        path = self.folder / "learn.json"
        if path.exists():
            self._check_same(asked, path)
            return
        begin_folder(self.folder, "--out", "campaign")
        write_json(path, asked)

    def _check_same(self, asked: CampaignRequest, path: Path) -> None:
        before = read_json(path, CampaignRequest)
        for name in CampaignRequest.__struct_fields__:
            was, now = getattr(before, name), getattr(asked, name)
            if was != now and name != "budget_s":
                raise InputError(path, name, f"was begun with {_words(was)}, not with {_words(now)}: another --out")
        if asked.budget_s != before.budget_s:  # more, or less, may be recorded than was thought
            write_json(path, asked)

    def run_files(self, number: int) -> RunFiles:
        """Of the run with this number, from 1."""
        return RunFiles(self.folder / f"run_{number:02d}")

    def runs(self, confidence: float) -> list[DiagnosedRun]:
        """Every run that has been diagnosed, in their order."""
        found: list[DiagnosedRun] = []
        while (files := self.run_files(len(found) + 1)).diagnosis.exists():
            choice = read_json(files.choice, ChosenRun)
            diagnosis = parse(file_bytes(files.diagnosis), files.diagnosis)
            by_hand = not files.recording.exists()
            kinds = choice.kinds if by_hand else len({one.choice.words for one in found} | {choice.words})
            recordings = choice.recordings if by_hand else self._recorded(len(found) + 1)
            fewer = [one for one in found if one.recordings < recordings]
            before = [one.diagnosis for one in fewer if one.choice.plant_sha256 == choice.plant_sha256]
            belief = belief_of(diagnosis, confidence, kinds, before)
            found.append(DiagnosedRun(files, choice, recorded_s(files), diagnosis, belief, recordings))
        return found

    def _recorded(self, number: int) -> frozenset[str]:
        """Every recording so far."""
        return frozenset(self.run_files(k).folder.name for k in range(1, number + 1))

    def choose(self, runs: list[DiagnosedRun]) -> ChosenRun | None:
        """What is recorded next: what was chosen before it was broken off, or what the last diagnosis asks for."""
        files = self.run_files(len(runs) + 1)
        if files.choice.exists():
            chosen: ChosenRun = read_json(files.choice, ChosenRun)
            return chosen
        played = [one.choice.words for one in runs]
        shown_by = {name: one.choice.words for one in reversed(runs) for name in one.belief.laws}
        given_up = self._given_up()
        last = runs[-1] if runs else None
        choice = (
            first_but(given_up)
            if last is None
            else next_choice(last.diagnosis, last.belief, played, shown_by, given_up)
        )
        if choice is not None:
            self.decide(files, choice)
        return choice

    def _given_up(self) -> list[tuple[str, ...]]:
        """Words of signals that a limit ends however small they are."""
        found: list[ChosenRun] = [
            read_json(one, ChosenRun) for one in sorted(self.folder.glob("run_*/given_up_*.json"))
        ]
        return [one.words for one in found]

    def decide(self, files: RunFiles, choice: ChosenRun) -> None:
        """Write down what is recorded and why."""
        files.folder.mkdir(exist_ok=True)
        write_json(files.choice, choice)

    def keep(self, files: RunFiles, choice: ChosenRun, seconds: float) -> None:
        """A run that somebody else has recorded: what it is, and how long."""
        self.decide(files, choice)
        write_json(files.experiment, RecordedTry(ended_at_s=seconds))

    def tell(self, **changed: Any) -> None:
        """What is done now, for whoever looks; what is not given stays as it was told."""
        write_progress(self.folder, msgspec.structs.replace(read_progress(self.folder), **changed))

    @property
    def controller(self) -> Path:
        """The controller that is designed on what was found."""
        return self.folder / "controller.yaml"

    @property
    def design(self) -> Path:
        """What `hoopd design` said."""
        return self.folder / "design.json"

    @property
    def comparison(self) -> Path:
        """What `hoopd compare` said."""
        return self.folder / "comparison.json"

    @property
    def result(self) -> Path:
        """What became of it."""
        return self.folder / "result.json"

    @property
    def story(self) -> Path:
        """The page."""
        return self.folder / "story.html"


def recorded_s(files: RunFiles) -> float:
    """Seconds that a run took, with those of its tries that ended too early, from their experiments' own words."""
    return sum(lasted_s(path) for path in (files.experiment, *files.early))


def lasted_s(experiment: Path) -> float:
    """Seconds of one try."""
    return recorded_try(experiment).ended_at_s or 0.0


def recorded_try(experiment: Path) -> RecordedTry:
    """One try in the experiment's own words; InputError where somebody spoiled the file."""
    told: RecordedTry = read_json(experiment, RecordedTry)
    return told
