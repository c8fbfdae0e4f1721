"""`hoopd fit`: recordings to a model file, with intervals, what is not determined, and the fit on data never fitted.

Rules of this file: files in, a result record, a model file and a figure out; the mathematics is in `hoopd.ident`.
Nothing is written before all is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.commands.fit_options import settings_of, start_model
from hoopd.commands.fit_plant import fit_other_plant
from hoopd.commands.fit_record import record
from hoopd.commands.inputs import read_ages, read_recording
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import other_model, refuse_shared
from hoopd.files.model import ModelFile, model_text
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.plants.hoop.fitting.fit import FitSettings, FittedParameters, fit, model_file, nominal_values
from hoopd.plants.hoop.fitting.fit_percent import score
from hoopd.plants.hoop.parameters import ParameterError
from hoopd.plants.hoop.recordings.recorded_runs import Subject
from hoopd.plants.model_file import load_model, parse_model
from hoopd.recording.recording import Recording

Progress = Callable[[str], None]

DIVERGED = "no finite result from this start; look at --model, --fix, --prior, or take --window 1"


def run(options: FitOptions, *, progress: Progress = lambda text: None) -> dict[str, Any]:
    """Fit, judge, write; the result as a record. InputError when anything cannot be used or written."""
    if (other := other_model(options.plant, options.model)) is not None:
        return fit_other_plant(other, options, progress)
    recordings, holdout, out, figure = options.recordings, options.holdout, options.out, options.figure
    check_results(out, figure)
    base = load_model(start_model(options))
    settings = settings_of(options, base)
    nominal = nominal_values(base, options.structure)
    train = [read_recording(text, options.columns, options.age, hold=options.hold) for text in recordings]
    held = [read_recording(text, options.columns, options.age, hold=options.hold) for text in holdout]
    refuse_shared([*zip(recordings, train, strict=True)], [*zip(holdout, held, strict=True)])
    found = fitted(train, nominal, settings, progress)
    named = dict(zip(recordings, train, strict=True)), dict(zip(holdout, held, strict=True))
    result = record(found, base, options, *named, progress)
    result |= {"age_s": read_ages(options.age)} if options.age else {}
    _write(found, base, train, out, figure)
    return {**result, **{key: str(path) for key, path in (("out", out), ("figure", figure)) if path is not None}}


def fitted(
    train: Sequence[Recording],
    nominal: Mapping[str, float],
    settings: FitSettings,
    progress: Progress = lambda text: None,
) -> FittedParameters:
    """The fit; InputError when the numbers leave the computer's range on the way."""
    try:
        found = fit(train, nominal, settings, progress)
    except InputError:
        raise
    except (np.linalg.LinAlgError, ArithmeticError, ParameterError) as error:
        raise InputError("fit", "", f"{DIVERGED} ({error})") from None
    if not np.isfinite([*found.values.values()]).all():
        raise InputError("fit", "", DIVERGED)
    return found


def _write(
    found: FittedParameters, base: ModelFile, train: Sequence[Recording], out: Path | None, figure: Path | None
) -> None:
    if out is not None:
        text = model_text(model_file(found, base, out.stem))
        parse_model(text, out)  # never a model that no command could load
        replace_file(out, text.encode())
    if figure is not None:
        from hoopd.plots.simulation import draw_simulation
        from hoopd.plots.style import save

        subject = Subject(found.structure, found.values, effects=found.settings.effects)
        whole = score(subject, train[0], encoder_counts=found.settings.encoder_counts)
        save(draw_simulation(whole, train[0], out.stem if out else found.structure), figure)
