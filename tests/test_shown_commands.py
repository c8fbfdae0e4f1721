"""What README and docs tell to type can be typed: commands and options exist, programs and make's targets are there."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from hoopd.commands.cli import UsageError
from tests.shellblocks import PAGES, PROGRAM, ROOT, Shown, below, parse, shown

RE_BLOCK = re.MULTILINE | re.DOTALL
GLOBAL = {"--help", "COMMAND"}


def usage(words: Iterable[str]) -> list[str]:
    """Words without what stands for the reader's own: brackets of what may be left out, dots."""
    return [word.strip("[]") for word in words if not set(word) <= {"."}]


@pytest.mark.parametrize("row", [row for row in shown("hoopd") if row.whole], ids=lambda row: row.text)
def test_a_line_of_a_block_is_understood(row: Shown) -> None:
    parse(usage(row.words[1:]))


def test_what_would_not_be_understood_is_seen() -> None:
    for words in (["nothing"], ["ref"], ["ref", "much"], ["stop", "--now"], ["fit"], ["--sim", "--camera"]):
        with pytest.raises(UsageError):
            parse(words)


def test_what_is_named_within_a_sentence_exists() -> None:
    """There a command may stand without what it needs, so that names are all that can be held."""
    wrong = []
    for row in shown("hoopd"):
        words = [word.partition("=")[0] for word in usage(row.words[1:]) if word not in GLOBAL]
        name = words[0] if words and not words[0].startswith("-") else ""
        command = PROGRAM.commands.get(name) if name else PROGRAM
        options = (option for one in command.params for option in (*one.opts, *one.secondary_opts)) if command else ()
        known = set(options)
        wrong += [row.text for word in words if not command or (word.startswith("--") and word not in known)]
    assert wrong == []


def test_every_command_is_on_a_page() -> None:
    named = {row.words[1] for row in shown("hoopd") if len(row.words) > 1}
    assert set(PROGRAM.commands) <= named


def test_the_page_of_help_groups_every_command_and_tells_the_exit_codes() -> None:
    assert all(getattr(command, "rich_help_panel", None) and command.help for command in PROGRAM.commands.values())
    codes = re.findall(r"(\d) (?=[a-z])", PROGRAM.epilog)
    table = (ROOT / "README.md").read_text(encoding="utf-8").partition("| exit code |")[2].partition("\n\n")[0]
    assert codes == ["0", "1", "2", "3"] == re.findall(r"^\| (\d) \|", table, re.MULTILINE)


def test_programs_of_the_tree_take_what_is_shown() -> None:
    wrong = []
    for row in shown("python"):
        place = ROOT / row.words[1]
        if row.words[1] == "-m":
            continue
        files = sorted(place.glob("*.py")) if place.is_dir() else [place] if place.is_file() else []
        text = "".join(file.read_text(encoding="utf-8") for file in files)
        options = [word for word in usage(row.words[2:]) if word.startswith("--")]
        wrong += [row.text for option in (*options, "") if not text or option not in text]
    assert wrong == []


def test_the_bench_s_table_names_what_there_is() -> None:
    """The page's table of benches: each is there and has the options that are shown."""
    table = (ROOT / "docs" / "reference" / "measurements.md").read_text(encoding="utf-8")
    benches = {path.name: path for path in (ROOT / "tools" / "bench").glob("*.py") if is_program(path)}
    named = set(re.findall(r"`(\w+\.py)", table))
    assert named and named <= set(benches)
    for line in table.splitlines():
        for name in re.findall(r"`(\w+\.py)", line)[:1]:
            for option in re.findall(r"--\w[\w-]*", line.split("|")[1]):
                assert f'"{option}"' in benches[name].read_text(encoding="utf-8"), (name, option)


def is_program(path: Path) -> bool:
    return "__main__" in path.read_text(encoding="utf-8")


def test_targets_of_make_are_there() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    wanted = {word for row in shown("make") for word in row.words[1:] if word.islower() and "=" not in word}
    assert wanted <= targets


def test_the_first_lines_say_what_to_type() -> None:
    """A stranger reads thirty lines: what it is, and three commands that run as they stand."""
    top = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:30]
    assert "make sim" in "\n".join(top) and "hoopd --sim" in "\n".join(top)
    assert [row.words for row in below("# hoopd")][:2] == [("make", "sim"), ("source", ".venv/bin/activate")]


def test_links_between_pages_lead_somewhere() -> None:
    broken = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if (
                "://" not in link
                and not link.startswith(("generated/", "../reference/generated/", "reference/generated/"))
                and not (page.parent / link).exists()
            ):
                broken.append(f"{page.name}: {link}")
    assert broken == []


def anchors(page: Path) -> set[str]:
    """Of a page's headings, as code hosts make them; a second heading of the same words has a number."""
    found: list[str] = []
    for heading in re.findall(
        r"^#+ (.*)", re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=RE_BLOCK), re.MULTILINE
    ):
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        found.append(f"{slug}-{found.count(slug)}" if slug in found else slug)
    return set(found)


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"])
def test_anchors_of_the_front_pages_lead_somewhere(name: str) -> None:
    """Those of the pages in docs/ are checked when the site is built."""
    links = re.findall(r"\]\(([^)#\s]*)#([^)\s]+)\)", (ROOT / name).read_text(encoding="utf-8"))
    broken = [
        f"{link}#{anchor}"
        for link, anchor in links
        if "://" not in link and anchor not in anchors(ROOT / (link or name))
    ]
    assert broken == []


def test_pages_that_code_and_configuration_name_are_there() -> None:
    """A message or a docstring that sends its reader to a page sends him to one that is there."""
    missing = []
    for folder in ("hoopd", "tests", "tools", "config", "systemd"):
        for path in (path for path in (ROOT / folder).rglob("*") if path.suffix in {".py", ".yaml", ".service"}):
            named = re.findall(r"(?<![\w/.])docs/(?!test_)[\w/.]+\.(?:md|py|png)", path.read_text(encoding="utf-8"))
            missing += [f"{path.relative_to(ROOT)}: {name}" for name in named if not (ROOT / name).is_file()]
    assert missing == []
