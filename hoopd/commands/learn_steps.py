"""The commands of a campaign: record, diagnose, design, compare.

Rules of this file: every step is an ordinary command in a process of its own, which ends with this one; what a step has
written stays, and a step whose file is there is not repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.commands.options.learn import LearnOptions
from hoopd.commands.step_commands import run_step
from hoopd.files.json_files import read_json
from hoopd.learn.campaign import Campaign, RunFiles
from hoopd.learn.choice import ChosenRun
from hoopd.shell.child import end_with_parent

Progress = Callable[[str], None]
QUIETLY = ("--camera", "direct", "--set", "log.level=error")
LAW = "lqg"
BY = "ball"  # what better means
# Of the limits, what the first run may use on the usual model: with parameters 10 % off angle and speed are up to a
# third larger than foreseen, near a resonance more.
UNKNOWN_USE = 0.6


@dataclass(frozen=True)
class Steps:
    """Runs the commands of a campaign."""

    campaign: Campaign
    options: LearnOptions
    progress: Progress

    def say(self, doing: str, asks: str = "") -> None:
        """What is done from now on, for a terminal and for whoever looks; `asks`: what a person has to do for it."""
        self.progress(doing)
        self.campaign.tell(doing=doing, asks=asks)

    def command(
        self, words: Sequence[str | Path], log: Path, accepted: Sequence[int] = (0,), *, seen: bool = False
    ) -> int:
        """Run `hoopd` with these words; StepError with its last line when it ends with another code.

        `seen`: an operator at the device has to see what it says while it runs.
        """
        return run_step(words, log, accepted, prefix=end_with_parent("TERM"), seen=seen)

    def place(self) -> list[str]:
        """Words that say where a run is played."""
        asked = self.options
        words = ["--sim", *QUIETLY] if asked.sim else []
        words += [] if asked.config is None else ["--config", str(asked.config)]
        return [*words, *(word for one in asked.sets for word in ("--set", one))]

    def record(self, files: RunFiles, choice: ChosenRun, number: int) -> None:
        """The recording, unless it is there; what a broken run has left is kept under another name."""
        if files.experiment.exists():
            return
        set_aside(files.recording, "broken")
        asks = "" if self.options.sim else "the operator: arm the device, the run begins then"
        self.say(f"run {number}: recording {' '.join(choice.played)}", asks)
        words: list[str | Path] = [
            "experiment",
            *choice.played,
            "--seed",
            str(self.options.seed + number),
            *self.place(),
        ]
        told = files.folder / ".experiment.json"
        words += self.foresight(number)
        words += ["--speed", "max"] if self.options.sim else []  # a comparison on the rig is fast by itself
        words += ["--out", str(files.recording), "--json", str(told)]
        self.command(words, files.folder / "experiment.log", (0, 1), seen=not self.options.sim)
        told.replace(files.experiment)

    def foresight(self, number: int) -> list[str]:
        """What foresees whether a run stays inside the limits: the last diagnosis's model; before there is one, the
        usual model with room for a device that is another."""
        model = self.campaign.run_files(number - 1).model
        return ["--model", str(model)] if number > 1 and model.exists() else ["--use", f"{UNKNOWN_USE:g}"]

    def diagnose(self, files: RunFiles, recordings: Sequence[Path | str], number: int) -> None:
        """The diagnosis of all recordings so far, unless it is there."""
        if files.diagnosis.exists():
            return
        self.say(f"run {number}: diagnosing {len(recordings)} recording{'s' if len(recordings) > 1 else ''}")
        words: list[str | Path] = ["diagnose", *recordings, "--yes", "--seed", str(self.options.seed)]
        words += [] if self.options.plant is None else ["--plant", self.options.plant]
        words += self.reading() if self.options.recordings else []
        words += [] if self.options.memory is None else ["--memory", self.options.memory]
        words += ["--jobs", str(self.options.jobs), "--report", files.report, "--write", files.model]
        self.command([*words, "--json", files.diagnosis], files.folder / "diagnosis.log")

    def reading(self) -> list[str]:
        """Words that say how the files of another laboratory are read."""
        asked = self.options
        words = [] if asked.columns is None else ["--columns", asked.columns]
        return [*words, "--age", asked.age, "--hold", asked.hold]

    def design(self, model: Path) -> None:
        """A controller on what was found, unless it is there."""
        if self.campaign.design.exists():
            return
        self.say("designing a controller on what was found")
        words: list[str | Path] = [
            "design",
            LAW,
            "--model",
            model,
            "--out",
            self.campaign.controller,
            "--json",
            self.campaign.design,
        ]
        self.command(words, self.campaign.folder / "design.log")

    def set_result_aside(self) -> None:
        """Keep what was designed and compared before a further run, whose result is another, under other names.

        The controller comes last: without its design it is designed anew.
        """
        campaign = self.campaign
        for path in (campaign.comparison, self.figure, campaign.design, campaign.controller):
            set_aside(path, f"earlier_{path.stem}")

    @property
    def figure(self) -> Path:
        """Of the alternating run."""
        return self.campaign.comparison.with_suffix(".png")

    def compare(self, accepted: str) -> dict[str, Any]:
        """Old against new in an alternating run, unless it is there."""
        path = self.campaign.comparison
        if not path.exists():
            self.say("trying the new controller against the old one")
            words: list[str | Path] = [
                "compare",
                accepted,
                self.campaign.controller,
                *self.place(),
                "--by",
                BY,
                "--seed",
                str(self.options.seed),
            ]
            words += ["--figure", self.figure, "--json", path]
            self.command(words, self.campaign.folder / "comparison.log", (0, 1))
        compared: dict[str, Any] = read_json(path, dict[str, Any])
        return compared


def set_aside(path: Path, name: str) -> None:
    """Keep a file under another name, with the first number that is free; nothing where it is not there."""
    if path.exists():
        number = 1
        while (other := path.with_name(f"{name}_{number}{path.suffix}")).exists():
            number += 1
        path.replace(other)
