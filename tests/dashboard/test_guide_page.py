"""The guided calibration in a browser, beside a daemon with its rig in real time: the hoop moves, a result is accepted,
an earlier one comes back."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest
from dashboard.driven import BUSY_S, Driven, arm, driven, log_in
from harness.browser import CHROMIUM

from hoopd.dashboard.guide.guide import KeptCalibrations
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.jobs import Jobs
from hoopd.files.calibration import Calibrations
from hoopd.files.shipped import defaults_folder

HOSTILE = "<img src=x onerror=window.broken=1>"
TRIES = 6


def laid_out(folder: Path) -> tuple[Bench, KeptCalibrations]:
    """Folders as a laboratory has them."""
    for name in ("recordings", "results", "controllers", "versions"):
        (folder / name).mkdir()
    shutil.copy(defaults_folder() / "controllers" / "lqg.yaml", folder / "controllers")
    bench = Bench(folder / "recordings", folder / "results", folder / "controllers")
    bench.jobs = Jobs(folder / "results" / "jobs", starting=tuple)  # not at idle priority: others may leave it no time
    return bench, KeptCalibrations(Calibrations(folder / "versions"), "hoop")


def goes_to(rig: Driven, view: str) -> None:
    rig.page.ask(f"void (location.hash = '#{view}')")
    rig.page.wait_for(f"!document.querySelector('main[data-view={view}]').hidden")


def word(rig: Driven, step: str) -> str:
    return str(rig.page.ask(f"document.querySelector('[data-step-card={step}] .word').innerText"))


def play(rig: Driven) -> None:
    """Until a signal was played to its end: a busy machine's faults end some."""
    for _ in range(TRIES):
        goes_to(rig, "drive")
        arm(rig.page)
        time.sleep(1.5)  # the ball that the rig released comes to rest
        goes_to(rig, "calibrate")
        rig.page.wait_for("!document.querySelector('[data-step=torque]').disabled")
        rig.page.click("[data-step=torque]")
        rig.page.wait_for("/computed|nothing/.test(page.guide.told.motion) || !page.guide.busy")
        rig.page.wait_for("page.guide.told.motion !== 'plays' && !/computes/.test(page.guide.told.motion)", BUSY_S)
        if rig.page.ask("page.guide.told.steps.find(step => step.name === 'torque').result !== null"):
            return
    raise AssertionError(rig.page.ask("page.guide.told.motion"))


@pytest.mark.proof
@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_signs_torque_and_delay_are_measured_accepted_and_rolled_back(tmp_path: Path) -> None:
    bench, kept = laid_out(tmp_path)
    control = {"file": str(tmp_path / "controllers" / "lqg.yaml")}
    sim = {"psi_rad": 0.0, "torque_constant_nm_per_a": 0.3}
    with driven(tmp_path, bench, kept, control=control, sim=sim) as rig:
        page = rig.page
        page.wait_for("window.page && page.device", 60)
        goes_to(rig, "calibrate")
        page.wait_for("document.querySelectorAll('[data-step]').length === 7")
        assert page.ask("[...document.querySelectorAll('[data-step], #guide-accept')].every(one => one.disabled)")
        log_in(page)
        play(rig)
        page.wait_for("document.querySelectorAll('[data-step-card=torque] .drawing path.curve').length === 2")
        assert word(rig, "signs") == "good" and word(rig, "delay") == "good"
        found = page.ask("page.guide.told.steps.find(step => step.name === 'torque').result.values.constant_nm_per_a")
        assert found[0] == pytest.approx(0.3, abs=0.02)
        page.ask("document.querySelector('#guide-why').focus()")
        page.type("#guide-why", HOSTILE)
        page.click("#guide-accept")
        page.wait_for("document.querySelectorAll('#guide-versions [data-row]').length === 1")
        assert HOSTILE in page.text("#guide-versions") and page.ask("window.broken") is None
        assert "counts from the daemon" in page.text("#guide-force")
        shown = Calibrations(tmp_path / "versions").read(1)
        assert shown.configuration["faults"]["torque_constant_nm_per_a"] == pytest.approx(0.3, abs=0.02)
        Calibrations(tmp_path / "versions").add({"vision": {"threshold": 81.0}}, device="hoop", who="other", why="hand")
        page.wait_for("document.querySelectorAll('#guide-versions [data-row]').length === 2")
        page.click("#guide-versions [data-row='1'] button")
        page.wait_for("document.querySelectorAll('#guide-versions [data-row]').length === 3")
        assert Calibrations(tmp_path / "versions").in_force().configuration == shown.configuration  # type: ignore[union-attr]
        lines = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        told = [(one["who"], one["command"]) for one in lines if "calibration" in one["command"] and one["ok"]]
        assert told[-2:] == [
            ("operator", "calibration of signs, torque, delay"),
            ("operator", "calibration restored from 1"),
        ]
        newest = tmp_path / "versions" / "0003.yaml"
        newest.write_text(newest.read_text().replace("restored from 1", "restored from 2"))
        page.wait_for("document.querySelectorAll('#guide-versions [data-row].spoiled').length === 1")
        assert "was changed after it was accepted" in page.text("#guide-force")
        assert page.errors == []
