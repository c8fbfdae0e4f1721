"""The page on architecture is true: its rooms are there, its order of imports is the contract's."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]


def layers(name: str) -> list[str]:
    (contract,) = (one for one in CONTRACTS if name in one["name"])
    return list(contract["layers"])


def test_the_order_of_imports_is_the_contract_s() -> None:
    drawn = PAGE.partition("```text\n")[2].partition("```")[0]
    assert drawn.splitlines() == layers("rooms")
    assert ", ".join(f"`{room}`" for room in layers("diagnosis")) in PAGE


def test_every_room_has_a_row() -> None:
    told = set(re.findall(r"^\| `hoopd/([a-z]+)`", PAGE, re.MULTILINE))
    assert told == {path.parent.name for path in (ROOT / "hoopd").glob("*/__init__.py")}


def test_what_the_page_names_is_there() -> None:
    named = re.findall(r"`((?:hoopd/|tools/|tests/|config|docs|systemd)?[\w/]*(?:/\w+)(?:\.py)?)`", PAGE)
    places = [[ROOT / name, ROOT / "hoopd" / name] for name in named]
    assert len(named) > 30 and [str(two[0]) for two in places if not any(place.exists() for place in two)] == []
