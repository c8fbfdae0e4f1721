"""One run of races in virtual time: the daemon as the command line would start it, on the rig.

Rules of this file: a run is its seed; what it leaves behind is read from its files. SIGTERM is what its handler does:
the loop is asked to stop between two ticks.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from harness.runs import Run, load, serve_late

from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.daemon import app
from hoopd.daemon.build import read_texts
from hoopd.daemon.replay import replay
from hoopd.shell import config as configuration
from hoopd.shell.loop import Loop
from racing import judge
from racing.script import PERIOD_S, RACE_TICKS, Race, Script, at_s, make_script

REPLAYED = 10  # every tenth run is replayed, too: that takes a third of its time
REFERENCE_RAD = 0.1  # keeps the hoop turning


class Ender:
    """A guest who has the loop asked to stop before given ticks."""

    trouble = False
    loads: Sequence[str] = ()

    def __init__(self, signals: list[int]) -> None:
        self._signals = list(signals)
        self._loop: Loop | None = None

    @contextmanager
    def attend(self, loop: Loop) -> Iterator[None]:
        self._loop = loop
        yield

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        while self._signals and inputs.id + 1 >= self._signals[0] and self._loop is not None:
            self._signals.pop(0)
            self._loop.request_stop()

    def note(self, t: float, note: Note) -> None: ...

    def status(self) -> str:
        return ""

    def commands(self, t: float) -> tuple[Command, ...]:
        return ()


def play(script: Script, folder: Path) -> Run:
    """Run the daemon through a script."""
    record = folder / "rec"
    record.mkdir()
    commands = [
        {"at_s": max(0.0, at_s(sent.tick)), "name": sent.name, "value": REFERENCE_RAD * (sent.name == "reference")}
        for sent in script.sent
    ]
    sim: dict[str, Any] = {"directory": str(folder), "commands": commands, "faults": script.faults}
    path = folder / "run.yaml"
    path.write_text(yaml.safe_dump({"log": {"level": "error"}, "sim": sim}))
    options = app.Options(True, path, (), script.ticks * PERIOD_S, record, 0, "max", True)
    config = configuration.load(path, sim=True, overrides=[])
    quiet = io.StringIO()
    with contextlib.redirect_stderr(quiet), contextlib.redirect_stdout(quiet), pytest.MonkeyPatch.context() as patch:
        serve_late(patch, late=lambda k: script.stalls.get(k, 0.0))
        app.perform(options, config, read_texts(config, path), Ender(script.signals))
    return load(folder, record, "")


def run(seed: int, races: int) -> list[judge.Outcome]:
    """Play a seed and judge its races."""
    script = make_script(seed, races)
    with tempfile.TemporaryDirectory(prefix="hoopd-races-") as scratch:
        found = play(script, Path(scratch))
        replays = seed % REPLAYED != 0 or replay(found.recordings[0])["equal"]
    wrong = [*wrong_in(script, found), *judge.whole(found, replays)]
    return judge.outcomes(seed, [window(script, race) for race in script.races], found, wrong)


def wrong_in(script: Script, found: Run) -> list[judge.Wrong]:
    """All that broke the rule in a run."""
    rows = judge.taken(found)
    armed_t = [at_s(sent.tick) for sent in script.sent if sent.name == "arm"]
    return (
        judge.modes_wrong(found)
        + judge.torque_wrong(found, rows, deaf_in(script))
        + judge.armed_by_nobody(armed_t, rows)
    )


def deaf_in(script: Script) -> list[tuple[float, float]]:
    """From when to when the board hears nothing."""
    return [(f["at_s"], f["at_s"] + f["for_s"]) for f in script.faults if f["kind"] == "board_silent"]


def window(script: Script, race: Race) -> judge.Window:
    """When one race is watched."""
    begin, end = race.tick * PERIOD_S, (race.tick + RACE_TICKS) * PERIOD_S
    until = min((other.slot for other in script.races if other.slot > race.tick), default=script.ticks) * PERIOD_S
    return judge.Window(race.begins, begin, end, until, Counter(sent.name for sent in race.sent))
