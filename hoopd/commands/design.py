"""`hoopd design`: a law from a model and a specification, judged, written as the file that the daemon loads.

Rules of this file: from files to a file and a result, no mathematics; an unstable design writes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import degrees, isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.commands import design_effects, plant_design_record, plant_linear
from hoopd.commands.design_options import KINDS, spec_from
from hoopd.commands.identified_design import design_for
from hoopd.commands.inputs import read_recording
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.output_files import check_results
from hoopd.core.estimator import EkfSettings
from hoopd.design.arx_law import design_arx
from hoopd.design.controller_text import controller_data, controller_text
from hoopd.design.gang_of_four import GangOfFour, gang_of_four, noise_gain, nyquist_gain, peaks
from hoopd.design.identified import OUTPUTS, design_identified
from hoopd.design.innovation_levels import innovation_levels
from hoopd.design.laws import LAWS, Law, Spec, SpecError
from hoopd.design.margins import Margins, margins
from hoopd.design.poles import Pole, closed_loop_poles, unstable
from hoopd.files.controller import ControllerFile, parse_controller
from hoopd.files.identified import IdentifiedFile, load_identified
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped, way_to
from hoopd.files.whole_files import replace_file
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun
from hoopd.plants.hoop.loop.trial import Trial, at_rest, figures_of, nonlinear_difference, trial
from hoopd.plants.hoop.loop.writeback import delays_of, filter_plant, limits_of
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import effects_of, load_model, plant_of
from hoopd.plots import style
from hoopd.plots.loops import draw_design

HEAD = "Made by `hoopd design {law}` from {model}."
# Below these a loop is fragile (Astrom and Murray, Feedback Systems, 10.3: 30 to 60 degrees, Ms 1.2 to 2).
LEAST_PHASE_DEG, LARGEST_MS, LEAST_GAIN_UP = 30.0, 2.0, 2.0
DELAY_POLE = 0.01  # |z|: below it a pole's response is over within a tick; a fourfold one is found at 1e-4, not at 0


def run(options: DesignOptions) -> dict[str, Any]:
    """Design, judge, write and draw; the result as plain data. InputError: unusable input or an unstable loop."""
    if plant_linear.is_other(options.plant, options.model):
        return plant_design_record.run(options)
    if options.model is None and options.law == "identified" and options.identified is not None:
        return design_for(options.identified, options)
    if options.model is None:
        raise InputError("Missing option '--model'", "", "a model file, or --plant for another plant than the hoop")
    if options.at or options.steer:
        raise InputError(
            "--at" if options.at else "--steer", "", "is of other plants: a law of the hoop is for rest at the bottom"
        )
    law, out, figure, disturbance_rad = options.law, options.out, options.figure, options.disturbance_rad
    spec = spec_from(options)
    check_results(out, figure)
    _check_disturbance(disturbance_rad)
    model_path = or_shipped(options.model)
    model = load_model(model_path)
    plant, found_effects = plant_of(model), effects_of(model)
    spec = _with_delays(spec, found_effects)
    designed = _designed(law, plant, spec, options.recording, options.identified)
    poles = _poles_of(law, designed)
    _refuse_unstable(law, poles, spec)
    text = _text(law, designed, spec, model, model_path, out)
    file = parse_controller(text, out or law)
    age_s = spec.delay_s - delays_of(found_effects).camera_s
    found, runs = margins(designed.loop), trial(file, plant, disturbance_rad, age_s, found=found_effects)
    _refuse_runaway(law, runs)
    if figure is not None:
        drawn = draw_design(_gang(designed), runs, disturbance_rad, title=_title(law, found, spec))
        style.save(drawn, figure)
    _write(out, text)
    return {
        "model": model_path.name,
        "controller": "" if out is None else out.name,
        **_result(law, file, designed, spec, poles, found, runs),
        "summary": design_effects.sentence(found_effects),
        **({"effects": design_effects.told(found_effects)} if found_effects else {}),
        "warnings": [
            *designed.notes,
            *_poor(found, spec),
            *_restless(runs),
            *design_effects.left_out(law, found_effects),
        ],
    }


# ---------------------------------------------------------------------------------------------- design


def _designed(law: str, plant: HoopPlant, spec: Spec, recording: str | None, identified: Path | None) -> Law:
    if law not in KINDS:
        raise InputError("LAW", "", f"unknown law {law!r}; known: {', '.join(KINDS)}")
    if (law == "arx") != (recording is not None):
        raise InputError("--recording", "", "goes with the law arx, and only with it")
    if (law == "identified") != (identified is not None):
        raise InputError("--identified", "", "goes with the law identified, and only with it")
    try:
        if identified is not None:
            return _on_identified(plant, spec, load_identified(identified))
        if recording is None:
            return LAWS[law](plant, spec)
        return design_arx(plant, spec, read_recording(recording))
    except InputError:
        raise
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"design {law}", "", str(error)) from None


def _on_identified(plant: HoopPlant, spec: Spec, file: IdentifiedFile) -> Law:
    if tuple(file.outputs) != OUTPUTS:
        raise ValueError(f"a law needs a model of {', '.join(OUTPUTS)}, this one is of {', '.join(file.outputs)}")
    return design_identified(plant, spec, file.matrices(), file.sample_time_s)


def _check_disturbance(disturbance_rad: float) -> None:
    """The ball is let go somewhere in the hoop."""
    if not 0.0 < abs(disturbance_rad) <= pi:
        raise InputError("--disturbance", "", f"must be at most {pi:.3g} rad and not 0, not {disturbance_rad:g}")


def _poles_of(law: str, designed: Law) -> list[Pole]:
    try:
        return closed_loop_poles(designed.loop)
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"design {law}", "", f"the closed loop has no finite poles ({error})") from None


def _refuse_runaway(law: str, runs: Trial) -> None:
    """A law is not written for the daemon when the nonlinear plant runs away with it."""
    for name in ("disturbed", "released"):
        if not np.isfinite(getattr(runs, name).x).all():
            raise InputError(f"design {law}", "", f"the nonlinear run {name!r} leaves every bound; nothing written")


def _refuse_unstable(law: str, poles: list[Pole], spec: Spec) -> None:
    if worst := unstable(poles):
        z = f"{worst.z.real:.4g}" + (f" +- {abs(worst.z.imag):.4g}j" if abs(worst.z.imag) > 1e-9 else "")
        where = f"pole z = {z}, |z| = {abs(worst.z):.4g}, {worst.natural_rad_s:.3g} rad/s"
        reason = f"the closed loop is unstable with pictures {1e3 * spec.delay_s:.3g} ms old: {where}; nothing written"
        raise InputError(f"design {law}", "", reason)


def _poor(found: Margins, spec: Spec) -> list[str]:
    """What is wrong with margins that are smaller than a loop on a real device needs."""
    phase, ms = degrees(abs(found.phase_rad)), found.peak_sensitivity
    checks = (
        (phase < LEAST_PHASE_DEG, f"phase margin {phase:.1f} degrees, below {LEAST_PHASE_DEG:g}"),
        (ms > LARGEST_MS, f"largest |S| {ms:.2f}, above {LARGEST_MS:g}"),
        (found.gain_up < LEAST_GAIN_UP, f"gain margin {found.gain_up:.2f}, below {LEAST_GAIN_UP:g}"),
        (found.delay_s < spec.sample_time_s, f"bears {1e3 * found.delay_s:.0f} ms more delay, less than one tick"),
    )
    return [text for poor, text in checks if poor]


def _restless(runs: Trial) -> list[str]:
    names = ("disturbed", "released")
    return [f"ball not at rest at the end of the nonlinear run {n!r}" for n in names if not at_rest(getattr(runs, n))]


def _with_delays(spec: Spec, found: FoundEffects) -> Spec:
    """The specification for what is later than usual; InputError when that is more than the filter remembers."""
    late = delays_of(found)
    try:
        return replace(spec, delay_s=spec.delay_s + late.camera_s, torque_delay_s=late.torque_s)
    except SpecError as error:
        raise InputError("--delay", "", f"with the model's effects: {error.reason}") from None


# ---------------------------------------------------------------------------------------------- files


def _text(law: str, designed: Law, spec: Spec, model: ModelFile, model_path: Path, out: Path | None) -> str:
    data = controller_data(
        out.stem if out is not None else law,
        designed.kind,
        designed.gains,
        model=way_to(model_path, out),
        notes=f"designed as {law} for pictures {1e3 * spec.delay_s:g} ms old",
        sample_time_s=spec.sample_time_s,
        torque_nm=min((model.device.torque_limit_nm, *limits_of(effects_of(model)))),
        innovations=_levels(model, spec),
    )
    return controller_text(data, HEAD.format(law=law, model=model_path.name))


def _levels(model: ModelFile, spec: Spec) -> dict[str, list[float]]:
    """What the filter's innovations are while the device is as the model with its effects says."""
    found = effects_of(model)
    age_s = spec.delay_s - delays_of(found).camera_s
    return innovation_levels(filter_plant(found), EkfSettings(), age_s, spec.sample_time_s)


def _write(out: Path | None, text: str) -> None:
    if out is not None:
        replace_file(out, text.encode())


def _gang(designed: Law) -> GangOfFour:
    return gang_of_four(designed.plant, designed.controller, designed.loop)


def _title(law: str, found: Margins, spec: Spec) -> str:
    margin = f"phase margin {degrees(abs(found.phase_rad)):.0f} degrees, bears {1e3 * found.delay_s:.0f} ms more"
    return f"{law}, pictures {1e3 * spec.delay_s:g} ms old: {margin}"


# ---------------------------------------------------------------------------------------------- result


def _result(
    law: str, file: ControllerFile, designed: Law, spec: Spec, poles: list[Pole], found: Margins, runs: Trial
) -> dict[str, Any]:
    p, c, loop, limit = designed.plant, designed.controller, designed.loop, file.limits.torque_nm
    return {
        "law": law,
        "kind": file.kind,
        "sample_time_s": spec.sample_time_s,
        "delay_s": spec.delay_s,
        "gains": file.gains,
        "design": _finite(designed.numbers),
        **_poles(poles),
        "margins": _finite(_margins(found)),
        "gang_of_four": _finite(
            peaks(_gang(designed)) | {"nyquist_gain": nyquist_gain(c), "noise_gain": noise_gain(p, c, loop)}
        ),
        "closed_loop": {
            "disturbed": _figures(runs.disturbed, limit, runs.disturbed_linear),
            "released": _figures(runs.released, limit, runs.released_linear),
            "wrong_zero": _figures(runs.wrong_zero, limit),
        },
    }


def _figures(made: ClosedLoopRun, limit_nm: float, linear: ClosedLoopRun | None = None) -> dict[str, Any]:
    values: dict[str, Any] = _finite(figures_of(made, limit_nm))
    return values if linear is None else values | {"nonlinear_difference_rad": nonlinear_difference(made, linear)}


def _margins(found: Margins) -> dict[str, Any]:
    """Margins of a stable loop in degrees and ms, and where they are in rad/s."""
    return {
        "phase_deg": degrees(abs(found.phase_rad)),
        "phase_rad_s": found.phase_rad_s,
        "delay_ms": 1e3 * found.delay_s,
        "gain_up": found.gain_up,
        "gain_up_rad_s": found.gain_up_rad_s,
        "gain_down": found.gain_down,
        "peak_sensitivity": found.peak_sensitivity,
        "peak_complementary": found.peak_complementary,
    }


def _poles(poles: list[Pole]) -> dict[str, Any]:
    """The poles z that shape the response, with natural frequency and damping; those at 0, torques and pictures on
    their way, are counted."""
    slow = [pole for pole in poles if abs(pole.z) >= DELAY_POLE]
    return {
        "closed_loop_poles": [{"re": pole.z.real, "im": pole.z.imag} for pole in slow],
        "natural_rad_s": [pole.natural_rad_s for pole in slow],
        "damping": [pole.damping for pole in slow],
        "delay_poles": len(poles) - len(slow),
    }


def _finite(values: Any) -> Any:
    """The same with None for what JSON cannot hold: no limit, not a number."""
    if isinstance(values, Mapping):
        return {key: _finite(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [_finite(value) for value in values]
    return values if not isinstance(values, float) or isfinite(values) else None
