"""`hoopd fit --plant`: recordings of any declared plant to its parameters, with intervals and percent of fit.

Rules of this file: files in, a result record, a plant or model file and a figure out. Nothing is written before all
is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

from hoopd.commands.fit_options import fixed_values, priors_of
from hoopd.commands.inputs import read_recording
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number, plant_path, refuse_shared, system_of
from hoopd.files.plant_text import with_values
from hoopd.files.reading import InputError, read_text
from hoopd.files.whole_files import replace_file
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_fit import ChannelFit, PlantFit, channel_fits, fit_plant, fit_starts
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.fits.undetermined import direction_sentence
from hoopd.plants.likelihood.stretches import read_too_rarely
from hoopd.plants.plant_file import parse_plant
from hoopd.plants.plant_model import PROGRAM, PlantModel, plant_model_text, with_parameters
from hoopd.plants.recording_doubts import plant_doubts
from hoopd.recording.recording import Recording

# What asks for the hoop's own structures and judgements, and what it is when nothing is asked.
HOOPS_OWN = {"structure": "entries", "kinematics": False}
SHORTEST_WINDOW_SAMPLES = 10


def fit_other_plant(model: PlantModel, options: FitOptions, progress: Callable[[str], None]) -> dict[str, Any]:
    """Fit, judge, write; the result as a record. InputError when anything cannot be used or written."""
    check_results(options.out, options.figure)
    train, held = _read(model.plant, options, options.recordings), _read(model.plant, options, options.holdout)
    refuse_shared(train, held)
    found = fitted_plant(model, [one for _, one in train], options, progress)
    start, said = system_of(model)
    progress("scoring")
    said = [*(f"{name}: {text}" for name, one in train + held for text in plant_doubts(one, model.plant)), *said]
    result = _record(found, start, dict(train), dict(held), said)
    _write(found, model, train[0][1], options)
    paths = {"out": options.out, "figure": options.figure}
    return {**result, **{key: str(path) for key, path in paths.items() if path is not None}}


def fitted_plant(
    model: PlantModel,
    recordings: Sequence[Recording],
    options: FitOptions,
    progress: Callable[[str], None] = lambda text: None,
) -> PlantFit:
    """The fit of a model to recordings; InputError for what is asked and cannot be."""
    _refuse_hoops_own(options)
    _refuse_of_free_runs(options)
    system, _ = system_of(model)
    plant, names = model.plant, tuple(system.nominal)
    fixed = fixed_values(options.fix, system.values, names)
    _check_bounds("--fix", fixed, system)
    free = [name for name in (options.free or plant.free) if name not in fixed]
    priors = priors_of(options.prior, names, lambda name: system.bounds.get(name, (-1.0, 0.0))[0] >= 0.0)
    _check_bounds("--prior", {name: one.value for name, one in priors.items()}, system)
    if idle := [name for name in priors if name not in free]:
        raise InputError("--prior", idle[0], f"is not fitted; {', '.join(free) or 'nothing'} is")
    return fit_plant(
        plant, recordings, free, options.method, effects=system.effects,
        values={**system.changed, **fixed}, priors=priors, channels=_channels(plant, options),
        window_s=_window(plant, options), loss=options.loss, progress=progress,
    )  # fmt: skip


def _check_bounds(option: str, values: Mapping[str, float], system: PlantSystem) -> None:
    """InputError for a number with which there is no such plant."""
    for name, value in values.items():
        low, high = system.bounds.get(name, (-inf, inf))
        if not low <= value <= high:
            raise InputError(option, name, f"{value:g} is outside of {low:g} to {high:g}")


def _read(plant: Plant, options: FitOptions, texts: Sequence[str]) -> list[tuple[str, Recording]]:
    """By the names they were given."""
    hold = options.hold
    found = [(text, read_recording(text, options.columns, options.age, plant=plant, hold=hold)) for text in texts]
    for text, recording in found:
        if reason := read_too_rarely(recording.t, plant):
            raise InputError(text, "t", reason)
    return found


def _refuse_hoops_own(options: FitOptions) -> None:
    for field, usual in HOOPS_OWN.items():
        if getattr(options, field) != usual:
            raise InputError(f"--{field}", "", "belongs to the hoop; another plant's numbers stand in its file")


def _refuse_of_free_runs(options: FitOptions) -> None:
    """InputError for what a likelihood of predictions would take no notice of."""
    for field in ("prior", "loss", "window_s"):
        usual = FitOptions.__dataclass_fields__[field].default
        if options.method == "prediction" and getattr(options, field) != usual:
            raise InputError(
                option_name(FitOptions, field), "", "of another plant than the hoop goes with --method output"
            )


def _window(plant: Plant, options: FitOptions) -> float | None:
    least = SHORTEST_WINDOW_SAMPLES * plant.time_scale_s
    if options.window_s is not None and not options.window_s >= least:
        raise InputError("--window", "", f"must be {least:g} s at least, not {options.window_s:g}")
    return options.window_s


def _channels(plant: Plant, options: FitOptions) -> tuple[str, ...]:
    for name in options.channels:
        if name not in plant.channels:
            raise InputError("--channels", "", f"unknown {name!r}; known: {', '.join(plant.channels)}")
    return options.channels


# ---------------------------------------------------------------------------------------------- result


def _record(
    found: PlantFit, start: PlantSystem, train: Mapping[str, Recording], held: Mapping[str, Recording], said: list[str]
) -> dict[str, Any]:
    plant, solution = found.system.plant, found.solution
    units = units_of(start)
    return {
        "plant": plant.name,
        "method": found.method,
        "starts": len(found.runs),
        "converged": solution.converged,
        "parameters": {
            name: {
                "value": found.values[name],
                "unit": units.get(name, ""),
                "ci95": list(found.intervals[name]) if name in found.intervals else None,
                "nominal": start.values[name],
            }
            for name in start.values
            if name in found.names or found.system.changed.get(name, start.values[name]) != start.values[name]
        },
        "start": {name: float(value) for name, value in zip(plant.states, solution.starts[0], strict=False)},
        "fit": {
            part: {name: _scores(found, start, one) for name, one in recordings.items()}
            for part, recordings in (("train", train), ("holdout", held))
            if recordings
        },
        "effects": [effect.name for effect in start.effects],
        "notes": [*said, *_notes(found)],
    }


def units_of(system: PlantSystem) -> dict[str, str]:
    """Of every parameter of a plant and its effects."""
    effects = {effect.key(one.name): one.unit for effect in system.effects for one in effect.parameters}
    return {**system.plant.units, **effects}


def _scores(found: PlantFit, start: PlantSystem, recording: Recording) -> dict[str, Any]:
    """By channel: free runs with the values that the fit began with and with those found, each from its best start."""
    rows: dict[str, dict[str, Any]] = {}
    for label, system in (("nominal", start), ("fitted", found.fitted)):
        for channel, one in _free_run_fits(system, recording).items():
            row = rows.setdefault(channel, {})
            row[label] = number(one.nrmse_percent)
            row |= {"rmse": number(one.rmse), "unit": one.unit, "samples": one.samples}
    return rows


def _free_run_fits(system: PlantSystem, recording: Recording) -> Mapping[str, ChannelFit]:
    runs, solution = fit_starts(system, recording)
    return channel_fits(system.plant, runs, solution)[recording.source]


def _notes(found: PlantFit) -> list[str]:
    bounds, notes = found.system.bounds, []
    if not found.names:
        notes.append("no parameter is free: the start alone was fitted")
    for name in found.names:
        low, high = bounds.get(name, (-inf, inf))
        if found.values[name] in (low, high):
            notes.append(f"{name} is on its bound: its interval says nothing")
    notes += [direction_sentence(one) for one in found.undetermined]
    memory = found.uncertainty.memory if found.uncertainty is not None else {}
    if coloured := [channel for channel, order in memory.items() if order]:
        notes.append(
            f"{', '.join(coloured)}: residuals are coloured (the model misses something): the intervals count their "
            "correlation; compare --method prediction"
        )
    if not found.solution.converged and found.method == "output":
        notes.append("the search ended before it had converged")
    return notes


def _write(found: PlantFit, model: PlantModel, first: Recording, options: FitOptions) -> None:
    if options.out is not None:
        replace_file(options.out, _text(found, model, options, options.out).encode())
    if options.figure is not None:
        draw(found.fitted, first, options.figure)


def _text(found: PlantFit, model: PlantModel, options: FitOptions, out: Path) -> str:
    """A plant in YAML with its numbers; of a model, and of a plant in Python, a model file beside the plant."""
    path = plant_path(options.plant)
    if options.model is None and path is not None and path.suffix != PROGRAM:
        text = with_values(read_text(path), str(options.plant), found.values, found.intervals, out.stem)
        parse_plant(text, out)  # never a plant that no command could load
        return text
    return plant_model_text(with_parameters(model, found.values, found.intervals, out.stem), out)


def draw(system: PlantSystem, recording: Recording, figure: Path, start: Mapping[str, float] | None = None) -> None:
    """Inputs, measured against simulated, what is left."""
    from hoopd.plots.plant import draw_comparison
    from hoopd.plots.style import save

    run = simulate_plant(system, recording, start)
    percent = {name: one.nrmse_percent for name, one in run.percent.items()}
    save(draw_comparison(system.plant.name, recording, run.simulated, percent), figure)
