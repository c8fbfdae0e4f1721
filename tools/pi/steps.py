"""Steps of a check: each has a name, a bound in time and a verdict; a table of all stands at the end.

Rules of this file: a step either returns one line of what it saw or raises; only processes that were started here are
ended here, with everything that they started themselves.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

KILL_AFTER_S = 10.0
LINE_CHARS = 160


class StepError(Exception):
    """A step failed; the text is the one line that says why."""


class SkippedError(Exception):
    """A step cannot be made on this machine; the text says what is missing."""


class Step(NamedTuple):
    """One thing to see."""

    name: str
    run: Callable[[], str]
    needed: bool = False  # the steps after it make no sense without it


class Row(NamedTuple):
    """What became of a step."""

    name: str
    verdict: str
    seconds: float
    detail: str


def demand(condition: bool, reason: str) -> None:
    """StepError with this reason unless the condition holds."""
    if not condition:
        raise StepError(reason)


def perform(steps: Sequence[Step]) -> list[Row]:
    """Every step in order; those after a needed one that was not seen are skipped."""
    rows: list[Row] = []
    broken = ""
    for step in steps:
        begun = time.monotonic()
        print(f"-- {step.name} ...", flush=True)
        verdict, detail = ("skipped", f"needs: {broken}") if broken else _outcome(step)
        row = Row(step.name, verdict, time.monotonic() - begun, detail)
        print(f"   {row.verdict}, {row.seconds:.0f} s: {row.detail}", flush=True)
        rows.append(row)
        if step.needed and verdict != "ok" and not broken:
            broken = step.name
    return rows


def _outcome(step: Step) -> tuple[str, str]:
    try:
        return "ok", step.run()
    except SkippedError as reason:
        return "skipped", str(reason)
    except (StepError, OSError, ValueError, KeyError, IndexError) as error:
        return "FAILED", str(error) or type(error).__name__


def show(rows: Sequence[Row]) -> int:
    """The table; 1 when a step failed."""
    width = max((len(row.name) for row in rows), default=0)
    print(f"\n{'step'.ljust(width)}  {'verdict':<8} {'s':>5}  what was seen")
    for row in rows:
        print(f"{row.name.ljust(width)}  {row.verdict:<8} {row.seconds:5.0f}  {row.detail}")
    counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in ("ok", "FAILED", "skipped")}
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    return int(counts["FAILED"] > 0)


def run(
    command: Sequence[str | Path],
    seconds: float,
    *,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
    codes: Sequence[int] = (0,),
) -> str:
    """What a command printed; StepError with its last line when it takes too long or ends with another exit code."""
    with subprocess.Popen(
        [str(word) for word in command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env=None if environment is None else dict(environment),
        cwd=folder,
        start_new_session=True,
    ) as child:
        try:
            text, _ = child.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            _end_group(child)
            raise StepError(f"{_short(command)}: not done after {seconds:.0f} s") from None
        except BaseException:
            _end_group(child)
            raise
    if child.returncode not in codes:
        sys.stderr.write(text[-4000:])
        raise StepError(f"{_short(command)}: exit code {child.returncode}: {last_line(text)}")
    return text


def wait_until(true: Callable[[], bool], seconds: float, what: str, step_s: float = 0.2) -> float:
    """Seconds until it was true; StepError when it was not in time."""
    begun = time.monotonic()
    while not true():
        demand(time.monotonic() - begun < seconds, f"{what}: not within {seconds:.0f} s")
        time.sleep(step_s)
    return time.monotonic() - begun


def last_line(text: str) -> str:
    """The last line that is not empty."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:LINE_CHARS] if lines else "no output"


def _short(command: Sequence[str | Path]) -> str:
    return " ".join(str(word) for word in command)[-LINE_CHARS:]


def _end_group(child: subprocess.Popen[str]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(OSError):
            os.killpg(child.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.communicate(timeout=KILL_AFTER_S)
            return
