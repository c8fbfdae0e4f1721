"""The identification toolbox beside its peers on the same data: milliseconds, and how near the true model it comes.

python tools/bench/ident_speed.py [--runs 5] [--seed 0] [--samples 1000000] [--json FILE]

Data sets: arx2 (10,000 samples), armax2, oe2 (5,000), mimo4 and mimo4k (2 in, 3 out, 5,000);
`harness.identcriteria.sets` and `.statespacesets` say what they are. Times are medians after a first call, one thread
of linear algebra, the methods in turn, so that a busy machine is busy for all. GNU Octave with its control package is
asked where it is installed. A reference in numpy (ARX by an orthogonal triangle with its covariance, output error by
Gauss-Newton steps) does the algebra alone: no check, no warning. Its ratio to ours is told for the whole call, and of
ARX for the regression alone. The memory is the largest resident set of a process that makes `--samples` samples and
fits an ARX model to them. Exit code 1 when a bound is missed: a busy machine may.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

# one thread of linear algebra; before numpy is loaded
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import numpy as np  # noqa: E402
from harness.identcriteria import sets, statespacesets  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.io import savemat  # noqa: E402
from scipy.signal import lfilter  # noqa: E402

from hoopd.ident import Data, armax, arx, oe, predict, subspaceid  # noqa: E402
from hoopd.ident.polynomial.regression import least_regression  # noqa: E402
from hoopd.ident.polynomial.structure import structure  # noqa: E402
from hoopd.ident.statespace import nonlinear  # noqa: E402

Array = NDArray[np.float64]
# Seconds that a peer's process may take.
PEER_S = 300.0
LIMIT_MIB, LIMIT_POINTS = 500.0, 0.06
OCTAVE = """
pkg load control; d = load("DATA"); dat = iddata(d.y, d.u, 1); ms = zeros(RUNS + 1, 1);
for k = 1:RUNS + 1
  tic; CALL; ms(k) = 1000 * toc;
end
printf("%.6g\\n", median(ms(2:end)));
"""


class Task(NamedTuple):
    """One data set and how it is asked: ours, the plain algebra, Octave's."""

    name: str
    method: str
    data: Data
    ours: Callable[[], Any]
    limit_ms: float
    octave: str
    judged: Callable[[Any], float]  # parameter error, or one-step points below the true model
    measure: str


def tasks(seed: int) -> list[Task]:
    """The bars."""
    found = []
    for name, (data, true), method, fit, limit_ms, octave in (
        ("arx2", sets.arx2(seed=seed), "arx", lambda d: arx(d, 2, 2), 1.0, "arx(dat, 'na', 2, 'nb', 2)"),
        ("armax2", sets.armax2(seed=seed), "armax", lambda d: armax(d, 2, 2, 2), 10.0, "moen4(dat, 2, 's', 10)"),
        ("oe2", sets.oe2(seed=seed), "oe", lambda d: oe(d, 2, 2), 10.0, "moen4(dat, 2, 's', 10)"),
    ):
        found.append(Task(
            name, method, data, lambda d=data, f=fit: f(d), limit_ms, octave,
            lambda m, t=true: float(np.linalg.norm(m.values - t) / np.linalg.norm(t)), "parameter error",
        ))  # fmt: skip
    for name, gain in (("mimo4", False), ("mimo4k", True)):
        own, both, truth = statespacesets.mimo_set(seed, gain=gain)
        found.append(Task(
            name, "subspaceid", own, lambda d=own: subspaceid(d, 4), 20.0, "moen4(dat, 4, 's', 10)",
            lambda m, b=both, t=truth, n=own.n: _below(m, b, t, n), "points below the true model",
        ))  # fmt: skip
    return found


def _below(model: Any, both: Data, truth: Any, n: int) -> float:
    """One-step fit of the validation half: the true model's less the model's."""
    best, own = (statespacesets.fit_percent(both.y[n:], predict(m, both)[n:]) for m in (truth, model))
    return best - own


def by_algebra(data: Data) -> Array:
    """Least squares of the same regressors and nothing else: what no ARX estimate can be faster than."""
    y, u = data.y[:, 0], data.u[:, 0]
    x = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]])
    return np.linalg.solve(x.T @ x, x.T @ y[2:])


def by_triangle(data: Data) -> Array:
    """The same by the orthogonal triangle of regressors and outputs, with the variance and covariance."""
    y, u = data.y[:, 0], data.u[:, 0]
    r = np.linalg.qr(np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2], y[2:]]), mode="r")
    inverse = np.linalg.inv(r[:4, :4])
    return inverse @ r[:4, 4] + 0.0 * np.diag(r[4, 4] ** 2 * inverse @ inverse.T)


def by_gauss_newton(data: Data) -> Array:
    """Output error of order 2 in plain numpy and scipy: filtered signals, their lags, least squares, until it stays."""
    y, u = data.y[:, 0], data.u[:, 0]
    a1, a2, b1, b2 = by_algebra(data)
    x = np.array([b1, b2, a1, a2])
    for _ in range(30):
        f = np.concatenate([[1.0], x[2:]])
        w = lfilter([0.0, *x[:2]], f, u)
        change = [np.concatenate([np.zeros(k), lfilter([1.0], f, one)[:-k]]) for one in (u, -w) for k in (1, 2)]
        step = np.linalg.lstsq(np.column_stack(change), y - w, rcond=None)[0]
        x = x + step
        if np.linalg.norm(step) < 1e-8 * np.linalg.norm(x):
            break
    return x


# What each method is asked beside, in plain numpy: "algebra" is a floor, "numpy" the reference that ours is to beat.
REFERENCES: dict[str, dict[str, Callable[[Data], Array]]] = {
    "arx": {
        "algebra": by_algebra,
        "numpy": by_triangle,
        "core": lambda data: least_regression([data], structure(1, 2, 2), 0.0).values,
    },
    "oe": {"numpy": by_gauss_newton},
}


def timed(ask: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds of one call, and what it gave."""
    start = time.perf_counter()
    found = ask()
    return 1e3 * (time.perf_counter() - start), found


def measured(seed: int, runs: int) -> list[dict[str, Any]]:
    """One row a task; the methods take turns."""
    rows = []
    for task in tasks(seed):
        references = REFERENCES.get(task.method, {})
        asked = {"ours": task.ours} | {name: partial(ask, task.data) for name, ask in references.items()}
        first = {name: timed(ask)[1] for name, ask in asked.items()}
        ms = {name: [] for name in asked}
        for _ in range(runs):
            for name, ask in asked.items():
                ms[name].append(timed(ask)[0])
        rows.append({
            "set": task.name, "method": task.method, "ms": statistics.median(ms["ours"]), "bound_ms": task.limit_ms,
            "algebra_ms": statistics.median(ms["algebra"]) if "algebra" in ms else None,
            "numpy_ms": statistics.median(ms["numpy"]) if "numpy" in ms else None,
            "core_ms": statistics.median(ms["core"]) if "core" in ms else None,
            "octave": task.octave.partition("(")[0], "octave_ms": octave_ms(task, runs),
            "measure": task.measure, "value": task.judged(first["ours"]),
        })  # fmt: skip
        print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return rows


def octave_ms(task: Task, runs: int) -> float | None:
    """Median of the peer's call in a process of its own; None where it is not installed or has no such answer."""
    program = shutil.which("octave-cli")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.mat"
        savemat(path, {"y": task.data.y, "u": task.data.u})
        code = OCTAVE.replace("DATA", str(path)).replace("RUNS", str(runs)).replace("CALL", f"m = {task.octave}")
        done = subprocess.run(
            [program, "--no-gui", "--norc", "--quiet", "--eval", code],
            capture_output=True, text=True, check=False, timeout=PEER_S,
        )  # fmt: skip
    last = done.stdout.split()
    return float(last[-1]) if done.returncode == 0 and last else None


def grey_box_s(seed: int, runs: int) -> dict[str, float]:
    """Medians of a fit of four tanks by the graph of the filter and sample by sample, in turn."""
    data, start = statespacesets.tank_data(seed), np.array([1.4, 1.4, 5.1, 0.25])
    own = nonlinear.filter_graph
    seconds: dict[str, list[float]] = {"graph": [], "samples": []}
    for _ in range(runs):
        for name, graph in (("graph", own), ("samples", lambda *_: None)):
            nonlinear.filter_graph = graph
            ask = partial(
                nonlinear.nonlinear_pem, data, statespacesets.tank_step, statespacesets.tank_levels, start,
                statespacesets.TANK_START / 2.0, process=1e-4, measurement=1e-2, spread=1.0, bounds=(0.01, 10.0),
            )  # fmt: skip
            seconds[name].append(timed(ask)[0] / 1e3)
    nonlinear.filter_graph = own
    return {name: statistics.median(each) for name, each in seconds.items()}


def mebibytes(samples: int) -> float:
    """Largest resident set of a process that fits an ARX model to so many samples."""
    code = (
        f"import resource, sys; sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / 'tools')!r}]\n"
        "from harness.identcriteria import sets; from hoopd.ident import arx\n"
        f"arx(sets.arx2({samples})[0], 2, 2)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PEER_S)
    return float(done.stdout)


def shown(rows: list[dict[str, Any]]) -> None:
    """The table."""
    print("| set | method | ms | bound | algebra alone, ms | numpy's, ms (ratio) | Octave, ms | what it comes to |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for row in rows:
        algebra = "-" if row["algebra_ms"] is None else f"{row['algebra_ms']:.2f}"
        peer = "-" if row["octave_ms"] is None else f"{row['octave_ms']:.1f} ({row['octave']})"
        numpy_ms = row["numpy_ms"]
        reference = "-" if numpy_ms is None else f"{numpy_ms:.2f} ({numpy_ms / row['ms']:.2f})"
        if row["core_ms"] is not None:
            reference += f", regression alone {numpy_ms / row['core_ms']:.2f}"
        own, value = f"{row['ms']:.2f} | {row['bound_ms']:g}", f"{row['value']:.4f} {row['measure']}"
        print(f"| {row['set']} | {row['method']} | {own} | {algebra} | {reference} | {peer} | {value} |")


def main() -> int:
    """Print the table; 1 when a bound is missed."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--runs", type=int, default=5)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--samples", type=int, default=1_000_000)
    asked.add_argument("--json", type=Path)
    chosen = asked.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = measured(chosen.seed, chosen.runs)
        tanks = grey_box_s(chosen.seed, min(chosen.runs, 3))
    memory = mebibytes(chosen.samples)
    shown(rows)
    print(f"\nARX of {chosen.samples:,} samples: {memory:.0f} MiB with data and libraries (bound {LIMIT_MIB:g})")
    print(f"Grey box of four tanks: {tanks['graph']:.2f} s, sample by sample {tanks['samples']:.2f} s "
          f"({tanks['samples'] / tanks['graph']:.1f} times as long)")  # fmt: skip
    if chosen.json is not None:
        chosen.json.write_text(json.dumps({"rows": rows, "mebibytes": memory, "tanks": tanks}, indent=1) + "\n")
    late = [row for row in rows if row["ms"] > row["bound_ms"] or (row["numpy_ms"] or np.inf) < row["ms"]]
    far = [row for row in rows if row["method"] == "subspaceid" and row["value"] > LIMIT_POINTS]
    return 1 if late or far or memory > LIMIT_MIB else 0


if __name__ == "__main__":
    sys.exit(main())
