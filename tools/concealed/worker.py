"""What a worker does with one case: `hoopd diagnose` as a process of its own, in a folder that holds nothing else.

Rules of this file: standard library only, so that any machine with `hoopd` can run it; files come and go as bytes; a
diagnosis that fails is an answer too.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

LIMIT_S = 900.0  # of one case: a worker must not hang for ever
TAIL_CHARS = 2000


def diagnose(
    files: Mapping[str, bytes],
    seed: int,
    without: Sequence[str] = (),
    library_only: bool = False,
    limit_s: float = LIMIT_S,
) -> dict[str, Any]:
    """{"diagnosis": JSON or None, "seconds", "code", "error"} of train_1, train_2 and holdout; `without`: names that
    the library shall lack; `library_only`: asked without the grammar."""
    with tempfile.TemporaryDirectory(prefix="case-") as folder:
        for name, data in files.items():
            Path(folder, name).write_bytes(data)
        start = time.perf_counter()
        code, error = _run(command(seed, without, library_only), folder, limit_s)
        seconds = time.perf_counter() - start
        out = Path(folder, "diagnosis.json")
        found = json.loads(out.read_text(encoding="utf-8")) if code == 0 and out.exists() else None
    return {"diagnosis": found, "seconds": seconds, "code": code, "error": error}


def command(seed: int, without: Sequence[str] = (), library_only: bool = False) -> list[str]:
    """The command line of one case; figures are those of windows, so that no free run is asked for."""
    files = ("train_1.csv", "train_2.csv", "--holdout", "holdout.csv", "--json", "diagnosis.json")
    shorter = ("--without", ",".join(without)) if without else ()
    names = ("--library-only",) if library_only else ()
    return [sys.executable, "-m", "hoopd", "diagnose", *files, "--seed", str(seed), "--no-free-run", *shorter, *names]


def _run(arguments: list[str], folder: str, limit_s: float) -> tuple[int | None, str]:
    # a dask worker has its memory given back at once, and what starts from it would fetch it again at every array
    as_anywhere = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    try:
        done = subprocess.run(
            arguments,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
            stdin=subprocess.DEVNULL,
            env=as_anywhere,
        )
    except subprocess.TimeoutExpired:
        return None, f"not done after {limit_s:g} s"
    return done.returncode, done.stderr[-TAIL_CHARS:] if done.returncode else ""
