"""`hoopd diagnose`: recordings to a diagnosis, a report and a model with the effects that were found.

Rules of this file: files in, files out; the mathematics is in `hoopd.diagnose`. Nothing is written before all is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from hoopd.commands.diagnose_inputs import check_distinct, check_lengths, check_motion, expanded, plants
from hoopd.commands.diagnosed_model import doubts, found_model, left_out
from hoopd.commands.diagnosis_memory import DiagnosisMemory, memory_of, subject_of
from hoopd.commands.inputs import read_recording
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.output_files import check_targets
from hoopd.commands.plant_inputs import refuse_shared
from hoopd.diagnose.case import Case, last_third
from hoopd.diagnose.inputs import Source, source_of
from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import to_json_bytes
from hoopd.diagnose.report.plain_words import summary
from hoopd.diagnose.run import Outcome, diagnose
from hoopd.diagnose.search.candidates import Settings
from hoopd.files.memory import add_to_memory
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.files.whole_files import replace_file
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.effects_file import load_effects
from hoopd.plants.model_file import HOOP
from hoopd.plants.plant_model import PlantModel, load_plant_model, nominal_model, plant_model_text
from hoopd.plants.recorded_sizes import with_recorded_sizes

Progress = Callable[[str], None]
# Whether a model of which this is to be said shall be written.
MayWrite = Callable[[Sequence[str]], bool]

DEFAULT_MODEL = Path("models/thesis.yaml")


def run(
    options: DiagnoseOptions, *, progress: Progress = lambda text: None, may_write: MayWrite = lambda said: False
) -> Diagnosis:
    """Diagnose and write; InputError when anything cannot be used or written. `may_write` is asked about a model of
    which there are doubts, and where it says no everything else is written."""
    texts, held_texts = expanded(options.recordings), expanded(options.holdout)
    inputs: list[Path | str] = [*texts, *held_texts]
    inputs += [one for one in (options.model, options.effects) if one is not None]
    base = judged_model(options.plant, options.model)
    check_targets(
        inputs,
        {"--json": options.json_path, "--report": options.report, "--write": options.write, "--memory": options.memory},
    )
    if options.report is not None and options.report.suffix.lower() not in (".html", ".htm"):
        raise InputError(options.report, "--report", "is a page: its name ends with .html")
    memory = memory_of(options, texts, base)
    outcome = outcome_of(texts, held_texts, base, options, memory=memory, progress=progress)
    said = doubts(outcome) if options.write is not None else []
    write = options.write if not said or options.yes or may_write(said) else None
    progress("drawing and writing")
    return _written(outcome, base, replace(options, write=write), said)


def refusal(write: Path, said: Sequence[str]) -> InputError:
    """Why a model is not written where no one can be asked."""
    return InputError(write, "", f"is not written without --yes: {'; '.join(said)}")


def judged_model(plant: str | None, model: Path | None) -> PlantModel:
    """The model of a file, of `plant` where it is told; without a file its nominal values (the thesis's)."""
    if model is not None:
        return load_plant_model(or_shipped(model), plant)
    return load_plant_model(or_shipped(DEFAULT_MODEL)) if plant in (None, HOOP) else nominal_model(str(plant))


def outcome_of(
    texts: Sequence[str],
    held_texts: Sequence[str],
    base: PlantModel,
    options: DiagnoseOptions | None = None,
    *,
    memory: DiagnosisMemory | None = None,
    progress: Progress = lambda text: None,
) -> Outcome:
    """The diagnosis with the curves and fits behind it; nothing is written, and of `options` only what is searched
    for counts."""
    options = options or DiagnoseOptions(recordings=tuple(texts))
    check_distinct(texts, held_texts)
    progress("reading the recordings")
    every = {
        text: read_recording(text, options.columns, options.age, plant=base.plant, hold=options.hold)
        for text in (*texts, *held_texts)
    }
    base = replace(base, plant=with_recorded_sizes(base.plant, [every[text] for text in texts]))
    train, held = ([source_of(text, every[text], base.plant) for text in part] for part in (texts, held_texts))
    return searched(train, held, base, options, memory=memory, progress=progress)


def searched(
    train: Sequence[Source],
    held: Sequence[Source],
    base: PlantModel,
    options: DiagnoseOptions,
    *,
    memory: DiagnosisMemory | None = None,
    progress: Progress = lambda text: None,
) -> Outcome:
    """The same from recordings that were read, whatever the options call them."""
    refuse_shared([(one.name, one.recording) for one in train], [(one.name, one.recording) for one in held])
    check_motion(train, held, base.file.structure if isinstance(base.file, ModelFile) else "")
    without = [name for text in options.without for name in text.split(",")]
    whole = [] if held else [*train]
    train, held, how = _parts(train, held, base.plant)
    known = _library([*train, *held], options.effects, without, [entry.name for entry in base.effects])
    named = [known[entry.name] for entry in base.effects if entry.name in known]
    own = [effect.holding(base.values) for effect in named if effect.is_simulated]
    if memory is not None:
        progress("what is remembered")
        memory = memory.asked(train, base, own, options.forgetting)
        train, held, whole = memory.told(train, held, whole)
    outcome = diagnose(
        Case(
            model=base.name,
            values=base.values,
            train=train,
            heldout=held,
            library=known,
            effects=own,
            free_run=options.free_run,
            choose_free_run=options.free_run_choice,
            whole=whole,
            seed=options.seed,
            held_out_how=how,
            progress=progress,
            settings=Settings(progress=progress, grammar=options.grammar),
            without=without,
            jobs=options.jobs,
            odds={} if memory is None else memory.counted.odds,
        )
    )
    return outcome if memory is None else _remembering(outcome, memory)


def _remembering(outcome: Outcome, memory: DiagnosisMemory) -> Outcome:
    """The diagnosis with what it owes to its memory, and what is to be added to that."""
    return replace(outcome, diagnosis=memory.use(outcome.diagnosis), memory=memory.learned(outcome.diagnosis))


def _parts(train: Sequence[Source], held: Sequence[Source], plant: Plant) -> tuple[list[Source], list[Source], str]:
    """What is fitted, what is held out, and how: the last third where nothing else is."""
    how = ", ".join(one.name for one in held)
    own = not held
    if own:
        train, held = last_third(train)
        how = "the last third of every recording"
    train, held = [one for one in train if one.stretches], [one for one in held if one.stretches]
    check_lengths(train, held, plant, given=not own)
    return train, held, how


def _library(
    sources: Sequence[Source], effects: Path | None, without: Sequence[str], named: Sequence[str]
) -> dict[str, Effect]:
    """Effects of all that moves in any recording, by name, and the mechanisms that a model has `named`; a user's file
    may add some and replace none."""
    known: dict[str, Effect] = {}
    grammar: set[str] = set()
    for plant in plants(sources):
        extra = () if effects is None else load_effects(effects, plant)
        try:
            known |= library(plant, extra)
        except ValueError as error:
            raise InputError(effects, "", str(error)) from None
        known |= {name: effect for name, effect in known_effects(plant, named).items() if name not in known}
        grammar |= {*mechanisms(plant)} if without else set()
    for name in without:
        if name not in known and name not in grammar:
            raise InputError("--without", name, f"is none of {', '.join(sorted(known))}")
    return {name: effect for name, effect in known.items() if name not in without}


def _written(outcome: Outcome, base: PlantModel, options: DiagnoseOptions, said: Sequence[str]) -> Diagnosis:
    """The diagnosis; every file is made before the first one is written. `said`: of the model.

    The memory comes first and the JSON last: who finds the JSON takes all of it for done, and who makes the same
    diagnosis again adds nothing, because its recordings count once.
    """
    diagnosis, files = outcome.diagnosis, list[tuple[Path, bytes]]()
    if options.write is not None:
        notes = [outcome.written.note] if outcome.written.note else []
        diagnosis = msgspec.structs.replace(diagnosis, notes=[*diagnosis.notes, *left_out(outcome), *notes, *said])
        files.append((options.write, _model_text(outcome, base, options.write).encode()))
    if options.report is not None:
        from hoopd.diagnose.report.page import page

        files.append((options.report, page(diagnosis, outcome.shown)))
    if options.json_path is not None:
        told = msgspec.structs.replace(diagnosis, summary=summary(diagnosis))
        files.append((options.json_path, to_json_bytes(told)))
    if options.memory is not None and outcome.memory is not None:
        add_to_memory(options.memory, subject_of(base), outcome.memory)
    for path, data in files:
        replace_file(path, data)
    return diagnosis


def write_model(outcome: Outcome, base: PlantModel, path: Path, *, yes: bool = False) -> Path:
    """Write the judged model with what was found; InputError where there are doubts of it and no `yes`."""
    said = doubts(outcome)
    if said and not yes:
        raise InputError(path, "", f"is not written without yes=True: {'; '.join(said)}")
    replace_file(path, _model_text(outcome, base, path).encode())
    return path


def _model_text(outcome: Outcome, base: PlantModel, path: Path) -> str:
    return plant_model_text(replace(base, file=found_model(outcome, base.file, path.stem)), path)
