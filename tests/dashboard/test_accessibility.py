"""Every view of the page, in both themes, by the rules of axe-core: contrast, names, roles, reach by the keyboard."""

from __future__ import annotations

import importlib.resources
import json
from collections.abc import Iterator
from typing import Any

import pytest
from dashboard.bench_folder import lay_out
from dashboard.driven import log_in
from dashboard.followed_folders import followed_folders
from dashboard.served import served
from harness.browser import CHROMIUM, Page, opened
from shell.peers import Ticks, controlled, running, wait_until

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
AXE = "axe_core_python"
VIEWS = ("drive", "calibrate", "work", "try", "follow")
# WCAG 2.1, levels A and AA, and what axe's authors recommend beside them.
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]}
# Where the focus is, from one press of the tabulator to the next.
FOCUSED = (
    "(e => e === document.body ? '' : e.id || e.getAttribute('aria-label') || e.innerText)(document.activeElement)"
)
OUTLINED = "getComputedStyle(document.activeElement).outlineStyle"
REACHED = {
    "drive": {"login", "arm", "brake", "clear", "picture-open", "load-file", "stop"},
    "calibrate": {"picture-open", "guide-why", "stop"},
    "work": {"Search recordings", "choose first.csv", "stop"},
    "try": {"signal-kind", "candidate", "stop"},
    "follow": {"Accept version 1", "Leave version 1", "Versions of healed", "Story", "stop"},
}
PRESSES = 150


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("axe")
    settings = controlled(folder)
    bench = Bench(lay_out(folder / "recordings"), folder / "results")
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    script = importlib.resources.files(AXE).joinpath("axe.min.js").read_text(encoding="utf-8")
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate),
        served(Feed([settings.endpoint], {}), operators, bench=bench, followed=followed_folders(folder)) as web,
        opened(folder, web.origin, 1280, 900) as page,
    ):
        assert wait_until(lambda: any(one.alive for one in web.feed.devices.values()))
        page.call("Runtime.evaluate", expression=script)  # as the page's own: its policy lets no other script in
        log_in(page)
        page.wait_for(
            "document.querySelectorAll('#recordings tbody tr').length === 4 || (location.hash = '#work', false)"
        )
        yield page


def show(page: Page, view: str, theme: str) -> None:
    page.ask(f"void (location.hash = '#{view}')")
    page.wait_for(f"!document.querySelector('main[data-view={view}]').hidden")
    for _ in range(3):
        if page.ask("document.documentElement.dataset.theme") == theme:
            return
        page.ask("void document.querySelector('#theme').click()")
    raise AssertionError("there is no such theme")


def told(found: dict[str, Any]) -> str:
    return f"{found['id']}: {found['help']}: {[node['target'] for node in found['nodes']][:5]}"


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("view", VIEWS)
def test_no_rule_is_broken(page: Page, view: str, theme: str) -> None:
    show(page, view, theme)
    result = page.ask(f"axe.run(document, {json.dumps(RULES)})")
    assert len(result["passes"]) > 15
    assert [told(one) for one in result["violations"]] == []


@pytest.mark.parametrize("view", VIEWS)
def test_everything_is_reached_by_the_keyboard_and_seen_to_be(page: Page, view: str) -> None:
    show(page, view, "dark")
    page.ask("document.activeElement.blur()")
    reached: list[str] = []
    for _ in range(PRESSES):
        page.key("Tab")
        name = str(page.ask(FOCUSED))
        assert not name or page.ask(OUTLINED) != "none", f"{name} does not show that it has the focus"
        if REACHED[view] <= {*reached}:
            break
        reached.append(name)
    assert REACHED[view] <= {*reached}, reached


def test_a_broken_page_is_noticed(page: Page) -> None:
    show(page, "drive", "dark")
    page.ask("void document.querySelector('#arm').insertAdjacentHTML('afterend', '<button id=\"nameless\"></button>')")
    try:
        found = page.ask(f"axe.run(document, {json.dumps(RULES)})")["violations"]
    finally:
        page.ask("document.querySelector('#nameless').remove()")
    assert any(one["id"] == "button-name" for one in found)
