"""Which locked versions an advisory touches, by made-up advisories in the OSV format."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ROOT / "tools"


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))


def tool(name: str) -> ModuleType:
    return importlib.import_module(name)


def advisory(*events: dict[str, str], name: str = "Tiny.Package", **more: Any) -> dict[str, Any]:
    """An advisory about one package, with one range of versions."""
    spans = [{"type": "ECOSYSTEM", "events": list(events)}] if events else []
    entry = {"package": {"ecosystem": "PyPI", "name": name}, "ranges": spans, **more.pop("entry", {})}
    return {"id": "TEST-1", "modified": "2026-01-02T03:04:05Z", "summary": "Made up.", "affected": [entry], **more}


@pytest.mark.parametrize(
    ("events", "touched", "spared"),
    [
        ([{"introduced": "0"}], ["0.dev0", "0", "1.0", "99!1"], []),
        (
            [{"introduced": "0"}, {"fixed": "1.2"}],
            ["0.1", "1.1.9", "1.2rc1", "1.2.dev3"],
            ["1.2", "1.2.0", "1.2.post1"],
        ),
        ([{"introduced": "1.2"}, {"last_affected": "1.4"}], ["1.2", "1.4", "1.4.0"], ["1.1", "1.4.1", "1.4.post1"]),
        # As text 1.10 lies before 1.9.
        ([{"introduced": "1.9"}, {"fixed": "1.10"}], ["1.9.5"], ["1.10", "1.1"]),
        # Two stretches in one range, not in order.
        (
            [{"introduced": "2.0"}, {"fixed": "2.1"}, {"introduced": "0"}, {"fixed": "1.5"}],
            ["1.4", "2.0.9"],
            ["1.5", "1.9", "2.1"],
        ),
        ([{"introduced": "0"}, {"limit": "2.0"}], ["1.9"], ["2.0", "3.0"]),
        ([{"introduced": "1.0"}, {"fixed": "not a version"}], ["0.1", "5.0"], []),
    ],
)
def test_ranges(events: list[dict[str, str]], touched: list[str], spared: list[str]) -> None:
    touches = tool("advisories").touches
    entry = advisory(*events)["affected"][0]
    assert [version for version in touched + spared if touches(entry, version)] == touched


def test_versions_by_name_and_entries_that_name_none() -> None:
    touches = tool("advisories").touches
    listed = advisory(entry={"versions": ["1.0", "2004b", "1.3"]})["affected"][0]
    assert [version for version in ("1.0", "1.0.0", "1.1", "1.3") if touches(listed, version)] == [
        "1.0",
        "1.0.0",
        "1.3",
    ]
    assert touches(advisory()["affected"][0], "7.0")
    commits = [{"type": "GIT", "events": [{"introduced": "0"}]}]
    assert not touches(advisory(entry={"ranges": commits, "versions": ["1.0"]})["affected"][0], "2.0")


def database(folder: Path, *records: Any, packed: bool) -> Path:
    """A folder or a zip of advisories."""
    if packed:
        with zipfile.ZipFile(folder / "all.zip", "w") as archive:
            for number, record in enumerate(records):
                archive.writestr(f"{number}.json", json.dumps(record))
        return folder / "all.zip"
    (folder / "db" / "deeper").mkdir(parents=True)
    for number, record in enumerate(records):
        (folder / "db" / "deeper" / f"{number}.json").write_text(json.dumps(record))
    return folder / "db"


def audit(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The tool with a lock file of one package."""
    lock = folder / "tiny.lock"
    lock.write_text(f"tiny-package==1.0 --hash=sha256:{64 * '0'}\n")
    command = [sys.executable, TOOLS / "audit.py", "--lock", lock, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("packed", [False, True])
def test_a_touched_version_is_one_line_and_exit_code_1(packed: bool, tmp_path: Path) -> None:
    records = [
        advisory({"introduced": "0"}, {"fixed": "1.1"}, aliases=["CVE-0000-0001"]),
        advisory({"introduced": "0"}, {"fixed": "1.0"}, id="TEST-2"),
        advisory({"introduced": "0"}, id="TEST-3", withdrawn="2026-02-01T00:00:00Z"),
        advisory({"introduced": "0"}, id="TEST-4", name="another"),
        {**advisory(id="TEST-5"), "affected": [{"package": {"ecosystem": "npm", "name": "tiny-package"}}]},
    ]
    done = audit(tmp_path, database(tmp_path, *records, packed=packed), "--json", tmp_path / "found.json")
    assert done.returncode == 1, done.stderr
    assert done.stdout.splitlines() == [
        "tiny-package 1.0: TEST-1 (CVE-0000-0001): Made up.; fixed in 1.1",
        "audit: 1 packages, 3 advisories, the newest of 2026-01-02: 1 touched, 0 accepted",
    ]
    assert [row["id"] for row in json.loads((tmp_path / "found.json").read_text())] == ["TEST-1"]


def test_nothing_touched_is_exit_code_0(tmp_path: Path) -> None:
    done = audit(tmp_path, database(tmp_path, advisory({"introduced": "1.1"}), packed=False))
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 touched" in done.stdout


def test_without_a_database_it_says_that_it_is_skipped(tmp_path: Path) -> None:
    done = audit(tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith("audit: skipped, no database")


@pytest.mark.parametrize(
    "text",
    ["{", "[]", "{}", '{"id": "A", "affected": [{"package": {"ecosystem": "PyPI", "name": "x"}, "ranges": [7]}]}',
     '{"id": "A", "affected": 7}', 100_000 * "[", '{"id": "A", "affected": []}'],
    ids=["half", "list", "empty", "number for range", "number for affected", "deep", "about nothing"],
)  # fmt: skip
def test_an_unusable_database_is_one_line_and_exit_code_2(text: str, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text(text)
    for path in (tmp_path / "bad.json", tmp_path / "none.zip"):
        done = audit(tmp_path, path)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(f"audit: {path}") and done.stderr.count("\n") == 1


def test_an_accepted_advisory_is_told_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tool_ = tool("audit")
    path = database(tmp_path, advisory({"introduced": "0"}, aliases=["CVE-0000-0001"]), packed=False)
    (tmp_path / "tiny.lock").write_text(f"tiny-package==1.0 --hash=sha256:{64 * '0'}\n")
    monkeypatch.setattr(tool_, "accepted", lambda: {"CVE-0000-0001": "never called"})
    monkeypatch.setattr(sys, "argv", ["audit", str(path), "--lock", str(tmp_path / "tiny.lock")])
    assert tool_.main() == 0
    assert "[accepted: never called]" in capsys.readouterr().out
