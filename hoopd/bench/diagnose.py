"""`hoopd diagnose`: recordings to a diagnosis, a report and a model with the effects that were found.

Rules of this file: files in, files out; the mathematics is in `hoopd.diagnose`. Nothing is written before all is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from hoopd.bench.inputs import read_recording
from hoopd.diagnose.inputs import Source, hoop_source
from hoopd.diagnose.naming import Settings
from hoopd.diagnose.record import Diagnosis, to_json_bytes
from hoopd.diagnose.report import write_html
from hoopd.diagnose.run import Case, Outcome, diagnose, last_third
from hoopd.files import InputError
from hoopd.modelfiles import EffectEntry, ModelFile, Parameter, load_model, model_text
from hoopd.physics.declared import DeclaredPlant
from hoopd.physics.effects.catalogue import library
from hoopd.recording.bytesof import check_target, replace_file
from hoopd.shipped import or_shipped

Progress = Callable[[str], None]

DEFAULT_MODEL = Path("models/thesis.yaml")


def run(
    recordings: Sequence[str],
    holdout: Sequence[str] = (),
    *,
    model: Path | None = None,
    json_path: Path | None = None,
    report: Path | None = None,
    write: Path | None = None,
    columns: str | None = None,
    age: str = "",
    seed: int = 0,
    progress: Progress = lambda text: None,
) -> Diagnosis:
    """Diagnose and write; InputError when anything cannot be used or written."""
    for path, option in ((json_path, "--json"), (report, "--report"), (write, "--write")):
        if path is not None:
            check_target(path, option)
    base = load_model(or_shipped(model or DEFAULT_MODEL))
    progress("reading")
    train = [_source(text, base, columns, age) for text in recordings]
    held = [_source(text, base, columns, age) for text in holdout]
    how = ", ".join(one.name for one in held)
    if not held:
        train, held = last_third(train)
        how = "the last third of every recording"
        if not all(one.stretches for one in (*train, *held)):
            raise InputError(train[0].name, "", "too short to hold its last third out: give --holdout")
    plant = _richest([*train, *held])
    case = Case(base.name, base.values(), train, held, library(plant), seed, how, progress, Settings(progress=progress))
    outcome = diagnose(case)
    _write(outcome, base, json_path, report, write)
    return outcome.diagnosis


def _source(text: str, base: ModelFile, columns: str | None, age: str) -> Source:
    device = base.device
    return hoop_source(
        text,
        read_recording(text, columns, age),
        base.structure,
        base.values(),
        encoder_counts=device.encoder_counts,
        torque_limit=device.torque_limit_nm,
    )


def _richest(sources: Sequence[Source]) -> DeclaredPlant:
    """The plant in which most moves: its library holds the others'."""
    plants = [stretch.plant for source in sources for stretch in source.stretches]
    return max(plants, key=lambda plant: len(plant.slots))


def _write(outcome: Outcome, base: ModelFile, json_path: Path | None, report: Path | None, write: Path | None) -> None:
    if write is not None:
        replace_file(write, model_text(found_model(outcome, base, write.stem)).encode())
    if report is not None:
        write_html(outcome.diagnosis, outcome.shown, report)
    if json_path is not None:
        replace_file(json_path, to_json_bytes(outcome.diagnosis))


def found_model(outcome: Outcome, base: ModelFile, name: str) -> ModelFile:
    """The base with re-estimated parameters and the effects that were named."""
    diagnosis = outcome.diagnosis
    parameters = {key: _parameter(one) for key, one in diagnosis.base.parameters.items()}
    effects = [
        EffectEntry(name=one.name, parameters={k: _parameter(v) for k, v in one.parameters.items() if "@" not in k})
        for one in diagnosis.effects
        if not one.name.startswith("unknown.")
    ]
    return msgspec.structs.replace(base, name=name, parameters={**base.parameters, **parameters}, effects=effects)


def _parameter(one: object) -> Parameter:
    value, low_high = one.value, one.ci95  # type: ignore[attr-defined]
    interval = None if low_high is None or None in low_high else tuple(low_high)
    return Parameter(value=value, unit=one.unit, ci95=interval, nominal=one.nominal)  # type: ignore[attr-defined]
