"""Where the real recordings and pictures are; tests that need them skip visibly elsewhere."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def shared_path(name: str) -> Path:
    """Path of a shared data file, or a skip that says what is missing."""
    folder = Path(os.environ.get("HOOPD_SHARED", ROOT.parent / "shared"))
    path = folder / name
    if not path.exists():
        pytest.skip(f"real data not here: {path} (set HOOPD_SHARED)")
    return path
