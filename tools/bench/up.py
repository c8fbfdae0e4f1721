"""A ball on top of the inner hoop, held against disturbances: the region, and runs that begin in it; and thrown there.

python tools/bench/up.py [--disturbances 100] [--seconds 30] [--radius 0.0445] [--off 0] [--json FILE]
python tools/bench/up.py --rigs 100 [--first 0] [--arms found,refit,nominal] [--json FILE]

The plant alone with the daemon's filter, in the daemon's time-line: a camera that is two frames late and has noise, an
encoder with counts, torques that act when they arrive. Hands hold the ball near the top and let it go with a push. The
region is found first (`hoopd.plants.hoop.maneuver.balance`), then disturbances are drawn evenly in it, with other
noise. `--off 0.1`: the plant's inertias and frictions are drawn a tenth off, up or down, for every run.

`--rigs N`: so many rigs whose inertias and frictions are a tenth off, up or down, and whose balls bounce with a
restitution of 0 to 0.4; radii and mass are known, as who measures them does. Each is recorded for 40 s, `hoopd
diagnose` and `hoopd fit` make a model each of that, `hoopd design lqg` a law, and `hoopd maneuver up` is played once;
beside it with the shipped model. With `--json` it goes on with the rigs that the file does not have. Exit code 1 when a
disturbance was not held.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import msgspec
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from concealed.proportions import clopper_pearson  # noqa: E402
from harness.kept_rows import KeptRows  # noqa: E402
from maneuver import attempted, judged, show  # noqa: E402
from sealedrigs.rigs import SealedRig  # noqa: E402

from hoopd.commands.design import run as design  # noqa: E402
from hoopd.commands.maneuver import run as maneuver  # noqa: E402
from hoopd.commands.options.design import DesignOptions  # noqa: E402
from hoopd.commands.options.maneuver import ManeuverOptions  # noqa: E402
from hoopd.files.controller import load_controller, settings_of  # noqa: E402
from hoopd.files.model import InnerHoop, ModelFile, model_text  # noqa: E402
from hoopd.files.reading import InputError  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.plants.found_effects import FoundEffects  # noqa: E402
from hoopd.plants.hoop.maneuver.balance import Balance  # noqa: E402
from hoopd.plants.hoop.maneuver.inner_model import InnerModel  # noqa: E402
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel  # noqa: E402
from hoopd.plants.model_file import effects_of, load_model  # noqa: E402

DRAWN = ("Ih", "Ib", "bh", "bb")


def balance_of(radius_m: float) -> Balance:
    """The regulator on the shipped model with an inner hoop."""
    hoop = load_model(defaults_folder() / "models" / "hoop.yaml")
    model = InnerModel(PlanningModel(effects_of(with_inner(hoop, radius_m))))
    settings = settings_of(load_controller(defaults_folder() / "controllers" / "lqg.yaml"))
    return Balance(model, settings, hoop.device.torque_limit_nm)


def off_by(found: FoundEffects, share: float, seed: int) -> FoundEffects:
    """The same plant with inertias and frictions a share off, up or down."""
    rng = np.random.default_rng([seed, 11])
    factors = {name: 1.0 + share * float(rng.choice([-1.0, 1.0])) for name in DRAWN}
    return replace(found, base={name: value * factors.get(name, 1.0) for name, value in found.base.items()})


def up_rig(seed: int, arms: list[str], radius_m: float) -> dict[str, Any]:
    """One rig, all its arms."""
    rng = np.random.default_rng([seed, 4712])
    touch = {"restitution": float(rng.uniform(0.0, 0.4)), "grip": float(rng.uniform(0.3, 0.6))}
    factors = {name: 1.0 + 0.1 * float(rng.choice([-1.0, 1.0])) for name in DRAWN}
    rig = SealedRig(seed, {**dict.fromkeys(("mb", "Ro", "Rb"), 1.0), **factors}, {"ball.lift_off": touch})
    return attempted(rig, arms, "swing", partial(thrown_up, radius_m=radius_m))


def thrown_up(rig: SealedRig, model: Path, folder: Path, arm: str, radius_m: float) -> dict[str, Any]:
    """Plan on a model with the inner hoop in it, play once on the rig that has it, too."""
    own = folder / arm
    own.mkdir()
    sealed, told, law = own / "sealed.yaml", own / "told.yaml", own / "lqg.yaml"
    sealed.write_text(model_text(with_inner(rig.model(), radius_m)))
    told.write_text(model_text(with_inner(load_model(model), radius_m)))
    sets = (f"sim.model={sealed}", f"control.file={law}", "log.level=error")
    try:
        design(DesignOptions(law="lqg", model=told, out=law))
        options = ManeuverOptions(
            kind="up", sim=True, sets=sets, seed=1000 + rig.seed, speed="max", camera="direct", out=own / "run.mcap"
        )
        result = maneuver(options)
    except (InputError, ValueError) as error:
        return {"success": False, "why": f"no plan: {str(error)[:80]}"}
    return {**judged(result, 1.0), "faults": result["faults"]}


def with_inner(model: ModelFile, radius_m: float) -> ModelFile:
    """The same model with an inner hoop."""
    return msgspec.structs.replace(model, device=msgspec.structs.replace(model.device, inner=InnerHoop(radius_m)))


def show_rigs(seeds: range, arms: list[str], radius_m: float, kept: Path | None) -> None:
    """Rigs one after another, and their rates."""
    held = KeptRows(kept, {"arms": arms, "radius_m": radius_m})
    for seed in sorted({*seeds} - {row["seed"] for row in held.rows}):
        row = up_rig(seed, arms, radius_m)
        held.add(row)
        what = {arm: one["why"] or "held" for arm, one in row["arms"].items()}
        print(f"rig {seed} {row['seconds']} s: {what}", file=sys.stderr, flush=True)
    show(held.rows, arms, "way up")


def main() -> int:
    """Find the region, draw, run, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--disturbances", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--radius", type=float, default=0.0445, help="of the inner hoop, m")
    parser.add_argument("--off", type=float, default=0.0, help="share by which the plant is another one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rigs", type=int, default=0, help="throw to the top on so many sealed rigs, and nothing else")
    parser.add_argument("--first", type=int, default=0, help="seed of the first rig")
    parser.add_argument("--arms", default="found,refit,nominal", help="of the rigs: what the plan is made on")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.rigs:
        seeds = range(options.first, options.first + options.rigs)
        show_rigs(seeds, options.arms.split(","), options.radius, options.json)
        return 0
    balance = balance_of(options.radius)
    region = balance.region(options.seed)
    widths = dict(zip(("hoop_rad_s", "angle_rad", "ball_rad_s"), map(float, region.half_widths), strict=True))
    print("region, half widths:", ", ".join(f"{name} {value:.3g}" for name, value in widths.items()), flush=True)
    held = []
    for k, start in enumerate(region.drawn(options.disturbances, options.seed + 1)):
        true = off_by(balance.model.found, options.off, k)
        held.append(balance.holds(start, options.seconds, 1000 + k, true))
        if not held[-1]:
            print(f"not held: {np.round(start, 3).tolist()}", flush=True)
    low, high = clopper_pearson(sum(held), len(held)) or (0.0, 1.0)
    print(f"held for {options.seconds:g} s: {sum(held)} of {len(held)} ({100 * low:.0f} to {100 * high:.0f} %)")
    if options.json:
        options.json.write_text(json.dumps({"region": widths, "held": held, "seconds": options.seconds}, indent=1))
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
