"""`hoopd heal` beside the daemon in lock-step: the same decisions and computations, whose time is charged as time of
the rig.

Rules of this file: what the loop is told comes by the commands that the live process sends; nothing else touches it.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.commands.heal_work import HealWorker
from hoopd.core.modes import Mode
from hoopd.core.records import Command, Inputs, TickRecord
from hoopd.core.tick import Note
from hoopd.daemon.app import Options, check_options, perform
from hoopd.daemon.attending import AttendingGuest
from hoopd.daemon.build import read_texts
from hoopd.daemon.loading import ControllerLoader
from hoopd.dashboard.work.controllers import Controllers
from hoopd.design.yardstick import TickSample
from hoopd.files.controller_folder import key_of
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import HealVersion, VersionFolder
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.heal.healing import Healing
from hoopd.heal.plan import HealPlan, HealWork
from hoopd.heal.version_copies import lay_copies
from hoopd.shell import config as configuration
from hoopd.shell.config import Config

WHO = "heal"


@dataclass
class RigClock:
    """Dates are the rig's own time."""

    t: float = 0.0  # s

    def __call__(self) -> float:
        """Now."""
        return self.t


class HealingGuest(AttendingGuest):
    """Lets a healing see every tick of a run and command it."""

    def __init__(
        self, healing: Healing, worker: HealWorker, loader: ControllerLoader, clock: RigClock, *, wall: bool = False
    ) -> None:
        """`wall`: charge time on the wall; else the processor's, which a core of its own would take."""
        super().__init__()
        self.healing, self._worker, self._loader, self._clock, self._wall = healing, worker, loader, clock, wall
        self.costs: list[tuple[float, str, float, float]] = []  # rig's time, what, s wall, s processor
        self._due: tuple[float, HealWork, dict[str, Any]] | None = None

    def status(self) -> str:
        """How far it is."""
        return self.healing.phase

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """One tick."""
        assert self._loop is not None
        self._clock.t = record.t
        self.healing.see(self._loop.tick.faults)
        if self._due is not None and record.t >= self._due[0]:
            (_, work, result), self._due = self._due, None
            self.healing.done(work, result)
        running = record.mode == Mode.RUNNING
        sample = TickSample(record.t, running, record.u, record.dtheta, record.psi, record.psi_t, record.reference)
        for order in self.healing.put(sample):
            try:
                text = self._loader.load(order.key, WHO) if order.key else ""
            except InputError as error:
                self.healing.refuse(order, str(error))
                continue
            self.ask(Command(order.name, order.value, order.key, text))
        if (work := self.healing.take_work()) is not None:
            self._compute(record.t, work)

    def note(self, t: float, note: Note) -> None:
        """One fact."""
        self.healing.note(note.name, note.fields)

    def _compute(self, t: float, work: HealWork) -> None:
        began, began_cpu = time.perf_counter(), _processor_s()
        result = self._worker.work(work)
        wall_s, cpu_s = time.perf_counter() - began, _processor_s() - began_cpu
        self.costs.append((t, work.name, wall_s, cpu_s))
        self._due = (t + (wall_s if self._wall else cpu_s), work, result)


def _processor_s() -> float:
    """Of this process and of those that it started and that have ended."""
    used = [resource.getrusage(one) for one in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


@dataclass(frozen=True)
class HealedRun:
    """What became of a run."""

    folder: Path
    recording: Path
    versions: tuple[HealVersion, ...]
    acting: int
    told: tuple[str, ...]
    costs: tuple[tuple[float, str, float, float], ...]
    summary: dict[str, Any]


def controllers_of(folder: Path) -> Path:
    """A daemon's folder of controllers, with the shipped law and its model."""
    place = folder / "controllers"
    place.mkdir(parents=True, exist_ok=True)
    (place / "models").mkdir(exist_ok=True)
    for name in ("controllers/lqg.yaml", "models/hoop.yaml"):
        target = place / name.removeprefix("controllers/")
        if not target.exists():
            target.write_text((defaults_folder() / name).read_text())
    return place


@dataclass(frozen=True)
class PreparedHealing:
    """A run of the rig's daemon that has not begun; its versions lie in `folder`/healed."""

    folder: Path
    record: Path
    options: Options
    config: Config
    versions: VersionFolder
    plan: HealPlan
    policy: HealPolicy | None
    worker: HealWorker
    clock: RigClock
    told: list[str]

    def healing(self) -> Healing:
        """One that goes on with the folder as it is."""
        return Healing(self.versions, self.plan, self.policy, self.clock, self.record.name, self.told.append)

    @property
    def loader(self) -> ControllerLoader:
        """Reads the files that the loop is told to load."""
        return ControllerLoader(self.config, None)

    def perform(self, guest: HealingGuest) -> HealedRun:
        """The run."""
        summary = perform(self.options, self.config, read_texts(self.config, None), guest)
        guest.healing.stop("the run ended")
        every, acting = tuple(self.versions.every()), self.versions.loop().acting
        recording = self.worker.recording()
        return HealedRun(self.folder, recording, every, acting, tuple(self.told), tuple(guest.costs), summary)


def prepared(
    folder: Path,
    *sets: str,
    duration_s: float,
    plan: HealPlan,
    policy: HealPolicy | None,
    seed: int = 0,
    worker: Callable[..., HealWorker] = HealWorker,
) -> PreparedHealing:
    """Everything but the run."""
    folder.mkdir(parents=True, exist_ok=True)
    controllers = Controllers(controllers_of(folder))
    record = Path(tempfile.mkdtemp(prefix="rec-", dir=folder))
    law = controllers.folder / "lqg.yaml"
    words = (f"control.file={law}", "sim.psi_rad=0", "log.level=error", f"sim.directory={folder}", *sets)
    options = Options(True, None, words, duration_s, record, seed, "max", True)
    config = configuration.load(None, sim=True, overrides=list(words))
    check_options(options, config)
    versions, told = VersionFolder(folder / "healed"), list[str]()
    begins = not (folder / "healed").exists()
    versions.begin(config.device.name)
    if begins:
        versions.first(
            key_of(law), law.read_text(), (controllers.folder / "models" / "hoop.yaml").read_text(), 0.0, WHO
        )

    lay_copies(versions, controllers.lay_in_with, told.append)

    def recording() -> Path:
        return max(record.glob("run-*.mcap"))

    working = worker(folder=versions, recording=recording, lay_in=controllers.lay_in_with, by=plan.by, seed=seed)
    return PreparedHealing(folder, record, options, config, versions, plan, policy, working, RigClock(), told)


def heal_run(folder: Path, *sets: str, wall: bool = False, **how: Any) -> HealedRun:
    """One run of the rig's daemon in lock-step with a healing beside it; `how`: as of `prepared`."""
    made = prepared(folder, *sets, **how)
    return made.perform(HealingGuest(made.healing(), made.worker, made.loader, made.clock, wall=wall))
