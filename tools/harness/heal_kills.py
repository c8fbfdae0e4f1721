"""A healing that is killed at random moments beside a daemon in lock-step, and begins again from what lies there.

Killed means: nothing that it meant to say is said, nothing that is being computed comes, and of what is being computed
either all files are there or none. After a while another one takes the folder up, as soon as the daemon tells of an
accepted controller, as `hoopd heal` does.

Rules of this file: what must hold is judged by the daemon's own tick and by the files' bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.healed_rig import WHO, HealingGuest, PreparedHealing, prepared
from harness.told_heal import POLICY, QUICK, ToldWorker, friction, moved
from hoopd.core.records import Inputs, TickRecord
from hoopd.core.shadow import SHADOW_S
from hoopd.core.succession import CONTROLLER
from hoopd.core.trial import SILENCE_S
from hoopd.daemon.replay import replay
from hoopd.files.heal_versions import FOUND, HealVersion, VersionFolder
from hoopd.files.loaded_controller import parse_loaded
from hoopd.heal.plan import HealWork
from hoopd.heal.resumption import LoopFiles, note_what_acts

# A trial that was asked for in the last words may still take over, and is then watched by nobody.
BACK_S = SHADOW_S + SILENCE_S + 0.1
FIRST_S, QUIET_S = 30.0, 110.0  # friction grows at the first; what was killed last has the others to go on
EACH_S = 45.0  # between two kills in the mean
# Of a version these grow; nothing else changes once it is there.
UNHEARD = ("accepting", "rolling")
GROWING = ("version.json", "heal.json", ".watched")


class HealKill(NamedTuple):
    """One kill."""

    at_s: float
    away_s: float  # until somebody begins it again
    loses_files: bool  # of what is being computed


class _Snapshot(NamedTuple):
    """What lies in a folder."""

    files: dict[Path, bytes]
    versions: dict[int, HealVersion]


@dataclass(frozen=True)
class KilledRun:
    """What became of it; `phases`: in which it was killed."""

    at_s: tuple[float, ...]
    phases: tuple[str, ...]
    wrong: tuple[str, ...]


class KilledGuest(HealingGuest):
    """Kills the healing and begins another one."""

    def __init__(self, made: PreparedHealing, kills: Sequence[HealKill]) -> None:
        super().__init__(made.healing(), made.worker, made.loader, made.clock)
        self.wrong: list[str] = []
        self.killed: list[tuple[float, str]] = []
        self._made, self._waiting = made, list(kills)
        self._dead: HealKill | None = None
        self._left: _Snapshot | None = None
        self._before_work: frozenset[Path] = frozenset()

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """One tick; without anybody who watches the loop while it is dead."""
        if self._dead is None and self._waiting and record.t >= self._waiting[0].at_s:
            self._kill(record.t)
        if self._dead is None:
            super().put(record, inputs)
            return
        self._clock.t = record.t
        if record.t >= self._dead.at_s + BACK_S:
            self._check_law(record.t)
        if record.t >= self._dead.at_s + self._dead.away_s and self._accepted_key():
            self._begin_again(record.t)

    def note(self, t: float, note: object) -> None:
        """One fact, which nobody hears while it is dead."""
        if self._dead is None:
            super().note(t, note)  # type: ignore[arg-type]

    def _compute(self, t: float, work: HealWork) -> None:
        self._before_work = frozenset(_files(self._made.versions.folder))
        super()._compute(t, work)

    def _kill(self, t: float) -> None:
        self._dead = self._waiting.pop(0)._replace(at_s=t)
        self.killed.append((t, self.healing.phase))
        if self._due is not None and self._dead.loses_files:
            for path in _files(self._made.versions.folder):
                if path not in self._before_work:
                    path.unlink()
        self._due, self._orders = None, []
        self._left = _snapshot(self._made.versions)

    def _begin_again(self, t: float) -> None:
        assert self._left is not None
        self.wrong += [f"{t:.1f} s: {one}" for one in lost(self._left, self._made.versions)]
        noted = note_what_acts(self._made.versions, self._accepted_key(), t, WHO, self._loaded)
        if noted is not None and noted.kind == FOUND:
            self.wrong.append("the daemon has a controller that nobody knows")
        self.healing, self._dead = self._made.healing(), None

    def _loaded(self) -> LoopFiles:
        """Of the controller that the daemon has."""
        loaded = parse_loaded(self._made.loader.load(self._accepted_key(), WHO))
        return LoopFiles(loaded.file, loaded.model)

    def _accepted_key(self) -> str:
        """NAME.yaml@SHA256 of what the daemon has accepted; empty while another one acts or follows."""
        assert self._loop is not None
        succession = self._loop.tick.succession
        if succession.purpose != CONTROLLER or succession.waiting or succession.acting is not succession.accepted:
            return ""
        return f"{succession.accepted.label.name}@{succession.accepted.label.sha256}"

    def _check_law(self, t: float) -> None:
        """Nobody watches: what acts is what was accepted, and that is the version that the folder names."""
        key, versions, phase = self._accepted_key(), self._made.versions, self.killed[-1][1]
        may = {*versions.read(versions.loop().acting).keys}
        if phase in UNHEARD:  # the daemon's word about the last order was not heard any more
            may |= {key for one in versions.every() if one.state in ("trying", "accepted") for key in one.keys}
        if not any(key and _same(key, told) for told in may):
            self.wrong.append(f"{t:.1f} s: {key or 'what was not accepted'} acts, not one of {sorted(may)}")


def _same(one: str, other: str) -> bool:
    """Keys of one file; a hash may be cut off."""
    (name, sha), (other_name, other_sha) = one.split("@"), other.split("@")
    return name == other_name and (sha.startswith(other_sha) or other_sha.startswith(sha))


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def _snapshot(versions: VersionFolder) -> _Snapshot:
    kept = {path: path.read_bytes() for path in _files(versions.folder) if path.name not in GROWING}
    return _Snapshot(kept, {one.number: one for one in versions.every()})


def lost(before: _Snapshot, versions: VersionFolder) -> list[str]:
    """What is no longer as it was: a file of another content, a version or a part of its history that is gone."""
    wrong = [f"{path.name} is another" for path, data in before.files.items() if _is_another(path, data)]
    for number, one in before.versions.items():
        now = versions.read(number)
        if now.history[: len(one.history)] != one.history:
            wrong.append(f"version {number} lost a part of its history")
    return wrong


def _is_another(path: Path, data: bytes) -> bool:
    """A log is of the step that wrote it last."""
    return not path.exists() or (path.suffix != ".log" and path.read_bytes() != data)


def drawn(kills: int, seed: int) -> list[HealKill]:
    """Moments that nobody chose."""
    rng = np.random.default_rng(seed)
    moments = np.sort(rng.uniform(FIRST_S, FIRST_S + EACH_S * kills, kills))
    return [HealKill(float(t), float(rng.uniform(0.5, 12.0)), bool(rng.integers(2))) for t in moments]


def run_killed(folder: Path, kills: int, seed: int, progress: Callable[[str], None] = lambda text: None) -> KilledRun:
    """A loop in which friction grows, whose healing is killed so often."""
    chosen = drawn(kills, seed)
    duration_s = chosen[-1].at_s + QUIET_S
    made = prepared(
        folder, friction(), moved(duration_s), duration_s=duration_s, plan=QUICK, policy=POLICY, seed=seed,
        worker=ToldWorker,
    )  # fmt: skip
    guest, begun = KilledGuest(made, chosen), _snapshot(made.versions)
    run = made.perform(guest)
    progress(f"killed {', '.join(f'{phase} at {t:.0f} s' for t, phase in guest.killed)}; {'; '.join(run.told)}")
    wrong = guest.wrong + lost(begun, made.versions)
    acting = made.versions.read(run.acting)
    if acting.number == 0:
        wrong.append(f"nothing was learned in the end: {'; '.join(run.told)}")
    if run.summary["faults"]:
        wrong.append(f"faults: {run.summary['faults']}")
    if not replay(run.recording)["equal"]:
        wrong.append("a replay differs")
    return KilledRun(tuple(t for t, _ in guest.killed), tuple(phase for _, phase in guest.killed), tuple(wrong))
