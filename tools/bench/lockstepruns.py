"""Runs of the whole daemon on the rig in virtual time, watched from beside the loop: when which fault came.

Rules of this file: a run is its configuration and its seed; torque and state are what the board and the plant logged,
never the daemon's word; nothing is recorded.
"""

from __future__ import annotations

import contextlib
import gc
import io
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from hoopd.core import ballresponse, encoderchecks, picturechecks
from hoopd.core.faulttable import BY_NAME, Action
from hoopd.core.modes import Mode
from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.daemon import app
from hoopd.daemon.build import Texts, read_texts
from hoopd.shell import config as configuration
from hoopd.shell.config import Config
from hoopd.shell.loop import Loop
from hoopd.sim import torque_log, truth

# Rows that end control: what a lie must raise.
ENDING = tuple(name for name, fault in BY_NAME.items() if fault.action >= Action.STOP)
# Of them those that call a sensor a liar, or the ball gone: nothing honest may raise one.
JUDGING = (*picturechecks.NAMES, "ball_runaway", *encoderchecks.NAMES, "speed_implausible")


def be_hasty() -> None:
    """Let the rows of the camera speak at their first evidence in this process, to tell what patience costs."""
    ballresponse.ENOUGH_S = ballresponse.EVERY_S
    picturechecks.BLOCKS = picturechecks.STUCK_PICTURES = picturechecks.IDENTICAL_PICTURES = 1


class Raised(NamedTuple):
    """A fault that became active."""

    t: float  # s
    name: str


class Watched(NamedTuple):
    """What a run came to."""

    raised: tuple[Raised, ...]
    running_s: float  # with the law acting
    ended_s: float  # the last tick
    ended_by: str  # what a law of a limited length gave as its reason
    torque: torque_log.TorqueLog
    truth: truth.Truth

    def first(self, names: tuple[str, ...], after_s: float = 0.0) -> Raised | None:
        """The first of these that came at or after a time."""
        return next((one for one in self.raised if one.name in names and one.t >= after_s), None)


class Onlooker:
    """A guest who writes down faults, and ends the run after the first that ends control, or when the law is over."""

    trouble = False
    loads: Sequence[str] = ()

    def __init__(self) -> None:
        self.raised: list[Raised] = []
        self.running_ticks, self.t, self.ended_by = 0, 0.0, ""
        self._loop: Loop | None = None

    @contextmanager
    def attend(self, loop: Loop) -> Iterator[None]:
        self._loop = loop
        yield

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        self.t = record.t
        self.running_ticks += record.mode == Mode.RUNNING
        over = self.ended_by or any(one.name in ENDING for one in self.raised)
        if over and record.mode in (Mode.DISARMED, Mode.FAULT) and self.running_ticks and self._loop is not None:
            self._loop.request_stop()

    def note(self, t: float, note: Note) -> None:
        if note.name == "fault":
            self.raised.append(Raised(t, str(note.fields["fault"])))
        elif note.name == "law_ended":
            self.ended_by = str(note.fields["reason"])

    def status(self) -> str:
        return ""

    def commands(self, t: float) -> tuple[Command, ...]:
        return ()


def prepared(content: Mapping[str, Any], folder: Path) -> tuple[Config, Texts]:
    """A run's configuration, as a file in its folder would give it, and its texts."""
    sim = {**content.get("sim", {}), "directory": str(folder)}
    path = folder / "run.yaml"
    path.write_text(yaml.safe_dump({**content, "log": {"level": "error"}, "sim": sim}))
    config = configuration.load(path, sim=True, overrides=[])
    return config, read_texts(config, path)


def watch(config: Config, texts: Texts, folder: Path, seconds: float, seed: int, *, pictures: bool) -> Watched:
    """One run."""
    onlooker, interval = Onlooker(), sys.getswitchinterval()
    options = app.Options(True, None, (), seconds, None, seed, "max", not pictures)
    quiet = io.StringIO()
    try:
        with contextlib.redirect_stderr(quiet), contextlib.redirect_stdout(quiet):
            app.perform(options, config, texts, onlooker)
    finally:  # what the daemon sets for its own process
        sys.setswitchinterval(interval)
        gc.unfreeze()
        gc.enable()
    return Watched(
        tuple(onlooker.raised),
        onlooker.running_ticks * config.loop.period_s,
        onlooker.t,
        onlooker.ended_by,
        torque_log.read(folder / "torque.jsonl"),
        truth.read(folder / "truth.csv"),
    )


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder for one run."""
    with tempfile.TemporaryDirectory(prefix="hoopd-watched-") as name:
        yield Path(name)
