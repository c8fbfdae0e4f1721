"""Results of `hoopd design` and `hoopd linearize` as a person reads them: what decides first, matrices and poles last.

Rules of this file: records are put in another order and turned on their side, nothing is computed; the JSON has the
whole result as it was.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.commands.output import shown

POLE_DIGITS = 5


def of_design(result: Mapping[str, Any], out: Path | None = None) -> dict[str, Any]:
    """Margins, the three runs side by side, gains, poles; warnings as sentences; what to do with the file."""
    head = ("model", "controller", "law", "kind", "sample_time_s", "delay_s")
    told = {} if out is None else {"next": f"hoopd --sim --set control.file={shlex.quote(str(out))}"}
    return {
        **{key: result[key] for key in head if result[key] != ""},
        "margins": result["margins"],
        "closed_loop": turned(result["closed_loop"]),
        **{key: result[key] for key in ("gang_of_four", "gains", "design") if result[key]},
        "closed_loop_poles": _poles(result),
        **told,
        "notes": [result["summary"], *result["warnings"]],
    }


def of_plant_design(result: Mapping[str, Any]) -> dict[str, Any]:
    """A law of another plant: the same with its poles in rows and gains by name."""
    rows = [one for one in result["closed_loop_poles"] if one["im"] >= 0.0]
    poles = {str(number): {"z": _pair(one), **{key: one[key] for key in ("natural_rad_s", "damping")}}
             for number, one in enumerate(rows, 1)}  # fmt: skip
    told = {**result, "closed_loop_poles": poles}
    for key in ("states", "inputs", "channels"):
        told[key] = ", ".join(result[key])
    told["operating_point"] = ", ".join(f"{name} {shown(value)}" for name, value in result["operating_point"].items())
    return told


def of_linearize(result: Mapping[str, Any]) -> dict[str, Any]:
    """Margins, poles and zeros, what can be seen and moved; then fractions, matrices and the step; several outputs
    side by side."""
    outputs = {result["output"]: result, **result.get("further_outputs", {})}
    sampled = ("sample_time_s", "delay_samples") if result["sample_time_s"] is not None else ()
    told = {
        **{key: result[key] for key in ("model", "structure", "plant", *sampled) if key in result},
        "output": ", ".join(result["observability"]["measured"]),
        "operating_point": ", ".join(f"{name} {shown(value)}" for name, value in result["operating_point"].items()),
    }
    seen = {key: result[key] for key in ("controllability", "observability", "detectability")}
    if "margins" not in result:  # nothing drives the plant
        kept = ("observability", "detectability")
        rest = {key: result[key] for key in ("state_space", "notes")}
        return {**told, "poles": result["poles"], **{key: seen[key] for key in kept}, **rest}
    return {
        **told,
        "margins": _beside(outputs, "margins"),
        "poles": result["poles"],
        **_each(outputs, "zeros"),
        "bandwidth": _beside(outputs, "bandwidth"),
        "sampling": _beside(outputs, "sampling"),
        **seen,
        **_each(outputs, "transfer_function"),
        **_each(outputs, "minimal"),
        "state_space": result["state_space"],
        "step": _beside(outputs, "step"),
        "notes": result["notes"],
    }


def turned(columns: Mapping[str, Mapping[str, Any] | None]) -> dict[str, dict[str, Any]]:
    """Records by name to one row for each of their keys; None where a record has no such key."""
    keys = dict.fromkeys(key for one in columns.values() for key in one or {})
    return {key: {name: (one or {}).get(key) for name, one in columns.items()} for key in keys}


def _each(outputs: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A value of every output, the output in its name where there are several."""
    return {key if len(outputs) == 1 else f"{key} of {name}": one[key] for name, one in outputs.items()}


def _beside(outputs: Mapping[str, Any], key: str) -> Any:
    """A record of numbers, with a column for each of several outputs."""
    found = {name: one[key] for name, one in outputs.items()}
    return turned(found) or None if len(found) > 1 else next(iter(found.values()))


def _poles(result: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """A row for each pole or pair of poles; one for those of torques and pictures on their way."""
    rows = zip(result["closed_loop_poles"], result["natural_rad_s"], result["damping"], strict=True)
    kept = [
        {"z": _pair(pole), "natural_rad_s": natural, "damping": damping}
        for pole, natural, damping in rows
        if pole["im"] >= 0.0
    ]
    table = {str(number): row for number, row in enumerate(kept, 1)}
    if count := result["delay_poles"]:
        table["delays"] = {"z": f"0, {count} of them", "natural_rad_s": None, "damping": None}
    return table


def _pair(pole: Mapping[str, float]) -> str:
    real = shown(pole["re"], POLE_DIGITS)
    return real if pole["im"] == 0.0 else f"{real} +- {shown(pole['im'], POLE_DIGITS)}j"
