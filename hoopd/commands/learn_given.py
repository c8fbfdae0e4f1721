"""What was recorded by hand, as a campaign counts it, and what is to be recorded next by hand.

Rules of this file: recordings and diagnoses in, words and numbers out; nothing is run and nothing written.
"""

from __future__ import annotations

import hashlib
import math
import shlex
from dataclasses import replace

from hoopd.commands.diagnose import judged_model
from hoopd.commands.inputs import read_recording
from hoopd.commands.options.learn import LearnOptions
from hoopd.commands.plant_inputs import plant_path
from hoopd.files.whole_files import file_bytes
from hoopd.learn.campaign import DiagnosedRun
from hoopd.learn.choice import MENU, ChosenRun
from hoopd.plants.declaration import Input, Plant
from hoopd.plants.model_file import HOOP
from hoopd.recording.formats import split_path
from hoopd.recording.recording import Recording
from hoopd.recording.slices import split_slice

# Kinds of signal that `hoopd experiment` knows, in the order of the campaign's own menu.
KINDS = tuple(dict.fromkeys(words[0] for words in MENU))


def given(options: LearnOptions) -> ChosenRun:
    """The recordings by what their files hold, and their plant: under the same name there may be another one."""
    own = plant_path(options.plant)
    digests = [_digest_of(text) for text in options.recordings]
    digests += [] if own is None else [hashlib.sha256(file_bytes(own)).hexdigest()]
    return ChosenRun(options.recordings, "was recorded by hand", sha256=tuple(digests))


def _digest_of(text: str) -> str:
    """Of the file, with the experiment in it and the seconds that were asked for."""
    path, span = split_slice(text)
    file, experiment = split_path(path)
    seconds = "" if span is None else "@" + ":".join("" if end is None else f"{end:g}" for end in span)
    part = "" if experiment is None else f":{experiment}"
    return f"{hashlib.sha256(file_bytes(file)).hexdigest()}{part}{seconds}"


def read_through(choice: ChosenRun, options: LearnOptions) -> tuple[ChosenRun, float]:
    """With what drove each of the recordings, and the seconds of all of them. InputError for what cannot be read."""
    plant = judged_model(options.plant, None).plant
    found = [
        read_recording(text, options.columns, options.age, plant=plant, hold=options.hold) for text in choice.words
    ]
    inputs = tuple(_digest_of_inputs(one) for one in found) if plant.inputs else ()
    return replace(choice, inputs=inputs), float(sum(one.t[-1] - one.t[0] for one in found))


def _digest_of_inputs(recording: Recording) -> str:
    """Of what drove it; an input that never moves is the same, however long it is recorded."""
    digest = hashlib.sha256()
    for name, signal in sorted(recording.inputs.items()):
        moves = bool((signal.values != signal.values[0]).any())
        digest.update(name.encode() + (signal.values if moves else signal.values[:1]).tobytes())
    return digest.hexdigest()


def next_by_hand(last: DiagnosedRun, plant: Plant, name: str | None) -> tuple[str, str]:
    """What is to be recorded next, empty where nothing is, and the reason. `name`: what the plant is called."""
    proposed = last.diagnosis.next_experiment
    if proposed is not None and proposed.expected_nats is not None:
        return proposed.command or proposed.signal, proposed.reason
    if last.belief.settled:
        return "", "Nothing more has to be recorded."
    if proposed is None:
        why = "No signal is computed: the diagnosis has no two laws that one would tell apart."
    else:
        why = f"{proposed.reason} {' or '.join(proposed.tells_apart)}: what would tell is {proposed.signal}."
    if not plant.inputs or (
        proposed is not None and proposed.apart_nats is None and last.belief.lacks_probability_alone
    ):
        return "", why
    return _another_kind(plant.inputs, name, last.choice.kinds), why


def _another_kind(inputs: tuple[Input, ...], name: str | None, kinds: int) -> str:
    """A signal of the menu, the next one for as many as there are."""
    kind, moved = KINDS[min(kinds, len(KINDS) - 1)], ", then of ".join(_within(one) for one in inputs)
    signal = f"another kind of signal than these, as {kind} of {moved} about where it works"
    command = f"hoopd experiment {kind}"
    if name in (None, HOOP):
        return f"{signal}: {command}"
    return f"{signal}; by simulation: {command} --plant {shlex.quote(str(name))} --out {kind}.mcap --at NAME=VALUE"


def _within(one: Input) -> str:
    """An input and what its drive gives."""
    if one.limit is None or not math.isfinite(one.limit):
        return f"{one.name} ({one.unit})"
    return f"{one.name} (within {one.limit:g} {one.unit})"
