"""What a comparison shows beside its verdict: figures that got worse in words, and all of it on a phone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from dashboard.served import served
from design.test_comparison import begun
from harness.browser import CHROMIUM, opened
from shell.peers import free_endpoint, running, tick

from hoopd.dashboard.feed import Feed
from hoopd.shell.telemetry import TelemetrySettings

BESIDE = {
    "device": "hoop", "who": "ann", "begun": 1.0, "running": False, "step": "", "share": 1.0, "decided": "",
    "accepted": f"lqg.yaml@{'cd' * 32}", "hoop_speed_counted": True,
}  # fmt: skip


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_what_got_worse_stands_in_words_between_the_verdict_and_the_figures(tmp_path: Path) -> None:
    rig = begun(20, off={"A": 0.02, "B": 0.015}, torque={"A": 0.001, "B": 0.02}, scatter=0.1)
    rig.run()
    result = rig.comparison.result()
    assert len(result["warnings"]) == 2 and result["warnings"][1].endswith("(+1900 %, +1900 to +1900 %).")
    endpoint = free_endpoint()
    with (
        running(TelemetrySettings(endpoint=endpoint)) as telemetry,
        served(Feed([endpoint], {})) as web,
        opened(tmp_path, f"{web.origin}/#try", 390, 844) as page,
    ):
        telemetry.put(tick(1))
        page.wait_for("window.page?.device")
        page.ask(f"void (page.compare.ask = () => null, page.compare.last = {json.dumps({**BESIDE, **result})})")
        page.wait_for("document.querySelectorAll('#compare-table tbody tr').length === 3")
        assert "The candidate is better" in page.text("#compare-verdict")
        said = page.ask("[...document.querySelectorAll('#compare-warnings > li')].map((one) => one.textContent)")
        assert said == result["warnings"]
        assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0 and page.errors == []
