"""Plants of any kind: registered ones by name, files by path.

Rules of this file: thin over `hoopd.plants.registry`.
"""

from __future__ import annotations

from pathlib import Path

from hoopd.plants.declaration import Plant
from hoopd.plants.registry import resolve_plant


def plant(name: Path | str) -> Plant:
    """Give a plant.

    Parameters
    ----------
    name : str or Path
        A registered name ("hoop", "pendulum", "axis", "tanks", "falling", "circuit",
        "drives"), or the path of a plant file (.yaml, .py).

    Returns
    -------
    Plant
        The declaration, as `load` and `diagnose` take it.

    Raises
    ------
    InputError
        Tells file, key and reason of what cannot be used.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> axis = lab.plant("axis")
    >>> axis.states, [one.name for one in axis.inputs], axis.values["M"]
    (('x', 'dx'), ['F'], 100.0)
    """
    return resolve_plant(str(name))
