"""The page in a real browser: it asks for nothing, overflows at no width, and shows its verdict and every part.

Rules of this file: Debian's chromium, headless, against a server on the loopback interface that counts what is asked
for. The page runs no script; a page of the test's own opens it in frames of two widths and measures them.
"""

from __future__ import annotations

import contextlib
import html
import json
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from diagnose.examples import EXAMPLES, made

from hoopd.diagnose.report import headline

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")

PHONE, DESK = 390, 1200
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
)  # fmt: skip
# The measuring page: each frame's title, width, parts and what it asked for, as JSON in its own text.
MEASURE = """<!DOCTYPE html><title>measure</title><pre id="found"></pre><script>
const wanted = WANTED, found = [];
const done = (frame, name, width) => {
  const page = frame.contentDocument, root = page.documentElement, box = one => one.getBoundingClientRect();
  found.push({name, width, title: page.title, text: page.body.innerText, overflow: root.scrollWidth - width,
    flat: [...page.querySelectorAll('section, figure svg, table')].filter(one => box(one).height < 20).length,
    sections: [...page.querySelectorAll('section')].map(one => one.id),
    drawings: page.querySelectorAll('figure svg').length,
    outside: [...page.querySelectorAll('figcaption, p, h1, h2, .wide')].filter(one => box(one).right > width).length,
    scrolled: [...page.querySelectorAll('.wide')].filter(one => one.scrollWidth > one.clientWidth + 1).length,
    asked: frame.contentWindow.performance.getEntriesByType('resource').map(one => one.name)});
  if (found.length == wanted.length) document.getElementById('found').textContent = JSON.stringify(found);
};
for (const [name, width] of wanted) {
  const frame = document.createElement('iframe');
  frame.style = `border: 0; height: 900px; width: ${width}px`;
  frame.onload = () => done(frame, name, width);
  frame.src = name;
  document.body.append(frame);
}
</script>"""


@dataclass
class Site:
    """A folder served on the loopback interface, and what was asked of it."""

    folder: Path
    address: str
    asked: list[str] = field(default_factory=list)

    def measured(self, wanted: list[tuple[str, int]]) -> list[dict[str, Any]]:
        """Pages opened at widths [px]."""
        (self.folder / "measure.html").write_text(MEASURE.replace("WANTED", json.dumps(wanted)))
        dom = self._chromium("--virtual-time-budget=20000", "--dump-dom", f"{self.address}/measure.html")
        found = re.search(r'<pre id="found">(.*?)</pre>', dom, re.DOTALL)
        assert found is not None and found.group(1), "the pages did not load"
        measured: list[dict[str, Any]] = json.loads(html.unescape(found.group(1)))
        return sorted(measured, key=lambda one: (one["name"], one["width"]))

    def _chromium(self, *arguments: str) -> str:
        profile = self.folder / "profile"
        command = [str(CHROMIUM), *FLAGS, f"--user-data-dir={profile}", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=90).stdout


class Handler(SimpleHTTPRequestHandler):
    """Notes every path that is asked for."""

    def __init__(self, *arguments: Any, asked: list[str], **options: Any) -> None:
        self.asked = asked
        super().__init__(*arguments, **options)

    def log_request(self, code: object = "-", size: object = "-") -> None:
        self.asked.append(self.path)

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@pytest.fixture
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with _served(tmp_path_factory.mktemp("site")) as site:
        yield site


@contextlib.contextmanager
def _served(folder: Path) -> Iterator[Site]:
    asked = list[str]()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder), asked=asked))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield Site(folder, f"http://127.0.0.1:{server.server_port}", asked)
    server.shutdown()
    server.server_close()
    thread.join()


WIDTHS = [(f"{name}.html", width) for name in EXAMPLES for width in (PHONE, DESK)]


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict[str, Any]], list[str]]:
    """Every example at both widths, and what was asked of the server."""
    with _served(tmp_path_factory.mktemp("visit")) as site:
        for name in EXAMPLES:
            (site.folder / f"{name}.html").write_bytes(made(name))
        return site.measured(WIDTHS), site.asked


def squeezed(text: str) -> str:
    return " ".join(text.split())


def test_every_page_shows_its_verdict_and_all_its_parts_at_both_widths_and_asks_for_nothing(
    visit: tuple[list[dict[str, Any]], list[str]],
) -> None:
    measured, asked = visit
    assert [(one["name"], one["width"]) for one in measured] == sorted(WIDTHS)
    for one in measured:
        diagnosis, _ = EXAMPLES[one["name"].removesuffix(".html")]()
        assert one["title"] == f"Diagnosis: {headline.TITLES[diagnosis.verdict]}"
        assert squeezed(headline.verdict_sentence(diagnosis)) in squeezed(one["text"])
        assert {"where", "proof", "alternatives", "parameters", "power", "quality"} <= set(one["sections"])
        assert one["drawings"] >= 4 and one["flat"] == 0
        assert one["overflow"] <= 0 and one["outside"] == 0, one
        assert one["asked"] == []
    assert set(asked) - {"/favicon.ico"} == {"/measure.html", *(f"/{name}.html" for name in EXAMPLES)}


def test_on_a_desk_nothing_has_to_be_scrolled_sideways_and_on_a_phone_only_inside_the_page(
    visit: tuple[list[dict[str, Any]], list[str]],
) -> None:
    for one in visit[0]:
        if one["width"] == DESK:
            assert one["scrolled"] == 0
        else:
            assert one["scrolled"] >= one["drawings"]  # drawings stay large enough to be read


def test_a_page_that_did_ask_or_overflow_would_be_caught_and_its_policy_stops_the_request(site: Site) -> None:
    whole = made("consistent").decode()
    wide = '<div class="wide" style="width: 3000px">x</div><img src="/spy.png"><script src="/spy.js"></script></body>'
    spoiled = whole.replace("</body>", wide)
    assert spoiled != whole
    (site.folder / "guarded.html").write_text(spoiled)
    (site.folder / "open.html").write_text(re.sub(r"<meta http-equiv=[^>]*>", "", spoiled))
    guarded, unguarded = site.measured([("guarded.html", DESK), ("open.html", DESK)])
    assert guarded["overflow"] > 0 and guarded["outside"] > 0
    assert len(unguarded["asked"]) == 2
    # once each, by the page without a policy
    assert sorted(path for path in site.asked if path.startswith("/spy")) == ["/spy.js", "/spy.png"]
