"""`hoopd fit --plant`: recordings of any declared plant to its parameters, with intervals and percent of fit.

Rules of this file: files in, a result record, a plant file and a figure out. Nothing is written before all is computed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hoopd.commands.fit_options import fixed_values, priors_of
from hoopd.commands.inputs import read_recording
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number, plant_path, refuse_shared
from hoopd.files.plant_text import with_values
from hoopd.files.reading import InputError, read_text
from hoopd.files.whole_files import replace_file
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_fit import ChannelFit, PlantFit, channel_fits, fit_plant, fit_starts
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.plant_file import parse_plant
from hoopd.recording.recording import Recording

# What asks for the hoop's own structures and judgements, and what it is when nothing is asked.
HOOPS_OWN = {"structure": "entries", "model": None, "kinematics": False, "channels": ()}
SHORTEST_WINDOW_SAMPLES = 10


def fit_other_plant(plant: Plant, options: FitOptions, progress: Callable[[str], None]) -> dict[str, Any]:
    """Fit, judge, write; the result as a record. InputError when anything cannot be used or written."""
    check_results(options.out, options.figure)
    _refuse_hoops_own(options)
    source = _text_of(options) if options.out is not None else ""
    train, held = _read(plant, options, options.recordings), _read(plant, options, options.holdout)
    refuse_shared(train, held)
    names, fixed = tuple(plant.values), fixed_values(options.fix, plant.values, tuple(plant.values))
    free = [name for name in (options.free or plant.free) if name not in fixed]
    priors = priors_of(options.prior, names, lambda name: plant.bounds.get(name, (-1.0, 0.0))[0] >= 0.0)
    found = fit_plant(
        plant, [one for _, one in train], free, options.method, values=fixed, priors=priors,
        window_s=_window(plant, options), loss=options.loss, progress=progress,
    )  # fmt: skip
    progress("scoring")
    result = _record(found, dict(train), dict(held))
    _write(found, source, train[0][1], options)
    paths = {"out": options.out, "figure": options.figure}
    return {**result, **{key: str(path) for key, path in paths.items() if path is not None}}


def _read(plant: Plant, options: FitOptions, texts: Sequence[str]) -> list[tuple[str, Recording]]:
    """By the names they were given."""
    hold = options.hold
    return [(text, read_recording(text, options.columns, options.age, plant=plant, hold=hold)) for text in texts]


def _refuse_hoops_own(options: FitOptions) -> None:
    for field, usual in HOOPS_OWN.items():
        if getattr(options, field) != usual:
            raise InputError(f"--{field}", "", "belongs to the hoop; another plant's numbers stand in its file")


def _window(plant: Plant, options: FitOptions) -> float | None:
    least = SHORTEST_WINDOW_SAMPLES * plant.time_scale_s
    if options.window_s is not None and not options.window_s >= least:
        raise InputError("--window", "", f"must be {least:g} s at least, not {options.window_s:g}")
    return options.window_s


def _text_of(options: FitOptions) -> str:
    """The plant's file, into which the values go."""
    path = plant_path(options.plant)
    if path is None or path.suffix == ".py":
        raise InputError("--out", str(options.out), "a plant in Python keeps its numbers itself: take them from --json")
    return read_text(path)


# ---------------------------------------------------------------------------------------------- result


def _record(found: PlantFit, train: Mapping[str, Recording], held: Mapping[str, Recording]) -> dict[str, Any]:
    plant, solution = found.system.plant, found.solution
    units = plant.units
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
                "nominal": found.nominal[name],
            }
            for name in plant.values
            if name in found.intervals or name in found.system.changed
        },
        "start": {name: float(value) for name, value in zip(plant.states, solution.starts[0], strict=True)},
        "fit": {
            part: {name: _scores(found, one) for name, one in recordings.items()}
            for part, recordings in (("train", train), ("holdout", held))
            if recordings
        },
        "notes": _notes(found),
    }


def _scores(found: PlantFit, recording: Recording) -> dict[str, Any]:
    """By channel: free runs with the nominal values and with those found, each from its best start."""
    nominal = PlantSystem(found.system.plant, found.system.effects)
    rows: dict[str, dict[str, Any]] = {}
    for label, system in (("nominal", nominal), ("fitted", found.fitted)):
        for channel, one in _free_run_fits(system, recording).items():
            row = rows.setdefault(channel, {})
            row[label] = number(one.nrmse_percent)
            row |= {"rmse": number(one.rmse), "unit": one.unit, "samples": one.samples}
    return rows


def _free_run_fits(system: PlantSystem, recording: Recording) -> Mapping[str, ChannelFit]:
    runs, solution = fit_starts(system, recording)
    return channel_fits(system.plant, runs, solution)[recording.source]


def _notes(found: PlantFit) -> list[str]:
    plant, notes = found.system.plant, []
    if not found.names:
        notes.append("no parameter is free: the start alone was fitted")
    for name in found.names:
        low, high = plant.bounds.get(name, (-float("inf"), float("inf")))
        if found.values[name] in (low, high):
            notes.append(f"{name} is on its bound: its interval says nothing")
    memory = found.uncertainty.memory if found.uncertainty is not None else {}
    if coloured := [channel for channel, order in memory.items() if order]:
        notes.append(
            f"{', '.join(coloured)}: residuals are coloured (the model misses something): the intervals count their "
            "correlation; compare --method prediction"
        )
    return notes


def _write(found: PlantFit, source: str, first: Recording, options: FitOptions) -> None:
    if options.out is not None:
        text = with_values(source, str(options.plant), found.values, found.intervals, options.out.stem)
        parse_plant(text, options.out)  # never a plant that no command could load
        replace_file(options.out, text.encode())
    if options.figure is not None:
        draw(found.fitted, first, options.figure)


def draw(system: PlantSystem, recording: Recording, figure: Path, start: Mapping[str, float] | None = None) -> None:
    """Inputs, measured against simulated, what is left."""
    from hoopd.plots.plant import draw_comparison
    from hoopd.plots.style import save

    run = simulate_plant(system, recording, start)
    percent = {name: one.nrmse_percent for name, one in run.percent.items()}
    save(draw_comparison(system.plant.name, recording, run.simulated, percent), figure)
