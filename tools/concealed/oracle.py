"""The oracle: told which effects there are, it only fits them. What a perfect namer would reach on held-out data.

Rules of this file: an adapter; the fit is `hoopd.diagnose.oracle.oracle`, imported when called.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


class NoOracleError(RuntimeError):
    """This hoopd has no `hoopd.diagnose.oracle`."""


def oracle(files: Mapping[str, bytes], names: Sequence[str]) -> dict[str, Any]:
    """{"fit": fits of a case whose effects are known, as in a diagnosis}; or {"error"}; NoOracleError without one."""
    try:
        from hoopd.diagnose.oracle import oracle as fitted
    except ImportError as error:
        raise NoOracleError(str(error)) from None
    from hoopd.recording.formats import load

    with tempfile.TemporaryDirectory(prefix="oracle-") as folder:
        loaded = {}
        for name, data in files.items():
            path = Path(folder, name)
            path.write_bytes(data)
            loaded[name] = load(path)
    holdout = loaded.pop("holdout.csv")
    try:
        return {"fit": dict(fitted([loaded[name] for name in sorted(loaded)], holdout, tuple(names)))}
    except Exception as error:  # of one case: no reason to lose the run
        return {"error": f"{type(error).__name__}: {error}"}
