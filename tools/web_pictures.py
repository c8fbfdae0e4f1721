#!/usr/bin/env python3
"""Takes docs/figures/dashboard.png and those of a fault, of work and of a comparison: the page beside the rig.

Rules of this file: it looks at what a person would see and drives as one would; the rig is on the clock, so that no two
pictures are alike, and a busy machine's faults are acknowledged. Usage: tools/web_pictures.py [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from harness.browser import Page, opened
from harness.realrun import FIFO_PRIORITY, fifo_granted
from sim_web import USER, configuration, controllers, ended, started

ROOT = Path(__file__).resolve().parents[1]
LISTEN = "127.0.0.1:8766"
FAULT_S = 60.0  # of the rig's own time: after the driving, however often it had to be armed
STALLED_S = 30.0  # then it is well again, and the controllers take turns
REFERENCES_PX = (-9.0, 18.0, -12.0, 8.0, -10.0, 7.0)  # to the side, from where the target is
HOLD_S = 3.0
JOB_S = 300.0
HIDDEN = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.008}}]"
HANDLE = "document.querySelector('.handle circle').getBoundingClientRect()"


def log_in(page: Page, password: str) -> None:
    """As the one user that the rig knows."""
    page.wait_for("document.querySelector('#mode').innerText === 'RUNNING'")
    page.click("#login")
    page.type("input[name=user]", USER)
    page.type("input[name=password]", password)
    page.key("Enter")
    page.wait_for("document.body.classList.contains('may-drive')")


def arm(page: Page) -> None:
    """Until it runs: pages that open cost time that the rig may have missed."""
    for _ in range(20):
        if page.text("#mode") == "RUNNING":
            return
        page.click("#arm")
        time.sleep(1.5)
    raise SystemExit(f"the rig does not run: {page.text('#faults')}")


def drive(page: Page) -> None:
    """The target to both sides, by hand."""
    for step in REFERENCES_PX:
        arm(page)
        x, y = page.ask(f"(box => [box.x + box.width / 2, box.y + box.height / 2])({HANDLE})")
        page.drag([(x, y), (x + step / 2, y), (x + step, y)])
        time.sleep(HOLD_S)
    page.ask("document.activeElement.blur()")


def recorded(folder: Path) -> Path:
    """Two experiments on a rig with friction that its model does not know."""
    folder.mkdir()
    for kind in ("prbs", "multisine"):
        words = ("experiment", kind, "--sim", "--speed", "max", "--camera", "direct", "--set", HIDDEN)
        started(*words, "--out", str(folder / f"{kind}.mcap")).wait()
    return folder


def work(page: Page) -> None:
    """A diagnosis of one, judged by the other, and its report."""
    page.click("[data-to=work]")
    for name in ("multisine.mcap", "prbs.mcap"):
        page.wait_for(f"document.querySelector('[aria-label=\"choose {name}\"]') !== null")
        page.click(f"[aria-label='choose {name}']")
    page.ask("document.querySelector('#job-form [name=holdout]').value = 'multisine.mcap'")
    page.ask("document.querySelector('#job-form [name=model]').value = 'models/hoop.yaml'")
    page.click("#job-form .primary")
    page.wait_for("document.querySelector('#jobs li').dataset.state === 'done'", JOB_S)
    page.click("#jobs .row button")
    time.sleep(HOLD_S)
    page.ask("window.scrollTo(0, 0)")


def compare(page: Page) -> None:
    """The shipped controllers, in turns, again when a fault came between."""
    page.ask("void (location.hash = '#try')")
    page.wait_for("[...document.querySelectorAll('#candidate option')].some(one => one.value.startsWith('arx'))")
    candidate = "[...document.querySelectorAll('#candidate option')].find(one => one.value.startsWith('arx'))"
    page.ask(f"void (document.querySelector('#candidate').value = {candidate}.value)")
    for _ in range(10):
        while page.text("#mode") != "RUNNING":
            page.ask("void document.querySelector('#compare .arm').click()")
            time.sleep(1.5)
        page.ask("page.compare.begin()")
        page.wait_for("page.compare.last && !page.compare.last.running", JOB_S)
        if page.ask("page.compare.last.verdict === 'better'"):
            time.sleep(HOLD_S)
            return
    raise SystemExit("no comparison came to its end")


def main() -> int:
    """Exit code 0 when all pictures are there."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "figures"
    with tempfile.TemporaryDirectory(prefix="hoopd-web-") as temporary:
        shared = ("--config", str(configuration(Path(temporary), "turn")))
        fault = ("--set", f"sim.faults=[{{kind: camera_stall, at_s: {FAULT_S}, for_s: {STALLED_S}}}]")
        # with the priority that the unit grants, where this machine does, too: a browser starts beside it
        first = ("chrt", "--fifo", str(FIFO_PRIORITY)) if fifo_granted() else ()
        own = controllers(Path(temporary) / "controllers")
        rig = started("--sim", "--camera", "direct", *shared, *own, *fault, first=first)
        recordings = recorded(Path(temporary) / "recordings")
        bench = ("--recordings", str(recordings), "--controllers", str(Path(temporary) / "controllers"))
        server = started("dashboard", *shared, "--listen", LISTEN, *bench)
        try:
            with opened(Path(temporary), f"http://{LISTEN}/", 1440, 900) as page:
                page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
                log_in(page, "turn")
                drive(page)
                page.picture(folder / "dashboard.png")
                page.key("t")
                page.size(1920, 1080)
                page.wait_for("document.querySelector('#faults').innerText.includes('camera_lost')", 2 * FAULT_S)
                time.sleep(HOLD_S)
                page.picture(folder / "dashboard_fault.png")
                page.size(1440, 1400)
                work(page)
                page.picture(folder / "dashboard_work.png")
                page.size(1440, 1000)
                compare(page)
                page.picture(folder / "dashboard_try.png")
        finally:
            ended([rig, server])
    return 0


if __name__ == "__main__":
    sys.exit(main())
