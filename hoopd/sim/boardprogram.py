"""A board that is a program of its own: the host build of a firmware in the place of `DriverBoard`.

Rules of this file: lines to its standard input, lines from its standard output (docs/guides/firmware.md has their
words); its clock is ours in whole microseconds; the plant is moved between two lines with the torque that it gave, so
that it meets every change of the torque at its instant. It ends with its input.
"""

from __future__ import annotations

import contextlib
import math
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Final

import numpy as np

from hoopd.core.frames import DEFAULT_LAYOUT, STATUS_ENABLED, Layout
from hoopd.sim.board import BYTE_S, FAULT_BITS, BoardConfig, BoardPlant, DriverBoard, FaultName, RigBoard
from hoopd.sim.torque_log import TorqueRow, TorqueSink

# The program carries the sensors on by the hoop's speed; over a millisecond that is right to less than a count.
SEGMENT_US: Final = 1000
US_PER_S: Final = 1_000_000
# A time that was a whole microsecond before it was a float is still one.
ROUNDING_US: Final = 1e-3
END_PATIENCE_S: Final = 2.0


class BoardProgramError(RuntimeError):
    """The program did not start, ended, or said what no board says."""


class BoardProgram:
    """The board's side of the rig, played by a program; times in s on the board's clock."""

    def __init__(
        self,
        program: str,
        plant: BoardPlant,
        *,
        layout: Layout = DEFAULT_LAYOUT,
        byte_s: float = BYTE_S,
        sink: TorqueSink | None = None,
        t: float = 0.0,
    ) -> None:
        """`program`: its path; BoardProgramError when it does not start."""
        self._program, self._plant, self._sink, self._byte_s = program, plant, sink, byte_s
        self._request_bytes = layout.request.length
        self._now_us = self._zero_us = _us(t)
        self._injected = 0
        self._torque_nm = 0.0
        self._status = 0
        self._answers: list[tuple[float, bytes]] = []
        self._process = self._open()
        try:
            self._power("start")
        except BoardProgramError:
            self.close()
            raise

    # --- what the rig calls ---

    def receive(self, t: float, data: bytes) -> None:
        """Bytes came in back to back; `t` is the arrival of the last one's stop bit."""
        chunks = [data] if len(data) == self._request_bytes else [data[i : i + 1] for i in range(len(data))]
        for index, chunk in enumerate(chunks):
            self.advance(max(t - (len(chunks) - 1 - index) * self._byte_s, self._now_us / US_PER_S))
            self._tell_plant()
            self._ask(f"rx {chunk.hex()}")

    def advance(self, t: float) -> None:
        """Let time pass."""
        end_us = _us(t)
        while self._now_us < end_us:
            self._tell_plant()
            torque_nm = self._torque_nm
            self._ask(f"run {min(end_us, self._now_us + SEGMENT_US) - self._zero_us}", moved_by=torque_nm)
        self._plant.advance(t, self._torque_nm)

    def outgoing(self, t: float) -> list[tuple[float, bytes]]:
        """Answers whose first byte may go on the wire by `t`, each with that instant; every one is given once."""
        answers, self._answers = self._answers, []
        return answers

    def reset(self, t: float) -> None:
        """Power cycle."""
        self.advance(t)
        self._power("reset")

    def inject(self, name: FaultName, t: float) -> None:
        """A condition of the hardware begins."""
        self.advance(t)
        self._injected |= FAULT_BITS[name]

    def heal(self, name: FaultName) -> None:
        """The condition ends."""
        self._injected &= ~FAULT_BITS[name]

    def close(self) -> None:
        """End the program: its input ends, and it is killed when it goes on all the same."""
        if self._process.stdin:
            with contextlib.suppress(OSError):  # it ended before it had read all
                self._process.stdin.close()
        try:
            self._process.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()

    @property
    def torque_nm(self) -> float:
        """Torque applied now."""
        return self._torque_nm

    @property
    def status(self) -> int:
        """Status byte as an answer would carry it now."""
        return self._status

    @property
    def enabled(self) -> bool:
        """The drive is on."""
        return bool(self._status & STATUS_ENABLED)

    # --- lines ---

    def _open(self) -> subprocess.Popen[str]:
        try:
            return subprocess.Popen(
                [self._program],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,  # what a terminal sends is the daemon's
            )
        except OSError as error:
            raise BoardProgramError(f"{self._program}: {error.strerror or error}") from None

    def _power(self, reason: str) -> None:
        self._answers.clear()
        self._tell_plant()
        self._ask("start", reason=reason)

    def _tell_plant(self) -> None:
        angle, speed, current = self._plant.sample()
        self._write(f"plant {angle!r} {speed!r} {current!r} {self._injected}")

    def _write(self, line: str) -> None:
        pipe = self._pipe(self._process.stdin)
        try:
            pipe.write(line + "\n")
        except OSError:
            raise self._ended() from None

    def _ask(self, line: str, *, moved_by: float | None = None, reason: str = "") -> None:
        """One line out, its reply in; `moved_by`: the plant goes along with this torque to where the program stops."""
        rows = []
        self._write(line)
        words = self._reply()
        while words[0] != "at":
            if words[0] == "torque":
                rows.append((float(words[1]), words[2] == "1", reason or words[3]))
            elif words[0] == "tx":
                self._answers.append((self._now_us / US_PER_S, bytes.fromhex(words[1])))
            words = self._reply()
        self._now_us = self._zero_us + int(words[1])
        self._status = int(words[2])
        if moved_by is not None:
            self._plant.advance(self._now_us / US_PER_S, moved_by)
        for torque_nm, enabled, because in rows:
            self._torque_nm = torque_nm
            if self._sink:
                self._sink(TorqueRow(self._now_us / US_PER_S, torque_nm, enabled, because))

    def _reply(self) -> list[str]:
        """Words of the next line, checked for their number."""
        try:
            self._pipe(self._process.stdin).flush()
        except OSError:
            raise self._ended() from None
        words = self._pipe(self._process.stdout).readline().split()
        if not words:
            raise self._ended()
        if {"torque": 4, "tx": 2, "at": 4}.get(words[0]) != len(words):
            raise BoardProgramError(f"{self._program}: not understood: {' '.join(words)[:60]}")
        return words

    def _pipe(self, pipe: IO[str] | None) -> IO[str]:
        if pipe is None:
            raise self._ended()
        return pipe

    def _ended(self) -> BoardProgramError:
        return BoardProgramError(f"{self._program}: ended with exit code {self._process.wait(END_PATIENCE_S)}")


def _us(t: float) -> int:
    """Whole microseconds up to `t`."""
    return math.floor(t * US_PER_S + ROUNDING_US)


@contextmanager
def powered_board(
    program: str,
    plant: BoardPlant,
    rng: np.random.Generator,
    *,
    layout: Layout,
    config: BoardConfig,
    sink: TorqueSink | None,
) -> Iterator[RigBoard]:
    """The simulated board, or the program in its place, whose limits and sensors are its own."""
    if not program:
        yield DriverBoard(plant, rng, layout=layout, config=config, sink=sink)
        return
    board = BoardProgram(program, plant, layout=layout, byte_s=config.byte_s, sink=sink)
    try:
        yield board
    finally:
        board.close()
