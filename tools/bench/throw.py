"""Throws at the first attempt on sealed rigs whose balls bounce: planned on re-fitted parameters, on the shipped model.

python tools/bench/throw.py [--rigs 20] [--first 0] [--arms refit,nominal] [--practice 3] [--json FILE]

Every rig has all its parameters a tenth off, a dry friction of up to 15 mN m, a restitution of 0 to 0.4 and a friction
of its touches of 0.1 to 0.5; nobody is told. It is recorded for 40 s, `hoopd fit` makes a model of that, `hoopd design
lqg` a law for the bottom on it; three practice throws (`--practice`) tell the restitution, `hoopd maneuver throw` plans
with it, and the throw is played once. It counts when it succeeds by the recording's judgement and, in the rig's own
state, the ball moved as none does that is held. Rigs on which no throw can be planned with everything known are counted
apart. It prints rates with their 95 % intervals.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from maneuver import attempted, judged, show  # noqa: E402
from sealedrigs.rigs import SealedRig, sealed_rig  # noqa: E402

from hoopd.commands.design import run as design  # noqa: E402
from hoopd.commands.maneuver import run as maneuver  # noqa: E402
from hoopd.commands.options.design import DesignOptions  # noqa: E402
from hoopd.commands.options.maneuver import ManeuverOptions  # noqa: E402
from hoopd.files.reading import InputError  # noqa: E402
from hoopd.sim import truth  # noqa: E402

MOST_FRICTION_NM, MOST_RESTITUTION, GRIP = 0.015, 0.4, (0.1, 0.5)
# Of the rig's own state, while nothing could have held the ball: a part of the planned flight.
LEAST_LOOSE_S = 0.04
# A restitution is right within; its interval ends on a grid.
NEAR, NEAR_SHARE, HALF_STEP = 0.02, 0.1, 0.005


def bouncing_rig(seed: int) -> SealedRig:
    """One rig: the parameters of the sealed one, and a ball that bounces."""
    rng = np.random.default_rng([seed, 4711])
    touch = {"restitution": float(rng.uniform(0.0, MOST_RESTITUTION)), "grip": float(rng.uniform(*GRIP))}
    friction = {"Fc": float(rng.uniform(0.0, MOST_FRICTION_NM))}
    return sealed_rig(seed)._replace(effects={"hoop.coulomb_friction": friction, "ball.lift_off": touch})


def thrown(rig: SealedRig, model: Path, folder: Path, arm: str, practice: int = 0) -> dict[str, Any]:
    """Plan on a model, play once on the rig; what became of it."""
    own = folder / arm
    own.mkdir()
    law = own / "lqg.yaml"
    sets = (f"sim.model={folder / 'sealed.yaml'}", f"sim.directory={own}", f"control.file={law}", "log.level=error")
    try:
        design(DesignOptions(law="lqg", model=model, out=law))
        result = maneuver(
            ManeuverOptions(
                kind="throw", practice=practice, sim=True, sets=sets, seed=1000 + rig.seed, speed="max",
                camera="direct", out=own / "run.mcap",
            )
        )  # fmt: skip
    except (InputError, ValueError) as error:
        return {"success": False, "why": f"no plan: {str(error)[-260:]}"}
    if result["maneuver"] != "throw" or len(result["attempts"]) != 1:
        return {"success": False, "why": f"no throw: {result['outcome']}"}
    loose = loose_s(own, rig)
    told = judged(result, 1.0)
    if told["success"] and loose < LEAST_LOOSE_S:
        told = {"success": False, "why": f"the rig's ball flew for {loose:.2f} s"}
    return {**told, "loose_s": loose, "faults": result["faults"], "practice": result.get("practice", {})}


def loose_s(folder: Path, rig: SealedRig) -> float:
    """How long the rig's ball moved as none does that its hoop holds."""
    state, p = truth.read(folder / "truth.csv"), rig.model().values()
    free = (p["Ro"] - p["Rb"]) * state.dpsi**2 + p["g"] * np.cos(state.psi) < 0.0
    return float(np.sum(free) * np.median(np.diff(state.t)))


def run_rig(seed: int, arms: list[str], practice: int = 0) -> dict[str, Any]:
    """One rig, all its arms."""
    return attempted(bouncing_rig(seed), arms, "throw", partial(thrown, practice=practice))


def identified(rows: list[dict[str, Any]], arm: str) -> str:
    """How near the restitutions are to the rigs' own."""
    pairs = [
        (row["effects"]["ball.lift_off"]["restitution"], row["arms"][arm]["practice"])
        for row in rows
        if row["arms"].get(arm, {}).get("practice", {}).get("ci95")
    ]
    near = [abs(told["restitution"] - true) <= max(NEAR, NEAR_SHARE * true) for true, told in pairs]
    held = [told["ci95"][0] - HALF_STEP <= true <= told["ci95"][1] + HALF_STEP for true, told in pairs]
    within = f"within {NEAR:g} or {100 * NEAR_SHARE:g} %: {sum(near)} of {len(near)}"
    return f"{arm}: restitution {within}; in its interval: {sum(held)}"


def main() -> None:
    """Run the rigs one after another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first rig")
    parser.add_argument("--arms", default="refit,nominal")
    parser.add_argument("--practice", type=int, default=3, help="throws before the one that counts; 0: none")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    arms, rows = options.arms.split(","), []
    for seed in range(options.first, options.first + options.rigs):
        rows.append(run_rig(seed, arms, options.practice))
        row = rows[-1]
        what = {arm: one["why"] or "caught" for arm, one in row["arms"].items()}
        told = ", ".join(f"{name} {value:.3g}" for one in row["effects"].values() for name, value in one.items())
        print(f"rig {seed} ({told}) {row['seconds']} s: {what}", file=sys.stderr, flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=1))
    show(rows, arms, "throw")
    if options.practice:
        for arm in arms:
            print(identified(rows, arm))


if __name__ == "__main__":
    main()
