"""The driver board as a process of its own on a pseudo-terminal: `python -m hoopd.sim.boardprocess --link PATH ...`.

Rules of this file: the only clock is the machine's monotonic one; bytes take their time on the wire in both directions;
the plant is integrated behind the clock in small steps and never ahead of it; the process ends with its parent, on
SIGTERM or when its stdin pipe closes, once its drive is off, and takes its link with it.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import gc
import importlib
import math
import os
import select
import signal
import stat
import subprocess
import sys
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from hoopd import uncaught_errors
from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import layout_from_table
from hoopd.shell.service import raise_thread_priority
from hoopd.sim.board import BoardConfig, BoardPlant
from hoopd.sim.boardprogram import BoardProgramError, powered_board
from hoopd.sim.faults import FaultScript, fault_from_table
from hoopd.sim.statering import StateRingWriter
from hoopd.sim.torque_log import TorqueLogFile, TorqueRow
from hoopd.sim.truth import TruthFile
from hoopd.sim.wiredboard import WiredBoard

# The plant lags the clock by at most this, and the state ring has a row as often: readers interpolate by rates, so
# a finer grid would only cost wake-ups (requests are met at their own instant whatever this is).
ROW_S: Final = 0.002
# Every so many rows the true state is written: 20 ms, and in between a polynomial through states and rates is exact to
# 1e-5 rad.
TRUTH_ROWS: Final = 10
# How often the parent is looked for, beside the kernel's own signal.
PARENT_CHECK_S: Final = 0.25
# A board does not know that its host was killed: it goes on until its own time-out, here no longer than twice that.
LINGER_S: Final = 0.2
_READ_BYTES: Final = 4096
_PR_SET_PDEATHSIG: Final = 1
_PR_SET_TIMERSLACK: Final = 29


class ProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The configuration file: JSON with these keys."""

    plant: str  # "package.module:callable"; called with plant_arguments it gives a hoopd.sim.board.Plant at t = 0
    torque_log: str  # path of the JSON lines
    truth_log: str = ""  # path of the plant's true state, empty for none
    plant_arguments: dict[str, Any] = {}
    state_ring: str = ""  # path of what a camera sees, empty for none
    truth_ring: str = ""  # path of the plant's state, empty for none
    seed: int = 0
    t0: float | None = None  # monotonic time of run time zero, for the faults' times; None: when the process starts
    layout: dict[str, Any] | None = None  # for hoopd.core.layout.layout_from_table; None: the default
    program: str = ""  # plays the board in place of ours
    board: dict[str, Any] = {}  # fields of hoopd.sim.board.BoardConfig
    faults: list[dict[str, Any]] = []  # rows for hoopd.sim.faults.fault_from_table


class BoardProcess:
    """Board, wire and port on the board's clock (seconds since the process started)."""

    def __init__(self, config: ProcessConfig, master: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._master = master
        self._clock = clock
        layout = DEFAULT_LAYOUT if config.layout is None else layout_from_table(config.layout)
        constants = BoardConfig(**config.board)
        script = FaultScript([fault_from_table(row) for row in config.faults], config.seed)
        rng = np.random.default_rng([config.seed, 1])
        self._plant = _make_plant(config)
        self._log = TorqueLogFile(Path(config.torque_log))
        self._rings = [
            (StateRingWriter(Path(path)), look)
            for path, look in ((config.state_ring, shown), (config.truth_ring, state))
            if path
        ]
        self._truth = TruthFile(Path(config.truth_log)) if config.truth_log else None
        self._t_start = clock()
        shift_s = 0.0 if config.t0 is None else self._t_start - config.t0
        self._stack = contextlib.ExitStack()
        powered = powered_board(config.program, self._plant, rng, layout=layout, config=constants, sink=self._write_row)
        board = self._stack.enter_context(powered)
        self._board = WiredBoard(board, script, layout=layout, byte_s=constants.byte_s, shift_s=shift_s)
        self._t_row = 0.0  # of the next row
        self._rows = 0

    def now(self) -> float:
        """Board's clock, s."""
        return self._clock() - self._t_start

    @property
    def enabled(self) -> bool:
        """The drive is on."""
        return self._board.board.enabled

    def read(self) -> None:
        """Put what the host wrote on the wire."""
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._master, _READ_BYTES)
            self._board.write(self.now(), data)

    def advance(self, now: float) -> None:
        """Catch up with the clock: plant and requests in the order of time, then answers."""
        while self._t_row <= now:
            self._board.advance(self._t_row)
            for ring, look in self._rings:
                ring.push(self._t_row + self._t_start, look(self._plant), shown_distance(self._plant))
            if self._truth and self._rows % TRUTH_ROWS == 0:
                self._truth(
                    self._t_row + self._t_start, state(self._plant), float(getattr(self._plant, "distance", 1.0))
                )
            self._t_row += ROW_S
            self._rows += 1
        if self._board.next_event() <= now:
            self._board.advance(now)
        for _, chunk in self._board.arrived(now):
            with contextlib.suppress(BlockingIOError):  # nobody reads: a UART loses bytes too
                os.write(self._master, chunk)

    def wake_in(self, now: float) -> float:
        """Seconds until there is something to do."""
        return max(min(self._t_row, self._board.next_event()) - now, 0.0)

    def close(self) -> None:
        """The motor's supply goes: last row of the log."""
        self._stack.close()
        self._write_row(TorqueRow(self.now(), 0.0, False, "end"))
        self._log.close()
        if self._truth:
            self._truth.close()
        for ring, _ in self._rings:
            ring.close()

    def _write_row(self, row: TorqueRow) -> None:
        self._log(row._replace(t=row.t + self._t_start))


def state(plant: BoardPlant) -> tuple[float, float, float, float]:
    """What a plant really does."""
    return plant.state


def shown(plant: BoardPlant) -> tuple[float, float, float, float]:
    """What the camera sees of a plant: its state, unless the plant says otherwise."""
    state: tuple[float, float, float, float] = getattr(plant, "shown", plant.state)
    return state


def shown_distance(plant: BoardPlant) -> float:
    """How far from the axis the camera sees the ball, in shares of what it is on the hoop."""
    return float(getattr(plant, "shown_distance", 1.0))


def _make_plant(config: ProcessConfig) -> BoardPlant:
    module, _, name = config.plant.partition(":")
    plant: BoardPlant = getattr(importlib.import_module(module), name)(**config.plant_arguments)
    return plant


# --- the process -----------------------------------------------------------------------------------------------------


def run(link: Path, config: ProcessConfig, fifo: int = 0) -> None:
    """Open the port, publish its link, work until told to stop."""
    stop = _stop_on_sigterm()
    _tie_to_parent()
    master, slave = os.openpty()  # the slave stays open here: the host may close and reopen without a hang-up
    tty.setraw(slave)
    os.set_blocking(master, False)
    device = os.ttyname(slave)
    board = BoardProcess(config, master)
    _settle_process(fifo)
    _publish(link, device)
    try:
        _loop(board, master, stop)
    finally:
        _withdraw(link, device)
        board.close()


def _loop(board: BoardProcess, master: int, stop: Callable[[], bool]) -> None:
    lifeline = [0] if _stdin_is_pipe() else []
    parent, next_check, end = os.getppid(), board.now() + PARENT_CHECK_S, math.inf
    while board.now() < end and not (math.isfinite(end) and not board.enabled):
        now = board.now()
        board.advance(now)
        readable, _, _ = select.select([master, *lifeline], [], [], board.wake_in(board.now()))
        if master in readable:
            board.read()
        gone = stop()
        if 0 in readable and not os.read(0, _READ_BYTES):
            lifeline, gone = [], True
        if now > next_check:
            gone, next_check = gone or os.getppid() != parent, now + PARENT_CHECK_S
        if gone:
            end = min(end, now + LINGER_S)


def _stop_on_sigterm() -> Callable[[], bool]:
    """Flag that SIGTERM sets; what a terminal sends is left to the daemon: it must not take the board from under it."""
    state = {"stop": False}
    signal.signal(signal.SIGTERM, lambda *_: state.update(stop=True))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    return lambda: state["stop"]


def _tie_to_parent() -> None:
    """SIGTERM when the thread that started us ends (start the board from the main thread); wake-ups to 1 us."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)


def _settle_process(fifo: int) -> None:
    """What exists now stays: the collector need not walk it; this real-time priority when asked for and granted."""
    gc.collect()
    gc.freeze()
    if fifo and not raise_thread_priority(fifo):
        sys.stderr.write("board: real-time priority was not granted, going on without\n")


def _stdin_is_pipe() -> bool:
    """A pipe or socket ends when its other side does; a terminal or /dev/null says nothing."""
    try:
        mode = os.fstat(0).st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


def _publish(link: Path, device: str) -> None:
    """Point the link to the device in one step; an old link is replaced."""
    fresh = link.with_name(f".{link.name}.{os.getpid()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(device)
    fresh.replace(link)


def _withdraw(link: Path, device: str) -> None:
    """Remove the link unless another board took it over."""
    with contextlib.suppress(OSError):
        if str(link.readlink()) == device:
            link.unlink()


# --- starting one ----------------------------------------------------------------------------------------------------


def start(link: Path, config: ProcessConfig, fifo: int = 0, timeout_s: float = 10.0) -> subprocess.Popen[bytes]:
    """Start the process beside its link and wait for the port; RuntimeError with its last line when it fails.

    Close its stdin or terminate it to end it. Call it from the main thread: the board dies with the caller's thread."""
    path = link.with_name(link.name + ".json")
    path.write_bytes(msgspec.json.encode(config))
    link.unlink(missing_ok=True)
    command = [sys.executable, "-m", __name__ if __name__ != "__main__" else __spec__.name]
    command += ["--link", str(link), "--config", str(path), "--fifo", str(fifo)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    deadline = time.monotonic() + timeout_s
    while not link.is_symlink():
        if process.poll() is not None or time.monotonic() > deadline:
            process.kill()
            _, errors = process.communicate()
            raise RuntimeError(f"board process: {errors.decode(errors='replace').strip()[-500:] or 'no port in time'}")
        time.sleep(0.005)
    return process


def main(arguments: list[str] | None = None) -> int:
    """Command line; exit code 2 and one line for a wrong configuration."""
    parser = argparse.ArgumentParser(prog="hoopd.sim.boardprocess", description=__doc__)
    parser.add_argument("--link", type=Path, required=True, help="symbolic link to make for the port")
    parser.add_argument("--config", type=Path, required=True, help="JSON file, keys of ProcessConfig")
    parser.add_argument("--fifo", type=int, default=0, metavar="N", help="ask for this real-time priority (0: none)")
    options = parser.parse_args(arguments)
    try:
        config = msgspec.json.decode(options.config.read_bytes(), type=ProcessConfig)
        run(options.link, config, options.fifo)
    except (
        OSError,
        ValueError,
        TypeError,
        ImportError,
        AttributeError,
        BoardProgramError,
        msgspec.MsgspecError,
    ) as error:
        sys.stderr.write(f"{options.config}: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    uncaught_errors.watch()
    sys.exit(main())
