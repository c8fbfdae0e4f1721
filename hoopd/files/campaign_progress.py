"""What `hoopd learn` does at this moment and believes so far (`hoopd.progress/1`), for whoever looks.

Rules of this file: one record and where it lies; it is told anew with every step, and nothing goes on from it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from hoopd.files.json_files import read_json, write_json

PROGRESS = "progress.json"
LOCK, TAKEN = ".learning", "another hoopd learn is at work here"


class BelievedRun(msgspec.Struct, kw_only=True):
    """A run, and what was believed after it."""

    signal: str
    why: str
    seconds: float
    explanation: str
    sure: float
    open: list[str]


class CampaignProgress(msgspec.Struct, kw_only=True):
    """`doing`: in a sentence; `asks`: what a person has to do, empty for nothing; `ended`: why, empty while it goes
    on."""

    schema: Literal["hoopd.progress/1"] = "hoopd.progress/1"
    budget_s: float = 0.0
    confidence: float = 0.0
    doing: str = ""
    asks: str = ""
    ended: str = ""
    runs: list[BelievedRun] = []


def read_progress(folder: Path) -> CampaignProgress:
    """Of a campaign's folder; an empty one where nothing was told yet, InputError for a spoiled one."""
    path = folder / PROGRESS
    told: CampaignProgress = read_json(path, CampaignProgress) if path.exists() else CampaignProgress()
    return told


def write_progress(folder: Path, progress: CampaignProgress) -> None:
    """The whole file."""
    write_json(folder / PROGRESS, progress)
