"""Layers of a configuration: files and `--set a.b=value`, as trees, and one tree over another.

Rules of this file: trees of YAML alone; what a key means is not known here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.files.reading import InputError, load_yaml, parse_yaml, read_text
from hoopd.files.yaml_text import MAX_DEPTH

Layer = tuple[object, dict[str, Any]]  # what it is called in a message, and its tree


def layer_of(path: Path) -> Layer:
    """A file; InputError for what is none."""
    return path, parse_yaml(read_text(path), path)


def override_of(text: str) -> Layer:
    """One `a.b=value` of a command line; InputError for what is none."""
    key, equals, value = text.partition("=")
    source = f"--set {text}"
    if not equals or not key:
        raise InputError(source, "", "expected a.b=value")
    nested, parts = load_yaml(value, source), key.split(".")
    if len(parts) > MAX_DEPTH:
        raise InputError(source, "", f"nested too deeply: {MAX_DEPTH} levels at most")
    for part in reversed(parts):
        nested = {part: nested}
    return source, nested


def merged_with(base: dict[str, Any], top: dict[str, Any]) -> dict[str, Any]:
    """A tree with another one over it, leaf by leaf."""
    merged = dict(base)
    for key, value in top.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = merged_with(merged[key], value) if both else value
    return merged
