"""Folders of a campaign and of a healed loop, as their commands leave them."""

from __future__ import annotations

from pathlib import Path

from hoopd.files.campaign_progress import BelievedRun, CampaignProgress, write_progress
from hoopd.files.heal_versions import VersionFolder


def followed_folders(folder: Path) -> tuple[Path, Path]:
    """A campaign after its first run, and a loop with a version that waits for a person."""
    return campaign(folder / "learned"), healed(folder / "healed")


def campaign(folder: Path) -> Path:
    """One run was diagnosed, the next one is recorded."""
    (folder / "run_01").mkdir(parents=True)
    (folder / "learn.json").write_text("{}")
    (folder / "story.html").write_text("<!DOCTYPE html><p>what was believed")
    run = BelievedRun(
        signal="prbs", why="nothing is known yet", seconds=21.0, explanation="hoop.<b>friction", sure=0.65,
        open=["65% sure, 95% are asked for"],
    )  # fmt: skip
    doing = {"doing": "run 2: recording chirp", "asks": "the operator: arm the device"}
    write_progress(folder, CampaignProgress(budget_s=180.0, confidence=0.95, runs=[run], **doing))
    return folder


def healed(folder: Path) -> Path:
    """As it was found, and one that is proposed."""
    versions = VersionFolder(folder)
    versions.begin("hoop")
    versions.first("lqg.yaml@" + "0" * 64, "law", "model", 0.0, "ann")
    version = versions.add(60.0, kind="physics", reason="new: hoop.coulomb_friction", key="heal-1.yaml@" + "1" * 64)
    (versions.of(1) / "model.yaml").write_text("a: 1\n")
    (versions.of(1) / "report.html").write_text("<!DOCTYPE html><p>friction")
    version.sha256 = versions.hashes(1)
    version.evidence = {"gain": {"nats": 90.0}, "promise": {"before": 0.04, "new": 0.03}}
    version.state = "proposed"
    versions.keep(version, 61.0, "proven: 90 nats")
    return folder
