"""Controllers of a running daemon: which file is meant, and that nothing leads out of the folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from hoopd.files.controller_folder import LEAST_DIGITS, MAX_BYTES, key_of, parse_key, read_controller
from hoopd.files.reading import InputError

DIGITS = "0123456789ab"


def written(folder: Path, name: str = "mine.yaml", text: str = "schema: x\n") -> str:
    """A file, and its hash."""
    (folder / name).write_text(text)
    return hashlib.sha256(text.encode()).hexdigest()


def refusal(folder: Path, key: str) -> str:
    with pytest.raises(InputError) as caught:
        read_controller(folder, parse_key(key))
    assert "\n" not in str(caught.value) and str(folder) not in str(caught.value)
    return str(caught.value)


def test_a_file_is_read_by_its_name_and_some_digits_of_its_hash(tmp_path: Path) -> None:
    sha256 = written(tmp_path)
    for digits in (LEAST_DIGITS, 20, 64):
        assert read_controller(tmp_path, parse_key(f"mine.yaml@{sha256[:digits]}")) == ("schema: x\n", sha256)
    assert key_of(tmp_path / "mine.yaml") == f"mine.yaml@{sha256}"


def test_another_file_than_the_one_that_was_meant_is_refused(tmp_path: Path) -> None:
    before = written(tmp_path)
    now = written(tmp_path, text="schema: y\n")
    assert f"its hash is {now[:12]}..., not {before[:12]}..." in refusal(tmp_path, f"mine.yaml@{before}")


@pytest.mark.parametrize(
    "name",
    [
        "../mine.yaml",
        "/etc/mine.yaml",
        "sub/mine.yaml",
        "..\\mine.yaml",
        ".hidden.yaml",
        "..yaml",
        "mine.yaml\0.yaml",
        "mine.yaml\n",
        "mi ne.yaml",
        "~/mine.yaml",
        "mine.txt",
        "mine",
        "",
        "m" * 200 + ".yaml",
        "möin.yaml",
    ],
)
def test_a_name_is_no_path(name: str) -> None:
    with pytest.raises(InputError, match=r"expected the name of a \.yaml file"):
        parse_key(f"{name}@{DIGITS}")


@pytest.mark.parametrize("digits", ["", "0123456789a", "0" * 65, "0123456789aB", "0123456789ag", "0123456789ab\n"])
def test_digits_are_of_a_hash(digits: str) -> None:
    with pytest.raises(InputError, match=r"expected NAME\.yaml@SHA256 with 12 to 64 digits"):
        parse_key(f"mine.yaml@{digits}")


def test_code_is_never_loaded() -> None:
    with pytest.raises(InputError, match="a law that is code is never loaded by a running daemon"):
        parse_key(f"law.py@{DIGITS}")


def test_only_a_small_file_of_the_folder_itself_is_read(tmp_path: Path) -> None:
    folder, outside = tmp_path / "controllers", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    sha256 = written(outside)
    (folder / "link.yaml").symlink_to(outside / "mine.yaml")
    (folder / "lost.yaml").symlink_to(outside / "none.yaml")
    (folder / "folder.yaml").mkdir()
    os.mkfifo(folder / "pipe.yaml")
    large = "x" * (MAX_BYTES + 1)
    assert "is a link" in refusal(folder, f"link.yaml@{sha256}")
    assert "is a link" in refusal(folder, f"lost.yaml@{sha256}")
    assert "not a file" in refusal(folder, f"folder.yaml@{DIGITS}")
    assert "not a file" in refusal(folder, f"pipe.yaml@{DIGITS}")
    assert "no such file" in refusal(folder, f"none.yaml@{DIGITS}")
    assert "larger than" in refusal(folder, f"large.yaml@{written(folder, 'large.yaml', large)}")
    (folder / "picture.yaml").write_bytes(b"\xff\xfe")
    assert "not a text file" in refusal(folder, f"picture.yaml@{hashlib.sha256(bytes([255, 254])).hexdigest()}")
