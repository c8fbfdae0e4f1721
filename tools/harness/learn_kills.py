"""`hoopd learn` killed at random moments, again and again, until it may end: what must hold after every kill.

Nothing of it goes on; the rig's drive is off; what a finished step has written keeps its bytes; and in the end there is
what an undisturbed campaign has.

Rules of this file: only processes that were started here are killed; a moment is drawn within a step, so that every
kind of step is met.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

PROGRAM = Path(__file__).with_name("told_learn.py")
# A step by the file that ends it, in their order; the last one ends the campaign.
ENDS = (
    "run_01/experiment.json", "run_01/diagnosis.json", "run_02/experiment.json", "run_02/diagnosis.json", "design.json",
    "comparison.json",
)  # fmt: skip
# What an undisturbed campaign has to the byte.
SAME = ("run_01/recording.mcap", "run_01/diagnosis.json", "run_02/recording.mcap", "controller.yaml")
GONE_S, LONGEST_S = 20.0, 600.0
USUAL_S = [5.0, 4.0, 5.0, 4.0, 5.0, 20.0]  # of the steps, on an idle machine
BEGIN_S = 1.5  # of a process, until it does anything
OFF_NM = 1e-9


class LearnKill(NamedTuple):
    """After which step has ended, and what share of the next one's time later."""

    step: int
    share: float


@dataclass(frozen=True)
class KilledCampaign:
    """What became of it; `met`: what was done when it was killed."""

    met: tuple[str, ...]
    wrong: tuple[str, ...]


def began(out: Path, rig: Path) -> subprocess.Popen[bytes]:
    """A campaign."""
    rig.mkdir(exist_ok=True)
    quiet = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, str(PROGRAM), str(out), str(rig)], stdout=quiet, stderr=quiet)


def undisturbed(out: Path, rig: Path) -> list[float]:
    """One that nobody kills; how long each step took, s."""
    process, begun, ended = began(out, rig), time.monotonic(), list[float]()
    while process.poll() is None and time.monotonic() - begun < LONGEST_S:
        if len(ended) < len(ENDS) and (out / ENDS[len(ended)]).exists():
            ended.append(time.monotonic() - begun)
        time.sleep(0.02)
    process.kill()
    process.wait()
    ended += [time.monotonic() - begun] * (len(ENDS) - len(ended))
    return [max(0.1, b - a) for a, b in zip([BEGIN_S, *ended], ended, strict=False)]


def run_killed(
    folder: Path, kills: int, seed: int, progress: Callable[[str], None] = lambda text: None, *, compared: bool = True
) -> KilledCampaign:
    """One campaign, killed so often, then left to its end; `compared`: with one that nobody killed."""
    plain, out, rig = folder / "plain", folder / "killed", folder / "rig"
    lengths = undisturbed(plain, rig) if compared else USUAL_S
    wrong, met = list[str](), list[str]()
    for kill in drawn(kills, seed):
        doing = _kill_once(out, rig, kill, lengths)
        met.append(doing)
        wrong += [f"killed in {doing or 'its beginning'}: {one}" for one in _not_right(out, rig)]
        progress(f"killed in {doing or 'its beginning'}: {len(wrong)} wrong")
    process = began(out, rig)
    try:
        process.wait(LONGEST_S)
    except subprocess.TimeoutExpired:
        wrong.append(f"it did not end within {LONGEST_S:g} s")
        process.kill()
        process.wait()
    return KilledCampaign(tuple(met), (*wrong, *_differences(plain if compared else out, out)))


def drawn(kills: int, seed: int) -> list[LearnKill]:
    """Steps in their order, as they come; in each a moment that nobody chose."""
    rng = np.random.default_rng(seed)
    return [LearnKill(int(step), float(rng.uniform())) for step in np.sort(rng.integers(0, len(ENDS), kills))]


def _kill_once(out: Path, rig: Path, kill: LearnKill, lengths: list[float]) -> str:
    """Kill the process (not its children) in a step; what it was doing."""
    before = {path: path.read_bytes() for path in _finished(out)}
    process, begun = began(out, rig), time.monotonic()
    while kill.step and not (out / ENDS[kill.step - 1]).exists() and time.monotonic() - begun < LONGEST_S:
        time.sleep(0.02)
    early = BEGIN_S if time.monotonic() - begun < BEGIN_S else 0.0
    time.sleep(early + kill.share * lengths[kill.step])
    doing = ""
    if (out / "progress.json").exists():
        doing = str(json.loads((out / "progress.json").read_text())["doing"])
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert all(path.read_bytes() == data for path, data in before.items()), "a finished step was repeated"
    return doing


def _finished(out: Path) -> list[Path]:
    """Files of steps that have ended."""
    return [path for name in (*ENDS, *SAME) if (path := out / name).exists() and _step_of(out, name)]


def _step_of(out: Path, name: str) -> bool:
    """Whether the step of a file has ended."""
    last = {"run_01/recording.mcap": ENDS[0], "run_02/recording.mcap": ENDS[2], "controller.yaml": ENDS[4]}
    return (out / last.get(name, name)).exists()


def _not_right(out: Path, rig: Path) -> list[str]:
    """What must not be after a kill."""
    deadline = time.monotonic() + GONE_S
    while (left := running(out)) and time.monotonic() < deadline:
        time.sleep(0.05)
    wrong = [f"goes on: {one}" for one in left]
    if (torque := last_torque(rig)) is not None and abs(torque) > OFF_NM:
        wrong.append(f"the drive has {torque:g} N m")
    for path in out.rglob("*.json"):
        try:
            json.loads(path.read_text() or "null")
        except ValueError:
            if not path.name.startswith("."):
                wrong.append(f"{path.name} is a half")
    return wrong


def last_torque(rig: Path) -> float | None:
    """What the rig's board applied in the end, N m; None where no run has begun."""
    path = rig / "torque.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    whole = [line for line in lines if line.startswith("{") and line.endswith("}")]
    return float(json.loads(whole[-1])["torque_nm"]) if whole else None


def running(folder: Path) -> list[str]:
    """Processes that name the folder, but this one."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            text = path.read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if str(folder) in text and int(path.parent.name) != os.getpid():
            found.append(text[:120])
    return found


def _differences(plain: Path, out: Path) -> list[str]:
    """In what the killed one differs from the one that nobody killed."""
    wrong = [f"{name} is missing" for name in (*ENDS, "result.json", "story.html") if not (out / name).exists()]
    wrong += [f"{name} differs" for name in SAME if (out / name).exists() and _differ(plain / name, out / name)]
    return wrong


def _differ(one: Path, other: Path) -> bool:
    return one.read_bytes() != other.read_bytes()
