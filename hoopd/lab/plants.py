"""Plants of any kind: registered ones by name, files by path.

Rules of this file: thin over `hoopd.plants.registry`.
"""

from __future__ import annotations

from pathlib import Path

from hoopd.plants.declaration import Plant
from hoopd.plants.registry import resolve_plant


def plant(name: Path | str) -> Plant:
    """A plant by its registered name ("hoop", "pendulum", "axis", "tanks", "falling") or its file's path (.yaml, .py).

    InputError tells file, key and reason of what cannot be used.

    >>> axis = plant("axis")
    >>> axis.states, [one.name for one in axis.inputs], axis.values["M"]
    (('x', 'dx'), ['F'], 100.0)
    """
    return resolve_plant(str(name))
