"""Files that appear whole or not at all.

Rules of this file: standard library only; the last step is a rename.
"""

from __future__ import annotations

from pathlib import Path


def put(path: Path, data: bytes) -> None:
    """Writes a file beside its place and moves it there; makes the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)
