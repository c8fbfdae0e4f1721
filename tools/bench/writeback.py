"""Write-back in the rig: physics hidden in the plant, the daemon without and with a model file that names it.

python tools/bench/writeback.py [--seeds N] [--only NAME ...] [--alarms N] [--json FILE] [--figure FILE]

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
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.app import Options, run_daemon
from hoopd.modelfiles import EffectEntry, Parameter, load_model, model_text
from hoopd.recording.mcap import read_run
from hoopd.sim import truth

CONFIG = Path(__file__).resolve().parents[2] / "config"
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
    """Ball and hoop with the base model and with the effect written back."""
    from hoopd.plots import style

    with tempfile.TemporaryDirectory() as folder:
        runs = {
            "model without it": run((hide(name),), 0),
            "effect written back": run((hide(name), written_back(name, Path(folder))), 0),
        }
    figure = style.figure(7.0, 4.5, rows=2, sharex=True, title=f"{HIDDEN[name][0]} hidden in the rig")
    angle, speed = figure.axes
    for label, made in runs.items():
        angle.plot(made.t, made.psi, label=label)
        speed.plot(made.t, made.dtheta)
    angle.plot(made.t, made.reference, color="black", linewidth=0.8, label="reference")
    angle.set_ylim(-0.14, 0.14)
    angle.set_xlim(0.0, END_S)
    style.labelled(angle, "", "ball psi in rad")
    style.labelled(speed, "t in s", "hoop speed in rad/s")
    style.legend(angle, loc="upper right", ncols=3)
    style.save(figure, path)


def show(found: dict[str, Any]) -> None:
    """The table."""
    head = ("psi-r rms", "settled", "psi off", "dtheta off", "torque")
    print(f"{'':16}{'':14}" + "".join(f"{one:>12}" for one in head))
    for name, rows in found.items():
        for which, row in rows.items():
            units = zip(row.values(), ("mrad", "mrad", "mrad", "rad/s", "mN m"), strict=True)
            print(f"{name:16}{which:14}" + "".join(f"{value:7.2f} {unit:4}" for value, unit in units))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=HIDDEN, default=list(HIDDEN))
    parser.add_argument("--alarms", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    found: dict[str, Any] = {}
    if options.alarms:
        found["alarms"] = alarms(options.alarms, options.only)
        for name, (count, of) in found["alarms"].items():
            print(f"{name:28} {count:3} of {of:3} raise model_drift")
    else:
        found["errors"] = compared(options.only, options.seeds)
        show(found["errors"])
    if options.figure is not None:
        draw(options.only[0], options.figure)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
