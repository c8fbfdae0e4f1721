"""The table of long proofs in tests/README.md: every one stands in it, beside a sample that `make test` runs."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROWS = [line.split("|")[1:-1] for line in (TESTS / "README.md").read_text().splitlines() if line.startswith("| `")]
NAMED = re.compile(r"`([\w/]+\.py::\w+)`")


def marked() -> Iterator[tuple[str, bool]]:
    """Every test by its place, and whether it is a proof."""
    for path in TESTS.rglob("test_*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                proof = any(ast.unparse(one) == "pytest.mark.proof" for one in node.decorator_list)
                yield f"{path.relative_to(TESTS)}::{node.name}", proof


def test_every_proof_stands_in_the_table_with_its_sample() -> None:
    is_proof = dict(marked())
    assert {name for name, proof in is_proof.items() if proof} == {
        name for row in ROWS for name in NAMED.findall(row[0])
    }
    for row in ROWS:
        samples = NAMED.findall(row[2])
        assert samples and not any(is_proof[name] for name in samples)
