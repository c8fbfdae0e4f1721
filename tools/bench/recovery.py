"""Known parameters found again: fits of rig recordings over many seeds, their errors and what their intervals cover.

python tools/bench/recovery.py [--seeds 1000] [--seconds 10] [--alternate] [--pictures] [--json FILE]

Every seed is a whole run of `hoopd experiment prbs` in lock-step (bytes, board, encoder counts, camera noise, two
frames of delay), another signal and other noise, recorded, read again and fitted as `hoopd fit` does: `entries` from
the entries of the thesis, and `rolling` from values up to twice as large, with masses, radii and gravity as weighed and
measured. `--alternate` fits one of the two in turn; `--pictures` renders and analyses every picture, so that the
camera's own error is inside. Exit code 1 when a bound is missed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the processes share the cores

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from hoopd.core.controllers import DONE  # noqa: E402
from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.experiment import run  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.ident.normal import Z95  # noqa: E402
from hoopd.plants.hoop.fitting.fit import FitSettings, fit  # noqa: E402
from hoopd.plants.hoop.loop.experiment_plan import Plan  # noqa: E402
from hoopd.plants.model_file import load_model, plant_of  # noqa: E402
from hoopd.recording.mcap import read  # noqa: E402
from hoopd.recording.recording import Recording  # noqa: E402

Array = NDArray[np.float64]

MODELS = ROOT / "config" / "models"
STRUCTURES = ("entries", "rolling")
WEIGHED = ("mb", "Ro", "Rb", "g")
# Far enough from the truth that nobody calls the start the answer.
ROLLING_START = {"Ib": 2e-6, "Ih": 1e-3, "bb": 1e-6, "bh": 2e-3}
ENTRIES = {"J11": (1, 1), "J12": (1, 3), "K1": (1, 2), "J21": (3, 1), "J22": (3, 3), "K2": (3, 2)}
# An error is small when it is below this share of the value, or below two standard errors; this many must be.
SMALL, LEAST_SMALL = 0.02, 0.95
# What the intervals must cover: many seeds tell it to 0.7 %, few to 1.5 %.
MANY = 1000
COVERAGE_OF_MANY, COVERAGE_OF_FEW = (0.93, 0.97), (0.90, 0.985)


class Found(NamedTuple):
    """A parameter of one fit."""

    value: float
    low: float
    high: float


class Result(NamedTuple):
    """One seed: what its experiment ended with, and the fits by structure and parameter."""

    outcome: str
    fits: dict[str, dict[str, Found]]


@cache
def truth() -> dict[str, dict[str, float]]:
    """The rig's own parameters: physical, and as entries (the linear model at rest)."""
    model = load_model(MODELS / "hoop.yaml")
    a, b = plant_of(model).linearize()
    entries = {name: float(a[place]) for name, place in ENTRIES.items()} | {"L1": b[1, 0], "L2": b[3, 0]}
    return {"entries": entries, "rolling": {name: model.values()[name] for name in ROLLING_START}}


@cache
def starts() -> dict[str, tuple[dict[str, float], FitSettings]]:
    """What each fit begins with."""
    rig = load_model(MODELS / "hoop.yaml").values()
    fixed = {name: rig[name] for name in WEIGHED}
    return {
        "entries": (load_model(MODELS / "thesis.yaml").values(), FitSettings("entries")),
        "rolling": ({**rig, **ROLLING_START}, FitSettings("rolling", fixed=fixed)),
    }


# The model holds each torque from one request to the next; a board that ramps it (0.7 N m/ms) is another physics, which
# costs 0.012 % of L1 and 3 % of the small J12, and intervals of these experiments tell as little as that.
HELD = "sim.board.slew_nm_per_ms=1000"


def recorded(seed: int, seconds: float, *, pictures: bool) -> tuple[Recording, str]:
    """A run of the rig and how it ended."""
    options = Options(sim=True, sets=("log.level=error", HELD), seed=seed, speed="max", direct=not pictures)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
        told = run(Plan("prbs", seconds, seed=seed), options, Where(folder=Path(folder)))
        return read(Path(told["file"])), str(told["outcome"])


def recovered(seed: int, *, seconds: float, pictures: bool, alternate: bool) -> Result:
    """One seed's fits."""
    recording, outcome = recorded(seed, seconds, pictures=pictures)
    chosen = (STRUCTURES[seed % 2],) if alternate else STRUCTURES
    return Result(outcome, {structure: fitted(recording, structure) for structure in chosen})


def fitted(recording: Recording, structure: str) -> dict[str, Found]:
    """One fit."""
    nominal, settings = starts()[structure]
    found = fit([recording], nominal, settings)
    return {name: Found(found.values[name], *both) for name, both in found.intervals.items()}


def results(seeds: int, processes: int, **how: Any) -> list[Result]:
    """All seeds, in their order."""
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        found = pool.map(partial(recovered, **how), range(seeds), chunksize=2)
        console = Console(stderr=True)
        return list(track(found, "seeds", seeds, console=console, disable=not console.is_terminal))


class Row(NamedTuple):
    """A parameter over all seeds; errors as shares of the true value."""

    structure: str
    name: str
    fits: int
    bias: float
    spread: float  # standard deviation of the error
    claimed: float  # median of the standard errors
    largest: float
    small: float  # share of errors below 2 % or two standard errors
    coverage: float
    coverage_se: float


def rows(found: list[Result]) -> Iterator[Row]:
    """The table, for each structure its parameters and `all`."""
    for structure in STRUCTURES:
        fits = [one.fits[structure] for one in found if structure in one.fits]
        if not fits:
            continue
        true = truth()[structure]
        parts = {name: _errors(np.array([one[name] for one in fits]), true[name]) for name in fits[0]}
        yield from (_row(structure, name, part) for name, part in parts.items())
        # parameters of one fit err together: the scatter over the seeds tells how well their mean is known
        each = np.mean([part.inside for part in parts.values()], axis=0)
        error = np.concatenate([part.error for part in parts.values()])
        small = float(np.mean([part.small for part in parts.values()]))
        se = float(np.std(each) / math.sqrt(len(each)))
        nan, largest = math.nan, float(np.abs(error).max())
        yield Row(structure, "all", len(fits), nan, nan, nan, largest, small, float(each.mean()), se)


class _Errors(NamedTuple):
    error: Array  # (n,) share of the true value
    claimed: Array  # (n,) standard error, the same
    small: NDArray[np.bool_]
    inside: NDArray[np.bool_]


def _errors(found: Array, true: float) -> _Errors:
    """Found (n, 3) values with their intervals against the truth."""
    value, low, high = found.T
    error, claimed = (value - true) / abs(true), (high - low) / (2 * Z95 * abs(true))
    small = np.abs(error) < np.maximum(SMALL, 2.0 * claimed)
    return _Errors(error, claimed, small, (low <= true) & (true <= high))


def _row(structure: str, name: str, part: _Errors) -> Row:
    error, n, coverage = part.error, len(part.error), float(part.inside.mean())
    return Row(
        structure,
        name,
        n,
        bias=float(error.mean()),
        spread=float(error.std()),
        claimed=float(np.median(part.claimed)),
        largest=float(np.abs(error).max()),
        small=float(part.small.mean()),
        coverage=coverage,
        coverage_se=math.sqrt(max(coverage * (1.0 - coverage), 0.25 / n) / n),
    )


def missed(table: list[Row], found: list[Result], *, pictures: bool) -> list[str]:
    """Bounds that were not kept, in words; each parameter's own coverage counts with many seeds."""
    early = [f"seed {seed} ended: {one.outcome}" for seed, one in enumerate(found) if one.outcome != DONE]
    wrong = [
        f"{row.structure} {row.name}: {row.small:.1%} of errors are small" for row in table if row.small < LEAST_SMALL
    ]
    if pictures:  # the camera's own error is in no interval
        return early + wrong
    for row in table:
        low, high = COVERAGE_OF_MANY if row.fits >= MANY else COVERAGE_OF_FEW
        judged = row.name == "all" or row.fits >= MANY
        if judged and not low <= row.coverage <= high:
            wrong.append(f"{row.structure} {row.name}: {row.coverage:.1%} covered, not {low:.1%} to {high:.1%}")
    return early + wrong


def show(table: list[Row]) -> None:
    """Print the table; errors in percent of the value."""
    out = Table(title="errors in percent of the true value")
    for head in ("structure", "", "fits", "bias", "spread", "claimed", "largest", "small", "covered", "+-"):
        out.add_column(head, justify="left" if head in ("structure", "") else "right")
    for row in table:
        errors = (f"{100 * value:.4f}" if math.isfinite(value) else "" for value in row[3:7])
        shares = (f"{100 * value:.2f}" for value in row[7:])
        out.add_row(row.structure, row.name, str(row.fits), *errors, *shares)
    Console(width=None if sys.stdout.isatty() else 120).print(out)


def main() -> int:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each experiment")
    parser.add_argument("--alternate", action="store_true", help="one structure a seed, in turn")
    parser.add_argument("--pictures", action="store_true", help="render and analyse every picture (ten times slower)")
    parser.add_argument("--processes", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    how = {"seconds": options.seconds, "pictures": options.pictures, "alternate": options.alternate}
    found = results(options.seeds, options.processes, **how)
    table = list(rows(found))
    show(table)
    failures = missed(table, found, pictures=options.pictures)
    for failure in failures:
        print(f"MISSED: {failure}")
    if options.json is not None:
        result = {**how, "seeds": options.seeds, "rows": [row._asdict() for row in table], "missed": failures}
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
