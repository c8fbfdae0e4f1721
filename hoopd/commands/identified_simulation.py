"""`hoopd simulate` of an identified model: what it says of a recording, compared with what was measured.

Rules of this file: files in, a result record, a recording and a figure out; nothing is written before all is computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.commands.identify_columns import ColumnChoice, read_columns, without
from hoopd.commands.identify_data import INPUT, read
from hoopd.commands.identify_figures import HOOP_UNITS
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number
from hoopd.files.identified import IdentifiedFile, load_identified
from hoopd.files.reading import InputError
from hoopd.ident.data import Data
from hoopd.ident.measures import fit_percent, rms
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict
from hoopd.recording import save
from hoopd.recording.formats import extension_of
from hoopd.recording.recording import Recording, Signal, from_signals

HORIZONS = {"1": 1.0, "10": 10.0, "simulation": math.inf}
# Options of `hoopd simulate` that such a model has no use for.
OTHERS = {"plant": "--plant", "x0": "--x0", "age": "--age"}


def model_of(file: IdentifiedFile) -> Innovations:
    """The innovation form of a file."""
    parts = file.matrices()
    return Innovations(
        parts["a"], parts["b"], parts["c"], parts["d"], parts["k"], file.sample_time_s, r=parts["r"],
        inputs=tuple(file.inputs), outputs=tuple(file.outputs),
    )  # fmt: skip


def simulate_identified(path: Path, options: SimulateOptions) -> dict[str, Any]:
    """Simulate, predict, compare, write; the result as a record. InputError when anything cannot be used or written."""
    for name, option in OTHERS.items():
        if getattr(options, name):
            raise InputError(option, "", "is of plants and their models, this one was identified")
    if options.out is not None:
        extension_of(options.out)  # said before the work, not after it
    check_results(options.out, options.figure)
    file = load_identified(path)
    model = model_of(file)
    each, notes = _data(file, options)
    around = [without(one, file.operating_point) for one in each]
    _check(model, around, options.recording)
    said = [predict(model, one, math.inf) for one in around]
    if options.out is not None:
        longest = int(np.argmax([one.n for one in each]))
        save(_recording(each[longest], _lifted(said[longest], file), file), options.out)
    if options.figure is not None:
        _draw(model, around, file, options.figure)
    paths = {"out": options.out, "figure": options.figure}
    return {
        "model": file.name,
        "method": file.method,
        "recording": options.recording,
        "rows": sum(one.n for one in each),
        "stretches": len(each),
        "start_from": "estimated",
        "fit_percent": _percents(model, around),
        "rms_error": dict(zip(file.outputs, map(number, _errors(around, said)), strict=True)),
        "notes": [*notes, *_doubts(model)],
        **{key: str(one) for key, one in paths.items() if one is not None},
    }


def _data(file: IdentifiedFile, options: SimulateOptions) -> tuple[list[Data], list[str]]:
    """The recording as the model takes it: the hoop's by tick, other ones by their columns."""
    if not file.columns and file.inputs == [INPUT]:
        asked = IdentifyOptions(recordings=(options.recording,), outputs=tuple(file.outputs), columns=options.columns)
        return read((options.recording,), asked, None)
    if options.columns:
        raise InputError("--columns", "", "the model's file says the columns: " + ", ".join(file.columns.values()))
    asked_columns = {name: (file.columns.get(name, name), "") for name in (*file.inputs, *file.outputs)}
    choice = ColumnChoice(
        {name: asked_columns[name] for name in file.inputs}, {name: asked_columns[name] for name in file.outputs},
        file.columns.get("t", ""), file.sample_time_s,
    )  # fmt: skip
    each, _, notes = read_columns((options.recording,), choice, options.hold)
    return each, notes


def _check(model: Innovations, each: Sequence[Data], name: str) -> None:
    if abs(each[0].dt / model.dt - 1.0) > 1e-6:
        raise InputError(name, "t", f"rows are {each[0].dt:g} s apart, the model's {model.dt:g} s")


def _lifted(said: Any, file: IdentifiedFile) -> Any:
    return said + np.array([file.operating_point.get(name, 0.0) for name in file.outputs])


def _percents(model: Innovations, each: Sequence[Data]) -> dict[str, dict[str, float | None]]:
    y, found = np.concatenate([one.y for one in each]), {}
    for name, horizon in HORIZONS.items():
        with np.errstate(all="ignore"):
            said = np.concatenate([predict(model, one, horizon) for one in each])
            fits = fit_percent(y, said)
        found[name] = {output: number(float(one)) for output, one in zip(model.outputs, fits, strict=True)}
    return found


def _errors(each: Sequence[Data], said: Sequence[Any]) -> list[float]:
    with np.errstate(all="ignore"):
        return [float(one) for one in rms(np.concatenate([one.y - of for one, of in zip(each, said, strict=True)]))]


def _doubts(model: Innovations) -> list[str]:
    largest = float(np.abs(np.linalg.eigvals(model.a)).max(initial=0.0))
    return [f"the model is unstable (|z| = {largest:.4g}): its simulation grows without bound"] if largest > 1.0 else []


def _recording(data: Data, said: Any, file: IdentifiedFile) -> Recording:
    inputs = {name: Signal(data.u[:, i], data.t, file.units.get(name, "")) for i, name in enumerate(file.inputs)}
    outputs = {name: Signal(said[:, i], data.t, file.units.get(name, "")) for i, name in enumerate(file.outputs)}
    return from_signals(data.t, inputs, outputs, source=file.name)


def _draw(model: Innovations, each: Sequence[Data], file: IdentifiedFile, figure: Path) -> None:
    from hoopd.plots.identification import draw_said
    from hoopd.plots.style import save as save_figure

    units = file.units if file.columns else HOOP_UNITS
    shown = max(each, key=lambda one: one.n)
    with np.errstate(all="ignore"):
        said = {file.name: [predict(model, shown, math.inf)]}
    save_figure(draw_said([shown], said, "simulated", file.name, units, file.operating_point), figure)
