"""Signals by name in MATLAB files: fields of a struct, Simulink's "structure with time", or plain variables.

Simulink writes a struct with `time` and `signals`, an array of structs with `values` and `label`; others keep a struct
with a field per signal. Which of them is the time is told by `column_choice`.

Rules of this file: what is no number is passed over; damage is one `InputError`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hoopd.files.reading import InputError
from hoopd.recording import mat5
from hoopd.recording.by_name import NamedValues, chosen, has_time
from hoopd.recording.matlab_objects import TableVariable, tables

VALUES = ("values", "Values", "Data", "data")
UNITS = ("unit", "units", "Unit")
AS_STRUCT = "save it as a table, or as a struct: s = table2struct(T, 'ToScalar', true)"


def fields_of(data: bytes, path: Path, experiment: str | None = None) -> tuple[str, dict[str, NamedValues]]:
    """Name of the struct (empty: plain variables) and its signals; InputError when there is none, or several."""
    try:
        if mat5.version(data) == 73:
            from hoopd.recording.hdf5 import named_fields, opened

            with opened(path) as file:
                return named_fields(file, path, experiment)
        arrays = list(mat5.variables(data, None))
        structs = {a.name: dict(_of_struct(a)) for a in arrays if a.kind == mat5.STRUCT and a.shape == (1, 1)}
        structs |= {name: _of_table(columns) for name, columns in tables(arrays).items()}
        plain = {a.name: NamedValues(mat5.values(a)) for a in arrays if a.name and _is_numbers(a)}
    except InputError:
        raise
    except ValueError as error:
        raise InputError(path, "", f"not a MATLAB file, or a damaged one ({error})") from None
    objects = [a.name for a in arrays if a.kind == mat5.OPAQUE and a.name not in structs]
    if experiment in objects or (objects and experiment is None and not structs and not has_time(plain)):
        name = experiment or objects[0]
        raise InputError(path, name, f"an object, of which no signals are read; {AS_STRUCT}")
    return chosen({name: fields for name, fields in structs.items() if fields}, plain, path, experiment)


def _is_numbers(array: mat5.Array) -> bool:
    return array.kind in mat5.NUMBERS and not array.flags & mat5.COMPLEX


def _of_table(columns: Mapping[str, TableVariable]) -> dict[str, NamedValues]:
    return {name: NamedValues(mat5.values(c.values), c.unit) for name, c in columns.items() if _is_numbers(c.values)}


def _of_struct(array: mat5.Array) -> Iterator[tuple[str, NamedValues]]:
    for name, field in mat5.fields(array).items():
        if _is_numbers(field):
            yield name, NamedValues(mat5.values(field))
        elif field.kind == mat5.STRUCT:
            yield from _of_signals(name, mat5.elements(field))


def _of_signals(group: str, elements: list[dict[str, mat5.Array]]) -> Iterator[tuple[str, NamedValues]]:
    """Signals of a struct (or an array of them) within a struct."""
    for k, element in enumerate(elements):
        values = next((name for name in VALUES if name in element and _is_numbers(element[name])), None)
        if values is not None:
            name = _words(element, ("label", "Name", "name")) or _words(element, ("blockName",)).rpartition("/")[2]
            usual = group if len(elements) == 1 else f"{group}_{k + 1}"
            yield name or usual, NamedValues(mat5.values(element[values]), _words(element, UNITS))
            continue
        for name, field in element.items():
            if _is_numbers(field):
                yield name, NamedValues(mat5.values(field))
            elif field.kind == mat5.STRUCT and field.shape == (1, 1):
                inner: Any = mat5.fields(field)
                yield from ((name, one) for _, one in _of_signals(name, [inner]) if _has_values(inner))


def _has_values(element: Mapping[str, Any]) -> bool:
    return any(name in element for name in VALUES)


def _words(element: Mapping[str, mat5.Array], names: tuple[str, ...]) -> str:
    """The first text of these fields, empty without one."""
    for name in names:
        if name in element and element[name].kind == mat5.TEXT:
            return mat5.text(element[name]).strip()
    return ""
