"""What `hoopd diagnose` is given: recordings and folders of them as text, checked sources of the search.

Rules of this file: from text to checked objects; everything unusable is one `InputError`; a recording is called by the
text that names it.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hoopd.diagnose.inputs import Source
from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.stretches import fewest_readings
from hoopd.recording.formats import EXTENSIONS, HDF5, split_path
from hoopd.recording.slices import split_slice

# What a plant says to be enough to fit, and to prove with, is told for its usual sampling: where it is faster, so many
# samples are.
TRAIN_STEPS, HELD_STEPS = 200, 100

# Characters of an impossible name that a message repeats.
LONGEST_TOLD = 200


class Given(NamedTuple):
    """Where a recording's text points: file, experiment and seconds."""

    file: Path
    experiment: str | None
    start_s: float
    end_s: float

    def overlaps(self, other: Given) -> bool:
        """Whether both hold some of the same samples."""
        same = self.file == other.file and (self.experiment == other.experiment or None in (self[1], other[1]))
        return same and self.start_s < other.end_s and other.start_s < self.end_s


def expanded(texts: Sequence[str]) -> list[str]:
    """Every folder replaced by the recordings in it, by name; InputError for a folder without one."""
    return [one for text in texts for one in _of_text(text)]


def _of_text(text: str) -> list[str]:
    try:
        return _in_folder(Path(text)) if Path(text).is_dir() else [text]
    except (OSError, RuntimeError) as error:  # a name too long, a folder that may not be read, links in a circle
        raise InputError(text[:LONGEST_TOLD], "", f"cannot be read: {error}"[:LONGEST_TOLD]) from None


def _in_folder(folder: Path) -> list[str]:
    """Recordings of a folder; of an .h5 file every experiment."""
    files = sorted(one for one in folder.iterdir() if one.is_file() and one.suffix.lower() in EXTENSIONS)
    if not files:
        raise InputError(folder, "", f"no recording in this folder ({', '.join(EXTENSIONS)})")
    return [text for file in files for text in _experiments(file)]


def _experiments(file: Path) -> Iterator[str]:
    if file.suffix.lower() not in HDF5:
        yield str(file)
        return
    from hoopd.recording import hdf5

    yield from (f"{file}:{name}" for name in hdf5.experiments(file))


def check_distinct(train: Sequence[str], held: Sequence[str]) -> None:
    """InputError when samples are given twice: they would count twice, or prove a model that was fitted to them."""
    given = [(text, _given(text)) for text in (*train, *held)]
    for index, (text, one) in enumerate(given):
        for other, before in given[:index]:
            if not one.overlaps(before):
                continue
            if index >= len(train) and given.index((other, before)) < len(train):
                raise InputError(text, "--holdout", f"is fitted, too, as {other}: it proves nothing")
            raise InputError(text, "", "is given twice" if text == other else f"holds some of the same data as {other}")


def _given(text: str) -> Given:
    path, span = split_slice(text)
    file, experiment = split_path(path)
    start, end = (None, None) if span is None else span
    try:
        file = Path(os.path.realpath(file))
        if file.is_symlink():  # still: it leads to itself
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    except OSError as error:
        raise InputError(text[:LONGEST_TOLD], "", f"cannot be read: {error}"[:LONGEST_TOLD]) from None
    return Given(file, experiment, -np.inf if start is None else start, np.inf if end is None else end)


# ---------------------------------------------------------------------------------------------- sources


def check_lengths(train: Sequence[Source], held: Sequence[Source], plant: Plant, *, given: bool) -> None:
    """InputError when there is too little to fit or to prove with; `given`: what is held out was given."""
    fitted, proves = (sum(one.seconds for one in part) for part in (train, held))
    least_train, least_held = _least_s(plant)
    if given:
        for sources, seconds, least in ((train, fitted, least_train), (held, proves, least_held)):
            if seconds < least:
                name = sources[0].name if sources else "--holdout"
                raise InputError(name, "", f"too short: {seconds:.3g} s of usable samples, {least:.3g} s are needed")
    elif fitted < least_train or proves < least_held:
        name, total = (train or held)[0].name if train or held else "recordings", fitted + proves
        least = least_train + least_held
        reason = f"too short to hold a third out: {total:.3g} s of usable samples, {least:.3g} s are needed"
        raise InputError(name, "", reason)


def _least_s(plant: Plant) -> tuple[float, float]:
    """Seconds that are enough to fit, and to prove with; of a plant that does not say it, as many readings are."""
    sample_s, readings = plant.time_scale_s, fewest_readings(plant)
    if plant.judges.least_s is None:
        return readings * sample_s, readings // 2 * sample_s
    train, held = plant.judges.least_s
    return min(train, TRAIN_STEPS * sample_s), min(held, HELD_STEPS * sample_s)


def check_motion(train: Sequence[Source], held: Sequence[Source], structure: str = "") -> None:
    """InputError when recordings say nothing about one another: something moves in one of them only.

    Under the hoop's `entries` all must be of one kind: the entries of a bare hoop are other numbers.
    """
    fitted = {q for source in train for q in _moving(source)}
    for source in (*train, *held):
        own = _moving(source)
        if structure == "entries" and own != _moving(train[0]):
            reason = f"here {_words(own, source)} moved, in {train[0].name} {_words(_moving(train[0]), source)}"
            raise InputError(source.name, "", f"{reason}: entries differ; a physical structure takes both (--model)")
        if new := own - fitted:
            raise InputError(
                source.name, "--holdout", f"here {_words(new, source)} moved, and in nothing that is fitted"
            )


def _moving(source: Source) -> set[str]:
    return {q for stretch in source.stretches for q in stretch.plant.coordinates}


def _words(coordinates: set[str], source: Source) -> str:
    names = source.quality.plant.judges.words
    return " and ".join(names.get(q, q) for q in sorted(coordinates, reverse=True))


def plants(sources: Sequence[Source]) -> list[Plant]:
    """One of each kind; that in which most moves comes last."""
    every = {one.plant.coordinates: one.plant for source in sources for one in source.stretches}
    return sorted(every.values(), key=lambda plant: len(plant.slots))
