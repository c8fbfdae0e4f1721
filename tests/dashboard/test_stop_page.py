"""From a click on STOP to a board whose torque is zero, by the board's own log."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from dashboard.driven import BUSY_S, arm, driven, log_in
from harness.browser import CHROMIUM, Page
from harness.timing import on_the_clock

WITHIN_S = 0.1
WHERE = "(b => [b.x + b.width / 2, b.y + b.height / 2])(document.querySelector('#stop').getBoundingClientRect())"


def clicked(page: Page) -> float:
    """When the button was let go, s."""
    x, y = page.ask(WHERE)
    page.mouse("mousePressed", x, y)
    at = time.monotonic()
    page.mouse("mouseReleased", x, y)
    return at


@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_the_torque_is_zero_within_a_tenth_of_a_second(tmp_path: Path) -> None:
    with driven(tmp_path, sim={"commands": []}) as rig:
        log_in(rig.page)
        arm(rig.page)
        time.sleep(1.0)
        arm(rig.page)
        at = clicked(rig.page)
        rig.page.wait_for("document.querySelector('#answer').dataset.state === 'good'", BUSY_S)
    run = rig.daemon.result()
    last = max(row.t for row in run.torque.rows if row.torque_nm)
    with on_the_clock():
        assert last > at - WITHIN_S, "no torque that could become zero: something else had switched off"
        assert last - at <= WITHIN_S, f"{1e3 * (last - at):.0f} ms from the click to the last torque"
