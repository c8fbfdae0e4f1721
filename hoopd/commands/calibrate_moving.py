"""`hoopd calibrate --moving`: signs, torque and camera delay of a recorded test signal.

Rules of this file: files in, a result record and a figure out; the numbers are `moving_calibration`'s.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.calibrate import write_text
from hoopd.commands.options.calibrate import CalibrateOptions
from hoopd.commands.output_files import check_targets
from hoopd.files.reading import InputError, parse_yaml
from hoopd.files.shipped import defaults_folder
from hoopd.files.yaml_text import text_of
from hoopd.plants.hoop.fitting.moving_calibration import MovingCalibration, judged, measure
from hoopd.plants.model_file import load_model
from hoopd.recording.formats import load
from hoopd.recording.recording import Recording

Column = NDArray[np.float64]
Curve = dict[str, Any]

POINTS = 500  # of a curve that is shown: ten seconds at 50 Hz
TIME = "time, s"
NOTHING = "# Found by `hoopd calibrate --moving`: nothing of the configuration has to change.\n{}\n"


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
    steps, drawings = judged(found, *_in_force(recording)), _drawings(found)
    written = {"json": options.json_path, "figure": options.figure, "save": options.save}
    result = {
        "recording": moving.name,
        **steps,
        "drawings": drawings,
        **{name: str(path) for name, path in written.items() if path is not None},
        "notes": ["values: what was found, then both ends of its 95 % interval"],
    }
    if options.figure is not None:
        from hoopd.plots.moving_calibration import draw_moving
        from hoopd.plots.style import save

        save(draw_moving(moving.name, [one for step in drawings.values() for one in step]), options.figure)
    if options.save is not None:
        part = _part(steps)
        write_text(options.save, text_of(part, default_flow_style=None) if part else NOTHING)
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


# ---------------------------------------------------------------------------------------------- what is drawn


def _drawings(found: MovingCalibration) -> dict[str, list[dict[str, Any]]]:
    """By step: axes and curves, measured and foretold."""
    told = found.told
    torque = [_curve("demanded", "steps", told.t - told.t[0], told.u)]
    return {
        "signs": [
            {"x": TIME, "y": "torque, N m", "curves": torque},
            {"x": TIME, "y": "hoop speed, rad/s", "curves": _both(found, "dtheta")},
        ],
        "torque": _current(found),
        "delay": [{"x": TIME, "y": "ball angle, rad", "curves": _both(found, "psi")}],
    }


def _both(found: MovingCalibration, channel: str) -> list[Curve]:
    """What was measured, and what the fitted model makes of it at the same times."""
    times, measured, foretold = [], [], []
    for run_, errors in zip(found.fit.runs, found.fit.solution.residuals, strict=True):
        if channel in run_.series:
            series = run_.series[channel]
            times.append(run_.t[series.nodes] - found.told.t[0])
            measured.append(series.values)
            foretold.append(series.values + errors[channel])
    t = np.concatenate(times or [np.empty(0)])
    return [
        _curve("measured", "points", t, np.concatenate(measured or [t])),
        _curve("foretold", "line", t, np.concatenate(foretold or [t])),
    ]


def _current(found: MovingCalibration) -> list[dict[str, Any]]:
    """The current over the torque, and the line that the constant stands for."""
    if found.constant_nm_per_a is None:
        return []
    u = found.held_torque_nm
    ends = np.array([np.nanmin(u), np.nanmax(u)])
    curves = [
        _curve("measured", "points", u, np.asarray(found.told.current)),
        _curve("line of the constant", "line", ends, ends / found.constant_nm_per_a[0]),
    ]
    return [{"x": "torque, N m", "y": "current, A", "curves": curves}]


def _curve(label: str, kind: str, x: Column, y: Column) -> Curve:
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))[:POINTS]
    return {"label": label, "kind": kind, "x": np.round(x[rows], 5).tolist(), "y": np.round(y[rows], 5).tolist()}
