"""`hoopd calibration`: list, show, add, restore."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hoopd.commands.calibration import run
from hoopd.commands.options.calibration import CalibrationOptions
from hoopd.files.reading import InputError


def asked(tmp_path: Path, action: str, what: str = "", **more: Any) -> dict[str, Any]:
    return run(
        CalibrationOptions(action=action, what=what, sets=(f"calibration.folder={tmp_path / 'versions'}",), **more)
    )


def test_what_was_proposed_is_added_listed_shown_and_restored(tmp_path: Path) -> None:
    (tmp_path / "versions").mkdir()
    proposal = tmp_path / "vision.yaml"
    proposal.write_text("vision: {threshold: 90}\ncamera: {delay_s: 30 ms}\n")
    assert asked(tmp_path, "list")["notes"] == ["no calibration was accepted yet"]
    added = asked(tmp_path, "add", str(proposal), why="a new lamp")
    assert added["configuration"] == {"vision": {"threshold": 90.0}, "camera": {"delay_s": 0.03}}
    proposal.write_text("vision: {threshold: 95}\n")
    asked(tmp_path, "add", str(proposal))
    assert asked(tmp_path, "show", "2")["changes"] == {"vision.threshold": {"before": 90.0, "now": 95.0}}
    assert asked(tmp_path, "restore", "1")["version"] == 3
    told = asked(tmp_path, "list")
    assert told["in_force"] == 3 and [one["why"] for one in told["versions"].values()] == [
        "a new lamp",
        "from vision.yaml",
        "restored from 1",
    ]
    json.dumps(told)


def test_a_spoiled_version_is_the_answer_no(tmp_path: Path) -> None:
    (tmp_path / "versions").mkdir()
    (tmp_path / "versions" / "0001.yaml").write_text("nonsense: 1\n")
    told = asked(tmp_path, "list")
    assert told["exit"] == 1 and told["notes"][0].startswith("0001: ")


@pytest.mark.parametrize(
    ("action", "what", "reason"),
    [
        ("frob", "", "unknown; known: list, show, add, restore"),
        ("restore", "x", "expected a version's number"),
        ("restore", "7", "no such file"),
        ("list", "7", "takes no more than that"),
        ("add", "missing.yaml", "missing.yaml: "),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path: Path, action: str, what: str, reason: str) -> None:
    (tmp_path / "versions").mkdir()
    with pytest.raises(InputError, match=reason):
        asked(tmp_path, action, what)


def test_values_that_the_configuration_refuses_are_refused(tmp_path: Path) -> None:
    (tmp_path / "versions").mkdir()
    (tmp_path / "bad.yaml").write_text("vision: {threshold: 900}\n")
    with pytest.raises(InputError, match=r"vision\.threshold"):
        asked(tmp_path, "add", str(tmp_path / "bad.yaml"))
    (tmp_path / "bad.yaml").write_text("control: {law: evil.py}\n")
    with pytest.raises(InputError, match="no key that a calibration may set"):
        asked(tmp_path, "add", str(tmp_path / "bad.yaml"))


def test_without_a_folder_it_says_where_one_is_named() -> None:
    with pytest.raises(InputError, match="names no folder of calibrations"):
        run(CalibrationOptions(action="list"))
