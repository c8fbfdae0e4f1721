"""The last resort, as a process: one line, an exit code, a file, and no traceback on the terminal."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILE = re.compile(r"the traceback is in (\S+)$")
BEGIN = "from hoopd import uncaught_errors\nuncaught_errors.watch()\n"

MISTAKES: dict[str, tuple[str, str]] = {
    "in a command": ("uncaught_errors.run(lambda: int('x'))", "ValueError"),
    "while importing": ("import hoopd.no_such_module", "ModuleNotFoundError"),
    "recursion": ("def f(): f()\nuncaught_errors.run(f)", "RecursionError"),
    "memory": ("uncaught_errors.run(lambda: bytearray(2**62))", "MemoryError: the memory is full"),
    "text of many lines": ("raise RuntimeError('a\\nb' * 9000)", "RuntimeError: a"),
    "a terminal's own codes": ("raise RuntimeError('\\x1b[2J')", r"RuntimeError: \?\[2J"),
    "in a thread": (
        "import threading\none = threading.Thread(target=lambda: 1 / 0, name='reader')\none.start()\none.join()",
        "in thread reader: .*ZeroDivisionError",
    ),
    "in a daemon's thread": (
        "import threading\none = threading.Thread(target=lambda: 1 / 0, daemon=True)\none.start()\none.join()",
        "ZeroDivisionError",
    ),
    "in a callback of asyncio": (
        "import asyncio\n"
        "async def main(): asyncio.get_running_loop().call_soon(lambda: 1 / 0); await asyncio.sleep(0.01)\n"
        "uncaught_errors.run(lambda: asyncio.run(main()))",
        "ZeroDivisionError",
    ),
    "in a task that nobody awaits": (
        "import asyncio\n"
        "async def wrong(): raise KeyError('x')\n"
        "async def main(): kept = asyncio.create_task(wrong()); await asyncio.sleep(0.01)\n"
        "uncaught_errors.run(lambda: asyncio.run(main()))",
        "KeyError",
    ),
    "in a destructor": (
        "class One:\n  def __del__(self): raise IndexError('gone')\none = One()\ndel one",
        "IndexError: gone",
    ),
    "at the end": ("import atexit\natexit.register(lambda: [][0])", "IndexError"),
}


def run(code: str, folder: Path, **more: str) -> tuple[int, list[str]]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder), **more}
    environment = {key: value for key, value in environment.items() if key != "STATE_DIRECTORY" or more}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=30, check=False
    )
    assert done.stdout == ""
    return done.returncode, done.stderr.splitlines()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_and_a_file(name: str, tmp_path: Path) -> None:
    code, said = MISTAKES[name]
    status, lines = run(BEGIN + code, tmp_path)
    assert status == 1 and len(lines) == 1, lines
    assert re.search(said, lines[0]) and lines[0].isprintable() and len(lines[0]) < 600
    match = FILE.search(lines[0])
    assert match
    path = Path(match.group(1))
    assert path.parent == tmp_path / "hoopd/failures" and path.stat().st_mode & 0o077 == 0
    assert path.read_text().startswith("Traceback")


def test_a_mistake_that_repeats_leaves_few_files(tmp_path: Path) -> None:
    again = "  one = threading.Thread(target=lambda: 1 / 0)\n  one.start()\n  one.join()"
    status, lines = run(f"{BEGIN}import threading\nfor _ in range(30):\n{again}", tmp_path)
    assert status == 1 and len(lines) == 5
    assert len(list((tmp_path / "hoopd/failures").iterdir())) == 5


def test_old_files_make_room(tmp_path: Path) -> None:
    place = tmp_path / "hoopd/failures"
    place.mkdir(parents=True)
    for number in range(70):
        (place / f"hoopd-failure-2000{number:02}.txt").touch()
    run(BEGIN + "1 / 0", tmp_path)
    assert len(list(place.iterdir())) == 50


def test_where_no_folder_takes_it(tmp_path: Path) -> None:
    (tmp_path / "hoopd").touch()
    (tmp_path / "tmp").mkdir()
    _, (line,) = run(BEGIN + "1 / 0", tmp_path, TMPDIR=str(tmp_path / "tmp"))
    match = FILE.search(line)
    assert match and Path(match.group(1)).parent == tmp_path / "tmp"


def test_the_service_has_a_folder_of_its_own(tmp_path: Path) -> None:
    _, (line,) = run(BEGIN + "1 / 0", tmp_path, STATE_DIRECTORY=str(tmp_path / "state"))
    match = FILE.search(line)
    assert match and Path(match.group(1)).parent == tmp_path / "state/failures"


def test_an_exit_code_stays_what_it_is(tmp_path: Path) -> None:
    assert run(BEGIN + "import sys\nuncaught_errors.run(lambda: sys.exit(2))", tmp_path) == (2, [])
    assert run(BEGIN + "uncaught_errors.run(lambda: None)", tmp_path) == (0, [])


def test_a_library_that_only_warns_is_one_line(tmp_path: Path) -> None:
    status, lines = run(BEGIN + "import logging\nlogging.getLogger('fonts').warning('not\\nthere')", tmp_path)
    assert (status, lines) == (0, ["hoopd: fonts: not there"])


def test_output_that_nobody_takes(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for reader, said in ((">/dev/full", "no space left on device"), ("| true", "")):  # `true` may be there still
        line = f"{{ sleep 0.2; {sys.executable} -m hoopd --version; echo $? >&2; }} {reader}"
        done = subprocess.run(["sh", "-c", line], env=environment, capture_output=True, text=True, check=False)
        assert "Traceback" not in done.stderr and "Exception" not in done.stderr
        assert said in done.stderr and done.stderr.endswith("1\n")


def test_a_font_that_stands_in_for_another_is_no_news(tmp_path: Path) -> None:
    code = "import logging\nlogging.getLogger('matplotlib.font_manager').warning('not found')"
    assert run(BEGIN + code, tmp_path) == (0, [])
