"""`hoopd simulate --plant`: any declared plant run freely under the inputs of a recording.

Rules of this file: files in, a result record, a recording and a figure out; nothing is written before all is computed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hoopd.commands.fit_plant import draw
from hoopd.commands.inputs import read_recording, read_values
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number, system_of
from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.vocabulary import remembering
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import simulate_plant
from hoopd.plants.plant_model import PlantModel
from hoopd.recording import save
from hoopd.recording.formats import extension_of

# The longest step when nobody asks for one: the plant's own.
USUAL_STEP_S = SimulateOptions.__dataclass_fields__["step_s"].default
NOTHING_MEASURED = "the recording has inputs and no measurement: nothing to compare with"


def simulate_other_plant(model: PlantModel, options: SimulateOptions) -> dict[str, Any]:
    """Simulate, compare, write; the result as a record. InputError when anything cannot be used or written."""
    plant = model.plant
    if options.out is not None:
        extension_of(options.out)  # said before the work, not after it
    check_results(options.out, options.figure)
    system, said = asked_system(model, options)
    recording = read_recording(options.recording, options.columns, options.age, plant=plant, hold=options.hold)
    start = None if options.x0 is None else read_values("--x0", options.x0, plant.states)
    run = simulate_plant(system, recording, start)
    if options.out is not None:
        save(run.simulated, options.out)
    if options.figure is not None:
        draw(system, recording, options.figure, start)
    result = {
        "plant": plant.name,
        **({} if options.model is None else {"model": model.name}),
        "recording": recording.source,
        "rows": len(recording),
        "seconds": float(recording.t[-1] - recording.t[0]),
        "stretches": len(run.starts),
        "start_from": "estimated" if run.estimated else "rest" if start is None else "given",
        "start": {name: float(value) for name, value in zip(plant.states, run.starts[0], strict=False)},
        **({"zero": run.zeros} if run.zeros else {}),
        "free_run": {
            name: {
                "nrmse_percent": number(one.nrmse_percent),
                "rmse": number(one.rmse),
                "unit": one.unit,
                "samples": one.samples,
            }
            for name, one in run.percent.items()
        },
        "effects": [effect.name for effect in system.effects],
        "notes": [
            *said,
            *zero_words(run.zeros, system.effects),
            *memory_words(plant, system.effects),
            *([] if run.percent else [NOTHING_MEASURED]),
        ],
    }
    paths = {"out": options.out, "figure": options.figure}
    return {**result, **{key: str(path) for key, path in paths.items() if path is not None}}


def memory_words(plant: Plant, effects: Sequence[Effect]) -> list[str]:
    """That what an effect remembers is nothing where a run or a window begins."""
    names = remembering(plant, effects)
    return [f"what {', '.join(names)} remembers begins with nothing in every run and window"] if names else []


def zero_words(zeros: Mapping[str, float], effects: Sequence[Effect]) -> list[str]:
    """That phases of the model were turned to the recording's own zero."""
    return [
        f"{q} counts from another place in each recording: fitted to this one, {zero:+.2f} rad of the model's zero, "
        f"for {', '.join(effect.name for effect in effects if q in effect.depends_on)}"
        for q, zero in zeros.items()
    ]


def asked_system(model: PlantModel, options: SimulateOptions) -> tuple[PlantSystem, list[str]]:
    """The model as it is to be run, and what has to be said; InputError for options that no such plant has."""
    if options.moving != "auto":
        raise InputError("--moving", "", "belongs to the hoop")
    if not 0.0 < options.step_s <= 1e6:
        raise InputError("--step", "", f"must be above 0, not {options.step_s:g}")
    step_s = None if options.step_s == USUAL_STEP_S else options.step_s
    return system_of(model, step_s=step_s, effects=not options.without_effects)
