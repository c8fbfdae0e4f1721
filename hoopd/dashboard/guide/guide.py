"""What a guided calibration knows of each device: results since the page began, and the versions that were accepted.

Rules of this file: a result is no calibration before somebody accepts it; what is accepted becomes a version and is
written nowhere else. Calls wait for pictures and disks, so they belong into a thread.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec
import numpy as np
import zenoh

from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Connection, Feed
from hoopd.dashboard.guide import motion, picture_steps
from hoopd.dashboard.guide.looking import next_scene, positions
from hoopd.dashboard.guide.steps import STEPS, Drawing, StepResult
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.forms import RESULT, JobOrder
from hoopd.files.calibration import AcceptedCalibration, Calibrations, Part
from hoopd.files.reading import InputError, parse_yaml
from hoopd.shell.config import calibration_part
from hoopd.shell.session import device_key
from hoopd.vision.calibration import CalibrationError

CONFIG_S = 5.0  # how long what a daemon told of its configuration holds
ANSWER_S = 1.0
VERSIONS = 50  # on the page
STILL_ROWS = 100
RESULT_BYTES = 2**20
NO_FOLDER = "no folder of calibrations: name calibration.folder in the configuration that this server gets (--config)"
MOVING = ("signs", "torque", "delay")


class MovingStep(msgspec.Struct):
    """One step of a job's result."""

    good: bool
    why: str
    values: dict[str, Any] = {}
    part: Part = {}


class MovingResult(msgspec.Struct):
    """What `hoopd calibrate --moving` writes."""

    signs: MovingStep
    torque: MovingStep
    delay: MovingStep
    drawings: dict[str, list[Drawing]]


@dataclass
class DeviceGuide:
    """One device's session."""

    results: dict[str, StepResult] = field(default_factory=dict)
    accepted: dict[str, int] = field(default_factory=dict)  # version by step, of what was accepted since the page began
    motion: str = ""  # what the test signal does, for a person
    job: int = 0  # that computes what the signal told
    config: dict[str, Any] = field(default_factory=dict)
    config_text: str = ""
    asked_s: float = -CONFIG_S
    lock: threading.Lock = field(default_factory=threading.Lock)  # one step at a time


class KeptCalibrations(NamedTuple):
    """A folder of versions, and the name of the device whose they are."""

    versions: Calibrations | None = None
    owner: str = ""


NOT_KEPT = KeptCalibrations()


class Guide:
    """All devices."""

    def __init__(self, feed: Feed, bench: Bench | None, kept: KeptCalibrations) -> None:
        self._feed, self._bench, (self._versions, self._owner) = feed, bench, kept
        self._guides: dict[str, DeviceGuide] = {}

    # ------------------------------------------------------------------------------------------ steps

    def look(self, device: ShownDevice, step: str) -> StepResult:
        """Do a step that looks at pictures; InputError says why there is no result."""
        guide = self._of(device)
        if step not in STEPS or STEPS[step].moves:
            raise InputError("step", step[:40], "no step that looks at pictures")
        if not guide.lock.acquire(blocking=False):
            raise InputError("step", step, "another step is being done")
        try:
            found = self._looked(guide, device, step)
        except CalibrationError as error:
            raise InputError(STEPS[step].title, "", str(error)) from None
        finally:
            guide.lock.release()
        guide.results[step] = found
        guide.accepted.pop(step, None)
        return found

    def _looked(self, guide: DeviceGuide, device: ShownDevice, step: str) -> StepResult:
        connection = self._feed.connection_of(device)
        scene = next_scene(connection, device.name)
        if step != "zero":
            steps: Mapping[str, Callable[[picture_steps.LookedPicture], StepResult]] = {
                "exposure": picture_steps.exposure,
                "circle": picture_steps.circle,
                "threshold": picture_steps.threshold,
            }
            return steps[step](scene)
        x, y, _ = scene.about.circle_px
        if (circle := guide.results.get("circle")) is not None:  # what will be in force together with the zero
            x, y = circle.part["vision"]["circle_px"]["centre"]
        hoop = device.columns(("dtheta",))["dtheta"][-STILL_ROWS:]
        speed = float(np.sqrt(np.nanmean(hoop**2))) if np.isfinite(hoop).any() else np.inf
        return picture_steps.zero(positions(connection, device.name), (x, y), scene.about.zero_angle_rad, speed)

    # ------------------------------------------------------------------------------------------ motion

    def signal(self, device: ShownDevice) -> str:
        """Key of the test signal, laid where the daemon can load it."""
        if self._bench is None:
            raise InputError("bench", "", "this server was started without --recordings and --controllers")
        controller = device.status.get("controller")
        return motion.lay_in(self._bench, controller if isinstance(controller, dict) else {})

    def begun(self, device: ShownDevice) -> None:
        """The signal plays."""
        guide = self._of(device)
        guide.motion, guide.job = "plays", 0

    def finish(self, device: ShownDevice, run: str, begun_t: float, since_s: float, who: str) -> None:
        """Keep what was told of the signal and ask the job that computes; what hinders it is said in `motion`."""
        guide = self._of(device)
        assert self._bench is not None
        try:
            if (why := motion.why_ended(device, since_s)) != motion.PLAYED:
                raise InputError("the signal", "", f"ended early: {why or 'the daemon told of no end'}")
            self._ask_config(guide, self._feed.connection_of(device), device)
            name = motion.keep(self._bench, device, run, begun_t, guide.config_text)
            job = self._bench.ask(JobOrder("calibrate", [name]), who)
            guide.motion, guide.job = f"was recorded as {name}; job {job.number} computes", job.number
        except InputError as error:
            guide.motion = f"gave nothing: {error}"

    def _take_job(self, guide: DeviceGuide) -> None:
        """Results of the job once it is done."""
        if not guide.job or self._bench is None:
            return
        told = next((one for one in self._bench.jobs.told() if one["number"] == guide.job), None)
        if told is None or told["state"] in ("failed", "cancelled"):
            guide.motion, guide.job = f"gave nothing: {told['line'] if told else 'its job is gone'}", 0
        elif told["state"] == "done":
            number, guide.job = guide.job, 0
            try:
                self._fill(guide, self._bench.jobs.file(number, RESULT).read_bytes()[:RESULT_BYTES])
                guide.motion = f"was played; job {number} computed"
            except (InputError, OSError, msgspec.MsgspecError) as error:
                guide.motion = f"gave nothing: {error}"[:200]

    def _fill(self, guide: DeviceGuide, content: bytes) -> None:
        result = msgspec.json.decode(content, type=MovingResult)
        for name in MOVING:
            step: MovingStep = getattr(result, name)
            drawings = result.drawings.get(name, [])
            guide.results[name] = StepResult(step.good, step.why, step.values, step.part, drawings)
            guide.accepted.pop(name, None)

    # ------------------------------------------------------------------------------------------ versions

    def accept(self, device: ShownDevice, names: list[str], why: str, who: str) -> AcceptedCalibration:
        """A version of what these steps found."""
        versions, guide = self._folder(device), self._of(device)
        if not names:
            raise InputError("steps", "", "choose one at least")
        for name in names:
            if name not in guide.results:
                raise InputError("steps", name[:40], "has no result to accept")
        part: Part = {}
        for name in names:
            for section, keys in guide.results[name].part.items():
                part.setdefault(section, {}).update(keys)
        judged = {name: guide.results[name].judgement() for name in names}
        pictures = {f"{name}.jpg": guide.results[name].picture for name in names if guide.results[name].picture}
        drawn = {name: guide.results[name].told() for name in names}
        evidence = {**pictures, "steps.json": msgspec.json.encode(drawn)}
        version = versions.add(
            calibration_part(part, "calibration"), device=device.name, who=who, why=why or ", ".join(names),
            steps=judged, evidence=evidence,
        )  # fmt: skip
        guide.accepted |= dict.fromkeys(names, version.number)
        return version

    def restore(self, device: ShownDevice, number: int, who: str) -> AcceptedCalibration:
        """An earlier version again."""
        return self._folder(device).restore(number, who)

    def evidence(self, number: int, name: str) -> bytes:
        """A file of a version; InputError when there is none, or another one."""
        if self._versions is None:
            raise InputError("calibration", "", NO_FOLDER)
        return self._versions.evidence(self._versions.read(number), name)

    def picture(self, device: ShownDevice, step: str) -> bytes:
        """What a step looked at; InputError when there is none."""
        result = self._of(device).results.get(step)
        if result is None or not result.picture:
            raise InputError("picture", step[:40], "none was looked at")
        return result.picture

    def _folder(self, device: ShownDevice) -> Calibrations:
        if self._versions is None:
            raise InputError("calibration", "", NO_FOLDER)
        if device.name != self._owner:
            raise InputError("calibration", device.name, f"the folder is of device {self._owner!r}")
        return self._versions

    # ------------------------------------------------------------------------------------------ told

    def told(self, device: ShownDevice) -> dict[str, Any]:
        """All of it, for the page."""
        guide = self._of(device)
        self._take_job(guide)
        self._ask_config(guide, self._feed.connection_of(device), device)
        versions = self._versions.listed() if self._versions is not None and device.name == self._owner else []
        newest = versions[-1].calibration if versions else None
        return {
            "steps": [self._step(guide, name, newest) for name in STEPS],
            "open": [name for name in STEPS if newest is None or name not in newest.steps],
            "motion": guide.motion,
            "moves": "" if self._bench is not None and self._bench.controllers is not None else "--controllers",
            "keeps": "" if self._versions is not None and device.name == self._owner else NO_FOLDER,
            "wrong": versions[-1].wrong if versions and newest is None else "",
            "in_force": _in_force(newest, guide.config),
            "versions": [_version(one) for one in versions[-VERSIONS:][::-1]],
        }

    def _step(self, guide: DeviceGuide, name: str, newest: AcceptedCalibration | None) -> dict[str, Any]:
        step, result = STEPS[name], guide.results.get(name)
        before = newest.steps.get(name) if newest is not None else None
        return {
            "name": name,
            **step._asdict(),
            "result": result.told() if result is not None else None,
            "accepted": guide.accepted.get(name, 0),
            "before": msgspec.to_builtins(before) if before is not None else None,
        }

    def _ask_config(self, guide: DeviceGuide, connection: Connection, device: ShownDevice) -> None:
        """What the daemon says is in force, asked again only now and then."""
        now, session = time.monotonic(), connection.session
        if session is None or now - guide.asked_s < CONFIG_S:
            return
        guide.asked_s = now
        with contextlib.suppress(zenoh.ZError, msgspec.MsgspecError, InputError, KeyError, TypeError):
            for reply in session.get(device_key(device.name, "config"), timeout=ANSWER_S):
                if reply.ok is not None:
                    text = msgspec.json.decode(reply.ok.payload.to_bytes(), type=dict[str, str])["config"]
                    guide.config, guide.config_text = parse_yaml(text, device.name), text

    def _of(self, device: ShownDevice) -> DeviceGuide:
        return self._guides.setdefault(device.identity, DeviceGuide())


def _in_force(newest: AcceptedCalibration | None, config: Mapping[str, Any]) -> dict[str, Any]:
    """Which keys of the newest version the daemon does not have yet."""
    if newest is None:
        return {"number": None, "differs": []}
    if not config:
        return {"number": newest.number, "differs": None}
    differs = [
        f"{section}.{key}"
        for section, keys in newest.configuration.items()
        for key, value in keys.items()
        if not _same(config.get(section, {}).get(key), value)
    ]
    return {"number": newest.number, "differs": differs}


def _same(one: Any, other: Any) -> bool:
    return bool(msgspec.json.encode(one, order="sorted") == msgspec.json.encode(other, order="sorted"))


def _version(one: Any) -> dict[str, Any]:
    version = one.calibration
    told = {"number": one.number, "wrong": one.wrong, "changes": [change._asdict() for change in one.changes]}
    if version is None:
        return told
    fields = {"date": version.date, "who": version.who, "why": version.why, "evidence": list(version.evidence)}
    return {**told, **fields, "steps": msgspec.to_builtins(version.steps)}
