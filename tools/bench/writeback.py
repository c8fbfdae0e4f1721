"""Write-back in the rig: physics hidden in the plant, the daemon without and with a model file that names it.

python tools/bench/writeback.py [--seeds N] [--only NAME ...] [--alarms N] [--by-hand] [--json FILE] [--figure FILE]

Every run is the whole daemon in lock-step: the ball is let go at 0.4 rad, comes to rest, and follows steps of the
reference from the sixth second on. Judged by the plant's true state. `--alarms N`: how often half a minute of a rig
without hidden physics raises `model_drift` (N seeds, other phases of the camera and other references), and how often
one with it does.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from hoopd.commands.diagnose import outcome_of
from hoopd.daemon.app import Options, run_daemon
from hoopd.diagnose.report_curves import MissingForce
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_model import load_plant_model
from hoopd.plots import style
from hoopd.recording.mcap import read_run
from hoopd.sim import truth

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "config"
# What a chain is measured on; the others by hand.
CHAIN = ("coulomb", "cogging", "imbalance", "latency")
# At these sizes a model without them is plainly wrong; 8 mN m is a hundredth of what the drive gives.
HIDDEN: dict[str, tuple[str, dict[str, tuple[float, str]]]] = {
    "coulomb": ("hoop.coulomb_friction", {"Fc": (0.008, "N m")}),
    "cogging": ("actuator.cogging", {"A": (0.007, "N m"), "n": (7.0, "-"), "phi": (0.4, "rad")}),
    "imbalance": ("hoop.imbalance", {"A": (0.008, "N m"), "phi": (0.7, "rad")}),
    "latency": ("camera.latency", {"d": (0.040, "s")}),
    "deadzone": ("actuator.deadzone", {"d": (0.006, "N m")}),
    "gain": ("actuator.torque_gain", {"k": (0.6, "-")}),
    "delay": ("actuator.delay", {"d": (0.030, "s")}),
}
TICK_S = 0.02
FOLLOW_S, STEP_S, STEP_RAD, END_S = 6.0, 3.0, 0.04, 30.0
# A step of the reference is over by then; what is left is the law's own error.
SETTLED_S = 1.5
Column = NDArray[np.float64]


@dataclass(frozen=True)
class Made:
    """One run: true state and reference at every tick."""

    t: Column
    psi: Column  # rad
    dtheta: Column  # rad/s
    reference: Column  # rad
    u: Column  # N m
    alarm_s: float | None

    @property
    def settled(self) -> NDArray[np.bool_]:
        """At rest, or long enough after a step."""
        since = np.where(self.t < FOLLOW_S, self.t - 0.5, (self.t - FOLLOW_S) % STEP_S)
        return np.asarray((since > SETTLED_S) & (self.t > 0.5))


def run(sets: Sequence[str], seed: int, *, seconds: float = END_S, steps: Sequence[float] | None = None) -> Made:
    """The daemon for so long."""
    sizes = steps if steps is not None else [STEP_RAD] * int((seconds - FOLLOW_S) / STEP_S)
    rows = [
        f"{{at_s: {FOLLOW_S + STEP_S * index}, name: reference, value: {(-1) ** index * size:.4f}}}"
        for index, size in enumerate(sizes)
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        own = (f"sim.commands=[{', '.join(rows)}]", f"sim.directory={folder}", "log.level=error")
        options = Options(True, None, (*own, *sets), seconds, folder, seed, "max", True)
        with contextlib.redirect_stdout(io.StringIO()):
            summary = run_daemon(options)
        state, recorded = truth.read(folder / "truth.csv"), read_run(folder / summary["recording"]["file"])
    count = min(len(state.t), len(recorded.ticks), round(seconds / TICK_S) - 1)
    alarms = [event.t for event in recorded.events if event.event == "model_drift"]
    reference, u = (np.array([getattr(tick, name) for tick in recorded.ticks[:count]]) for name in ("reference", "u"))
    return Made(state.t[:count], state.psi[:count], state.dtheta[:count], reference, u, alarms[0] if alarms else None)


def hide(name: str) -> str:
    """The rig's setting."""
    effect, numbers = HIDDEN[name]
    told = ", ".join(f"{key}: {value}" for key, (value, _) in numbers.items())
    return f"sim.effects=[{{name: {effect}, parameters: {{{told}}}}}]"


def written_back(name: str, folder: Path) -> str:
    """The setting of a model file that names the effect."""
    effect, numbers = HIDDEN[name]
    parameters = {key: Parameter(value=value, unit=unit) for key, (value, unit) in numbers.items()}
    model = msgspec.structs.replace(
        load_model(CONFIG / "models" / "hoop.yaml"), effects=[EffectEntry(name=effect, parameters=parameters)]
    )
    path = folder / f"{name}.yaml"
    path.write_text(model_text(model), encoding="utf-8")
    return f"device.model={path}"


@dataclass(frozen=True)
class Chain:
    """What the commands made of one recording."""

    diagnosis: dict[str, Any]
    found: str  # the setting of the controller for the model with what was named
    fitted: str | None  # the same with the parameters alone fitted; None: no controller was to be had
    steps: dict[str, int]  # command -> exit code


def command(folder: Path, *words: str, may_fail: bool = False) -> int:
    """One `hoopd` command as a user types it, in its folder."""
    done = subprocess.run(
        [sys.executable, "-m", "hoopd", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=900.0,
    )
    if done.returncode and not may_fail:
        raise SystemExit(f"hoopd {' '.join(words)}: {done.returncode}: {done.stderr.strip().splitlines()[-1]}")
    return done.returncode


def chained(name: str, seed: int, folder: Path) -> Chain:
    """Record from the rig, diagnose, design; and beside it: fit the parameters alone, design."""
    rig = ("--sim", "--speed", "max", "--camera", "direct", "--seed", str(seed))
    model, steps = ("--model", "models/hoop.yaml"), {}
    # the daemon's own checks may end it early (a camera that is 40 ms late looks implausible): the recording is whole
    steps["experiment"] = command(
        folder, "experiment", "prbs", *rig, "--set", hide(name), "--out", "rec.mcap", may_fail=True
    )
    steps["diagnose"] = command(
        folder,
        "diagnose",
        "rec.mcap",
        *model,
        "--json",
        "found.json",
        "--write",
        "found.yaml",
        "--yes",
        "--report",
        "found.html",
    )
    steps["design"] = command(folder, "design", "lqg", "--model", "found.yaml", "--out", "lqg.yaml")
    steps["fit"] = command(
        folder, "fit", "rec.mcap", "--structure", "rolling", *model, "--out", "fitted.yaml", may_fail=True
    )
    steps["design fitted"] = command(
        folder, "design", "lqg", "--model", "fitted.yaml", "--out", "fitted_lqg.yaml", may_fail=True
    )
    fitted = folder / "fitted_lqg.yaml"
    return Chain(
        json.loads((folder / "found.json").read_text()),
        f"control.file={folder / 'lqg.yaml'}",
        f"control.file={fitted}" if fitted.exists() else None,
        steps,
    )


def named(name: str, chain: Chain) -> list[dict[str, Any]]:
    """What was named: numbers, intervals, and the truth beside them."""
    effect, numbers = HIDDEN[name]
    rows = []
    for one in chain.diagnosis["effects"]:
        true = numbers if one["name"] == effect else {}
        for key, quantity in one["parameters"].items():
            if "@" not in key:
                truth_value = true.get(key, (None, ""))[0]
                rows.append({"effect": one["name"], "parameter": key, "true": truth_value, **quantity})
    return rows


def rms(values: Column) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def judged(made: Made, healthy: Made) -> dict[str, float]:
    """Errors of one run; `healthy`: the same seed on the plant that the base model describes."""
    n = min(len(made.t), len(healthy.t))
    error = made.psi - made.reference
    return {
        "psi_mrad": 1e3 * rms(error),
        "psi_settled_mrad": 1e3 * rms(error[made.settled]),
        "psi_off_mrad": 1e3 * rms(made.psi[:n] - healthy.psi[:n]),
        "dtheta_off_rad_s": rms(made.dtheta[:n] - healthy.dtheta[:n]),
        "torque_mnm": 1e3 * rms(made.u),
    }


def compared(names: Sequence[str], seeds: int) -> dict[str, Any]:
    """Means over seeds by effect: the base model, the model file with the effect, and the plant without it."""
    found: dict[str, Any] = {}
    healthy = [run((), seed) for seed in range(seeds)]
    found["nothing hidden"] = {"base": _mean([judged(one, one) for one in healthy])}
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            known = written_back(name, Path(folder))
            rows = [
                (judged(run((hide(name),), seed), good), judged(run((hide(name), known), seed), good))
                for seed, good in enumerate(healthy)
            ]
        found[name] = {"base": _mean([row[0] for row in rows]), "written back": _mean([row[1] for row in rows])}
    return found


def through_chain(names: Sequence[str], seeds: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Errors by effect as in `compared`, of the controllers that the commands made; and what they named, by seed."""
    errors: dict[str, Any] = {}
    found: dict[str, Any] = {}
    healthy = [run((), seed) for seed in range(seeds)]
    errors["nothing hidden"] = {"base": _mean([judged(one, one) for one in healthy])}
    for name in names:
        rows: dict[str, list[dict[str, float]]] = {}
        for seed, good in enumerate(healthy):
            with tempfile.TemporaryDirectory() as folder:
                chain = chained(name, seed, Path(folder))
                found.setdefault(name, []).append({"named": named(name, chain), "exit": chain.steps})
                settings = {"base": (), "fitted": chain.fitted, "written back": chain.found}
                for which, setting in settings.items():
                    if setting is not None:
                        own = (setting,) if isinstance(setting, str) else setting
                        rows.setdefault(which, []).append(judged(run((hide(name), *own), seed), good))
        errors[name] = {which: _mean(each) for which, each in rows.items()}
        show({name: errors[name]})
        show_named({name: found[name]})
    return errors, found


def _mean(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def alarms(count: int, names: Sequence[str]) -> dict[str, Any]:
    """Runs of a minute that raise `model_drift`: without hidden physics, and with each."""

    def raised(sets: Sequence[str], seed: int) -> bool:
        rng = np.random.default_rng(seed)
        # one run in three stays at rest
        steps = [] if seed % 3 == 2 else rng.uniform(0.2, 1.0, 18) * STEP_RAD
        return (
            run((f"sim.camera_phase={rng.uniform():.3f}", *sets), seed, seconds=60.0, steps=steps).alarm_s is not None
        )

    found: dict[str, Any] = {"nothing hidden": [sum(raised((), seed) for seed in range(count)), count]}
    few = [seed for seed in range(count) if seed % 3 != 2][: max(3, count // 5)]
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            known = written_back(name, Path(folder))
            found[name] = [sum(raised((hide(name),), seed) for seed in few), len(few)]
            found[f"{name}, written back"] = [sum(raised((hide(name), known), seed) for seed in few), len(few)]
    return found


def draw(name: str, path: Path) -> None:
    """What the diagnosis saw, and the ball's error without and with it in the model."""
    with tempfile.TemporaryDirectory() as folder:
        chain = chained(name, 0, Path(folder))
        force = missing_force(Path(folder) / "rec.mcap", HIDDEN[name][0])
        runs = {"model without it": run((hide(name),), 0), "written back": run((hide(name), chain.found), 0)}
    figure = style.figure(9.0, 3.6, columns=2, title=f"{HIDDEN[name][0]} hidden in the rig: found, and written back")
    _draw_force(figure.axes[0], force)
    for (label, made), colour in zip(runs.items(), (style.VERMILION, style.BLUE), strict=True):
        error = 1e3 * (made.psi - made.reference)
        figure.axes[1].plot(made.t, error, color=colour, linewidth=1.0, label=label)
    figure.axes[1].set(xlim=(0.0, END_S), ylim=(-90.0, 110.0))
    style.labelled(figure.axes[1], "t in s", "ball psi less its reference in mrad")
    style.legend(figure.axes[1], loc="upper right", ncols=2)
    style.save(figure, path)


def missing_force(recording: Path, effect: str) -> MissingForce:
    """The smoothed force that the model without the effect lacks, with the named law."""
    outcome = outcome_of([str(recording)], [], load_plant_model(CONFIG / "models" / "hoop.yaml"))
    return next(
        one for one in outcome.shown.forces if any(r.law is not None and effect in r.law.label for r in one.regressors)
    )


def _draw_force(axes: Axes, force: MissingForce) -> None:
    over = next(one for one in force.regressors if one.law is not None)
    assert over.law is not None
    axes.plot(over.value, 1e3 * force.value, ".", color="0.75", markersize=2.5, label="smoothed, every sample")
    if over.binned is not None:
        low, high = over.binned.mean - over.binned.low, over.binned.high - over.binned.mean
        axes.errorbar(over.binned.x, 1e3 * over.binned.mean, 1e3 * np.array([low, high]), fmt="o", color="black",
                      markersize=3, markerfacecolor="white", linewidth=0.8, label="means with 95 %")  # fmt: skip
    axes.plot(over.law.x, 1e3 * over.law.y, label=over.law.label)
    style.labelled(axes, f"{over.name} in {over.unit}", f"missing in slot {force.slot}, m{force.unit}")
    style.legend(axes, loc="upper right")


def show(found: dict[str, Any]) -> None:
    """The table."""
    head = ("psi-r rms", "settled", "psi off", "dtheta off", "torque")
    print(f"{'':16}{'':14}" + "".join(f"{one:>12}" for one in head))
    for name, rows in found.items():
        for which, row in rows.items():
            units = zip(row.values(), ("mrad", "mrad", "mrad", "rad/s", "mN m"), strict=True)
            print(f"{name:16}{which:14}" + "".join(f"{value:7.2f} {unit:4}" for value, unit in units))


def show_named(found: dict[str, Any]) -> None:
    """Values against the truth."""
    for name, seeds in found.items():
        for seed, one in enumerate(seeds):
            print(f"{name:16}seed {seed}: exit codes {one['exit']}")
            for row in one["named"]:
                ci = "-" if row["ci95"] is None else "{:.5g} to {:.5g}".format(*row["ci95"])
                value = f"{row['value']:.5g} {row['unit']} ({ci}); true {row['true']}"
                print(f"{'':16}{row['effect']}.{row['parameter']} = {value}")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=HIDDEN, default=None)
    parser.add_argument("--alarms", type=int, default=0)
    parser.add_argument("--by-hand", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    found: dict[str, Any] = {}
    names = options.only or (list(HIDDEN) if options.alarms or options.by_hand else list(CHAIN))
    if options.alarms:
        found["alarms"] = alarms(options.alarms, names)
        for name, (count, of) in found["alarms"].items():
            print(f"{name:28} {count:3} of {of:3} raise model_drift")
    elif options.by_hand:
        found["errors"] = compared(names, options.seeds)
        show(found["errors"])
    elif options.figure is None:
        found["errors"], found["named"] = through_chain(names, options.seeds)
    if options.figure is not None:
        draw(names[0], options.figure)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
