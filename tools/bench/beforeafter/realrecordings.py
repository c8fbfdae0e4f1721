"""Fits and diagnoses of a laboratory's recordings, by any checkout, beside the numbers that were kept.

Rules of this file: the recordings are read where they are (`HOOPD_SHARED`, else ../shared); only figures are kept.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from beforeafter import figures, trees

SINE, BOTH = "meas_hoop01_f05_a01.mat", "meas_hoopAndBall2_01.mat"
LONG, CHIRP, BALL = "meas_hoop01_prbs.mat", "meas_hoop02_chirp.mat", "meas_ballOnly01.mat"
NAMED = ("--columns", "u,theta,dtheta,current")
ROLLING = ("--model", "models/hoop.yaml")


class Asked(NamedTuple):
    """A command on recordings."""

    name: str
    arguments: tuple[str, ...]

    @property
    def command(self) -> str:
        """As it is typed in the folder of the recordings."""
        return " ".join(("hoopd", *self.arguments))


FITS = (
    Asked("fit, hoop and ball 20 s", ("fit", BOTH)),
    Asked("fit, hoop and ball 50 s", ("fit", LONG)),
    Asked("fit, sine", ("fit", SINE)),
    Asked("fit, chirp", ("fit", CHIRP, *NAMED)),
    Asked("fit, ball", ("fit", BALL)),
    Asked("fit, kinematics", ("fit", f"{BOTH}@:19.8", "--kinematics")),
    Asked("fit, prediction error", ("fit", BOTH, "--method", "prediction")),
    Asked("fit, rolling, two recordings", ("fit", SINE, BOTH, "--structure", "rolling")),
)
# The names and values of docs/explanations/diagnose_real.md; the first two take 20 s each, the others minutes.
DIAGNOSES = (
    Asked("diagnosis, ball", ("diagnose", BALL, "--no-free-run")),
    Asked("diagnosis, chirp", ("diagnose", CHIRP, *NAMED, "--no-free-run")),
    Asked("diagnosis, hoop and ball 20 s", ("diagnose", BOTH, "--no-free-run")),
    Asked("diagnosis, sine", ("diagnose", SINE, "--no-free-run")),
    Asked("diagnosis, sine and hoop and ball", ("diagnose", SINE, BOTH, *ROLLING, "--no-free-run")),
    Asked("diagnosis, hoop and ball 50 s", ("diagnose", LONG, "--no-free-run")),
)
CHEAP = (*FITS, *DIAGNOSES[:2])
Say = Callable[[str], None]


def folder() -> Path:
    """Where the recordings are; ToolError when they are not there."""
    place = Path(os.environ.get("HOOPD_SHARED", trees.ROOT.parent / "shared")) / "recordings"
    if not (place / BOTH).exists():
        raise trees.ToolError(f"{place}: the recordings are not here (set HOOPD_SHARED)")
    return place


def run(tree: Path, work: Path, asked: Sequence[Asked], say: Say) -> dict[str, Any]:
    """Each command with its figures, in the form in which they are kept."""
    found = {}
    for one in asked:
        say(one.name)
        out = (work / f"{one.name.replace(' ', '_').replace(',', '')}.json").resolve()
        if not out.exists():
            trees.hoopd(tree, [*one.arguments, "--json", str(out)], folder())
        found[one.name] = {"command": one.command, "figures": _figures(json.loads(out.read_text()))}
    return {"versions": figures.versions(), "cases": found}


def _figures(result: dict[str, Any]) -> dict[str, Any]:
    """Of a fit or a diagnosis; of a diagnosis the windows' fits with what was found, too."""
    if "verdict" not in result:
        return figures.of_fit(result)
    percent = {
        f"{part} {recording} {channel}": row["with_effects"]
        for part in ("train", "heldout")
        for recording, channels in result["fit"][part].items()
        for channel, row in channels.items()
        if row["with_effects"] is not None
    }
    return figures.of_diagnosis(result) | {"percent": percent}
