"""The field tables in docs/ say what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hoopd.recording import schemas

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"
ROW = re.compile(r"^\| `([^`]+)` \| (.*?) \| (.*) \|$")


def documented(page: str, heading: str) -> dict[str, schemas.FieldDescription]:
    """Field table below a heading."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    below = lines[lines.index(heading) + 1 :]
    end = next((k for k, line in enumerate(below) if line.startswith("#")), len(below))
    rows = [match.groups() for line in below[:end] if (match := ROW.match(line))]
    return {name: schemas.FieldDescription("" if unit == "–" else unit, meaning) for name, unit, meaning in rows}


@pytest.mark.parametrize(
    ("page", "heading", "table"),
    [
        ("telemetry.md", "## Message `tick`", schemas.TICK),
        ("telemetry.md", "## Message `event`", schemas.EVENT),
        ("recording.md", "## Channel `tick` (`hoopd.tick`)", schemas.TICK),
        ("recording.md", "## Channel `input` (`hoopd.input`)", schemas.INPUT),
        ("recording.md", "## Channel `event` (`hoopd.event`)", schemas.EVENT),
        ("recording.md", "### `camera`", schemas.CAMERA),
        ("recording.md", "### `driver`", schemas.DRIVER),
        ("recording.md", "### `link`", schemas.LINK),
        ("recording.md", "### `commands[]`", schemas.COMMAND),
    ],
)
def test_field_tables(page: str, heading: str, table: schemas.Table) -> None:
    assert documented(page, heading) == dict(table)
    assert list(documented(page, heading)) == list(table)
