"""Where the configuration, models and controllers are that ship with hoopd.

Rules of this file: paths only.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

# Where a fit of each structure starts from when no model is named.
START_MODELS: Mapping[str, str] = MappingProxyType(
    {"entries": "models/thesis.yaml", "rolling": "models/hoop.yaml", "published": "models/hoop.yaml"}
)


def defaults_folder() -> Path:
    """Folder of the shipped configuration, in an installed package or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    shipped = package / "_config"
    return shipped if shipped.is_dir() else package.parent / "config"


def or_shipped(path: Path) -> Path:
    """The path as it stands, or the shipped file of that name where there is none (models/hoop.yaml)."""
    shipped = defaults_folder() / path
    with contextlib.suppress(OSError):  # a name too long: who reads the file says so
        if not path.exists() and shipped.is_file():
            return shipped
    return path


def way_to(model: Path, controller: Path | None) -> str:
    """The model as a controller file names it: a shipped one by its name, another from the file's own folder."""
    whole = model.resolve()
    if whole.is_relative_to(defaults_folder()):
        return whole.relative_to(defaults_folder()).as_posix()
    return whole.name if controller is None else Path(os.path.relpath(whole, controller.resolve().parent)).as_posix()
