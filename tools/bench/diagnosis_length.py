"""Processor time of a diagnosis by the length of its recording; ends with 1 where it grows faster than the length.

python tools/bench/diagnosis_length.py [--seconds 20,40,80,160] [--friction 0.004] [--runs 1] [--json FILE]

A made-up run of the hoop at 50 Hz, with dry friction in its bearing (0: none) and noise of its sensors, as a file; the
whole process of `hoopd diagnose` on it, which fits the first two thirds. Every length takes its turn in every round.
The exponent is that between two lengths, log(time)/log(length): 1 is linear, below it is what every diagnosis takes.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from math import log
from pathlib import Path
from statistics import median

import numpy as np

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.fitting.solver_comparison import two_level_torque
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import load_model

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "config" / "models" / "thesis.yaml"
TICK_S, BEGIN = 0.02, np.array([0.0, 0.0, 0.2, 0.0])
# Of theta (a count of the encoder), theta' and psi.
NOISE = np.array([2 * np.pi / 4096 / np.sqrt(12.0), 0.1, 0.002])
# What is not all of the time goes with the length: an exponent above this is not linear.
BOUND_EXPONENT = 1.1


def write_recording(path: Path, seconds: float, friction: float, seed: int = 1) -> None:
    """A run as CSV."""
    file, samples = load_model(MODEL), round(seconds / TICK_S)
    found = (FoundEffect("hoop.coulomb_friction", {"Fc": friction}),) if friction else ()
    model = HoopModel.with_effects(FoundEffects(file.structure, file.values(), found))
    t, u = TICK_S * np.arange(samples + 1), two_level_torque(samples)
    seen = model.run((), BEGIN, t, u)[:, [0, 1, 2]]
    seen = seen + NOISE * np.random.default_rng(seed).normal(size=seen.shape)
    rows = np.column_stack([t, np.append(u, u[-1]), seen])
    np.savetxt(path, rows, delimiter=",", header="t,u,theta,dtheta,psi", comments="", fmt="%.9g")


def processor_s(recording: Path) -> tuple[float, str]:
    """Of the whole process, one thread; and what it said."""
    out, before = recording.with_suffix(".json"), resource.getrusage(resource.RUSAGE_CHILDREN)
    one_thread = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "hoopd", "diagnose", str(recording), "--no-free-run", "--json", str(out)]
    subprocess.run(command, check=True, cwd=ROOT, env=one_thread, stdout=subprocess.DEVNULL)
    after, said = resource.getrusage(resource.RUSAGE_CHILDREN), json.loads(out.read_text())
    names = ", ".join(one["name"] for one in said["effects"]) or said["verdict"]
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, names


def main() -> int:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", default="20,40,80,160")
    parser.add_argument("--friction", type=float, default=0.004, help="N m")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    lengths = [float(one) for one in options.seconds.split(",")]
    times: dict[float, list[float]] = {one: [] for one in lengths}
    with tempfile.TemporaryDirectory(prefix="length-") as folder:
        for _ in range(options.runs):
            for length in lengths:
                recording = Path(folder, f"{length:g}s.csv")
                write_recording(recording, length, options.friction)
                taken, said = processor_s(recording)
                times[length].append(taken)
                print(f"{length:5g} s: {taken:6.1f} s of the processor, {said}", flush=True)
    every = [median(times[one]) for one in lengths]
    pairs = list(zip(lengths[:-1], lengths[1:], every[:-1], every[1:], strict=True))
    exponents = [log(after / before) / log(long / short) for short, long, before, after in pairs]
    for (short, long, _, _), exponent in zip(pairs, exponents, strict=True):
        print(f"{short:g} to {long:g} s: exponent {exponent:.2f}")
    good = max(exponents) <= BOUND_EXPONENT
    print(f"{'ok' if good else 'MISSED'}; the bound is {BOUND_EXPONENT:g}")
    if options.json is not None:
        record = {"bound": BOUND_EXPONENT, "met": good, "seconds": lengths, "processor_s": every}
        options.json.write_text(json.dumps(record, indent=2) + "\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
