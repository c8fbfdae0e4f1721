"""Rows of a bench outlive it, and are of one question."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness.kept_rows import KeptRows

from hoopd.files.reading import InputError


def test_a_bench_goes_on_where_its_file_ends_and_refuses_the_rows_of_another_question(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    first = KeptRows(path, {"seed": 1, "kinds": ["a", "b"]})
    first.add({"change": "a"})
    assert KeptRows(path, {"seed": 1, "kinds": ["a", "b"]}).rows == [{"change": "a"}]
    with pytest.raises(InputError) as raised:
        KeptRows(path, {"seed": 2, "kinds": ["a", "b"]})
    assert raised.value.key == "seed" and "another file" in raised.value.reason
    path.write_text("[]")
    with pytest.raises(InputError):
        KeptRows(path, {"seed": 1})
    KeptRows(None, {"seed": 1}).add({"change": "a"})
