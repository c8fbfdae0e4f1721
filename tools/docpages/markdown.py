"""Small pieces of Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def code(text: object) -> str:
    """Text as code in a line; nothing for an empty one."""
    plain = str(text)
    return f"`{plain}`" if plain else ""


def plain(text: str) -> str:
    """Text of which nothing but `code` means anything: a product is no emphasis, an interval no link."""
    parts = re.split(r"(`[^`\n]*`)", text)
    return "".join(part if part[:1] == "`" else re.sub(r"([*\[\]<>$#~])", r"\\\1", part) for part in parts)


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; a bar in a cell is not a border."""
    lines = [_row(header), _row("---" for _ in header), *(_row(row) for row in rows)]
    return "\n".join(lines) + "\n"


def sections(*parts: str) -> str:
    """Parts of a page, an empty line between them."""
    return "\n\n".join(part.strip("\n") for part in parts if part.strip()) + "\n"


def _row(cells: Iterable[object]) -> str:
    return "| " + " | ".join(" ".join(str(cell).replace("|", "\\|").split()) for cell in cells) + " |"
