"""Plants that are known by name, and what `--plant` takes: such a name, or a plant file.

Rules of this file: names and files only; no equation lives here.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.plants.declaration import Plant
from hoopd.plants.model_file import effects_plant, load_model
from hoopd.plants.plant_file import load_plant

FOLDER = Path(__file__).parent
SUFFIXES = (".yaml", ".yml", ".py")


def _hoop() -> Plant:
    return effects_plant(load_model(or_shipped(Path("models/hoop.yaml"))))


def _shipped(name: str) -> Callable[[], Plant]:
    return lambda: load_plant(FOLDER / f"{name}.yaml")


FILES = ("pendulum", "axis", "tanks", "falling", "circuit", "drives")
REGISTERED: Mapping[str, Callable[[], Plant]] = MappingProxyType(
    {"hoop": _hoop, **{name: _shipped(name) for name in FILES}}
)


def plant_named(name: str) -> Plant:
    """Give a registered plant.

    Parameters
    ----------
    name : str
        hoop, pendulum, axis, tanks, falling, circuit or drives.

    Returns
    -------
    Plant
        The declaration.

    Raises
    ------
    InputError
        A name that is none.

    Examples
    --------
    >>> from hoopd.plants.registry import plant_named
    >>> plant_named("axis").free
    ('M', 'Fv', 'offset')
    """
    if name not in REGISTERED:
        close = difflib.get_close_matches(name, REGISTERED, 1)
        hint = f"did you mean {close[0]}" if close else f"known: {', '.join(REGISTERED)}"
        raise InputError("--plant", name, f"neither a registered plant nor a file (.yaml, .py); {hint}")
    return REGISTERED[name]()


def resolve_plant(text: str) -> Plant:
    """Give the plant of a registered name, or of a file.

    Parameters
    ----------
    text : str
        hoop, pendulum, axis, tanks, falling, circuit or drives; or a path that ends in .yaml, .yml or .py or holds a /:
        a file of a registered name in the folder is meant by ./NAME.

    Returns
    -------
    Plant
        The declaration.

    Raises
    ------
    InputError
        Neither a name nor a file, or a file that is wrong.

    Examples
    --------
    >>> from hoopd.plants.registry import resolve_plant
    >>> axis = resolve_plant("axis")
    >>> axis.states, [one.name for one in axis.inputs], axis.limit
    (('x', 'dx'), ['F'], 1000.0)
    """
    path = Path(text)
    return load_plant(path) if path.suffix in SUFFIXES or "/" in text else plant_named(text)


def is_text(text: str) -> bool:
    """Whether what `resolve_plant` takes is a YAML file, or a plant that ships as one."""
    return text in FILES or Path(text).suffix in (".yaml", ".yml")
