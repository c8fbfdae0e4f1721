"""`hoopd calibrate --moving`: signs, torque and camera delay of a recorded test signal.

Rules of this file: files in, a result record and a figure out; the numbers are `moving_calibration`'s.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from hoopd.commands.calibrate import write_text
from hoopd.commands.options.calibrate import CalibrateOptions
from hoopd.commands.output_files import check_targets
from hoopd.files.reading import InputError, parse_yaml
from hoopd.files.shipped import defaults_folder
from hoopd.files.yaml_text import text_of
from hoopd.plants.fits.plant_simulation import PlantSimulation, simulate_plant
from hoopd.plants.hoop.fitting.moving_calibration import MovingCalibration, judged, measure
from hoopd.plants.model_file import load_model
from hoopd.recording.formats import load
from hoopd.recording.recording import Recording

POINTS = 400  # of a curve that is shown: eight seconds at 50 Hz


def run(options: CalibrateOptions) -> dict[str, Any]:
    """The result as plain data; writes JSON, figure and configuration where told."""
    moving = options.moving
    assert moving is not None
    if options.picture is not None or options.positions is not None:
        raise InputError("--moving", "", "not with a picture or positions")
    check_targets([moving], {"--json": options.json_path, "--figure": options.figure, "--save": options.save})
    model = load_model(options.model or defaults_folder() / "models" / "hoop.yaml")
    recording = load(moving)
    found = measure(recording, model)
    constant, delay_s = _in_force(recording)
    steps = judged(found, constant, delay_s)
    simulation = simulate_plant(found.fit.fitted, found.told)
    result = {"recording": moving.name, **steps, "curves": _curves(found, simulation), "notes": []}
    if options.figure is not None:
        _draw(options, found, simulation)
    if options.save is not None:
        write_text(options.save, text_of(_part(steps), default_flow_style=None))
    if options.json_path is not None:
        write_text(options.json_path, json.dumps(result, indent=2) + "\n")
    return result


def _in_force(recording: Recording) -> tuple[float, float | None]:
    """Torque constant and delay of the configuration that was recorded; 0 and None where there is none."""
    try:
        told = parse_yaml(recording.config, recording.source) if recording.config else {}
        constant = float(told.get("faults", {}).get("torque_constant_nm_per_a", 0.0))
        delay = told.get("camera", {}).get("delay_s")
        return constant, None if delay is None else float(delay)
    except (InputError, AttributeError, TypeError, ValueError):
        return 0.0, None


def _part(steps: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {name: keys for step in steps.values() for name, keys in step["part"].items()}


def _curves(found: MovingCalibration, simulation: PlantSimulation) -> dict[str, list[dict[str, Any]]]:
    """What a page draws of each step: measured points, foretold lines."""
    told, foretold = found.told, simulation.simulated.channels
    t0 = float(told.t[0])

    def curve(label: str, t: Any, values: Any, kind: str) -> dict[str, Any]:
        known = np.isfinite(t) & np.isfinite(values)
        rows = np.flatnonzero(known)[:POINTS]
        x, y = np.asarray(t)[rows], np.asarray(values)[rows]
        return {"label": label, "kind": kind, "x": np.round(x, 5).tolist(), "y": np.round(y, 5).tolist()}

    def both(channel: str) -> list[dict[str, Any]]:
        measured, line = told.channels[channel], foretold[channel]
        return [
            curve("measured", measured.t - t0, measured.values, "points"),
            curve("foretold", line.t - t0, line.values, "line"),
        ]

    return {
        "signs": [curve("torque, N m", told.t - t0, told.u, "steps"), *both("dtheta")],
        "torque": _current_curves(found, curve),
        "delay": both("psi"),
    }


def _current_curves(found: MovingCalibration, curve: Callable[..., dict[str, Any]]) -> list[dict[str, Any]]:
    """The current over the torque, and the line that the constant stands for."""
    if found.constant_nm_per_a is None:
        return []
    u = found.held_torque_nm
    ends = np.array([np.nanmin(u), np.nanmax(u)])
    return [
        curve("measured", u, found.told.current, "points"),
        curve("line of the constant", ends, ends / found.constant_nm_per_a[0], "line"),
    ]


def _draw(options: CalibrateOptions, found: MovingCalibration, simulation: PlantSimulation) -> None:
    from hoopd.plots.plant import draw_comparison
    from hoopd.plots.style import save

    assert options.figure is not None
    percent = {name: one.nrmse_percent for name, one in simulation.percent.items()}
    save(draw_comparison("the model, calibrated", found.told, simulation.simulated, percent), options.figure)
