"""The result of a fit as a person reads it.

Rules of this file: from the record to tables and sentences; nothing is computed but percents.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from hoopd.plants.hoop.fitting.fit_percent import WINDOW_S
from hoopd.plants.hoop.parameters import PARAMETER_UNITS

MISSED_PERCENT = 0.1  # of an entry; what the positive parameters miss less is the rounding of a fit


def for_terminal(result: dict[str, Any]) -> dict[str, Any]:
    """The result as a person reads it: names of files without their folders, no matrices, sentences at the end."""
    hidden = ("correlation", "fit", "undetermined", "physical", "kinematics")
    shown = {key: value for key, value in result.items() if key not in hidden}
    shown["parameters"] = {name: _with_half_width(one) for name, one in result["parameters"].items()}
    for part, files in result["fit"].items():
        for name, rows in files.items():
            table = {channel: _percent(row) for channel, row in rows.items()}
            shown[f"fit of {Path(name).name} ({part})"] = table
    words = [*result.get("undetermined", {}).get("words", [])]
    if result.get("physical"):
        shown |= _made_of(result["physical"])
        words += result["physical"]["words"]
    words += result.get("kinematics", {}).get("words", [])
    shown |= {key: shown.pop(key) for key in ("out", "figure") if key in shown}  # last
    shown |= _next(result)
    shown["notes"] = [*result["notes"], *words]
    return shown


def _next(result: dict[str, Any]) -> dict[str, str]:
    """What a model file is for; fewer than eight entries are a bare hoop or a lone ball."""
    if (
        "plant" in result
        or "out" not in result
        or (result["structure"] == "entries" and "L2" not in result["parameters"])
    ):
        return {}
    return {"next": f"hoopd design lqg --model {shlex.quote(result['out'])} --out lqg.yaml"}


def _with_half_width(parameter: dict[str, Any]) -> dict[str, Any]:
    """The row of a parameter with half of its interval in percent: digits alone do not show a narrow one."""
    value, ends = parameter["value"], parameter["ci95"]
    half = "-"
    if ends is not None and value:
        percent = 50.0 * (ends[1] - ends[0]) / abs(value)
        half = f"{percent:.2g} %" if percent < 10.0 else f"{percent:.0f} %"
    return {"value": value, "unit": parameter["unit"], "+-": half, "ci95": ends, "nominal": parameter["nominal"]}


def _made_of(physical: dict[str, Any]) -> dict[str, Any]:
    """Parameters of the entries under both kinematics, and what the entries miss."""
    kinds = [kind for kind in ("rolling", "published") if kind in physical]
    units = PARAMETER_UNITS["rolling"]
    values = {
        name: {**{kind: physical[kind]["parameters"][name] for kind in kinds}, "unit": unit}
        for name, unit in units.items()
    }
    misfit = {
        name: {kind: f"{physical[kind]['misfit_percent'][name]:+.1f} %" for kind in kinds}
        for name in physical[kinds[0]]["misfit_percent"]
        if any(abs(physical[kind]["misfit_percent"][name]) > MISSED_PERCENT for kind in kinds)
    }
    shown = {"positive parameters nearest to the entries": values}
    return {**shown, "what their entries miss": misfit} if misfit else shown


def _percent(row: dict[str, Any]) -> dict[str, Any]:
    return {
        name.replace("_", ", "): "-" if row[name] is None else f"{row[name]:.1f} %"
        for name in ("nominal", "fitted", f"nominal_{WINDOW_S:g}s", f"fitted_{WINDOW_S:g}s")
        if name in row
    }
