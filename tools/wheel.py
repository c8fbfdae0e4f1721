#!/usr/bin/env python3
"""Builds the wheel into a folder (dist), lists what is in it, and fails when something of the package is missing.

Rules of this file: standard library and pip only; nothing is fetched: the build backend is the locked one of this
environment. Usage: tools/wheel.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import zipfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUILD = ("wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", "--no-index")


def build(folder: Path) -> Path:
    """The wheel of this checkout, made in `folder`; an older one of the same name is replaced."""
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([sys.executable, "-m", "pip", *BUILD, "--wheel-dir", folder, ROOT], check=True)
    return max(folder.glob("hoopd-*.whl"), key=lambda path: path.stat().st_mtime_ns)


def expected() -> set[str]:
    """Names that an installed hoopd needs: every file of the package that is no cache, and the configuration."""
    package = {path for path in (ROOT / "hoopd").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    config = set((ROOT / "config").rglob("*.yaml"))
    return {path.relative_to(ROOT).as_posix() for path in package} | {
        f"hoopd/_config/{path.relative_to(ROOT / 'config').as_posix()}" for path in config
    }


def missing(names: set[str]) -> list[str]:
    """What should be in a wheel with these names and is not."""
    absent = expected() - names
    licence = any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    return sorted(absent) + ([] if licence else ["LICENSE"])


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Build the wheel and say what is in it.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel")
    path = build(parser.parse_args().out)
    names = zipfile.ZipFile(path).namelist()
    for room, count in sorted(Counter("/".join(name.split("/")[:2]) for name in names).items()):
        print(f"  {room:<44}{count} file{'s' if count > 1 else ''}")
    absent = missing(set(names))
    absent_too = "".join(f", without {name}" for name in absent)
    print(f"{path}: {len(names)} files, {path.stat().st_size / 1e6:.2f} MB{absent_too}")
    return 1 if absent else 0


if __name__ == "__main__":
    sys.exit(main())
