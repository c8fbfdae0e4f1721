"""Campaigns on sealed devices: how many runs until the right law is reached, beside a fast two-level signal repeated.

python tools/bench/learn.py [--rigs 60] [--quiet 20] [--seed N] [--most 12] [--arms learn,prbs] [--loops] [--json FILE]

The devices are the proof's own generator's (tools/concealed): parameters 3 to 10 % off, a disturbance, and one effect,
two thirds of them of the library and a third outside of it, of 5 to 40 nats in one 20 s run; what no size shows so
well is drawn again. `learn` chooses each run,
`prbs` repeats the first; both stop by the same rule. It prints runs until settled and right (censored at --most), false
findings, and how near the limits the true states came. With `--loops` the law on what was learned holds the ball on a
rig with the same parameters and effect, beside the law on the truth and the one of before. Shares have their
Clopper-Pearson intervals (95 %). With a `--json` that is there it goes on where that ends; a quiet device is the same
one however many others there are.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

import msgspec  # noqa: E402
import numpy as np  # noqa: E402
from concealed.effects import OUTSIDE, SINGLES  # noqa: E402
from concealed.judged import Judged  # noqa: E402
from concealed.outside.judge import formula  # noqa: E402
from concealed.proportions import shown  # noqa: E402
from harness.kept_rows import KeptRows  # noqa: E402
from learning.device import SealedDevice  # noqa: E402
from learning.loops import loop_costs  # noqa: E402

from hoopd.commands.learn import record_until_settled  # noqa: E402
from hoopd.commands.learn_steps import Steps  # noqa: E402
from hoopd.commands.options.learn import LearnOptions  # noqa: E402
from hoopd.commands.step_commands import StepError  # noqa: E402
from hoopd.files.reading import InputError  # noqa: E402
from hoopd.learn.campaign import Campaign, CampaignRequest, DiagnosedRun, RunFiles  # noqa: E402
from hoopd.learn.choice import MENU, ChosenRun  # noqa: E402

NATS = (5.0, 40.0)
# Of one picture alone, in one recording alone, or a matter of parameters.
NOT_OF_A_RIG = frozenset({"camera.late_frames", "camera.outliers", "external.disturbance", "actuator.torque_gain"})
NEAR, WORSE = 1.1, 1.05
MOST_DRAWS = 20
console = Console()


class Repeated(Campaign):
    """A campaign that plays the same signal again and again."""

    def choose(self, runs: list[DiagnosedRun]) -> ChosenRun | None:
        """The fast two-level signal."""
        chosen = ChosenRun(MENU[0], "the same again")
        self.decide(self.run_files(len(runs) + 1), chosen)
        return chosen


@dataclass(frozen=True)
class SealedSteps(Steps):
    """Records from a sealed device."""

    device: SealedDevice

    def record(self, files: RunFiles, choice: ChosenRun, number: int) -> None:
        """The recording of a run."""
        words = (*choice.played, *self.foresight(number))
        files.experiment.write_text(json.dumps(self.device.record(words, number, files.recording)))


def drawn(number: int, seed: int) -> SealedDevice:
    """A device with something hidden, every third time what no library has.

    What one run does not show by the least that is asked for, at any size there is, is drawn again: the torque of a
    sizing run does not reach every saturation.
    """
    names = sorted(OUTSIDE) if number % 3 == 2 else sorted(set(SINGLES) - NOT_OF_A_RIG)
    for again in range(MOST_DRAWS):
        rng = np.random.default_rng([seed, number, again] if again else [seed, number])
        device = SealedDevice((str(rng.choice(names)),), NATS, (seed, number))
        if not any(one["capped"] for one in device.answer()["effects"]):
            return device
    raise SystemExit(f"device {number}: nothing of {MOST_DRAWS} effects is seen in one run")


def campaign(
    device: SealedDevice, arm: str, most: int, seed: int, answer: dict[str, Any], *, loops: bool
) -> tuple[list[DiagnosedRun], dict[str, float]]:
    """Its runs, and with `loops` what a loop costs afterwards."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "campaign"
        made = Repeated(folder) if arm == "prbs" else Campaign(folder)
        options = LearnOptions(sim=True, out=folder, budget=f"{most * 36}s", seed=seed)
        made.begin(CampaignRequest(budget_s=most * 36.0, confidence=0.95, seed=seed, sim=True, config=None, sets=()))
        steps = SealedSteps(made, options, lambda text: None, device)
        runs, _ = record_until_settled(steps, most * 36.0, most_runs=most)
        model = None if runs[-1].diagnosis.verdict == "consistent" else runs[-1].files.model
        costs = loop_costs(answer, model, Path(place) / "loops") if loops else {}
        return list(runs), costs


def judged(effects: Sequence[str], answer: dict[str, Any], runs: Sequence[DiagnosedRun]) -> dict[str, Any]:
    """Runs until the last word, whether it is right, what is false in it, and what was still open."""
    case = Judged(answer, msgspec.to_builtins(runs[-1].diagnosis))
    right = case.silent if not effects else formula(case) if effects[0] in OUTSIDE else case.in_class
    told = {"signals": [" ".join(one.choice.words) for one in runs], "open": list(runs[-1].belief.open)}
    return {"runs": len(runs), "right": right, "names": case.names, **told}


def main() -> None:
    """Devices, campaigns, table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=60)
    parser.add_argument("--quiet", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most", type=int, default=12)
    parser.add_argument("--arms", default="learn,prbs")
    parser.add_argument("--loops", action="store_true", help="hold the ball afterwards, where a library has words")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    try:
        kept = KeptRows(asked.json, {"seed": asked.seed, "most": asked.most, "loops": asked.loops})
    except InputError as error:
        parser.error(str(error))
    done = {(row["device"], row["arm"]) for row in kept.rows}
    numbers = [*((f"{k}", k) for k in range(asked.rigs)), *((f"quiet {k}", k) for k in range(asked.quiet))]
    for name, k in track(numbers, "devices", console=Console(stderr=True)):
        for arm in [one for one in asked.arms.split(",") if (name, one) not in done]:
            device = SealedDevice((), NATS, (asked.seed, k, 1)) if " " in name else drawn(k, asked.seed)
            answer = device.answer()
            effects = tuple(one["name"] for one in answer["effects"])
            has_words = not any(one in OUTSIDE for one in effects)
            costs: dict[str, float] = {}
            try:
                runs, costs = campaign(device, arm, asked.most, k, answer, loops=asked.loops and has_words)
                last_word = judged(effects, answer, runs)
            except StepError as error:
                # a campaign that breaks off has not come to the right law, whatever stopped it
                last_word = {"runs": asked.most, "right": False, "names": [f"broke off: {error}"]}
            uses = (max(one.most_angle_rad / 1.25, one.most_speed_rad_s / 45.0) for one in device.runs)
            use = max(uses, default=0.0)
            nats = [one["nats"] for one in answer["effects"]]
            kept.add(
                {"device": name, "hidden": effects, "nats": nats, "arm": arm, "use": use, **last_word, "costs": costs}
            )
    for arm in asked.arms.split(","):
        show(arm, [row for row in kept.rows if row["arm"] == arm], asked.most)


def show(arm: str, rows: Sequence[dict[str, Any]], most: int) -> None:
    """What the arm reached."""
    table = Table("device", "hidden", "nats in 20 s", "runs", "said", "right", "use of limits", title=arm)
    for row in rows:
        nats = ", ".join(f"{one / 3.0:.0f}" for one in row["nats"] if one is not None)
        cells = (", ".join(row["hidden"]) or "-", nats, str(row["runs"]), ", ".join(row["names"]) or "-")
        table.add_row(row["device"], *cells, "yes" if row["right"] else "no", f"{row['use']:.2f}")
    console.print(table)
    hidden, quiet = [row for row in rows if row["hidden"]], [row for row in rows if not row["hidden"]]
    counted = [row["runs"] if row["right"] else most for row in hidden]
    console.print(f"{arm}: right {shown(row['right'] for row in hidden)}, nothing where nothing is ", end="")
    console.print(f"{shown(row['right'] for row in quiet)}; runs until right, median {median(counted)}, quiet ", end="")
    console.print(f"{median([row['runs'] for row in quiet])}; limits passed {sum(row['use'] > 1 for row in rows)}")
    asked = [row["costs"] for row in rows if row.get("costs")]
    costs = [one for one in asked if isfinite(one["truth"])]
    if costs:
        near = shown(one["learned"] <= NEAR * one["truth"] for one in costs)
        worse = shown(one["learned"] > WORSE * one["before"] for one in costs)
        console.print(f"cost within 10 % of the law on the truth {near}, worse than before by 5 % {worse}; ", end="")
        console.print(f"the law on the truth was cut in {len(asked) - len(costs)} others")


def median(numbers: Sequence[float]) -> str:
    """Of some numbers, a dash of none."""
    return f"{statistics.median(numbers):g}" if numbers else "-"


if __name__ == "__main__":
    main()
