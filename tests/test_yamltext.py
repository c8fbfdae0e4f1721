"""YAML: what a word stands for, and that no text costs more than its length."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import pytest

from hoopd.files import yaml_text
from hoopd.files.yaml_text import YamlError, data_of, text_of

WORDS: dict[str, Any] = {
    "1": 1, "-17": -17, "+3": 3, "010": 10, "0o17": 15, "0xA5": 165, "1e-8": 1e-8, "1.": 1.0, ".5": 0.5, "-0.0": -0.0,
    ".inf": math.inf, "-.INF": -math.inf, "true": True, "False": False, "null": None, "~": None,
    "123456789012345678901": 123456789012345678901.0,
    # of YAML 1.1, text today
    "yes": "yes", "on": "on", "1_000": "1_000", "0b11": "0b11", "1:30": "1:30", "2024-02-31": "2024-02-31", "=": "=",
}  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
def test_what_a_plain_word_stands_for(word: str) -> None:
    (value,) = data_of(f"[{word}]")
    assert value == WORDS[word] and type(value) is type(WORDS[word])
    assert data_of(f"['{word}']") == [word]


def test_nan_is_a_number() -> None:
    assert math.isnan(data_of(".nan"))


def test_what_is_written_is_read_back() -> None:
    numbers = [1e22, 1e-8, -0.0, 10**17, math.inf]
    data = {"words": list(WORDS), "numbers": numbers, "nested": {"": None, "x": [True, {}]}}
    assert data_of(text_of(data)) == data


def merges(depth: int) -> str:
    """Mappings that merge the one before ten times each: 10 to the power of `depth` keys to copy."""
    lines = ["m0: &m0 {a: 1}"]
    lines += [f"m{k}: &m{k} {{<<: [{', '.join([f'*m{k - 1}'] * 10)}]}}" for k in range(1, depth + 1)]
    return "\n".join(lines)


def aliases(depth: int) -> str:
    lines = ["m0: &m0 [1]"]
    lines += [f"m{k}: &m{k} [{', '.join([f'*m{k - 1}'] * 10)}]" for k in range(1, depth + 1)]
    return "\n".join(lines)


BOMBS = {
    "merge keys": merges(8),
    "aliases": aliases(8),
    "nested aliases": "a: &a [1]\n" + "".join(f"b{k}: &a [*a, *a]\n" for k in range(40)),
    "base 60": "a: " + "59:" * 300_000 + "59.5",
    "digits": "a: " + "9" * 1_000_000,
    "400 digits": "a: " + "9" * 400,
    "hexadecimal digits": "a: 0x" + "f" * 1_000_000,
    "values": "[" + "1," * 400_000 + "]",
    "lists": "[" * 1_000_000,
    "keys": "{" * 1_000_000,
    "blocks": "- " * 500_000,
    "too long": "#" * 1_100_000,
}


@pytest.mark.parametrize("name", BOMBS)
def test_work_is_bounded_by_the_text(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    built = 0

    class Counted(yaml_text._Built):
        def __new__(cls, *values: Any) -> Counted:
            nonlocal built
            built += 1
            return super().__new__(cls, *values)

    monkeypatch.setattr(yaml_text, "_Built", Counted)
    tracemalloc.start()
    try:
        value = data_of(BOMBS[name])
    except YamlError as error:
        assert "\n" not in str(error)
    else:
        assert name == "base 60" and value == {"a": BOMBS[name][3:]}
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert built <= yaml_text.MAX_VALUES + 1
    assert peak < 60e6


def test_a_number_beyond_every_float_names_its_key() -> None:
    with pytest.raises(YamlError, match=r"line 2, a\.b\[1\]: must be a finite number"):
        data_of("# gains\na: {b: [1, " + "9" * 400 + "]}")


def test_aliases_that_stand_for_little_are_read() -> None:
    assert data_of("a: &x [1, 2]\nb: *x") == {"a": [1, 2], "b": [1, 2]}
