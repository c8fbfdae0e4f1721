"""`hoopd heal watch`: a process beside a running daemon that follows it.

Rules of this file: it commands what an operator could, by the same ways; what it decides stands in `hoopd.heal`, what
it computes in `heal_work`. Killed at any moment it leaves the loop on what was accepted: a trial that nobody watches
goes back in the daemon.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from hoopd.commands.options.heal import HealOptions
from hoopd.commands.version_words import user_name
from hoopd.files.folder_lock import alone_in
from hoopd.files.heal_versions import VersionFolder
from hoopd.files.memory import load_memory
from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target

if TYPE_CHECKING:
    from hoopd.commands.heal_work import HealWorker
    from hoopd.dashboard.device import ShownDevice
    from hoopd.dashboard.feed import Connection
    from hoopd.dashboard.work.controllers import Controllers
    from hoopd.files.heal_policy import HealPolicy
    from hoopd.heal.healing import Healing
    from hoopd.heal.plan import HealPlan, HealWork
    from hoopd.heal.resumption import LoopFiles
    from hoopd.shell.config import Config

LOOK_S, AGAIN_S, LAST_S = 0.2, 1.0, 5.0
FAULT = "FAULT"
HEALED = ".healed-"  # in the controllers' folder, before a device's name: somebody follows it
NICE = 5  # of this process; what it starts gets what nobody else wants


def watch(options: HealOptions) -> None:
    """Until Ctrl-C, from one run of the daemon to the next."""
    from hoopd.dashboard.feed import Connection
    from hoopd.files.heal_policy import load_policy

    plan = _plan(options)
    policy = None if options.policy is None else load_policy(options.policy)
    config = _config(options)
    if policy is not None and options.policy is not None:
        _check_names(policy, options.policy, config, options.config)
    if options.memory is not None:
        check_target(options.memory, "--memory")
        load_memory(options.memory, None)
    recordings = _recordings(options, config)
    # Of zenoh's keys a reader shares user, password and certificates with the daemon, not where it listens.
    extras = {key: value for key, value in config.telemetry.zenoh.items() if key.partition("/")[0] == "transport"}
    os.nice(NICE)
    connection = Connection(options.connect or config.telemetry.endpoint, extras)
    with _alone_with(config, options), _watched(options, config) as folder:
        connection.start()
        try:
            with suppress(KeyboardInterrupt):
                while True:
                    device = _awaited(connection, config.device.name)
                    _FollowedDaemon(options, config, device, folder, recordings).follow(plan, policy)
                    time.sleep(AGAIN_S)
        finally:
            connection.close()


@contextmanager
def _watched(options: HealOptions, config: Config) -> Iterator[VersionFolder]:
    """The folder of versions, followed by nobody else."""
    folder = VersionFolder(options.out)
    folder.begin(config.device.name)
    with folder.watching():
        folder.takes_controllers_from(_controllers(config, options).folder)
        yield folder


def _alone_with(config: Config, options: HealOptions) -> AbstractContextManager[None]:
    """InputError where another heal, with another folder of versions, follows the same daemon: each would take the
    other's controllers for a person's."""
    controllers, name = _controllers(config, options).folder, config.device.name
    return alone_in(controllers, f"{HEALED}{name}", f"another hoopd heal follows {name}", "--controllers")


def _controllers(config: Config, options: HealOptions) -> Controllers:
    """The daemon's folder; InputError when there is none."""
    from hoopd.daemon.loading import controller_folder
    from hoopd.dashboard.work.controllers import Controllers

    return Controllers(controller_folder(config, options.config))


def _check_names(policy: HealPolicy, path: Path, config: Config, config_path: Path | None) -> None:
    """InputError for a name that is none: a limit on it would be a limit on nothing."""
    from hoopd.daemon.build import model_path
    from hoopd.plants.effects.grammar.mechanisms import mechanisms
    from hoopd.plants.effects.vocabulary import known_effects
    from hoopd.plants.model_file import effects_plant, load_model

    model = load_model(model_path(config, config_path))
    limited = [key.rpartition(".")[0] for key in policy.largest if "." in key]
    plant = effects_plant(model)
    effects = known_effects(plant, [*mechanisms(plant), *limited])
    for index, pattern in enumerate(policy.effects):
        if not any(fnmatchcase(name, pattern) for name in effects):
            raise InputError(path, f"effects[{index}]", f"no effect is called {pattern} (docs/reference/effects.md)")
    for key in policy.largest:
        name, _, parameter = key.rpartition(".")
        known = {one.name for one in effects[name].parameters} if name in effects else set(model.parameters)
        if parameter not in known or (name and name not in effects):
            raise InputError(path, f"largest.{key}", "no effect or parameter is called so")


def _plan(options: HealOptions) -> HealPlan:
    from hoopd.design.comparison import MEASURES
    from hoopd.heal.plan import HealPlan

    if options.number:
        raise InputError("watch", options.number, "takes no number")
    if options.by not in MEASURES:
        raise InputError("--by", "", f"{options.by!r} is none of {', '.join(MEASURES)}")
    return HealPlan(window_s=options.window_s, every_s=options.every_s, trial_s=options.trial_s, by=options.by)


def _config(options: HealOptions) -> Config:
    from hoopd.shell.config import load

    told = [] if options.controllers is None else [f"control.folder={options.controllers.resolve()}"]
    return load(options.config, sim=False, overrides=[*options.sets, *told])


def _recordings(options: HealOptions, config: Config) -> Path:
    told = options.recordings or (Path(config.recording.directory) if config.recording.directory else None)
    if told is None:
        raise InputError("--recordings", "", "the folder into which the daemon records (hoopd --record FOLDER)")
    if not told.is_dir():
        raise InputError(told, "--recordings", "no such folder")
    return told.resolve()


def _awaited(connection: Connection, name: str) -> ShownDevice:
    """The daemon, as soon as it tells of itself and of what was accepted."""
    said = ""
    while True:
        device = connection.devices.get(name)
        if device is not None and device.alive and device.history.count and _accepted(device):
            return device
        why = connection.trouble or "it says nothing of an accepted controller"
        if why != said:
            typer.echo(f"waiting for {name}: {why}")
            said = why
        time.sleep(LOOK_S)


def _accepted(device: ShownDevice) -> str:
    """NAME.yaml@SHA256 of what a device tells as accepted; empty while another one acts."""
    told = device.status.get("controller")
    if not isinstance(told, dict) or told.get("purpose") != "controller" or told.get("next"):
        return ""
    return f"{told.get('file')}@{told.get('sha256')}"


def _filter(device: ShownDevice) -> str:
    """Hash of what the acting filter was made of; empty where a daemon does not tell."""
    told = device.status.get("controller")
    return str(told.get("filter") or "") if isinstance(told, dict) else ""


class _FollowedDaemon:
    """One run of a daemon, from its first word to its last."""

    def __init__(
        self, options: HealOptions, config: Config, device: ShownDevice, folder: VersionFolder, recordings: Path
    ) -> None:
        self._options, self._config, self._device, self._folder = options, config, device, folder
        self._recordings = recordings
        self._controllers = _controllers(config, options)
        self._wanted: queue.Queue[HealWork | None] = queue.Queue()
        self._results: queue.SimpleQueue[tuple[HealWork, dict[str, Any]]] = queue.SimpleQueue()
        self._interrupted, self._mode = False, ""

    def follow(self, plan: HealPlan, policy: Any) -> None:
        """Until the daemon is gone, somebody else changes its controller, or Ctrl-C."""
        from hoopd.dashboard.turns import ComparisonSupervisor
        from hoopd.heal.healing import Healing
        from hoopd.heal.resumption import note_what_acts
        from hoopd.heal.version_copies import lay_copies

        working = self._worker(plan)  # takes a second: what the daemon has is asked when nothing more takes time
        worker = threading.Thread(target=self._work, args=(working,), daemon=True)
        told = _accepted(self._device)
        note_what_acts(self._folder, told, time.time(), user_name(), self._files, _filter(self._device))
        lay_copies(self._folder, self._controllers.lay_in_with, typer.echo)
        healing = Healing(self._folder, plan, policy, time.time, self._device.run, typer.echo)
        typer.echo(f"following {self._device.identity}: version {self._folder.loop().acting} acts")
        worker.start()
        supervisor = ComparisonSupervisor(healing, self._device, self._send, lambda: self._attend(healing))
        supervisor.start()
        try:
            while supervisor.alive:
                time.sleep(LOOK_S)
        except KeyboardInterrupt:
            self._interrupted = True
            supervisor.join(LAST_S)  # for the trial to be taken back
            raise
        finally:
            self._wanted.put(None)
        if supervisor.error is not None:
            raise supervisor.error
        typer.echo(f"no longer following: {healing.why or 'the daemon is gone'}")
        worker.join()  # what it computes is whole then, and whoever follows next goes on from its files

    def _files(self) -> LoopFiles:
        """Of the controller that the daemon has."""
        from hoopd.daemon.loading import ControllerLoader
        from hoopd.files.loaded_controller import parse_loaded
        from hoopd.heal.resumption import LoopFiles

        key = _accepted(self._device)
        text = ControllerLoader(self._config, self._options.config).load(key, "heal")
        return LoopFiles(self._controllers.text(key), parse_loaded(text).model)

    def _worker(self, plan: HealPlan) -> HealWorker:
        from hoopd.commands.heal_work import HealWorker
        from hoopd.dashboard.work.background import background

        options = self._options
        return HealWorker(
            folder=self._folder,
            recording=self._recording,
            lay_in=self._controllers.lay_in_with,
            by=plan.by,
            jobs=options.jobs,
            grammar=options.grammar,
            memory=options.memory,
            prefix=background(),
            short=background(waited_for=True),
        )

    def _recording(self) -> Path:
        from hoopd.dashboard.experiments import recording_of
        from hoopd.dashboard.work.recordings import Recordings

        return recording_of(self._device, Recordings(self._recordings, self._folder.folder))

    def _work(self, worker: HealWorker) -> None:
        """A thread of its own: what it starts ends with it."""
        while (work := self._wanted.get()) is not None:
            self._results.put((work, worker.work(work)))

    def _attend(self, healing: Healing) -> str:
        """What came from elsewhere since the last look, and why it ends: told by the only thread that touches it.

        Ctrl-C is one of these: an order that another thread gave could be lost between two looks.
        """
        if self._interrupted:
            return "interrupted"
        faults = self._device.status.get("faults")
        healing.see(tuple(faults) if isinstance(faults, list) else (), _accepted(self._device))
        self._tell_mode()
        while not self._results.empty():
            healing.done(*self._results.get())
        if healing.version is not None:
            decision = self._folder.decision(healing.version.number)
            if decision is not None:
                healing.decide(decision.accept, decision.who)
        if (work := healing.take_work()) is not None:
            self._wanted.put(work)
        return ""

    def _tell_mode(self) -> None:
        """A line where the daemon falls into FAULT, and where it is out of it."""
        mode, was = self._device.mode, self._mode
        if mode == FAULT and was != FAULT:
            words = self._device.mode_words
            typer.echo(f"{self._device.identity} is in {words}: nothing is learned until it controls again")
        elif was == FAULT and mode != FAULT:
            typer.echo(f"{self._device.identity} is {mode}")
        self._mode = mode

    def _send(self, order: Any) -> Mapping[str, Any]:
        from hoopd.commands.operator import ask

        told = {"command": order.name, "value": order.value, "key": order.key}
        return ask(told, self._options.config, self._options.sets)
