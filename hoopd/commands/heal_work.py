"""What a loop that is followed wants to have computed: diagnosed, designed, proven on fresh seconds, weighed.

Rules of this file: diagnosis and design are the ordinary commands, in processes that get time which nobody else wants;
a step whose file is there is not repeated; the daemon's recording is read and never changed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from hoopd.commands.step_commands import StepError, run_step
from hoopd.design.comparison import LEAST_SHARE
from hoopd.diagnose.record_file import parse
from hoopd.files.heal_versions import HealVersion, VersionFolder
from hoopd.files.memory import add_to_memory, load_memory
from hoopd.files.model import model_text
from hoopd.files.reading import InputError
from hoopd.files.whole_files import file_bytes, replace_file
from hoopd.heal.change import judged, written_changes
from hoopd.heal.cost_promise import LoopCosts, controller_kind, loop_costs
from hoopd.heal.filter_evidence import LEAST_NATS, FilterEvidence, filter_evidence
from hoopd.heal.plan import REMEMBER, REMEMBERED, HealWork
from hoopd.heal.version_copies import LayIn, laid_copy
from hoopd.heal.weighing import GAIN_OF_BEFORE
from hoopd.plants.hoop.loop.writeback import unused
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.slices import read_recording

LAW = "lqg"
MEMORY = "memory.json"  # of a version: what was known, and its diagnosis
# A law that follows the time since a recording's begin is none of the next one's: a filter cannot have it, and what is
# fitted beside it would be wrong without it.
OF_A_RECORDING = ("hoop.friction_drift",)
LONGEST_S = 1800.0  # of a step: what takes longer is no answer to minutes that are over
UNUSABLE = 2  # of a diagnosis that writes everything but a model of which there are doubts


@dataclass(frozen=True, kw_only=True)
class HealWorker:
    """Does it, for one daemon.

    `recording`: the file that the daemon writes now; `prefix`: what stands before a diagnosis, which gets the time that
    nobody else wants; `short`: before what takes seconds.
    """

    folder: VersionFolder
    recording: Callable[[], Path]
    lay_in: LayIn
    by: str
    seed: int = 0
    jobs: int = 1
    grammar: bool = False
    memory: Path | None = None
    prefix: Sequence[str] = ()
    short: Sequence[str] = ()

    def work(self, work: HealWork) -> dict[str, Any]:
        """The result as plain data; `error` in it where nothing came of it."""
        try:
            steps = {"diagnose": self._diagnose, "prove": self._prove, "weigh": self._weigh, REMEMBER: self._remember}
            return steps[work.name](work)
        except (StepError, InputError, ValueError, OSError) as error:
            return {"error": str(error)}
        except Exception as error:  # a mistake of ours ends the version, and not whoever waits for a result
            return {"error": f"{type(error).__name__}: {error}"}

    def _diagnose(self, work: HealWork) -> dict[str, Any]:
        version, place = self.folder.read(work.number), self.folder.of(work.number)
        before = self.folder.of(version.before)
        evidence, told, model = place / "evidence.mcap", place / "diagnosis.json", place / "found.yaml"
        self._cut(work, evidence)
        if not told.exists():
            words: list[str | Path] = ["diagnose", evidence, "--model", before / "model.yaml", "--seed", str(self.seed)]
            words += self._memory_words(place, version.begun)
            words += [
                "--without",
                ",".join(OF_A_RECORDING),
                "--no-free-run",
                "--grammar" if self.grammar else "--library-only",
            ]
            words += ["--jobs", str(self.jobs), "--report", place / "report.html", "--write", model]
            code = _step([*words, "--json", told], place / "diagnosis.log", (0, UNUSABLE), self.prefix)
            if code == UNUSABLE and not told.exists():
                raise StepError(_last_line(place / "diagnosis.log"))
        found = judged(parse(file_bytes(told), told), version.faults_s, version.to_s - version.from_s)
        result = {
            "kind": found.kind, "reason": found.reason, "learn": found.may_be_learned, "effects": found.effects,
            "probabilities": found.probabilities, "parameters": found.parameters, "values": found.values,
        }  # fmt: skip
        if not found.may_be_learned:
            return result
        if not model.exists():
            return result | {"learn": False, "reason": f"{found.reason}; {_last_line(place / 'diagnosis.log')}"}
        if (kind := controller_kind(before)) != LAW:
            reason = f"{found.reason}; the law that acts is {kind}: design one of its kind on {model.name}"
            return result | {"learn": False, "reason": reason}
        self._without_corrections(place, before, found.effects)
        if why := _of_no_use(place / "model.yaml", found.effects):
            return result | {"learn": False, "reason": f"{found.reason}; {why}"}
        self._design(place)
        return result | self._written(place, before, result)

    def _written(self, place: Path, before: Path, told: Mapping[str, Any]) -> dict[str, Any]:
        """What a policy is asked about: beside what the data exclude, every number that the version's model changes."""
        written = written_changes(load_model(before / "model.yaml"), load_model(place / "model.yaml"))
        return {
            "parameters": {**told["parameters"], **written.shares},
            "values": {**told["values"], **written.values},
        }

    def _memory_words(self, place: Path, begun: float) -> list[str | Path]:
        """A diagnosis is told what is known, as a copy: what it adds counts once its version has proven itself."""
        if self.memory is None:
            return []
        copy = place / MEMORY
        copy.unlink(missing_ok=True)
        if self.memory.exists():
            replace_file(copy, file_bytes(self.memory))
        return ["--memory", copy, "--date", _day(begun)]

    def _remember(self, work: HealWork) -> dict[str, Any]:
        """What the diagnosis of a version says is known of the device from now on."""
        copy = self.folder.of(work.number) / MEMORY
        if self.memory is not None and copy.exists():
            told, _ = load_memory(copy, None)
            add_to_memory(self.memory, told.of, told.diagnoses[-1])
        return {REMEMBERED: self.memory is not None or not copy.exists()}

    def _without_corrections(self, place: Path, before: Path, effects: Collection[str]) -> None:
        """The model of a version: what was found, without effects that are no more than a correction beside it."""
        found = load_model(place / "found.yaml")
        kept = {one.name for one in load_model(before / "model.yaml").effects} | set(effects)
        model = msgspec.structs.replace(
            found, name=place.name, effects=[one for one in found.effects if one.name in kept]
        )
        replace_file(place / "model.yaml", model_text(model).encode())

    def _design(self, place: Path) -> None:
        controller, told = place / "controller.yaml", place / "design.json"
        if not told.exists():
            words: list[str | Path] = ["design", LAW, "--model", place / "model.yaml", "--out", controller]
            _step([*words, "--json", told], place / "design.log", prefix=self.short)

    def _prove(self, work: HealWork) -> dict[str, Any]:
        """On seconds that were not fitted: the new model's filter, and those of earlier versions."""
        version, place = self.folder.read(work.number), self.folder.of(work.number)
        fresh = place / "fresh.mcap"
        self._cut(work, fresh)
        recording = read_recording(str(fresh))
        acting = self.folder.of(version.before)
        gain = filter_evidence(recording, acting, place)
        earlier = {
            one.number: filter_evidence(recording, acting, self.folder.of(one.number)) for one in self._earlier(version)
        }
        restores = _as_good(earlier, gain)
        chosen = place if restores is None else self.folder.of(restores)
        promise = loop_costs(read_recording(str(place / "evidence.mcap")), acting, chosen, self.by)
        why = _not_proven(gain if restores is None else earlier[restores], promise)
        told = f"{gain.nats:.0f} nats on {gain.seconds:.0f} s that nobody fitted"
        key = "" if why else laid_copy(self.folder, version.number if restores is None else restores, self.lay_in)
        return {
            "proven": not why,
            "why": why or (told if restores is None else f"{told}; version {restores} explains them as well"),
            "gain": asdict(gain),
            "earlier": {str(number): asdict(one) for number, one in earlier.items()},
            "promise": asdict(promise),
            "restores": restores,
            "key": key,
        }

    def _earlier(self, version: HealVersion) -> list[HealVersion]:
        """Versions that acted once, were not given up and do not act now, the newest four."""
        every = [one for one in self.folder.every() if one.state == "accepted" and one.restores is None]
        return [one for one in every if one.number not in (version.number, version.before)][-4:]

    def _weigh(self, work: HealWork) -> dict[str, Any]:
        version = self.folder.read(work.number)
        before, new = self.folder.of(version.before), self.folder.of(version.acts_as)
        seconds = read_recording(f"{self.recording()}@{work.from_s:.3f}:{work.to_s:.3f}")
        costs = loop_costs(seconds, before, new, self.by)
        if costs.seconds < LEAST_SHARE * (work.to_s - work.from_s):
            told = f"{costs.seconds:.1f} s of {work.to_s - work.from_s:.1f} s"
            raise ValueError(f"nothing to be weighed: the recording has {told} in which the law acts")
        gain = filter_evidence(seconds, acting=new, other=before)
        return {**asdict(costs), GAIN_OF_BEFORE: asdict(gain), "from_s": work.from_s}

    def _cut(self, work: HealWork, path: Path) -> None:
        """Seconds of the daemon's recording, kept as evidence."""
        if path.exists():
            return
        span = ("--from", f"{work.from_s:.3f}", "--to", f"{work.to_s:.3f}")
        _step(["convert", self.recording(), path, *span], path.with_suffix(".log"), prefix=self.short)


def _step(words: Sequence[str | Path], log: Path, accepted: Sequence[int] = (0,), prefix: Sequence[str] = ()) -> int:
    return run_step(words, log, accepted, prefix=prefix, limit_s=LONGEST_S)


def _of_no_use(model: Path, found: Collection[str]) -> str:
    """Why neither filter nor feed-forward can do anything with all that was found; empty where one of it is of use."""
    reasons = {one.name: one.reason for one in unused(effects_of(load_model(model)))}
    return "; ".join(f"{name}: {reasons[name]}" for name in found) if found and {*found} <= {*reasons} else ""


def _day(begun: float) -> str:
    """Of a time in s since 1970."""
    return datetime.fromtimestamp(begun, UTC).date().isoformat()


def _as_good(earlier: dict[int, FilterEvidence], gain: FilterEvidence) -> int | None:
    """An earlier version that explains the fresh seconds as well as the new one: then nothing new is needed."""
    good = {number: one for number, one in earlier.items() if one.is_clear and one.nats >= gain.nats - LEAST_NATS}
    return max(good, key=lambda number: good[number].nats) if good else None


def _not_proven(gain: FilterEvidence, promise: LoopCosts) -> str:
    if not gain.is_clear:
        return f"not proven: {gain.nats:.1f} nats on {gain.seconds:.0f} s that nobody fitted"
    if promise.new > promise.before:
        return f"nothing to be gained: the new law promises {promise.new:.3g}, the old one {promise.before:.3g}"
    return ""


def _last_line(log: Path) -> str:
    told = [line for line in log.read_text("utf-8", "replace").splitlines() if line.strip()]
    return told[-1].removeprefix("hoopd: ") if told else "no word"
