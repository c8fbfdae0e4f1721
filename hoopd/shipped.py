"""Where the configuration, models and controllers are that ship with hoopd.

Rules of this file: paths only.
"""

from __future__ import annotations

from pathlib import Path


def defaults_folder() -> Path:
    """Folder of the shipped configuration, in an installed package or in a checkout."""
    package = Path(__file__).resolve().parent
    shipped = package / "_config"
    return shipped if shipped.is_dir() else package.parent / "config"


def or_shipped(path: Path) -> Path:
    """The path as it stands, or the shipped file of that name where there is none (models/hoop.yaml)."""
    shipped = defaults_folder() / path
    return shipped if not path.exists() and shipped.is_file() else path
