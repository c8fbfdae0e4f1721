"""The rig in real time: the board as a process behind a port, the camera as a command or as angles without pictures.

Rules of this file: only processes that were started here are ended here; everything lives in one folder that goes
with the rig; the daemon sees nothing but a port and a camera.
"""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from hoopd.core.records import CameraSample
from hoopd.shell.helpers import start_helper
from hoopd.sim import boardprocess, lies
from hoopd.sim.boardprocess import ProcessConfig
from hoopd.sim.faults import FaultScript
from hoopd.sim.statering import StateRingReader
from hoopd.sim.watchers import Watcher

# The board's process ends on SIGTERM within a wake-up of 2 ms; beyond this it hangs and is killed.
END_PATIENCE_S = 2.0


class Rig(NamedTuple):
    """Where the rig's parts are."""

    port: Path
    ring: Path  # what a camera sees
    truth: Path  # the plant's state
    torque_log: Path
    folder: Path


@contextmanager
def rig_processes(make: Callable[[Path], ProcessConfig], *, fifo: int) -> Iterator[Rig]:
    """A running board at this priority (0: an ordinary one); `make` gets the rig's folder and tells the board's."""
    with tempfile.TemporaryDirectory(prefix="hoopd-rig-") as name:
        folder = Path(name)
        config = make(folder)
        process = boardprocess.start(folder / "board", config, fifo=fifo)
        try:
            yield Rig(
                folder / "board", Path(config.state_ring), Path(config.truth_ring), Path(config.torque_log), folder
            )
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close its lifeline and wait; kill it only when it does not go."""
    process.terminate()
    try:
        process.communicate(timeout=END_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


class TruePsi:
    """The plant's true ball angle in the last second."""

    def __init__(self, ring: Path, start: float) -> None:
        """`start`: monotonic time of run time zero."""
        self._ring, self._start = StateRingReader(ring), start

    def __call__(self, t: float) -> float | None:
        """psi in rad at run time `t`; None when the ring does not hold it."""
        state = self._ring.at(self._start + t)
        return None if state is None else state.psi


class DirectEye:
    """Ball angles of the rig without pictures, delivered as late as pictures would be."""

    def __init__(
        self,
        ring: Path,
        watcher: Watcher,
        script: FaultScript,
        *,
        clock: Callable[[], float],
        start: float,
        frame_s: float,
        phase_s: float,
        delay_s: float,
        stall_s: float,
    ) -> None:
        """`start`: monotonic time of run time zero."""
        self._ring, self._watcher, self._script = StateRingReader(ring), watcher, script
        self._clock, self._start, self._frame_s, self._phase_s = clock, start, frame_s, phase_s
        self._delay_s, self._stall_s = delay_s, stall_s
        self._slot: deque[CameraSample] = deque(maxlen=1)
        self._last_t = clock()
        self._done = threading.Event()
        start_helper("camera", self._run)

    def take(self) -> CameraSample | None:
        """Newest sample since the last tick."""
        with contextlib.suppress(IndexError):
            return self._slot.pop()
        return None

    @property
    def stalled(self) -> bool:
        """No sample for longer than a camera may take."""
        return self._clock() - self._last_t > self._stall_s

    def close(self) -> None:
        """End the thread."""
        self._done.set()

    def _run(self) -> None:
        frame = int(self._clock() / self._frame_s)
        while not self._done.wait(max(0.0, self._due(frame) - self._clock())):
            self._deliver(frame)
            frame += 1

    def _due(self, frame: int) -> float:
        late = self._script.active(self._taken(frame), "late_pictures")
        return self._taken(frame) + self._delay_s + (float(late["delay_s"]) if late else 0.0)

    def _taken(self, frame: int) -> float:
        return frame * self._frame_s + self._phase_s

    def _deliver(self, frame: int) -> None:
        t = self._taken(frame)
        taken = self._start + t - lies.age_s(self._script, t)
        state = None if self._script.active(t, "camera_stall") else self._ring.at(taken)
        if state is None:
            return
        sample = self._watcher.see(frame, t, (state.theta, state.dtheta, state.psi, state.dpsi), state.distance)
        self._last_t = self._clock()
        self._slot.append(sample._replace(t_arrival=self._last_t))
