"""Claimed standard errors beside the spread of many estimates, with outputs missing; and how often bands hold.

python tools/bench/ident_errors.py [--runs 1000] [--gaps 0,5,20] [--only armax] [--samples 800] [--json FILE]

Every estimator gets data of the structure that it is made for. Printed: the claimed error over the spread, least and
largest over the coefficients (of state space, whose coefficients are a choice of basis: over the gain at six
frequencies); the bias in spreads, the largest; the share of 95 % bands of the gain that hold the true one. With fewer
runs a ratio is known to 1/sqrt(2 runs). Exit code 1 when a ratio lies outside of 0.9 to 1.1 or a share outside of 93 to
97 %, each by more than two of its own standard errors; what an estimator refuses to do it has no errors of.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy import signal  # noqa: E402

from hoopd.ident import (  # noqa: E402
    Data,
    ararx,
    armax,
    arx,
    bj,
    iddata,
    oe,
    pem,
    response_spread,
    subspaceid,
)  # fmt: skip

Array = NDArray[np.float64]
A, B, C, D = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -1.0, 0.2], [1.0, -0.5]
NOISE = 0.5
W = np.array([0.05, 0.2, 0.4, 0.6, 1.0, 2.0])
# Samples before the record begins.
BEFORE = 100


class Case(NamedTuple):
    """Noise's numerator and denominator, the estimator, the true coefficients (None: of state space)."""

    noise: tuple[list[float], list[float]]
    fit: Callable[[Data], Any]
    true: list[float] | None


CASES = {
    "arx": Case(([1.0], A), lambda d: arx(d, 2, 2), [*A[1:], *B[1:]]),
    "armax": Case((C, A), lambda d: armax(d, 2, 2, 2), [*A[1:], *B[1:], *C[1:]]),
    "ararx": Case(([1.0], list(np.convolve(A, D))), lambda d: ararx(d, 2, 2, 1), [*A[1:], *B[1:], *D[1:]]),
    "oe": Case(([1.0], [1.0]), lambda d: oe(d, 2, 2), [*B[1:], *A[1:]]),
    "bj": Case(([1.0, 0.6], [1.0, -0.8]), lambda d: bj(d, 2, 1, 1, 2), [*B[1:], 0.6, -0.8, *A[1:]]),
    "pem": Case((C, A), lambda d: pem(d, 2), None),
    "subspaceid": Case((C, A), lambda d: subspaceid(d, 2), None),
    "subspaceid, refined": Case((C, A), lambda d: subspaceid(d, 2, refine=3), None),
}  # fmt: skip


def data(case: Case, samples: int, missing: float, seed: int) -> Data:
    """A record with a share of its outputs missing."""
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, samples + BEFORE))
    y = signal.lfilter(B, A, u) + signal.lfilter(*case.noise, NOISE * e)
    y[rng.random(len(y)) < missing] = np.nan
    return iddata(y[BEFORE:], u[BEFORE:])


def measured(name: str, missing: float, runs: int, samples: int) -> dict[str, Any]:
    """One row."""
    case, values, claimed, inside = CASES[name], [], [], []
    truth = np.abs(signal.freqz(B, A, W)[1])
    for seed in range(runs):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                model = case.fit(data(case, samples, missing, seed))
            except ValueError as error:
                return {"estimator": name, "missing": missing, "runs": 0, "refused": str(error)}
            band = response_spread(model, W)
        if band is None:
            return {"estimator": name, "missing": missing, "runs": 0, "refused": "no standard errors"}
        gain, spread = np.abs(band.h[:, 0, 0]), band.gain[:, 0, 0]
        inside.append(np.abs(gain - truth) < 1.96 * spread * gain)
        values.append(gain if case.true is None else model.values)
        claimed.append(spread * gain if case.true is None else list(model.deviations().values()))
    spread = np.std(values, axis=0)
    ratio = np.sqrt(np.mean(np.square(claimed), axis=0)) / spread
    bias = (np.mean(values, axis=0) - (truth if case.true is None else case.true)) / spread
    return {
        "estimator": name, "missing": missing, "runs": runs, "least": float(ratio.min()), "largest": float(ratio.max()),
        "bias": float(np.abs(bias).max()), "held": float(np.mean(inside)),
    }  # fmt: skip


def late(row: dict[str, Any]) -> bool:
    """Whether a bound is missed by more than chance."""
    if not row["runs"]:
        return False
    chance, share = 2.0 / np.sqrt(2.0 * row["runs"]), 2.0 * np.sqrt(0.05 * 0.95 / row["runs"])
    return bool(
        row["least"] < 0.9 - chance or row["largest"] > 1.1 + chance
        or not 0.93 - share < row["held"] < 0.97 + share
    )  # fmt: skip


def main() -> int:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--runs", type=int, default=1000)
    asked.add_argument("--gaps", default="0,5,20", help="percent of the outputs that are missing")
    asked.add_argument("--only", default="", help="estimators whose name begins so")
    asked.add_argument("--samples", type=int, default=800)
    asked.add_argument("--json", type=Path)
    chosen = asked.parse_args()
    rows = []
    print("| estimator | missing, % | runs | claimed/spread | largest bias, spreads | 95 % bands that hold, % |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in [one for one in CASES if one.startswith(tuple(chosen.only.split(",")))]:
        for percent in map(float, chosen.gaps.split(",")):
            rows.append(row := measured(name, percent / 100.0, chosen.runs, chosen.samples))
            told = f"{row['refused']} | - | -" if not row["runs"] else (
                f"{row['least']:.2f}-{row['largest']:.2f} | {row['bias']:.2f} | {100.0 * row['held']:.1f}"
            )  # fmt: skip
            print(f"| {name} | {percent:g} | {row['runs']} | {told}{' *' * late(row)} |", flush=True)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(any(map(late, rows)))


if __name__ == "__main__":
    sys.exit(main())
