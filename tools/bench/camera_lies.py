"""Lies of a camera: how long until control ends, by which row, and how large the torque is meanwhile.

    python tools/bench/camera_lies.py [--seeds 3] [--law NAME ...] [--only LIE ...] [--pictures] [--hasty]

The daemon in virtual time with a shipped law and its filter; at 6 s the camera begins to lie, for 30 s, with stamps as
they should be. Each lie is told in three ways: while the ball rests and nothing is asked (`rest`), while the reference
steps by 0.3 rad every two seconds (`steps`), and from the first picture on, with those steps (`ever`: the camera has
never been honest). A lie that must be seen is to be seen within the 30 s of `steps` for every seed; exit code 1 when
one is not, or when an honest camera is called a liar. `--pictures` renders and analyses every picture; `--hasty` lets
each row speak at its first evidence, for comparison. Torque as the board logged it.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the processes share the cores
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools" / "bench")]

import numpy as np  # noqa: E402
from lockstepruns import ENDING, be_hasty, prepared, scratch, watch  # noqa: E402
from processes import cores, progress  # noqa: E402

AT_S, LASTS_S = 6.0, 30.0
STEP_RAD, STEP_S = 0.15, 2.0
FIRST_STEP_S = 3.0
LAWS = ("lqg", "arx")  # the shipped ones that hold the ball
WAYS = ("rest", "steps", "ever")


class Lie(NamedTuple):
    """A fault of the rig's camera; `told`: two sensors can tell it, so that it must be seen."""

    kind: str
    params: Mapping[str, float]
    told: bool


def _painted(psi_rad: float, swing_rad: float = 0.0, period_s: float = 3.0) -> Lie:
    return Lie("picture_ball_painted", {"psi_rad": psi_rad, "swing_rad": swing_rad, "period_s": period_s}, True)


def _scaled(factor: float, *, told: bool = True) -> Lie:
    return Lie("picture_scale", {"factor": factor}, told)


def _aged(delay_s: float, *, told: bool = True) -> Lie:
    return Lie("pictures_aged", {"delay_s": delay_s}, told)


HONEST = "no lie"
LIES: Mapping[str, Lie] = {
    HONEST: Lie("", {}, False),
    "the same picture": Lie("pictures_frozen", {}, True),
    "painted at 0": _painted(0.0),
    "painted at 0.05": _painted(0.05),
    "painted at -0.2": _painted(-0.2),
    "painted at 0.6": _painted(0.6),
    "held at 0": Lie("ball_held", {"psi_rad": 0.0}, True),
    "held at 0.05": Lie("ball_held", {"psi_rad": 0.05}, True),
    "held at 0.2": Lie("ball_held", {"psi_rad": 0.2}, True),
    "swings 0.02, 0.73 s": _painted(0.0, 0.02, 0.73),
    "swings 0.1, 0.73 s": _painted(0.0, 0.1, 0.73),
    "swings 0.05, 2 s": _painted(0.1, 0.05, 2.0),
    "swings 0.03, 4 s": _painted(0.0, 0.03, 4.0),
    "swings 0.15, 8 s": _painted(0.0, 0.15, 8.0),
    "scale -1": _scaled(-1.0),
    "scale 0.25": _scaled(0.25),
    "scale 0.5": _scaled(0.5),
    "scale 0.7": _scaled(0.7, told=False),
    "scale 0.9": _scaled(0.9, told=False),
    "scale 1.1": _scaled(1.1, told=False),
    "scale 1.5": _scaled(1.5, told=False),
    "scale 2": _scaled(2.0),
    "scale 4": _scaled(4.0),
    "aged 0.02 s": _aged(0.02, told=False),
    "aged 0.04 s": _aged(0.04, told=False),
    "aged 0.07 s": _aged(0.07, told=False),
    "aged 0.1 s": _aged(0.1),
    "aged 0.2 s": _aged(0.2),
    "aged 0.4 s": _aged(0.4),
}


class Case(NamedTuple):
    """One run."""

    lie: str
    way: str
    law: str
    seed: int


class Outcome(NamedTuple):
    """What one run came to; times from the lie's beginning, or from that of the law where the lie came first."""

    case: Case
    seen_s: float  # inf: never
    row: str
    torque_nm: float  # the largest while unseen
    hoop_rad_s: float  # the true ones, over the same time
    ball_rad: float


def content(case: Case) -> dict[str, Any]:
    """The run's configuration."""
    lie = LIES[case.lie]
    at_s = 0.0 if case.way == "ever" else AT_S
    count = 0 if case.way == "rest" else round((AT_S + LASTS_S - FIRST_STEP_S) / STEP_S)
    steps = [
        {"at_s": FIRST_STEP_S + STEP_S * k, "name": "reference", "value": STEP_RAD * (-1) ** k} for k in range(count)
    ]
    faults = [{"kind": lie.kind, "at_s": at_s, "params": dict(lie.params)}] if lie.kind else []
    return {"control": {"file": f"controllers/{case.law}.yaml"}, "sim": {"faults": faults, "commands": steps}}


def tell(case: Case, pictures: bool) -> Outcome:
    """Tell one lie."""
    with scratch() as folder:
        config, texts = prepared(content(case), folder)
        seen = watch(config, texts, folder, AT_S + LASTS_S, case.seed, pictures=pictures)
    begun = 1.0 if case.way == "ever" else AT_S
    told = seen.first(ENDING, begun)
    end = told.t if told else AT_S + LASTS_S
    rows = (seen.truth.t >= begun) & (seen.truth.t <= end)
    return Outcome(
        case,
        told.t - begun if told else inf,
        told.name if told else "",
        seen.torque.max_abs(begun, end),
        float(np.abs(seen.truth.dtheta[rows]).max()),
        float(np.abs(seen.truth.psi[rows]).max()),
    )


def campaign(cases: Sequence[Case], pictures: bool, workers: int, hasty: bool = False) -> list[Outcome]:
    """All cases, on so many processes."""
    outcomes = []
    begin = be_hasty if hasty else None
    with ProcessPoolExecutor(workers, initializer=begin) as pool:
        for done in as_completed([pool.submit(tell, case, pictures) for case in cases]):
            outcomes.append(done.result())
            progress(f"{len(outcomes)} of {len(cases)} runs")
    progress("")
    return sorted(outcomes, key=lambda outcome: cases.index(outcome.case))


def missed(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """What must have been seen and was not, and what was seen where nothing is."""
    silent = [
        one for one in outcomes if one.case.way == "steps" and LIES[one.case.lie].told and not isfinite(one.seen_s)
    ]
    return silent + [one for one in outcomes if one.case.lie == HONEST and isfinite(one.seen_s)]


def show(outcomes: Sequence[Outcome]) -> None:
    """A row a law, a lie and a way."""
    print(
        f"{'law':<5}{'lie':<22}{'way':<7}{'seen':>6}{'median':>9}{'latest':>9}"
        f"{'N m':>8}{'rad/s':>7}{'ball rad':>9}  by; N m, rad/s, rad: the largest while unseen"
    )
    groups = dict.fromkeys(one.case._replace(seed=0) for one in outcomes)
    for group in groups:
        mine = [one for one in outcomes if one.case._replace(seed=0) == group]
        seen = [one for one in mine if isfinite(one.seen_s)]
        times = [one.seen_s for one in mine]
        by = ", ".join(dict.fromkeys(one.row for one in seen))
        must = "" if LIES[group.lie].told or group.lie == HONEST else " (cannot always be told)"
        print(
            f"{group.law:<5}{group.lie:<22}{group.way:<7}{len(seen):>3}/{len(mine):<2}"
            f"{_seconds(statistics.median(times)):>9}{_seconds(max(times)):>9}"
            f"{max(one.torque_nm for one in mine):>8.3f}{max(one.hoop_rad_s for one in mine):>7.1f}"
            f"{max(one.ball_rad for one in mine):>9.2f}  {by}{must}"
        )


def conclude(outcomes: Sequence[Outcome], took_s: float) -> None:
    """What it comes to, by way."""
    for way in dict.fromkeys(one.case.way for one in outcomes if one.case.lie != HONEST):
        mine = [one for one in outcomes if one.case.way == way and one.case.lie != HONEST]
        unseen = {one.case.lie for one in mine if not isfinite(one.seen_s)}
        most = max(one.torque_nm for one in mine)
        silent = max((one.torque_nm for one in mine if not isfinite(one.seen_s)), default=0.0)
        print(
            f"{way}: {len({one.case.lie for one in mine} - unseen)} of {len({one.case.lie for one in mine})} lies seen"
            f" in every run within {LASTS_S:g} s; largest torque while unseen {most:.3f} N m, of a run in which"
            f" nothing was seen {silent:.3f} N m"
        )
    wrong = missed(outcomes)
    for one in wrong:
        print(f"WRONG: {one.case.lie}, law {one.case.law}, seed {one.case.seed}")
    print(f"{len(outcomes)} runs, {len(wrong)} of them wrong, {took_s:.0f} s")


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if isfinite(value) else "-"


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--law", nargs="*", choices=LAWS, default=["lqg"])
    parser.add_argument("--way", nargs="*", choices=WAYS, default=list(WAYS))
    parser.add_argument("--only", nargs="*", choices=sorted(LIES), metavar="LIE", default=list(LIES))
    parser.add_argument("--pictures", action="store_true", help="render and analyse every picture")
    parser.add_argument("--hasty", action="store_true", help="each row speaks at its first evidence")
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--json", type=Path, help="write every run to this file")
    options = parser.parse_args()
    begun = time.monotonic()
    cases = [Case(*parts) for parts in product(options.only, options.way, options.law, range(options.seeds))]
    outcomes = campaign(cases, options.pictures, options.workers, options.hasty)
    show(outcomes)
    conclude(outcomes, time.monotonic() - begun)
    if options.json:
        rows = [{**one.case._asdict(), **one._replace(case=None)._asdict()} for one in outcomes]
        options.json.write_text(json.dumps(rows, indent=1))
    return int(bool(missed(outcomes)))


if __name__ == "__main__":
    sys.exit(main())
