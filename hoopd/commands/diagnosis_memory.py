"""The memory of a diagnosis: read before it, told to its plant, and written after it.

Rules of this file: files in, files out; what is believed and what contradicts it stands in `hoopd.diagnose.memory`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import msgspec

from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.diagnose.inputs import Source
from hoopd.diagnose.memory import (
    RememberedPrior,
    against_memory,
    believing,
    dated_later,
    remembered,
    remembered_prior,
    sizes_of,
    used_memory,
)
from hoopd.diagnose.record import Diagnosis
from hoopd.files.memory import Memory, RememberedDiagnosis, check_date, load_memory
from hoopd.files.model import ModelFile
from hoopd.files.whole_files import file_bytes
from hoopd.plants.effects.base import Effect
from hoopd.plants.model_file import HOOP
from hoopd.plants.plant_model import PlantModel
from hoopd.recording.mcap import read_run
from hoopd.recording.slices import file_of

MCAP = ".mcap"


@dataclass(frozen=True)
class DiagnosisMemory:
    """One memory and one diagnosis. `known`: of everything but its recordings; `counted`: what its prior was."""

    memory: Memory
    sha256: str
    recordings: tuple[str, ...]
    date: str
    known: RememberedPrior = RememberedPrior()
    counted: RememberedPrior = RememberedPrior()

    @property
    def again(self) -> int:
        """Entries whose recordings are given once more."""
        return len(self.memory.diagnoses) - len(self.memory.without(self.recordings).diagnoses)

    def asked(
        self, sources: Sequence[Source], base: PlantModel, effects: Sequence[Effect], rate: float
    ) -> DiagnosisMemory:
        """With what is known before these recordings, and without what they contradict by themselves."""
        sizes = {name: size for one in sources for s in one.stretches for name, size in sizes_of(s.plant).items()}
        known = remembered_prior(self.memory.without(self.recordings), sizes, self.date, rate)
        against = against_memory(sources, effects, base.values, known) if known.values else []
        return replace(self, known=known, counted=known.without(against))

    def told(self, *groups: Sequence[Source]) -> list[list[Source]]:
        """Groups of recordings, their plants told what counts."""
        every = [one for group in groups for one in group]
        changed = iter(believing(every, self.counted) if self.counted.values else every)
        return [list(islice(changed, len(group))) for group in groups]

    def use(self, diagnosis: Diagnosis) -> Diagnosis:
        """The diagnosis with what it owes to the memory."""
        used = used_memory(diagnosis, self.sha256, self.known, self.counted, self.again)
        notes = [*diagnosis.notes, *(f"Against what is remembered: {one}" for one in used.contradictions)]
        if later := dated_later(self.memory.without(self.recordings), self.date):
            notes.append(f"Of what is remembered {later}.")
        return msgspec.structs.replace(diagnosis, memory=used, notes=notes)

    def learned(self, diagnosis: Diagnosis) -> RememberedDiagnosis:
        """What is to be remembered of this diagnosis."""
        return remembered(diagnosis, self.recordings, self.date, self.counted)


def memory_of(options: DiagnoseOptions, texts: Sequence[str], base: PlantModel) -> DiagnosisMemory | None:
    """What `--memory` names, before the recordings are looked at; None without it. InputError."""
    check_date("--date", options.date)
    if options.memory is None:
        return None
    memory, sha256 = load_memory(options.memory, subject_of(base))
    files = [file_of(text) for text in texts]
    digests = tuple(dict.fromkeys(hashlib.sha256(file_bytes(file)).hexdigest() for file in files))
    return DiagnosisMemory(memory, sha256, digests, options.date or _date_of(files))


def subject_of(base: PlantModel) -> str:
    """Plant and structure: under which names the parameters are known."""
    return f"{HOOP} {base.file.structure}" if isinstance(base.file, ModelFile) else base.plant.name


def _date_of(files: Sequence[Path]) -> str:
    """The newest day that a recording tells; empty where none does (lock-step, other formats)."""
    clocks = [read_run(file, ()).zero_ns for file in files if file.suffix.lower() == MCAP]
    newest = max(clocks, default=0)
    return datetime.fromtimestamp(newest / 1e9, UTC).date().isoformat() if newest else ""
