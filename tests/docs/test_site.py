"""The site is built without a warning (links and anchors included), and what it shows is all in its own folder.

The whole site is for `make proof`; the check of every change runs `make docs`, which takes a warning for an error, too.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# What a browser asks for by itself, in pages and in style sheets.
ASKED = re.compile(
    r"""<(?:script|img|iframe|source|link)\b[^>]*?\b(?:src|href)=["']([^"']+)"""
    r"""|url\(["']?([^"')]+)|@import\s+["']([^"']+)"""
)
KINDS = ("guides", "reference", "explanations")


def build(source: Path, site: Path) -> subprocess.CompletedProcess[str]:
    """The site of these pages; a warning is an error."""
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", source, site]
    return subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = build(ROOT / "docs", folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.mark.proof
def test_every_page_is_on_the_site(site: Path) -> None:
    pages = [path for kind in KINDS for path in (ROOT / "docs" / kind).glob("*.md")]
    assert pages and [page for page in pages if not (site / page.parent.name / f"{page.stem}.html").is_file()] == []


@pytest.mark.proof
def test_nothing_is_fetched(site: Path) -> None:
    """Whatever a page asks for is a file of the site: no fonts, scripts or pictures of somebody else."""
    away = []
    for path in (path for path in site.rglob("*") if path.suffix in {".html", ".css"}):
        for match in ASKED.finditer(path.read_text(encoding="utf-8")):
            wanted = next(filter(None, match.groups())).partition("#")[0].partition("?")[0]
            if wanted and not wanted.startswith("data:") and not (path.parent / wanted).exists():
                away.append(f"{path.relative_to(site)}: {wanted}")
    assert away == []


@pytest.mark.proof
def test_search_knows_the_pages(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert '"guides/install"' in index and "coulomb" in index


def test_links_and_anchors_that_lead_nowhere_fail(tmp_path: Path) -> None:
    settings = (ROOT / "docs" / "conf.py").read_text().partition("\ndef setup")[0]  # without the pages from the code
    (tmp_path / "conf.py").write_text(settings.replace('["_static"]', "[]"))
    (tmp_path / "index.md").write_text("# One\n\n```{toctree}\ntwo\n```\n\n[Two](two.md#there)\n")
    (tmp_path / "two.md").write_text("# Two\n\n## There\n")
    assert build(tmp_path, tmp_path / "good").returncode == 0
    broken = ("index.md#nothing", "nothing.md", "#nothing")
    (tmp_path / "two.md").write_text("# Two\n\n## There\n\n" + "\n\n".join(f"[Broken]({link})" for link in broken))
    done = build(tmp_path, tmp_path / "bad")
    assert done.returncode == 1 and [f"two.md:{line}:" in done.stderr for line in (5, 7, 9)] == 3 * [True]
