"""`hoopd linearize`: a model file to its linear model around an operating point, and what that says.

Rules of this file: files in, a result record and a figure out; the mathematics is in `hoopd.design`, the record
in `linearize_record`; whatever cannot be used is refused before the work.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np

from hoopd.commands import plant_linear
from hoopd.commands.linearize_record import report
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.design.analysis import STATES, channel, linear_model
from hoopd.design.delay import held
from hoopd.design.effects_near import Near, effects_near
from hoopd.files.model import ModelFile
from hoopd.files.plant import LONGEST_SAMPLE_S
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.plants.hoop.loop.operating_points import NoEquilibriumError, OperatingPoint, operating_point
from hoopd.plants.model_file import effects_of, load_model, plant_of

USUAL_OUTPUTS = ("psi",)
# Beyond this a chain of delays is no delay of a controller but a mistake in the command.
MOST_DELAY_SAMPLES = 100
# Sixteen turns: a larger angle is given in degrees, or damaged.
MOST_TURNS_RAD = 100.0
# Growth within a sample beyond which double precision says nothing about what happens between two of them.
MOST_GROWTH = 1e12


def run(options: LinearizeOptions) -> dict[str, Any]:
    """What `hoopd linearize` finds, as plain data; InputError on a file or a value that cannot be used."""
    _check_sampling(options)
    _check_figure(options.figure, options.plot)
    if plant_linear.is_other(options.plant, options.model):
        return plant_linear.run(options)
    if options.model is None:
        raise InputError("Missing option '--model'", "", "a model file, or --plant for another plant than the hoop")
    if options.at:
        raise InputError("--at", "", "is of other plants: --top, --psi and --hoop-speed say where the hoop is")
    model, options = options.model, replace(options, outputs=options.outputs or USUAL_OUTPUTS)
    _check(options)
    file = load_model(or_shipped(model))
    try:
        point, system, near = linearized(file, options)
        result = report(file, point, system, (options.sample_time_s, options.delay_samples), near)
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise InputError(model, "parameters", f"the linear model leaves the computer's range ({error})") from None
    if options.figure is not None:
        from hoopd.plots import linear, style

        output = options.outputs[0]
        draw, first = linear.DRAWINGS[options.plot or "overview"], channel(system, output)
        style.save(draw(first, title=f"{file.name}: {output} / torque"), options.figure)
    return result


def linearized(file: ModelFile, options: LinearizeOptions) -> tuple[OperatingPoint, control.StateSpace, Near]:
    """Operating point, linear system and what became of the model's effects; InputError where there is no point."""
    angle = math.pi if options.top else options.held_rad
    turning = bool(options.turning_rad_s) or (angle is not None and angle != 0.0 and not options.top)
    near = effects_near(plant_of(file), effects_of(file), options.outputs, turning=turning)
    plant = near.plant
    try:
        point = operating_point(
            plant, psi_rad=angle, dtheta_rad_s=options.turning_rad_s, torque_limit_nm=file.device.torque_limit_nm
        )
    except NoEquilibriumError as error:
        raise InputError("--hoop-speed" if options.turning_rad_s is not None else "--psi", "", str(error)) from None
    system = linear_model(plant, point.x, point.u, options.outputs)
    if options.sample_time_s is not None:
        delay_s = options.delay_samples * options.sample_time_s + near.delay_s
        system = held(system, options.sample_time_s, delay_s)
        if not np.abs(system.A).max() < MOST_GROWTH:
            raise InputError("--sample-time", "", "the plant runs away within one sample: shorten it")
    return point, system, near


# ---------------------------------------------------------------------------------------------- checks


def _check(options: LinearizeOptions) -> None:
    """One line for every value that cannot be meant."""
    unknown = [name for name in options.outputs if name not in STATES]
    if unknown or not options.outputs:
        raise InputError("--output", "", f"must be of {', '.join(STATES)}, not {unknown[0] if unknown else 'none'}")
    if len(set(options.outputs)) != len(options.outputs):
        raise InputError("--output", "", "an output is named twice")
    given = {"--top": options.top or None, "--psi": options.held_rad, "--hoop-speed": options.turning_rad_s}
    chosen = [name for name, value in given.items() if value is not None]
    if len(chosen) > 1:
        raise InputError(chosen[1], "", f"cannot be given together with {chosen[0]}: either fixes the other")
    if options.held_rad is not None and not abs(options.held_rad) <= MOST_TURNS_RAD:
        raise InputError("--psi", "", f"must be at most {MOST_TURNS_RAD:g} rad, not {options.held_rad:g}")


def _check_sampling(options: LinearizeOptions) -> None:
    step = options.sample_time_s
    if step is not None and not 1e-5 <= step <= LONGEST_SAMPLE_S:
        raise InputError("--sample-time", "", f"must be between 1e-05 and {LONGEST_SAMPLE_S:g} s, not {step:g}")
    if not 0 <= options.delay_samples <= MOST_DELAY_SAMPLES:
        raise InputError("--delay", "", f"must be 0 to {MOST_DELAY_SAMPLES} samples, not {options.delay_samples}")
    if options.delay_samples and options.sample_time_s is None:
        raise InputError("--delay", "", "counts samples: give --sample-time too")


def _check_figure(figure: Path | None, plot: str | None) -> None:
    if figure is None:
        if plot is not None:
            raise InputError("--plot", "", "chooses what --figure shows: give --figure too")
        return
    from hoopd.plots import linear, style

    style.check_path(figure)
    if plot is not None and plot not in linear.DRAWINGS:
        raise InputError("--plot", "", f"must be one of {', '.join(linear.DRAWINGS)}, not {plot!r}")
