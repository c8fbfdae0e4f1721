"""The page on modes and faults says what the tables say."""

from __future__ import annotations

import re
from pathlib import Path

from hoopd.core import encoderchecks, picturechecks
from hoopd.core.faulttable import FAULTS, Action
from hoopd.core.modes import ENERGISED, Mode

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "reference" / "faults.md").read_text()


def rows(heading: str) -> list[list[str]]:
    lines = PAGE.split(heading, 1)[1].splitlines()[2:]
    table = []
    for line in lines:
        if not line.startswith("|"):
            break
        table.append([cell.strip() for cell in line.strip("|").split("|")])
    return table


def test_every_fault_stands_in_the_page_as_in_the_code() -> None:
    told = rows("| fault | action |")
    known = [
        [f.name, f.action.name.lower(), str(f.on), str(f.off), "yes" if f.latched else "no", f.meaning] for f in FAULTS
    ]
    assert told == known


def test_modes_and_actions_are_complete() -> None:
    assert [row[0] for row in rows("| mode | drive |")] == list(Mode)
    assert {row[0] for row in rows("| mode | drive |") if row[1] == "on"} == set(ENERGISED)
    assert [row[0] for row in rows("| action | meaning |")] == [action.name.lower() for action in Action]


def test_the_page_on_lies_names_every_row_that_judges_a_sensor() -> None:
    named = (DOCS / "explanations" / "lies.md").read_text().split("The rows")[1].split("of the\n[fault table]")[0]
    assert {*re.findall(r"`(\w+)`", named)} == {*picturechecks.NAMES, *encoderchecks.NAMES, "speed_implausible"}
