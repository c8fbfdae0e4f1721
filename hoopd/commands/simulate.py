"""`hoopd simulate`: a model run freely with the torque of a recording, and how well it repeats what was measured.

Rules of this file: files in, a result record, a recording and a figure out; the mathematics is in `hoopd.ident`. JSON
knows no NaN: a fit that does not exist (a constant measurement) is null. Nothing is written before all is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hoopd.commands.identified_simulation import simulate_identified
from hoopd.commands.inputs import read_ages, read_recording, read_values
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number, other_model
from hoopd.commands.simulate_plant import memory_words, simulate_other_plant, zero_words
from hoopd.files.identified import is_identified
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.plants.hoop.fitting.fit_percent import WINDOW_S, FitScore, score
from hoopd.plants.hoop.recordings.fit_data import moving_of, was_measured
from hoopd.plants.hoop.recordings.recorded_runs import RUNAWAY_RAD_S, STATES, Subject, ran_away, simulated
from hoopd.plants.hoop.recordings.suspicions import suspicions
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording import Recording, save
from hoopd.recording.formats import extension_of
from hoopd.recording.slices import MAX_VALUE
from hoopd.recording.timeline import driven, off_the_hoop_words

MOVING = ("auto", "both", "hoop", "ball")
# Below, a run of seconds takes minutes and nothing changes; above, a step is longer than any tick.
STEP_RANGE_S = (1e-4, 0.1)


def run(options: SimulateOptions) -> dict[str, Any]:
    """Simulate, compare, write; the result as a record. InputError when anything cannot be used or written."""
    if options.model is not None and is_identified(or_shipped(options.model)):
        return simulate_identified(or_shipped(options.model), options)
    if (other := other_model(options.plant, options.model)) is not None:
        return simulate_other_plant(other, options)
    out, figure, step_s = options.out, options.figure, options.step_s
    if options.model is None:
        raise InputError("--model", "", "is missing; a plant of another kind is told by --plant")
    model = options.model
    if out is not None:
        extension_of(out)  # said before the work, not after it
    check_results(out, figure)
    file = load_model(or_shipped(model))
    effects = None if options.without_effects or not file.effects else effects_of(file)
    check_step(step_s)
    found = read_recording(options.recording, options.columns, options.age, hold=options.hold)
    start = None if options.x0 is None else read_values("--x0", options.x0, STATES)
    subject = Subject(file.structure, file.values(), step_s=step_s, effects=effects)
    what = moved(found, options.moving, file.device.encoder_counts)
    _check_start(what, start)
    whole = score(subject, found, start=start if start is not None else _rest(found), moving=what)
    subject = replace(subject, zero=whole.zero)
    windows = score(subject, found, window_s=WINDOW_S, moving=what) if whole.traces else None
    _refuse_runaway(model, whole)
    _write(subject, found, whole, file, out, figure)
    result = _result(file, found, whole, windows, start is not None, step_s)
    result |= {"age_s": read_ages(options.age)} if options.age else {}
    result["effects"] = [*effects.names] if effects else []
    result["notes"] = _notes(file, found, whole, without_effects=options.without_effects)
    if effects:
        result["notes"] += memory_words(effects.plant, effects.effects())
    if whole.zero is not None and effects:
        result["notes"] += zero_words({"theta": whole.zero}, effects.effects())
    return {**result, **{key: str(path) for key, path in (("out", out), ("figure", figure)) if path is not None}}


# ---------------------------------------------------------------------------------------------- checks


def check_step(step_s: float) -> None:
    """InputError for a step with which no run of the hoop is made."""
    low, high = STEP_RANGE_S
    if not low <= step_s <= high:
        raise InputError("--step", "", f"must be {low:g} to {high:g} s, not {step_s:g}")


def moved(recording: Recording, moving: str, encoder_counts: int) -> str:
    """What moves: as told; a recording of nothing but torque moves both."""
    if moving not in MOVING:
        raise InputError("--moving", "", f"unknown {moving!r}; known: {', '.join(MOVING)}")
    if moving != "auto":
        return moving
    return moving_of(recording, encoder_counts) if was_measured(recording) else "both"


def _rest(recording: Recording) -> Mapping[str, float] | None:
    """A recording of nothing but torque starts at rest."""
    return None if was_measured(recording) else {}


def _check_start(moving: str, start: Mapping[str, float] | None) -> None:
    """A state that does not move cannot be started."""
    still = {"hoop": ("psi", "dpsi"), "ball": ("dtheta",), "both": ()}[moving]
    for name, value in (start or {}).items():
        if abs(value) > MAX_VALUE:
            raise InputError("--x0", name, f"must be at most {MAX_VALUE:g}, not {value:g}")
    for name in still:
        if (start or {}).get(name, 0.0) != 0.0:
            raise InputError("--x0", name, f"only the {moving} moves in this recording; --moving both simulates both")


def _refuse_runaway(model: Path, whole: FitScore) -> None:
    if ran_away(whole.runs):
        raise InputError(model, "", f"the free run leaves every bound (above {RUNAWAY_RAD_S:g} rad/s)")


# ---------------------------------------------------------------------------------------------- results


def _write(
    subject: Subject, recording: Recording, whole: FitScore, file: ModelFile, out: Path | None, figure: Path | None
) -> None:
    if out is not None:
        save(simulated(subject, recording, whole.runs, whole.moving), out)
    if figure is not None:
        from hoopd.plots.simulation import draw_simulation
        from hoopd.plots.style import save as save_figure

        save_figure(draw_simulation(whole, recording, file.name), figure)


def _result(
    file: ModelFile, recording: Recording, whole: FitScore, windows: FitScore | None, given: bool, step_s: float
) -> dict[str, Any]:
    first = whole.runs[0]
    return {
        "model": file.name,
        "structure": file.structure,
        "recording": recording.source,
        "rows": len(recording),
        "seconds": float(recording.t[-1] - recording.t[0]),
        "stretches": len(whole.runs),
        "moving": whole.moving,
        "step_s": step_s,
        "start_from": "given" if given else "estimated" if whole.traces else "rest",
        "start": {name: float(value) for name, value in zip(STATES, first.start, strict=True)},
        **({} if whole.zero is None else {"zero": {"theta": whole.zero}}),
        "free_run": fits(whole),
        f"windows_{WINDOW_S:g}s": fits(windows) if windows is not None else {},
    }


def fits(found: FitScore) -> dict[str, Any]:
    """Fit per channel as plain data."""
    return {
        name: {
            "nrmse_percent": number(one.nrmse_percent),
            "nrmse_all_percent": number(one.nrmse_all_percent),
            "rmse": number(one.rmse),
            "unit": one.unit,
            "samples": one.samples,
            "set_aside": one.set_aside,
        }
        for name, one in found.channels.items()
    }


def _notes(file: ModelFile, recording: Recording, whole: FitScore, *, without_effects: bool) -> list[str]:
    notes = [*suspicions(recording, file.device.torque_limit_nm), *off_words(recording)]
    for name, one in whole.channels.items():
        if one.set_aside:
            notes.append(f"{name}: {one.set_aside} samples that repeat the last value do not count")
    if file.effects and without_effects:
        notes.append(f"left out of the model: {', '.join(entry.name for entry in file.effects)}")
    if not whole.traces:
        notes.append("the recording has a torque and no measurement: nothing to compare with")
    return notes


def off_words(recording: Recording) -> list[str]:
    """Rows in which something may have held hoop or ball, because the drive was off, and those in which no hoop did."""
    off = int((~driven(recording)).sum())
    told = [f"{off} rows were taken with the drive off and do not count"] if off else []
    return [f"{recording.source}: {words}" for words in (*told, *off_the_hoop_words(recording))]
