"""Lies of an encoder: how long until control ends, by which row, and how fast the true hoop turns meanwhile.

    python tools/bench/encoder_lies.py [--seeds 2] [--law NAME ...] [--only LIE ...]

The daemon in virtual time with a shipped law; at 4 s or a little later the encoder begins to lie, for 12 s. References:
`rest`, `held` (0.05 rad), `steps` (0.15 rad both ways) and `later` (the same from 6.5 s on, after rest). Delays count
from when true and told value first differ by five standard deviations of the filter's encoder; torque as the board
logged it. Exit code 1 when a lie that must be seen was not, when the torque outlived its row by more than 0.1 s (1.1 s
for a controlled stop), when the true hoop came beyond the board's own limit, or when a run was over before its lie
began, so that nothing was tried. A scale other than a reversed one must be seen under `steps` alone.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Mapping
from itertools import product
from math import inf, isnan, nan, tau
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools" / "bench")]

import numpy as np  # noqa: E402
from lockstepruns import ENDING, prepared, scratch, watch  # noqa: E402

from hoopd.core.faulttable import BY_NAME, Action  # noqa: E402
from hoopd.sim.truth import Truth  # noqa: E402

AT_S, LASTS_S = 4.0, 12.0
ANGLE_SD, SPEED_SD = tau / 4096 / 12**0.5, 0.05
BOARD_RAD_S = 105.0  # its limit, and what 5 ms at full torque add
LATE_S: Mapping[Action, float] = {Action.CUT: 0.1, Action.STOP: 1.1}
STEPS = tuple(0.15 * (-1) ** k for k in range(8))
REFERENCES: Mapping[str, tuple[float, tuple[float, ...]]] = {  # from when on, every two seconds
    "rest": (0.0, ()),
    "held": (2.5, (0.05,)),
    "steps": (2.5, STEPS),
    "later": (6.5, STEPS[:5]),
}
FACTORS = (-1.0, 0.2, 0.5, 2.0, 3.0)
LIES: Mapping[str, tuple[str, dict[str, float]]] = {
    "frozen": ("encoder_frozen", {}),
    "coasts": ("encoder_coasts", {}),
    **{f"scale {factor:g}": ("encoder_scale", {"factor": factor}) for factor in FACTORS},
}


class Case(NamedTuple):
    """One run."""

    lie: str
    law: str
    reference: str
    seed: int

    @property
    def must(self) -> bool:
        """It must be seen."""
        return self.lie in ("frozen", "coasts", "scale -1") or self.reference == "steps"


class Outcome(NamedTuple):
    """What it came to; times in s after the difference of five sigma, NaN when no row came."""

    tried: bool  # the run lasted until the lie
    row: str
    row_s: float
    zero_s: float
    outlived_s: float  # torque after the row
    top_rad_s: float  # of the true hoop while unseen, and until the torque was zero


def differs(lie: str, truth: Truth, at: float) -> float:
    """When told and true value differ by five sigma; inf when they never do."""
    k = min(int(np.searchsorted(truth.t, at)), len(truth.t) - 1)
    turned, speed = truth.theta - truth.theta[k], truth.dtheta
    factor = float(lie.split()[1]) if lie.startswith("scale") else 0.0
    if lie == "coasts":
        angle_off, speed_off = turned - speed[k] * (truth.t - truth.t[k]), speed - speed[k]
    else:
        angle_off, speed_off = (1.0 - factor) * turned, (1.0 - factor) * speed
    off = (np.abs(angle_off) > 5 * ANGLE_SD) | (np.abs(speed_off) > 5 * SPEED_SD)
    times = truth.t[off & (truth.t >= at)]
    return float(times[0]) if len(times) else inf


def tell(case: Case) -> Outcome:
    """Tell one lie."""
    at = AT_S + 0.37 * case.seed
    kind, params = LIES[case.lie]
    since, values = REFERENCES[case.reference]
    steps = [{"at_s": since + 2.0 * k, "name": "reference", "value": value} for k, value in enumerate(values)]
    sim: dict[str, Any] = {"faults": [{"kind": kind, "at_s": at, "params": params}], "commands": steps, "psi_rad": 0.2}
    with scratch() as folder:
        config, texts = prepared({"control": {"file": f"controllers/{case.law}.yaml"}, "sim": sim}, folder)
        seen = watch(config, texts, folder, at + LASTS_S, case.seed, pictures=False)
    raised, last = seen.first(ENDING, at), seen.torque.zero_for_good_from(at) + at
    end = min(raised.t, at + LASTS_S) if raised else at + LASTS_S
    rows = (seen.truth.t >= at) & (seen.truth.t <= (max(last, end) if raised else end))
    if not rows.any():
        return Outcome(False, "", nan, nan, nan, nan)
    top = float(np.abs(seen.truth.dtheta[rows]).max())
    if raised is None:
        return Outcome(True, "", nan, nan, nan, top)
    begun = min(differs(case.lie, seen.truth, at), end)  # a row may come before any difference: delay 0
    outlived = max(last - end, 0.0)
    return Outcome(True, raised.name, end - begun, end + outlived - begun, outlived, top)


def failing(case: Case, outcome: Outcome) -> bool:
    """See the head of the file."""
    if not outcome.tried:
        return True
    if not outcome.row:
        return case.must or outcome.top_rad_s > BOARD_RAD_S
    return outcome.outlived_s > LATE_S[BY_NAME[outcome.row].action] or outcome.top_rad_s > BOARD_RAD_S


def line(outcomes: list[Outcome]) -> str:
    """Of the runs of one lie and one reference."""
    seen = [outcome for outcome in outcomes if outcome.row]
    rows = ", ".join(sorted({outcome.row for outcome in seen})) or "-"
    late, zero = (most((getattr(outcome, name) for outcome in seen), "s") for name in ("row_s", "zero_s"))
    tried = [outcome for outcome in outcomes if outcome.tried]
    over = f"; {len(outcomes) - len(tried)} over before the lie" if len(tried) < len(outcomes) else ""
    top = most((outcome.top_rad_s for outcome in tried), "rad/s")
    return f"{len(seen)}/{len(outcomes)}    {rows}; {late}, {zero}; {top}{over}"


def most(values: Iterable[float], unit: str) -> str:
    """The greatest, '-' of none."""
    greatest = max(values, default=nan)
    return "-" if isnan(greatest) else f"{greatest:.2f} {unit}" if unit == "s" else f"{greatest:.0f} {unit}"


def main() -> int:
    parser = argparse.ArgumentParser(description="lies of an encoder")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--law", action="append", choices=("lqg", "arx", "pid"))
    parser.add_argument("--only", action="append", choices=list(LIES))
    given = parser.parse_args()
    bad = 0
    print("lie        reference  seen    rows; greatest delay of row, of torque zero; top true speed")
    for lie, reference in product(given.only or LIES, REFERENCES):
        cases = [Case(lie, law, reference, seed) for law in given.law or ("lqg", "arx") for seed in range(given.seeds)]
        told = [(case, tell(case)) for case in cases]
        bad += sum(failing(*one) for one in told)
        print(f"{lie:10} {reference:10} {line([outcome for _, outcome in told])}", flush=True)
    print(f"{bad} cases failed")
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
