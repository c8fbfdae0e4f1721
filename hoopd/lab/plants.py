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
        A registered name, or the path of a plant file.

    Returns
    -------
    Plant
        The declaration, as `load` and `diagnose` take it.

    Raises
    ------
    InputError
        What is neither a name nor a plant file that can be used.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.plant("pendulum").free
    ('J', 'c')
    """
    return resolve_plant(str(name))
