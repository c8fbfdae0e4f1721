"""Options of `hoopd learn`.

Rules of this file: the record alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import option
from hoopd.commands.options.running import config_option, sets_option
from hoopd.commands.options.shared import age_option, columns_option, hold_option, json_option
from hoopd.files.reading import InputError

_UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0}
LONGEST_S = 24 * 3600.0


def seconds_of(text: str) -> float:
    """Seconds of "10min", "90s", "1.5h" or "600"; InputError for anything else."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?)(s|min|h)?", text)
    value = float(found[1]) * _UNITS_S[found[2] or "s"] if found else 0.0
    if not 0.0 < value <= LONGEST_S:
        raise InputError("--budget", "", f"must be a time up to a day, as 10min or 90s, not {text!r}")
    return value


@dataclass(frozen=True, kw_only=True)
class LearnOptions:
    """Record and diagnose until it is known what the model leaves out, then try a controller that knows it."""

    sim: bool = option("--sim", text="On the simulated rig, as fast as it goes.", default=False, python=False)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    plant: str | None = option(
        "--plant", text="Plant of the recordings: a registered name, or a plant file; the hoop else.", python=False
    )
    recordings: tuple[str, ...] = option(
        "--recording",
        text="With --plant: what was recorded; repeatable. The next input is told, nothing is driven.",
        metavar="REC",
        default=(),
        python=False,
    )
    columns: str | None = columns_option()
    hold: str = hold_option()
    age: str = age_option()
    budget: str = option("--budget", text="Recorded time at most, as 10min or 90s.", metavar="TIME", default="10min")
    confidence: float = option(
        "--confidence",
        min=0.5,
        max=0.999,
        text="Probability that one explanation shall reach among all laws that are known.",
        default=0.95,
    )
    seed: int = option("--seed", min=0, text="Seed of signals, rig and search.", default=0)
    out: Path = option(
        "--out",
        text="Folder of the campaign; one that was broken off goes on.",
        default=Path("learned"),
        metavar="FOLDER",
        python="folder",
    )
    memory: Path | None = option(
        "--memory",
        text="What is known of this device (hoopd.memory/1): the prior of each diagnosis; what is learned is added.",
        metavar="FILE",
    )
    jobs: int = option("--jobs", min=1, max=64, text="Processes that share a diagnosis.", default=1)
    yes: bool = option(
        "--yes", text="Ask nothing before a run; an operator still arms the device.", default=False, python=False
    )
    json_path: Path | None = json_option()
