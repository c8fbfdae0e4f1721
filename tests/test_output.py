"""What a person sees of a result."""

from __future__ import annotations

import pytest

from hoopd.commands.output import print_result, rows, shown


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        (True, "yes"),
        (1 / 3, "0.3333333"),
        (12345, "12345"),
        ("text", "text"),
        ({"re": -0.5, "im": 0.0}, "-0.5"),
        ({"re": -0.5, "im": -2.0}, "-0.5 - 2j"),
        ([1.0, 2.5], "1, 2.5"),
        (["a", "b"], "a, b"),
        ([], "-"),
        ({}, "-"),
        ([{"re": 0.0, "im": 1.0}, {"re": 1.0, "im": 0.0}], "0 + 1j\n1"),
        ([{"a": 1}, {"a": 2}], "a: 1\na: 2"),
        ([[1.0, -20.123456], [0.0, 3.0]], "1 -20.12\n0      3"),
    ],
)
def test_values_as_a_person_reads_them(value: object, text: str) -> None:
    assert shown(value) == text


def test_records_inside_records_are_indented() -> None:
    assert rows("a", {"b": 1, "c": {"d": 2.0}}) == [("a", ""), ("  b", "1"), ("  c", ""), ("    d", "2")]


def test_notes_follow_the_table_and_nothing_is_read_as_markup(capsys: pytest.CaptureFixture[str]) -> None:
    print_result({"file[0]": "[bold]x", "inner": {"y": 1.5}, "notes": ["one", "two"]})
    shown_text = capsys.readouterr().out
    assert "file[0]" in shown_text and "[bold]x" in shown_text
    assert shown_text.endswith("- one\n- two\n")


def test_a_matrix_too_large_for_a_terminal_is_named() -> None:
    assert shown([[0.0] * 13] * 2) == "2 x 13 matrix (--json has it)"
    assert shown([[0.0] * 2] * 13) == "13 x 2 matrix (--json has it)"
    assert shown([[1.0, 2.0]]) == "1 2"
