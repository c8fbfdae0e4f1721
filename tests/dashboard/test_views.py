"""The parts of the page: a bar to change between them, an address that keeps where one is, STOP in all of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from shell.peers import Ticks, controlled, running

from hoopd.core.records import Command
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
SEEN = "[...document.querySelectorAll('[data-view]')].filter(one => one.offsetParent)"
SHOWN = f"{SEEN}.map(one => one.dataset.view).join()"
MIDDLE = "(b => [b.x + b.width / 2, b.y + b.height / 2])(document.querySelector('#stop').getBoundingClientRect())"
STOP_SEEN = f"document.elementFromPoint(...{MIDDLE}).closest('#stop') !== null"


def test_one_view_is_shown_the_address_keeps_it_and_stop_is_in_all(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        served(Feed([settings.endpoint], {}), operators) as web,
        opened(tmp_path, web.origin) as page,
    ):
        page.wait_for(f"{SHOWN} === 'drive'")
        page.click("[data-to=work]")
        page.wait_for(f"{SHOWN} === 'work' && location.hash.startsWith('#work')")
        page.call("Page.reload")
        page.wait_for(f"window.page && page.device && {SHOWN} === 'work'")
        assert page.ask("document.querySelector('[data-to=work]').getAttribute('aria-current')") == "page"
        assert page.ask(STOP_SEEN)
        page.click("#stop")
        page.wait_for("document.querySelector('#answer').innerText.includes('disarm')")
        assert ticks.take() == (Command("disarm"),)
        page.ask("void (location.hash = '#hoop%40somewhere')")  # an address of a device alone
        page.wait_for(f"{SHOWN} === 'drive' && location.hash === '#drive/hoop%40somewhere'")
        assert page.errors == []
