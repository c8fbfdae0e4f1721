"""Memory of every estimator that does not iterate, at a million samples, each in a process of its own.

python tools/bench/ident_memory.py [--samples 1000000] [--only tfest] [--json FILE]

One row an estimator: the largest resident set of the process in MiB, with the libraries and the data (input and output
of 8 MiB each at a million samples), and the seconds of the call. Exit code 1 when one needs more than 500 MB.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LIMIT_MIB = 500e6 / 2**20
# Seconds that a process may take.
TIMEOUT_S = 600.0
# What is called, of the names of hoopd.ident; `d` are the data, one input and output, `two` the same with two of each.
CALLS: Mapping[str, str] = MappingProxyType({
    "arx": "arx(d, 2, 2)",
    "arx, ridge": "arx(d, 2, 2, ridge=1.0)",
    "arx, total least squares": "arx(d, 2, 2, estimator=total_least_squares)",
    "lpv_arx": "lpv_arx(d, d.u[:, 0], 2, 2)",
    "varx": "varx(two(), 2, 2)",
    "ar": "ar(d, 4)",
    "arma, two-stage": "arma(d, 2, 2, method='two-stage')",
    "arma_ssa": "arma_ssa(d, 2, 2, window=60)",
    "plr": "plr(d, 2, 2, 1)",
    "scan": "scan(d, range(1, 6), range(1, 6))",
    "tfest": "tfest(d)",
    "tfest, short segments": "tfest(d, segment=256)",
    "tfest, correlation": "tfest(d, 'correlation', width=200)",
    "coherence": "coherence(d)",
    "power_spectrum": "power_spectrum(d)",
    "correlation": "correlation(d.y, d.u)",
    "etfe": "etfe(d)",
    "impulseest": "impulseest(d, 50)",
    "okid": "okid(d, 20)",
    "era_of_data": "era_of_data(d, 4)",
    "subspaceid": "subspaceid(d, 4)",
    "subspaceid, automatic": "subspaceid(d)",
    "pbsid": "pbsid(d, 4)",
    "fit_basis": "fit_basis(d, laguerre(0.8, 6, d.dt))",
    "detrend": "detrend(d)",
    "prefilter": "prefilter(d, (0.01, 0.2))",
    "resample": "resample(d, 0.5)",
    "predict": "predict(arx(d, 2, 2), d, 10)",
    "simulate": "simulate(arx(d, 2, 2), d)",
    "residuals": "residuals(arx(d, 2, 2), d)",
    "residuals, coloured": "residuals(arx(d, 1, 1), d)",
})  # fmt: skip
CODE = """
import resource, sys, time, warnings
sys.path[:0] = [{root!r}]
warnings.simplefilter("ignore")
import numpy as np
from hoopd.ident import *
def made(n):
    from scipy.signal import lfilter
    u, e = np.random.default_rng(0).standard_normal((2, n))
    return iddata(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + lfilter([1.0], [1.0, -1.5, 0.7], 0.5 * e), u)
def two():
    return iddata(np.hstack([d.y, d.y[::-1]]), np.hstack([d.u, d.u[::-1]]), d.dt)
d = made({samples})
start = time.perf_counter()
{call}
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, time.perf_counter() - start)
"""


def measured(name: str, samples: int) -> dict[str, Any]:
    """One row; without figures where the call failed."""
    code = CODE.format(root=str(ROOT), samples=samples, call=CALLS[name])
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    if done.returncode:
        return {"name": name, "mebibytes": None, "seconds": None, "error": done.stderr.strip().splitlines()[-1]}
    memory, seconds = map(float, done.stdout.split())
    return {"name": name, "mebibytes": memory, "seconds": seconds, "error": ""}


def main() -> int:
    """Print the table; 1 when a bound is missed."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--samples", type=int, default=1_000_000)
    asked.add_argument("--only", default="", help="names that hold this")
    asked.add_argument("--json", type=Path)
    chosen = asked.parse_args()
    rows = []
    print("| estimator | MiB | s |\n| --- | --- | --- |")
    for name in [one for one in CALLS if chosen.only in one]:
        row = measured(name, chosen.samples)
        rows.append(row)
        figures = row["error"] if row["mebibytes"] is None else f"{row['mebibytes']:.0f} | {row['seconds']:.2f}"
        print(f"| {name} | {figures} |", flush=True)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(any(row["mebibytes"] is None or row["mebibytes"] > LIMIT_MIB for row in rows))


if __name__ == "__main__":
    sys.exit(main())
