"""Loops at the first attempt on sealed rigs: planned on what was found, on re-fitted parameters, on the nominal model.

python tools/bench/maneuver.py [--rigs 100] [--first 0] [--arms found,refit,nominal] [--feasible-only] [--json FILE]

Every rig has all its parameters a tenth off and one or two effects of the library. It is recorded for 40 s
(multisine and prbs, lock-step, no pictures); `hoopd diagnose` and `hoopd fit` make a model each of that, `hoopd design
lqg` a law for the bottom on it, `hoopd trajectory loop` a plan; then the loop is played once. It counts when it
succeeds by the recording's judgement and, in the rig's own state, the contact was never lost. Rigs on which no loop can
be planned even with everything known are counted apart. With `--json` it goes on with the rigs that the file does not
have. It prints rates with their 95 % intervals (Clopper-Pearson) and
why the others failed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from concealed.proportions import rate  # noqa: E402
from sealedrigs.rigs import SealedRig, sealed_rig  # noqa: E402

from hoopd.commands.design import run as design  # noqa: E402
from hoopd.commands.diagnose import run as diagnose  # noqa: E402
from hoopd.commands.fit import run as fit  # noqa: E402
from hoopd.commands.options.design import DesignOptions  # noqa: E402
from hoopd.commands.options.diagnose import DiagnoseOptions  # noqa: E402
from hoopd.commands.options.fit import FitOptions  # noqa: E402
from hoopd.commands.options.trajectory import TrajectoryOptions  # noqa: E402
from hoopd.commands.trajectory import PlannedFile, planned  # noqa: E402
from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.experiment import run as experiment  # noqa: E402
from hoopd.daemon.maneuver import AskedManeuver, run as play  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.files.reading import InputError  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.plants.hoop.loop.experiment_plan import Plan  # noqa: E402
from hoopd.sim import truth  # noqa: E402

NOMINAL = defaults_folder() / "models" / "hoop.yaml"
SIGNALS, SIGNAL_S = ("multisine", "prbs"), 20.0
# A signal that was ended by its limits on a rig that nobody knows is played again, smaller.
SMALLER_NM = (None, 0.05, 0.025)


def recorded(rig: SealedRig, folder: Path) -> list[str]:
    """Forty seconds of the rig."""
    sets = (f"sim.model={folder / 'sealed.yaml'}", "log.level=error")
    files = []
    for kind in SIGNALS:
        for k, amplitude in enumerate(SMALLER_NM):
            path = folder / f"{kind}-{k}.mcap"
            options = Options(sim=True, sets=sets, seed=rig.seed, speed="max", direct=True)
            plan = Plan(kind, SIGNAL_S, amplitude, rig.seed)
            result = experiment(plan, options, Where(file=path))
            if result["outcome"] == "done" or amplitude == SMALLER_NM[-1]:
                files.append(str(path))
                break
    return files


def found(files: list[str], folder: Path) -> Path:
    """The model that the diagnosis writes; the nominal one where it finds nothing to write."""
    path = folder / "found.yaml"
    options = DiagnoseOptions(recordings=tuple(files), model=NOMINAL, write=path, yes=True, free_run=False)
    diagnose(options)
    return path if path.exists() else NOMINAL


def refitted(files: list[str], folder: Path) -> Path:
    """The nominal structure with parameters from the same recordings."""
    path = folder / "refit.yaml"
    fit(FitOptions(recordings=tuple(files), structure="rolling", method="prediction", model=NOMINAL, out=path))
    return path


def nominal(files: list[str], folder: Path) -> Path:
    """What the laboratory was told."""
    return NOMINAL


ARMS: dict[str, Callable[[list[str], Path], Path]] = {"found": found, "refit": refitted, "nominal": nominal}


@cache
def planned_nominally(kind: str) -> PlannedFile:
    """The same for all rigs."""
    return planned(TrajectoryOptions(kind=kind, model=NOMINAL))


def looped(rig: SealedRig, model: Path, folder: Path, arm: str) -> dict[str, Any]:
    """Plan on a model, play once on the rig; what became of it."""
    own = folder / arm
    own.mkdir()
    law = own / "lqg.yaml"
    try:
        design(DesignOptions(law="lqg", model=model, out=law))
        plan = planned_nominally("loop") if model == NOMINAL else planned(TrajectoryOptions(kind="loop", model=model))
    except (InputError, ValueError) as error:
        return {"success": False, "why": f"no plan: {str(error)[:80]}"}
    sets = (f"sim.model={folder / 'sealed.yaml'}", f"sim.directory={own}", f"control.file={law}", "log.level=error")
    options = Options(sim=True, sets=sets, seed=1000 + rig.seed, speed="max", direct=True)
    result = play(AskedManeuver(plan.file, "loop.yaml"), options, Where(file=own / "run.mcap"))
    contact = true_contact(own, rig)
    return {**judged(result, contact), "true_contact": contact, "faults": result["faults"]}


def judged(result: dict[str, Any], contact: float) -> dict[str, Any]:
    """Whether it was one, and else the first reason why not."""
    if not result["attempts"]:
        return {"success": False, "why": f"not begun: {result['outcome']}"}
    (attempt,) = result["attempts"]
    if attempt["success"] and contact > 0.0:
        return {"success": True, "why": ""}
    why = attempt["shortfalls"] or [attempt["ended"]]
    if attempt["ended"].startswith(("given up", "the mode")):
        why = [f"{attempt['ended']} ({result['outcome']})"]
    return {"success": False, "why": "the rig's contact was lost" if attempt["success"] else why[0]}


def true_contact(folder: Path, rig: SealedRig) -> float:
    """Least force between the rig's hoop and ball over the ball's weight."""
    state, p = truth.read(folder / "truth.csv"), rig.model().values()
    return float(np.min(((p["Ro"] - p["Rb"]) * state.dpsi**2 + p["g"] * np.cos(state.psi)) / p["g"]))


def feasible(folder: Path, kind: str = "loop") -> bool:
    """Whether one can be planned with everything known."""
    with contextlib.suppress(InputError, ValueError):
        planned(TrajectoryOptions(kind=kind, model=folder / "sealed.yaml"))
        return True
    return False


def run_rig(seed: int, arms: list[str], *, feasible_only: bool = False) -> dict[str, Any]:
    """One rig, all its arms."""
    return attempted(sealed_rig(seed), arms, "loop", looped, feasible_only=feasible_only)


def attempted(
    rig: SealedRig,
    arms: list[str],
    kind: str,
    attempt: Callable[[SealedRig, Path, Path, str], dict[str, Any]],
    *,
    feasible_only: bool = False,
) -> dict[str, Any]:
    """One rig recorded, and a maneuver of this kind attempted with the model of each arm; `feasible_only`: not on one
    where it cannot be planned with everything known."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        folder = Path(name)
        rig.write(folder / "sealed.yaml")
        row: dict[str, Any] = {"seed": rig.seed, "effects": rig.effects, "feasible": feasible(folder, kind), "arms": {}}
        tried = arms if row["feasible"] or not feasible_only else []
        files = recorded(rig, folder) if {*tried} - {"nominal"} else []
        for arm in tried:
            try:
                row["arms"][arm] = attempt(rig, ARMS[arm](files, folder), folder, arm)
            except (InputError, ValueError) as error:
                row["arms"][arm] = {"success": False, "why": f"no model: {str(error)[:80]}"}
    row["seconds"] = round(time.perf_counter() - began, 1)
    return row


def show(rows: list[dict[str, Any]], arms: list[str], kind: str = "loop") -> None:
    """Rates with intervals, and the reasons."""
    console = Console()
    able = [row for row in rows if row["feasible"]]
    without = len(rows) - len(able)
    console.print(f"{len(rows)} rigs, on {without} of them no {kind} can be planned with everything known")
    table = Table("planned on", f"{kind}s at the first attempt", "95 % interval", "of rigs without a plan")
    for arm in arms:
        told = rate(row["arms"][arm]["success"] for row in able)
        others = [row["arms"][arm]["success"] for row in rows if not row["feasible"] and arm in row["arms"]]
        interval = told["interval"] or (0.0, 1.0)
        ends = f"{100 * interval[0]:.0f} to {100 * interval[1]:.0f} %"
        table.add_row(arm, f"{told['k']} of {told['n']}", ends, f"{sum(others)} of {len(others)}")
    console.print(table)
    for arm in arms:
        for why, count in Counter(row["arms"][arm]["why"] for row in able).most_common():
            if why:
                console.print(f"{arm}: {count} x {why}", highlight=False)


def main() -> None:
    """Run the rigs one after another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first rig")
    parser.add_argument("--arms", default="found,refit,nominal")
    parser.add_argument("--feasible-only", action="store_true", help="attempt none that cannot be planned at all")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    arms = options.arms.split(",")
    rows = json.loads(options.json.read_text()) if options.json is not None and options.json.exists() else []
    known = {row["seed"] for row in rows}
    for seed in range(options.first, options.first + options.rigs):
        if seed in known:
            continue
        rows.append(run_rig(seed, arms, feasible_only=options.feasible_only))
        row = rows[-1]
        what = {arm: one["why"] or "looped" for arm, one in row["arms"].items()}
        print(f"rig {seed} ({', '.join(row['effects'])}) {row['seconds']} s: {what}", file=sys.stderr, flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=1))
    show(rows, arms)


if __name__ == "__main__":
    main()
