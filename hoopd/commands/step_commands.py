"""One of our own commands as a step of a longer work: in a process of its own, its words kept in a file.

Rules of this file: what is started ends with the process that started it, where the prefix says so.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

LAST_S = 5.0  # of a command that is told to end


class StepError(Exception):
    """A command of a step failed; its own words."""


def run_step(
    words: Sequence[str | Path],
    log: Path,
    accepted: Sequence[int] = (0,),
    *,
    prefix: Sequence[str] = (),
    seen: bool = False,
    limit_s: float | None = None,
) -> int:
    """Run `hoopd` with these words; StepError with its last line when it ends with a code that is not accepted.

    `prefix`: what stands before the command; `seen`: an operator has to see what it says on standard error; `limit_s`:
    what is not done by then is ended, a StepError.
    """
    line = [*prefix, sys.executable, "-m", "hoopd", *map(str, words)]
    with log.open("wb") as out:
        given, errors = (None, None) if seen else (subprocess.DEVNULL, subprocess.STDOUT)
        with subprocess.Popen(line, stdin=given, stdout=out, stderr=errors) as step:
            try:
                code = step.wait(limit_s)
            except subprocess.TimeoutExpired as error:
                raise StepError(f"hoopd {words[0]}: not done after {limit_s:.0f} s, ended") from error
            finally:
                _end(step)
    if code not in accepted:
        told = log.read_text("utf-8", "replace").strip().splitlines()
        raise StepError(f"hoopd {words[0]}: {told[-1] if told else f'ended with {code}'}")
    return code


def _end(step: subprocess.Popen[bytes]) -> None:
    """It ends now, where it has not."""
    if step.poll() is not None:
        return
    step.terminate()
    try:
        step.wait(LAST_S)
    except subprocess.TimeoutExpired:
        step.kill()
