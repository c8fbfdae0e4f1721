"""Which code spoke: a digest of the modules here, taken when a run begins or goes on; not of the packages below them.

Rules of this file: standard library only.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("hoopd", "tools/concealed")


def version(root: Path = ROOT) -> str:
    """Twelve hexadecimal digits of the names and the bytes of all modules."""
    found = hashlib.sha256()
    for path in sorted(path for folder in FOLDERS for path in (root / folder).rglob("*.py")):
        content = path.read_bytes()
        found.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
        found.update(content)
    return found.hexdigest()[:12]
