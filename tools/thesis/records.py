"""The recordings that the figures are drawn from: the public ones of the real device, or the rig's in their place.

Rules of this file: nothing is fetched; a real recording is read where it lies, a rig recording is made anew, seeded.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from hoopd.daemon import experiment
from hoopd.daemon.app import Options
from hoopd.daemon.recording_target import Where
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.fitting.fit import FitSettings, FittedParameters, fit
from hoopd.plants.hoop.fitting.fit_percent import FitScore, score
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.recordings.recorded_runs import Subject
from hoopd.plants.hoop.thesis import ENTRIES_PRINTED
from hoopd.plants.model_file import load_model
from hoopd.recording import Recording, load
from hoopd.recording.edit import between

ROOT = Path(__file__).resolve().parents[2]
PUBLIC = "the public GitHub repository aa4cc/flying-ball-in-hoop, folder m/identification/exp01"
# The drive stopped while the torque was still written down.
STOPPED_S = 0.2
# Nothing moves and no torque acts before; the camera repeats its angle there, which says nothing of a start.
REST_S = 1.0
# What the repository found for the hoop alone; the entries of hoop and ball together are not those of one alone.
HOOP_ALONE = {"J11": -0.28, "L1": 658.8}
PRINTED = "thesis's entries"


class Source(NamedTuple):
    """A real recording, and the experiment on the rig that stands for it."""

    words: str
    rig_words: str
    file: str
    plan: Plan
    columns: str | None = None
    spans: tuple[tuple[float | None, float | None], ...] = ((None, None),)
    cut_s: float = 0.0
    note: str = ""  # on the real one
    printed: str = PRINTED
    values: Mapping[str, float] = ENTRIES_PRINTED


SOURCES: Mapping[str, Source] = {
    "first": Source(
        "hoop and ball, 20 s",
        "hoop and ball, 20 s",
        "meas_hoopAndBall2_01.mat",
        Plan("prbs", 20.0, seed=1),
        spans=((REST_S, None),),
        cut_s=STOPPED_S,
        note="In the first second, left out, nothing moves; in the last 0.2 s the drive had stopped.",
    ),
    "second": Source(
        "hoop and ball, 50 s",
        "hoop and ball, 50 s",
        "meas_hoop01_prbs.mat",
        Plan("prbs", 50.0, seed=2),
        cut_s=STOPPED_S,
        note="In the last 0.2 s, left out, the drive had stopped.",
    ),
    "ball": Source(
        "ball alone, two free decays",
        "kicks and free decays",
        "meas_ballOnly01.mat",
        Plan("decay", 34.0),
        spans=((2.0, 14.0), (17.0, 29.0)),
        note="The hoop was held; a hand moved the ball between the two.",
    ),
    "sine": Source(
        "hoop alone, sine of 0.5 Hz",
        "hoop alone, multisine",
        "meas_hoop01_f05_a01.mat",
        Plan("multisine", 20.0, ball=False),
        printed="repository's entries",
        values={**ENTRIES_PRINTED, **HOOP_ALONE},
    ),
    "chirp": Source(
        "hoop alone, chirp",
        "hoop alone, chirp",
        "meas_hoop02_chirp.mat",
        Plan("chirp", 20.0, ball=False),
        columns="u,theta,dtheta,current",
        printed="repository's entries",
        values={**ENTRIES_PRINTED, **HOOP_ALONE},
    ),
}


def shared_folder() -> Path:
    """Where the real recordings are expected."""
    return Path(os.environ.get("HOOPD_SHARED") or ROOT.parent / "shared") / "recordings"


def how_to_get(folder: Path, missing: list[str]) -> str:
    """What to do about recordings that are not here."""
    return (
        f"not in {folder}: {', '.join(missing)}. The real recordings are in {PUBLIC}. Put them into a folder "
        "SHARED/recordings, set HOOPD_SHARED=SHARED and run this again. Until then recordings of the rig take their "
        "place, and the fits say nothing about the device."
    )


@dataclass
class Bench:
    """Recordings, fits and plants that several figures share, each made once."""

    scratch: Path
    say: Callable[[str], None] = lambda text: None
    _parts: dict[str, tuple[Recording, ...]] = field(default_factory=dict)
    _fits: dict[str, FittedParameters] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """Files that the rig has to stand for."""
        return [source.file for source in SOURCES.values() if not (shared_folder() / source.file).is_file()]

    def words(self, key: str) -> str:
        """What an experiment is."""
        source = SOURCES[key]
        words = source.rig_words if source.file in self.missing else source.words
        return words[0].upper() + words[1:]

    def origin(self, key: str) -> str:
        """What a title says about where the data are from."""
        file = SOURCES[key].file
        return f"rig instead of {file}" if file in self.missing else file.removesuffix(".mat")

    def parts(self, key: str) -> tuple[Recording, ...]:
        """Stretches of an experiment."""
        if key not in self._parts:
            source = SOURCES[key]
            path = shared_folder() / source.file
            self._parts[key] = _real(path, source) if path.is_file() else (self._rig(key, source),)
        return self._parts[key]

    def whole(self, key: str) -> Recording:
        """An experiment with its beginning and end."""
        path = shared_folder() / SOURCES[key].file
        return load(path, SOURCES[key].columns) if path.is_file() else self.parts(key)[0]

    def note(self, key: str) -> str:
        """What a reader should know about a real recording."""
        return "" if SOURCES[key].file in self.missing else SOURCES[key].note

    def fitted(self, key: str) -> FittedParameters:
        """Entries estimated from an experiment."""
        if key not in self._fits:
            self.say(f"fitting {self.origin(key)}")
            self._fits[key] = fit(self.parts(key), thesis_values(), FitSettings(structure="entries"))
        return self._fits[key]

    def scores(self, key: str) -> dict[str, list[FitScore]]:
        """Free runs over an experiment by model: as printed, re-estimated."""
        source = SOURCES[key]
        values = {source.printed: {**thesis_values(), **source.values}, "re-estimated": self.fitted(key).values}
        return {
            name: [score(Subject("entries", own), part) for part in self.parts(key)] for name, own in values.items()
        }

    def _rig(self, key: str, source: Source) -> Recording:
        self.say(f"recording on the rig: {source.rig_words}")
        path = self.scratch / f"{key}.mcap"
        options = Options(sim=True, sets=("log.level=error",), seed=source.plan.seed, speed="max", direct=True)
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            experiment.run(source.plan, options, Where(file=path))
        found = load(path)
        played = found.t[found.extra["mode"] == "RUNNING"]
        return between(found, float(played[0]), float(played[-1]))


def _real(path: Path, source: Source) -> tuple[Recording, ...]:
    whole = load(path, source.columns)
    last = float(whole.t[-1]) - source.cut_s
    return tuple(between(whole, start, last if end is None else end) for start, end in source.spans)


def thesis_values() -> dict[str, float]:
    """Every parameter of the model with the thesis's entries."""
    return load_model(defaults_folder() / "models" / "thesis.yaml").values()


def thesis_plant() -> HoopPlant:
    """The plant with the thesis's entries."""
    return HoopPlant("entries", thesis_values())
