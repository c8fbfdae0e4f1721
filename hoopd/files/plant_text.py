"""A plant file with other numbers: what a fit found, in the file that it began with.

Rules of this file: from text to text; no plant is made of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import yaml

from hoopd.files.plant import PlantFile, quantity
from hoopd.files.reading import parse_yaml, to_struct


def with_values(
    text: str, path: object, values: Mapping[str, float], intervals: Mapping[str, tuple[float, float]], name: str
) -> str:
    """The file's text with these values; 95 % intervals stand above it as comments, the file's own comments are gone.

    Examples
    --------
    >>> text = "{schema: hoopd.plant/1, name: a, coordinates: {x: m}, parameters: {m: 2 kg}, equations: {x: m*x''=0}}"
    >>> print(with_values(text, "a.yaml", {"m": 3.0}, {"m": (2.9, 3.1)}, "slide_fitted"))
    # Fitted, with 95 % intervals:
    # m = 3 kg, 2.9 to 3.1
    schema: hoopd.plant/1
    name: slide_fitted
    equations: {x: m*x''=0}
    coordinates: {x: m}
    parameters:
      m: {value: 3.0, unit: kg}
    <BLANKLINE>
    """
    file: dict[str, Any] = msgspec.to_builtins(to_struct(parse_yaml(text, path), PlantFile, path))
    defaults = msgspec.to_builtins(PlantFile(schema="hoopd.plant/1", name="", equations={}))
    parameters = {}
    for key, entry in file["parameters"].items():
        record = _record(entry, path, f"parameters.{key}")
        parameters[key] = record | {"value": float(values.get(key, record["value"]))}
    file |= {"name": name, "parameters": parameters}
    head = ["# Fitted, with 95 % intervals:"]
    head += [
        f"# {key} = {parameters[key]['value']:.7g} {parameters[key]['unit']}, {low:.7g} to {high:.7g}"
        for key, (low, high) in intervals.items()
    ]
    kept = {key: _said(value) for key, value in file.items() if value != defaults.get(key) or key == "schema"}
    order = [key for key in PlantFile.__struct_fields__ if key in kept]
    body = yaml.safe_dump({key: kept[key] for key in order}, sort_keys=False, default_flow_style=None, width=120)
    return "\n".join([*(head if intervals else []), body])


def _said(value: Any) -> Any:
    """Without the keys that stand for nothing."""
    if not isinstance(value, dict):
        return value
    return {key: _said(one) for key, one in value.items() if one is not None and one not in ("", (), [])}


def _record(entry: Any, path: object, key: str) -> dict[str, Any]:
    """A parameter's record without what it would be anyhow."""
    if isinstance(entry, str):
        value, unit = quantity(path, key, entry)
        return {"value": value, "unit": unit}
    usual = {"bounds": [-float("inf"), float("inf")], "held": False}
    return {name: value for name, value in entry.items() if name not in usual or value != usual[name]}
