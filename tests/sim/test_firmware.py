"""The reference firmware (tools/firmware), built with sanitizers, against docs/reference/board.md and
the simulated board. Its clock is simulated. Skipped where there is no gcc.
"""

from __future__ import annotations

import fcntl
import math
import random
import shutil
import subprocess
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from harness.rigrun import run_rig
from sim.boardbench import QUIET
from sim.test_board_doc import TABLES

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_CRC,
    ERROR_ENCODER,
    ERROR_OVERCURRENT,
    ERROR_SUPPLY,
    STATUS_ENABLED,
    STATUS_FAULT,
    STATUS_TIMEOUT,
    Answer,
    Decoder,
    encode_request,
)
from hoopd.files.reading import InputError
from hoopd.shell.config import load
from hoopd.sim.board import BYTE_S, DriverBoard, RigBoard, wrap_theta
from hoopd.sim.boardprogram import BoardProgram, BoardProgramError
from hoopd.sim.parts import board_program
from hoopd.sim.torque_log import TorqueLog, TorqueRow

SOURCE = Path(__file__).resolve().parents[2] / "tools" / "firmware"
COUNT_RAD = 2 * math.pi / 4096
# The firmware's loop comes round every 10 us on the simulated clock.
POLL_S = 1e-5
Build = Callable[[str], Path]


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """One build for all processes of a run; its warnings are errors."""
    folder = tmp_path_factory.getbasetemp().parent / "firmware"
    folder.mkdir(exist_ok=True)

    def make(target: str) -> Path:
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            command = ["make", "--no-print-directory", "-C", str(SOURCE), target, f"OUT={folder}"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return folder / f"board-{target}"

    for tool in ("gcc", "make"):
        if shutil.which(tool) is None:
            pytest.skip(f"no {tool}: the reference firmware is not tried")
    return make


class Turned:
    """A hoop that turns as it is told."""

    def __init__(self) -> None:
        self.t, self.theta, self.dtheta, self.current = 0.0, 1.0005, 0.0, math.nan
        self.state = (0.0, 0.0, 0.0, 0.0)

    def advance(self, t: float, torque_nm: float) -> None:
        self.theta += self.dtheta * max(t - self.t, 0.0)
        self.t = max(t, self.t)

    def sample(self) -> tuple[float, float, float]:
        return self.theta, self.dtheta, self.current


class Desk:
    """A board with its log and a host that asks."""

    def __init__(self, make: Callable[[Turned, Callable[[TorqueRow], None]], RigBoard]) -> None:
        self.rows: list[TorqueRow] = []
        self.plant = Turned()
        self.board = make(self.plant, self.rows.append)
        self.decoder = Decoder(DEFAULT_LAYOUT)
        self.seq = 0

    def ask(self, t: float, torque: float = 0.0, enable: bool = True, clear: bool = False) -> Answer:
        self.seq = (self.seq + 1) & 0xFF
        (answer,) = self.send(t, encode_request(DEFAULT_LAYOUT, self.seq, enable, clear, torque))
        assert answer.seq == self.seq
        return answer

    def send(self, t: float, data: bytes) -> list[Answer]:
        self.board.receive(t, data)
        return self.heard(t)

    def heard(self, t: float) -> list[Answer]:
        found = self.decoder.feed(b"".join(data for _, data in self.board.outgoing(t)))
        assert all(isinstance(answer, Answer) for answer in found)
        return found

    @property
    def log(self) -> TorqueLog:
        return TorqueLog(self.rows)


@pytest.fixture
def desk(build: Build) -> Iterator[Desk]:
    program = build("sanitized")
    desk = Desk(lambda plant, sink: BoardProgram(str(program), plant, sink=sink))
    yield desk
    desk.board.close()
    assert desk.board._process.returncode == 0  # no sanitizer had a word to say


def simulated() -> Desk:
    return Desk(lambda plant, sink: DriverBoard(plant, np.random.default_rng(1), config=QUIET, sink=sink))


# --- the vectors of the page -----------------------------------------------------------------------------------------


def test_frames_are_those_of_the_page_byte_for_byte(build: Build) -> None:
    lines, wanted = [], []
    for name, *_, check in TABLES["Checksums/name"]:
        lines.append(f"{name} {b'123456789'.hex()}")
        wanted.append(str(int(check, 16)))
    for values, text in TABLES["Test vectors/request"]:
        lines.append(f"request {text.replace(' ', '')}")
        seq, enable, clear, torque = values.split(", ")
        wanted.append(f"{seq} {enable} {clear} {np.float32(torque):.9g}")
    for values, text in TABLES["Test vectors/answer"]:
        lines.append(f"answer {values.replace(',', '')}")
        wanted.append(text.replace(" ", ""))
    done = subprocess.run(
        [build("vectors")], input="\n".join(lines), capture_output=True, text=True, timeout=20, check=True
    )
    assert len(wanted) == 10
    assert done.stdout.splitlines() == wanted


def test_every_request_with_one_flipped_bit_is_ignored(desk: Desk) -> None:
    t = 0.02
    assert desk.ask(t, 0.0).status == STATUS_ENABLED
    for _, text in TABLES["Test vectors/request"]:
        for bit in range(64):
            damaged = bytearray.fromhex(text)
            damaged[bit // 8] ^= 1 << bit % 8
            t += 0.005
            assert desk.send(t, bytes(damaged)) == []
    assert desk.log.max_abs() == 0.0
    assert desk.ask(t + 0.005).errors & ERROR_CRC


def test_vectors_of_the_slew_limit(build: Build) -> None:
    for cells in TABLES["Vectors of the slew limit/from"]:
        before, after, *expected = map(float, cells)
        desk = Desk(lambda plant, sink: BoardProgram(str(build("sanitized")), plant, sink=sink))
        desk.ask(0.02, before)
        desk.ask(0.04, after)
        desk.board.advance(0.06)
        got = [desk.log.torque_at(0.04 + 1e-3 * ms) for ms in (0.05, 0.45, 0.95, 1.95)]
        assert got == pytest.approx(expected, abs=1e-6)
        desk.board.close()


@pytest.mark.parametrize("row", TABLES["Vectors of the cuts/speed"], ids=lambda row: row[0])
def test_vectors_of_the_cuts(desk: Desk, row: list[str]) -> None:
    speed, current, told, cleared_at, told_then = row
    desk.ask(0.02, 0.1)
    desk.plant.dtheta, desk.plant.current = float(speed), float(current)
    first = desk.ask(0.04, 0.1)
    desk.plant.dtheta, desk.plant.current = float(cleared_at), 0.0
    second = desk.ask(0.06, clear=True)
    for answer, words in ((first, told), (second, told_then)):
        assert [answer.status, answer.errors] == [int(word, 16) for word in words.split(", ")]


# --- what it does by itself ------------------------------------------------------------------------------------------


def test_the_time_out_takes_the_torque_after_100_ms_and_stays(desk: Desk) -> None:
    desk.ask(0.02, 0.3)
    desk.board.advance(0.5)
    assert desk.log.zero_for_good_from(0.02) == pytest.approx(0.100, abs=2 * POLL_S)
    assert desk.rows[-1].reason == "timeout"
    assert desk.ask(0.52, 0.3).status == STATUS_TIMEOUT
    assert desk.ask(0.54, 0.3, clear=True).status == 0  # clearing never enables by itself
    assert desk.ask(0.56, 0.3).status == STATUS_ENABLED
    assert desk.ask(0.6599, 0.3).status == STATUS_ENABLED  # just in time
    assert desk.log.max_abs(0.13, 0.555) == 0.0


def test_a_run_up_is_cut_within_5_ms(build: Build) -> None:
    """At what the largest torque does to a hoop without a ball, both ways."""
    for torque in (0.7, -0.7):
        desk = Desk(lambda plant, sink: BoardProgram(str(build("sanitized")), plant, sink=sink))
        for k in range(1, 15):
            desk.ask(0.02 * k, torque)
            for ms in range(20):
                desk.plant.dtheta += math.copysign(0.4, torque)  # 400 rad/s^2
                desk.board.advance(0.02 * k + 1e-3 * (ms + 1) - 1e-6)
        cut = next(row.t for row in desk.rows if row.reason == "fault")
        passed = 0.02 + 100.0 / 400.0
        assert passed - 1e-3 <= cut <= passed + 5e-3
        assert desk.log.zero_for_good_from(cut) == 0.0
        desk.board.close()


def test_a_spike_of_the_current_is_no_overcurrent(desk: Desk) -> None:
    desk.ask(0.02, 0.3)
    desk.plant.current = 5.0
    desk.board.advance(0.0203)
    desk.plant.current = 0.8
    assert desk.ask(0.04, 0.3).status == STATUS_ENABLED
    desk.plant.current = 6.0
    assert desk.ask(0.06, 0.3).errors == ERROR_OVERCURRENT


def test_the_counter_is_unwrapped_and_theta_wrapped(desk: Desk) -> None:
    """The counter wraps every 16 turns, theta at 512; the speed knows of neither."""
    t = 0.0
    while desk.plant.theta < 3230.0:
        t += 0.001
        desk.plant.theta += 40.0 if desk.plant.theta < 3170.0 else 0.05
        desk.board.advance(t)
        if desk.plant.theta > 3210.0 and round(1000 * t) % 20 == 0:
            answer = desk.ask(t)
            counted = wrap_theta(math.floor(desk.plant.theta / COUNT_RAD) * COUNT_RAD)
            assert answer.theta == pytest.approx(counted, abs=3e-4)  # an f32 is no finer there
            assert answer.dtheta == pytest.approx(50.0, abs=0.2)
    assert answer.theta < -3200.0


def test_clocks_wrap(build: Build) -> None:
    """The hardware's after 2^32 us, that of the answers after 65.536 s."""
    program = str(build("sanitized"))
    request = encode_request(DEFAULT_LAYOUT, 1, True, False, 0.0).hex()
    lines = f"clock 4294960000\nstart\nrun 20000\nrx {request}\nrun 119999\nrun 120100\n"
    done = subprocess.run([program], input=lines, capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout.splitlines()[-3:] == ["at 119999 1 0", "torque 0 0 timeout", "at 120000 2 0"]
    desk = Desk(lambda plant, sink: BoardProgram(program, plant, sink=sink))
    desk.board._ask("run 65546500")
    assert desk.ask(65.546_500).board_ms == 10
    desk.board.close()


def test_faults_of_the_hardware_are_latched_and_cleared_when_they_are_gone(desk: Desk) -> None:
    for k, (name, bit) in enumerate((("encoder", ERROR_ENCODER), ("supply", ERROR_SUPPLY))):
        t = 0.1 * k
        assert desk.ask(t + 0.02, 0.3).status == STATUS_ENABLED
        desk.board.inject(name, t + 0.03)
        answer = desk.ask(t + 0.04, 0.3)
        assert (answer.status, answer.errors) == (STATUS_FAULT, bit)
        assert desk.ask(t + 0.06, clear=True).status == STATUS_FAULT
        desk.board.heal(name)
        assert desk.ask(t + 0.08).errors == bit
        cleared = desk.ask(t + 0.10, clear=True)
        assert (cleared.status, cleared.errors) == (0, 0)
    desk.board.reset(0.25)
    assert desk.rows[-1].reason == "reset"
    assert desk.ask(0.2605).board_ms == 10


# --- whatever comes --------------------------------------------------------------------------------------------------


def anything(chance: random.Random, seq: int) -> bytes:
    """A request, sound or not, or any bytes."""
    torque = chance.choice((chance.uniform(-3, 3), chance.uniform(-0.7, 0.7), math.nan, -math.inf, 0.7, 1e-40))
    frame = encode_request(DEFAULT_LAYOUT, seq, chance.random() < 0.85, chance.random() < 0.1, torque)
    kind = chance.random()
    if kind < 0.7:
        return frame
    if kind < 0.8:
        damaged = bytearray(frame)
        damaged[chance.randrange(8)] ^= 1 << chance.randrange(8)
        return bytes(damaged)
    if kind < 0.9:
        return bytes(chance.choices((0xA5, 0x00, chance.randrange(256)), k=chance.randrange(1, 12)))
    return frame[: chance.randrange(1, 8)] + chance.choice((b"", frame))


def test_whatever_comes_no_limit_is_passed(desk: Desk) -> None:
    chance, t, t_good = random.Random(7), 0.0, 0.0
    for seq in range(600):
        data = anything(chance, seq)
        t += chance.choice((0.0011, 0.004, 0.02, 0.02, 0.13)) + len(data) * BYTE_S
        t_good = t if desk.send(t, data) else t_good
    desk.board.advance(t + 0.2)
    rows = desk.rows
    assert max(abs(row.torque_nm) for row in rows) <= 0.7
    assert max(abs(row.torque_nm) for row in rows) > 0.69
    moved = [(a, b) for a, b in pairwise(rows) if b.enabled and b.torque_nm != a.torque_nm]
    assert all(abs(b.torque_nm - a.torque_nm) <= 0.07 + 1e-6 for a, b in moved)
    times = [b.t for _, b in moved]
    assert all(after - before >= 1e-4 - 1e-9 for before, after in pairwise(times))
    assert all(row.torque_nm == 0.0 for row in rows if not row.enabled)
    assert desk.log.zero_for_good_from(t_good) <= 0.1021  # a frame in doubt is known for one 2 ms later


SPEEDS = (0.0, 5.0, -5.0, 50.0, -99.0, 120.0, -150.0, 9.0, -11.0)
CURRENTS = (math.nan, math.nan, 1.9, -2.4, 2.6, -3.0)


class Course:
    """Bytes, and what happens to the hoop, at the same instants for two boards.

    The instants are whole microseconds whose last two digits do not come again within 99 of them: no deadline of a
    board (multiples of 0.1 ms after some byte) falls on an instant, where the other's rounding might decide."""

    def __init__(self, seed: int) -> None:
        self._chance, self._us, self.seq = random.Random(seed), 0, 0

    def next_s(self, gap_us: int) -> float:
        digits = (self._us % 100 + 37) % 100 or 37
        base = self._us + gap_us
        self._us = base + (digits - base) % 100
        return self._us / 1_000_000

    def play(self, desks: tuple[Desk, Desk]) -> Iterator[tuple[list[Answer], list[Answer]]]:
        for _ in range(60):
            if self._chance.random() < 0.2:
                self._disturb(desks)
            elif self._chance.random() < 0.05:
                self._wait(desks, 99_000)
            self.seq += self._chance.choice((1, 1, 1, 1, 1, 0, 2))
            self.next_s(self._chance.choice((1_000, 1_700, 2_300, 20_000)))
            for byte in anything(self._chance, self.seq):
                t = self.next_s(87)
                first, second = (desk.send(t, bytes([byte])) for desk in desks)
                yield first, second
            self._wait(desks, 2_500)
            yield tuple(desk.heard(self._us / 1_000_000) for desk in desks)

    def _disturb(self, desks: tuple[Desk, Desk]) -> None:
        """Speeds are judged over up to 20 ms by the one, at once by the other: they stay a while."""
        speed, current = self._chance.choice(SPEEDS), self._chance.choice(CURRENTS)
        name, begins = self._chance.choice(("encoder", "supply", "overcurrent")), self._chance.random() < 0.3
        for desk in desks:
            desk.plant.dtheta, desk.plant.current = speed, current
            desk.board.heal(name)
            if begins:
                desk.board.inject(name, self._us / 1_000_000)
        self._wait(desks, 25_000)

    def _wait(self, desks: tuple[Desk, Desk], gap_us: int) -> None:
        t = self.next_s(gap_us)
        for desk in desks:
            desk.board.advance(t)


@pytest.mark.parametrize("seed", range(8))
def test_it_answers_as_the_simulated_board_does(desk: Desk, seed: int) -> None:
    twin, answers = simulated(), 0
    for ours, theirs in Course(seed).play((desk, twin)):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            words = ("seq", "status", "errors", "board_ms")
            assert [getattr(one, word) for word in words] == [getattr(other, word) for word in words]
            assert one.theta == pytest.approx(other.theta, rel=2e-7)
            assert one.current == pytest.approx(other.current, rel=1e-5, abs=1e-6)
            answers += 1
        assert desk.board.torque_nm == pytest.approx(twin.board.torque_nm, abs=1e-6)
        assert desk.board.status == twin.board.status
    assert answers > 25


# --- the program in the rig's place ----------------------------------------------------------------------------------


def test_a_program_that_is_none_is_told(tmp_path: Path) -> None:
    with pytest.raises(BoardProgramError, match="No such file"):
        BoardProgram(str(tmp_path / "nothing"), Turned())
    for name, text, told in (
        ("ends", "exit 3", "ended with exit code 3"),
        ("babbles", "echo hello; cat > /dev/null", "not understood: hello"),
    ):
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
        with pytest.raises(BoardProgramError, match=told):
            BoardProgram(str(program), Turned())


def test_the_daemon_balances_the_ball_through_it(build: Build, tmp_path: Path) -> None:
    """The whole rig, its board a program: a fault of the hardware on the way, cleared and armed again."""
    fault = "{kind: board_fault, at_s: 4, for_s: 0.1, params: {name: supply}}"
    again = "{at_s: 4.5, name: clear}, {at_s: 5, name: arm}"
    run = run_rig(
        tmp_path,
        f"sim.board_program={build('sanitized')}",
        f"sim.faults=[{fault}]",
        f"sim.commands=[{again}]",
        duration_s=8.0,
    )
    assert run.torque.zero_for_good_from(0.0) > 7.0
    assert run.torque.max_abs(4.0002, 4.9) == 0.0
    assert np.abs(run.psi[(run.t > 2.0) & (run.t < 2.8)]).max() < 0.02
    assert {"request", "fault", "cleared"} <= {row.reason for row in run.torque.rows}
    assert run.torque.max_abs() <= 0.7


def test_a_configuration_that_names_no_program_is_one_line(tmp_path: Path) -> None:
    config = load(None, sim=True, overrides=[f"sim.board_program={tmp_path}"])
    with pytest.raises(InputError, match=r"sim\.board_program: no program that may be run"):
        board_program(config)


def test_for_a_microcontroller_it_compiles(build: Build) -> None:
    """Compiled, never run: nothing here has such a processor."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("no arm-none-eabi-gcc (Debian's gcc-arm-none-eabi): the example for an STM32 is not compiled")
    image = build("stm32f4").with_name("board-stm32f4.bin").read_bytes()
    stack, start = (int.from_bytes(image[i : i + 4], "little") for i in (0, 4))
    assert stack == 0x2001_0000  # the end of 64 KB
    assert 0x0800_0000 < start < 0x0800_0000 + len(image) and start & 1  # thumb
    assert len(image) < 16_384
