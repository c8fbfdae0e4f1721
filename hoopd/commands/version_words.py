"""What the commands of numbered versions share: the number that was typed, and who typed it.

Rules of this file: words in, words out; no files.
"""

from __future__ import annotations

import getpass

from hoopd.files.reading import InputError


def version_number(text: str, command: str) -> int:
    """The number of a version; InputError, which names the `command` that lists them, of anything else."""
    if not (text.isascii() and text.isdigit() and len(text) <= 4):
        raise InputError("NUMBER", text, f"expected a version's number; `hoopd {command} list` has them")
    return int(text)


def user_name() -> str:
    """Who is at the terminal."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # nobody of that number
        return "unknown"
