"""What tells two declarations apart: equal fingerprints compute the same, whatever they are called.

Functions are equal by their code, by the module they stand in and by what they close over; what cannot be looked into
is equal to itself alone.

Rules of this file: nothing here knows a plant or an effect.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from types import FunctionType, MethodType
from typing import Any

# Of a field that says something about a thing with which it computes the same.
DESCRIBES = {"describes": True}


class _Same:
    """An object that equals itself alone; it is kept, so that no other one takes its place in memory."""

    def __init__(self, thing: object) -> None:
        self._thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other._thing is self._thing

    def __hash__(self) -> int:
        return id(self._thing)


def fingerprint(thing: Any) -> Hashable:
    """A key that is equal for declarations that compute the same."""
    return _of(thing, ())


def _of(thing: Any, above: tuple[int, ...]) -> Hashable:
    if thing is None or isinstance(thing, str | bool | int | float | type):
        # -0.0 is not 0.0, 1 is not 1.0, and NaN is NaN
        return type(thing).__name__, repr(thing) if isinstance(thing, float) else thing
    if id(thing) in above:
        return "itself", len(above) - above.index(id(thing))
    kind, parts = _parts(thing)
    return kind, tuple(_of(one, (*above, id(thing))) for one in parts)


def _parts(thing: Any) -> tuple[Any, tuple[Any, ...]]:
    """What is compared of a thing itself, and the parts that are looked into."""
    kinds: tuple[tuple[Any, Callable[[], tuple[Any, tuple[Any, ...]]]], ...] = (
        (FunctionType, lambda: ((thing.__code__, _Same(thing.__globals__)), _bound(thing))),
        (MethodType, lambda: ("method", (thing.__func__, thing.__self__))),
        (partial, lambda: ("partial", (thing.func, thing.args, thing.keywords))),
        (Mapping, lambda: ("mapping", tuple(part for item in thing.items() for part in item))),
        (tuple | list, lambda: (type(thing), tuple(thing))),
    )
    if is_dataclass(thing):
        return type(thing), tuple(getattr(thing, one.name) for one in fields(thing) if one.metadata != DESCRIBES)
    return next((parts() for kind, parts in kinds if isinstance(thing, kind)), (_Same(thing), ()))


def _bound(function: FunctionType) -> tuple[Any, ...]:
    """What a function closes over, and its defaults."""
    cells = []
    for cell in function.__closure__ or ():
        try:
            cells.append(cell.cell_contents)
        except ValueError:  # not filled yet
            cells.append(None)
    return tuple(cells), function.__defaults__, function.__kwdefaults__
