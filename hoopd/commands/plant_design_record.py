"""`hoopd design lqg|placement --plant`: what it finds as plain data, the controller's file and the loop's figure.

Rules of this file: a design in, files and a result out; nothing is designed here. The file is for a program of one's
own: the daemon runs the hoop alone, and refuses it.
"""

from __future__ import annotations

from math import degrees, isfinite
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hoopd.commands.options.design import DesignOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_design import PlantDesign, designed
from hoopd.commands.plant_linear import asked_model
from hoopd.files.plant_controller import parse_plant_controller, plant_controller_text
from hoopd.files.shipped import or_shipped, way_to
from hoopd.files.whole_files import replace_file

HEAD = "Made by `hoopd design {law} --plant`: x += M (y - y0 - C x), u = u0 - K x, x = A x + B (u - u0)."
# Of its largest deviation, how near a signal stays when it has settled.
SETTLED_SHARE = 0.05


def run(options: DesignOptions) -> dict[str, Any]:
    """Gains, filter, poles, margins, the loop; InputError: no such law, nothing to steer, an unstable loop."""
    check_results(options.out, options.figure)
    found = designed(asked_model(options.plant, options.model), options)
    if options.figure is not None:
        from hoopd.plots.style import save

        save(figure_of(found), options.figure)
    if options.out is not None:
        write(found, options.out, options.model)
    paths = {"out": options.out, "figure": options.figure}
    return {**_result(found, options.law), **{key: str(one) for key, one in paths.items() if one is not None}}


def write(found: PlantDesign, out: Path, model: Path | None) -> None:
    """The controller's file; plant and model are named from its folder."""
    own, given = found.linear.model, found.file
    plant = given.plant if own.plant_file is None else way_to(own.plant_file, out)
    file = msgspec.structs.replace(
        given, name=out.stem, plant=plant, model="" if model is None else way_to(or_shipped(model), out)
    )
    text = plant_controller_text(file, HEAD.format(law=given.name))
    parse_plant_controller(text, out)
    replace_file(out, text.encode())


def figure_of(found: PlantDesign) -> Any:
    """The loop that is let go, on the plant and on its linear model."""
    from hoopd.plots.plant_loop import draw_plant_loop

    plant, file = found.linear.model.plant, found.file
    return draw_plant_loop(
        found.run.t,
        found.run.nonlinear,
        found.run.linear,
        units={**file.inputs, **file.channels},
        inputs={one.name: one.limit for one in plant.inputs if one.name in file.inputs},
        title=f"{found.linear.model.name}: closed loop with {file.name}, let go beside its operating point",
    )


def _result(found: PlantDesign, name: str) -> dict[str, Any]:
    linear, law = found.linear, found.law
    plant, (x, u) = linear.model.plant, linear.point
    return {
        "model": linear.model.name,
        "plant": plant.name,
        "law": name,
        "sample_time_s": found.file.sample_time_s,
        "operating_point": dict(
            zip((*plant.states, *(one.name for one in plant.inputs)), map(float, (*x, *u)), strict=True)
        ),
        "margins": None if found.margins is None else {
            "phase_deg": _finite(degrees(abs(found.margins.phase_rad))),
            "delay_ms": _finite(1e3 * found.margins.delay_s),
            "gain_up": _finite(found.margins.gain_up),
            "gain_down": _finite(found.margins.gain_down),
            "peak_sensitivity": _finite(found.margins.peak_sensitivity),
        },
        "closed_loop": _signals(found),
        "states": list(law.model.state_labels),
        "inputs": list(law.model.input_labels),
        "channels": list(law.model.output_labels),
        "feedback": np.asarray(law.feedback).tolist(),
        "filter": np.asarray(law.filter).tolist(),
        "closed_loop_poles": [
            {"re": one.z.real, "im": one.z.imag, "natural_rad_s": one.natural_rad_s, "damping": one.damping}
            for one in found.poles
        ],
        "notes": [*found.notes, *_unsettled(found)],
    }  # fmt: skip


def _signals(found: PlantDesign) -> dict[str, Any]:
    """Of each channel and input of the plant that was let go: where it began, its largest deviation, when it stays."""
    rest, units = found.file.operating_point, {**found.file.channels, **found.file.inputs}
    rows = {}
    for name, values in found.run.nonlinear.items():
        off = np.abs(values - rest[name])
        outside = np.flatnonzero(off > SETTLED_SHARE * off.max(initial=0.0))
        after = int(outside[-1]) + 1 if len(outside) else 0
        rows[name] = {
            "unit": units[name],
            "begins_at": float(values[0]),
            "largest_deviation": float(off.max(initial=0.0)),
            "ends_at": float(values[-1]),
            "settles_s": float(found.run.t[after]) if after < len(values) else None,
        }
    return rows


def _unsettled(design: PlantDesign) -> list[str]:
    """Channels that the plant does not bring back."""
    left = [name for name, one in _signals(design).items() if name in design.file.channels and one["settles_s"] is None]
    return [f"{', '.join(left)}: not settled when the run ends (what the linear model leaves out)"] if left else []


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
