"""`hoopd compare` on the rig: two controllers take turns in one run in lock-step.

Rules of this file: nothing here touches the drive; the candidate acts by the commands of a trial, which the recording
keeps, so that a replay repeats the run to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hoopd.core.modes import Mode
from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.daemon.app import Options, check_options, perform
from hoopd.daemon.attending import AttendingGuest
from hoopd.daemon.build import read_texts
from hoopd.design.alternation import Alternation
from hoopd.design.comparison import ControllerComparison
from hoopd.design.yardstick import TickSample, held_speed
from hoopd.files.controller import ControllerFile, load_controller
from hoopd.files.controller_folder import key_of
from hoopd.files.reading import InputError
from hoopd.shell import config as configuration

START_S = 10.0  # until the rig runs, and its end
Progress = Callable[[ControllerComparison], None]


def run(
    accepted: Path, candidate: Path, plan: Alternation, options: Options, progress: Progress | None = None, *, by: str
) -> dict[str, Any]:
    """Both on the rig, judged `by` one of `design.comparison.MEASURES`.

    The result of `ControllerComparison`, with the controllers' names and the recording's.
    """
    rest = (f"control.file={accepted.resolve()}", f"control.folder={candidate.resolve().parent}")
    options = options._replace(sets=(*options.sets, *rest), duration_s=START_S + plan.longest_s)
    config = configuration.load(options.config, sim=True, overrides=list(options.sets))
    check_options(options, config)
    file, _ = holding(accepted), holding(candidate)
    held = held_speed(file.gains)
    comparison = ControllerComparison(plan, key_of(candidate), held=held, period_s=config.loop.period_s, by=by)
    turns = ComparisonGuest(comparison, progress)
    before = set(_recorded(options))
    summary = perform(options, config, read_texts(config, options.config), turns)
    comparison.stop("the run ended before it was clear")
    recording = sorted(set(_recorded(options)) - before)
    return {
        "accepted": key_of(accepted),
        **comparison.result(),
        "hoop_speed_counted": held is not None,
        "recording": [str(one) for one in recording],
        "faults": summary["faults"],
    }


def holding(path: Path) -> ControllerFile:
    """A controller that can hold the ball; InputError for any other file."""
    file = load_controller(path)
    if file.kind in ("excitation", "maneuver"):
        raise InputError(path, "kind", f"{file.kind}: holds nothing, compare laws for the ball")
    return file


def _recorded(options: Options) -> Iterator[Path]:
    return iter(()) if options.record is None else options.record.glob("run-*.mcap")


class ComparisonGuest(AttendingGuest):
    """Lets a comparison see every tick of a run and command it."""

    def __init__(self, comparison: ControllerComparison, progress: Progress | None = None) -> None:
        super().__init__((comparison.key,))
        self.comparison, self._progress = comparison, progress or (lambda comparison: None)
        self._place = ""
        self._over_at: float | None = None

    def status(self) -> str:
        """How far it is."""
        return self.comparison.step

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """One tick."""
        sample = TickSample(
            record.t, record.mode == Mode.RUNNING, record.u, record.dtheta, record.psi, record.psi_t, record.reference
        )
        for one in self.comparison.put(sample):
            self.ask(Command(one.name, one.value, one.key))
        if self.comparison.step != self._place:
            self._place = self.comparison.step
            self._progress(self.comparison)
        if self.comparison.over and self._loop is not None and self._over_at is None:
            self._over_at = record.t
            self._loop.request_stop()

    def note(self, t: float, note: Note) -> None:
        """One fact."""
        self.comparison.note(note.name, note.fields)
