"""The driver board without a clock and without a port: what docs/reference/board.md demands of a firmware, in Python.

Rules of this file: time is an argument and never runs backwards; the plant is advanced exactly to every instant at
which the torque changes; each change of the applied torque and each good request is one row for the torque log.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, Protocol

import numpy as np

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    ERROR_CRC,
    ERROR_ENCODER,
    ERROR_OVERCURRENT,
    ERROR_SEQ_GAP,
    ERROR_SUPPLY,
    STATUS_ENABLED,
    STATUS_FAULT,
    STATUS_LIMITED,
    STATUS_TIMEOUT,
    THETA_WRAP_RAD,
    Answer,
    Decoder,
    Event,
    Layout,
    LinkFault,
    Request,
    encode_answer,
)
from hoopd.plants.hoop.parameters import LIMIT_NM
from hoopd.sim.guards import CURRENT_LIMIT_A, LOOK_S, OVERSPEED_RAD_S, Guards
from hoopd.sim.torque_log import TorqueSink
from hoopd.sim.torquestage import SLEW_NM_PER_MS, TorqueStage

# The motor driver saturates here.
TORQUE_LIMIT_NM: Final = LIMIT_NM
# Five ticks without a good request: the host is gone. Long enough for one late tick, short enough for the hoop.
TIMEOUT_S: Final = 0.100
# 23 byte times at 115200 baud: no pause inside a frame is that long, and the pause between two requests is longer.
PARTIAL_FRAME_S: Final = 0.002
# 10 bits a byte at 115200 baud.
BYTE_S: Final = 10 / 115200

FaultName = Literal["overcurrent", "encoder", "supply"]
FAULT_BITS: Final[dict[FaultName, int]] = {
    "overcurrent": ERROR_OVERCURRENT,
    "encoder": ERROR_ENCODER,
    "supply": ERROR_SUPPLY,
}


class BoardPlant(Protocol):
    """What the board moves; times in s on the board's clock."""

    def advance(self, t: float, torque_nm: float) -> None:
        """Integrate up to `t` with the torque held; `t` in the past or present changes nothing."""

    def sample(self) -> tuple[float, float, float]:
        """theta in rad (not wrapped), dtheta in rad/s, current in A (NaN: the board takes torque / kt)."""

    @property
    def state(self) -> tuple[float, float, float, float]:
        """theta, dtheta, psi, dpsi in rad and rad/s."""


class RigBoard(Protocol):
    """What the rig calls of a board; times in s on the board's clock, which never runs backwards."""

    def receive(self, t: float, data: bytes) -> None:
        """Bytes came in back to back; `t` is the arrival of the last one's stop bit."""

    def advance(self, t: float) -> None:
        """Let time pass."""

    def outgoing(self, t: float) -> list[tuple[float, bytes]]:
        """Answers whose first byte may go on the wire by `t`, each with that instant; every one is given once."""

    def reset(self, t: float) -> None:
        """Power cycle."""

    def inject(self, name: FaultName, t: float) -> None:
        """A condition of the hardware begins."""

    def heal(self, name: FaultName) -> None:
        """The condition ends."""

    @property
    def enabled(self) -> bool:
        """The drive is on."""


@dataclass(frozen=True)
class BoardConfig:
    """Constants of the board and its sensors."""

    torque_limit_nm: float = TORQUE_LIMIT_NM
    slew_nm_per_ms: float = SLEW_NM_PER_MS
    overspeed_rad_s: float = OVERSPEED_RAD_S
    current_limit_a: float = CURRENT_LIMIT_A
    timeout_s: float = TIMEOUT_S
    partial_frame_s: float = PARTIAL_FRAME_S
    byte_s: float = BYTE_S
    counts_per_turn: int = 4096
    dtheta_noise: float = 0.05  # rad/s, standard deviation
    current_noise: float = 0.02  # A, standard deviation
    kt: float = 0.37  # N m / A: slope of the torque over current in the chirp recording


class DriverBoard:
    """Decodes requests, applies torque, samples, answers; guards itself with a latched time-out and latched faults."""

    def __init__(
        self,
        plant: BoardPlant,
        rng: np.random.Generator,
        *,
        layout: Layout = DEFAULT_LAYOUT,
        config: BoardConfig = BoardConfig(),
        sink: TorqueSink | None = None,
        t: float = 0.0,
    ) -> None:
        self._plant = plant
        self._rng = rng
        self._layout = layout
        self._config = config
        self._stage = TorqueStage(config.slew_nm_per_ms, sink)
        self._guards = Guards(config.overspeed_rad_s, config.current_limit_a)
        self._now = t
        self._injected = 0  # error bits of conditions that persist
        self._answers: list[tuple[float, bytes]] = []
        self._start(t, "start")

    # --- what the process around it calls ---

    def receive(self, t: float, data: bytes) -> None:
        """Bytes came in back to back; `t` is the arrival of the last one's stop bit."""
        if len(data) == self._layout.request.length and not self._decoder.pending:
            return self._receive(t, data)  # one frame, as nearly always: nothing can happen before its last byte
        for index in range(len(data)):
            t_byte = t - (len(data) - 1 - index) * self._config.byte_s
            self._receive(max(t_byte, self._now), data[index : index + 1])
        return None

    def advance(self, t: float) -> None:
        """Let time pass: partial frames are dropped, the time-out falls, torque and plant move, the guards look."""
        while self._next_deadline() <= t:
            self._at_deadline(self._next_deadline())
        self._move(t)
        self._look(t)

    def outgoing(self, t: float) -> list[tuple[float, bytes]]:
        """Answers whose first byte may go on the wire by `t`, each with that instant; every one is given once."""
        if not self._answers:
            return []
        ready = [answer for answer in self._answers if answer[0] <= t]
        self._answers = [answer for answer in self._answers if answer[0] > t]
        return ready

    def reset(self, t: float) -> None:
        """Power cycle: disabled, nothing latched, clock from zero; a condition that persists faults again."""
        self.advance(t)
        self._answers.clear()
        self._start(t, "reset")

    def inject(self, name: FaultName, t: float) -> None:
        """A condition of the hardware begins: fault, latched."""
        self.advance(t)
        self._injected |= FAULT_BITS[name]
        self._trip(t)

    def heal(self, name: FaultName) -> None:
        """The condition ends; its bit stays until a clearing request."""
        self._injected &= ~FAULT_BITS[name]

    @property
    def torque_nm(self) -> float:
        """Torque applied now."""
        return self._stage.torque_nm

    @property
    def enabled(self) -> bool:
        return self._stage.enabled

    @property
    def status(self) -> int:
        """Status byte as an answer would carry it now."""
        return (
            (STATUS_ENABLED if self.enabled else 0)
            | (STATUS_TIMEOUT if self._timed_out else 0)
            | (STATUS_LIMITED if self._limited else 0)
            | (STATUS_FAULT if self._fault else 0)
        )

    # --- time ---

    def _start(self, t: float, reason: str) -> None:
        self._decoder = Decoder(self._layout, "request")
        self._t_zero = t  # of board_ms
        self._t_byte = -math.inf  # the last byte came in
        self._t_good = math.inf  # the last good request; none yet, so no time-out yet
        self._timed_out = self._limited = self._fault = False
        self._t_look = t  # the guards' next look at the sensors
        self._fault_bits = 0
        self._line_errors = 0  # crc and seq gap since the last answer
        self._seq: int | None = None
        self._apply(t, 0.0, False, reason)
        if self._injected:
            self._trip(t)

    def _next_deadline(self) -> float:
        return min(self._silence_deadline(), self._timeout_deadline(), self._stage.deadline(), self._t_look)

    def _silence_deadline(self) -> float:
        return self._t_byte + self._config.partial_frame_s if self._decoder.pending else math.inf

    def _timeout_deadline(self) -> float:
        return math.inf if self._timed_out else self._t_good + self._config.timeout_s

    def _at_deadline(self, t: float) -> None:
        self._move(t)
        self._look(t)
        if self._silence_deadline() <= t:
            self._handle(t, self._decoder.silence())
        elif self._timeout_deadline() <= t:
            self._timed_out = True
            self._apply(t, 0.0, False, "timeout")
        elif self._stage.deadline() <= t:
            self._stage.step(t)
            self._expect(t)

    def _move(self, t: float) -> None:
        if t > self._now:
            self._plant.advance(t, self.torque_nm)
            self._now = t

    def _look(self, t: float) -> None:
        """Compare speed and current with what the board stands for."""
        _, speed, current = self._measured()
        self._t_look = t + self._guards.pause_s(speed)
        if begun := self._guards.begun(speed, current) & ~self._fault_bits:
            self._trip(t, begun)

    def _apply(self, t: float, torque_nm: float, enabled: bool, reason: str) -> None:
        """Tell the torque stage; what has come to pass until `t` is done."""
        self._limited = self._limited and enabled
        self._stage.go(t, torque_nm, enabled, reason)
        self._expect(t)

    def _expect(self, t: float) -> None:
        """Look again at once at a current that the new torque takes beyond its limit, however slow the hoop is."""
        _, speed, current = self._measured()
        if self._guards.begun(speed, current) & ~self._fault_bits:
            self._t_look = min(self._t_look, t + LOOK_S)

    # --- requests ---

    def _receive(self, t: float, data: bytes) -> None:
        self.advance(t)
        self._t_byte = t
        self._handle(t, self._decoder.feed(data))

    def _handle(self, t: float, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, Request):
                self._obey(t, event)
            elif isinstance(event, LinkFault) and event.kind == "bad_crc":
                self._line_errors |= ERROR_CRC

    def _obey(self, t: float, request: Request) -> None:
        """A good request: feed the time-out, act, sample at the same instant, answer."""
        self._t_good = self._t_byte  # a frame behind garbage is known for one only in the silence after it
        if request.seq >= 0:
            if self._seq is not None and request.seq != (self._seq + 1) & 0xFF:
                self._line_errors |= ERROR_SEQ_GAP
            self._seq = request.seq
        self._act(t, request)
        self._answer(t, request.seq)

    def _act(self, t: float, request: Request) -> None:
        if not math.isfinite(request.torque_nm):
            self._trip(t)
        elif request.clear_fault:
            self._clear(t)
        elif request.enable and (self._timed_out or self._fault):
            self._apply(t, 0.0, False, "refused")
        else:
            limit = self._config.torque_limit_nm
            torque = min(max(request.torque_nm, -limit), limit) if request.enable else 0.0
            self._limited = request.enable and abs(request.torque_nm) > limit
            self._apply(t, torque, request.enable, "request")

    def _clear(self, t: float) -> None:
        """Forget what is latched, unless its condition persists; a clearing request never enables by itself."""
        _, speed, current = self._measured()
        self._timed_out = False
        self._fault_bits = self._injected | self._fault_bits & self._guards.lasting(speed, current)
        self._fault = bool(self._fault_bits)
        self._apply(t, 0.0, False, "cleared")

    def _trip(self, t: float, bits: int = 0) -> None:
        """Latch a fault: a guard's, an injected condition, or a demand that is not a number (no bit of its own)."""
        self._fault = True
        self._fault_bits |= self._injected | bits
        self._apply(t, 0.0, False, "fault")

    # --- answers ---

    def _answer(self, t: float, seq: int) -> None:
        theta, dtheta, current = self._sensors()
        board_ms = int((t - self._t_zero) * 1000.0) & 0xFFFF
        errors = self._line_errors | self._fault_bits
        self._line_errors = 0
        answer = Answer(seq, self.status, errors, theta, dtheta, current, board_ms)
        self._answers.append((t, encode_answer(self._layout, answer)))

    def _sensors(self) -> tuple[float, float, float]:
        """theta by the encoder, wrapped; dtheta and current with noise."""
        config = self._config
        theta, dtheta, current = self._measured()
        count = 2 * math.pi / config.counts_per_turn
        theta = math.floor(theta / count) * count
        of_speed, of_current = self._rng.standard_normal(2).tolist()
        return wrap_theta(theta), dtheta + config.dtheta_noise * of_speed, current + config.current_noise * of_current

    def _measured(self) -> tuple[float, float, float]:
        """theta, dtheta and current without noise, as encoder and shunt have them."""
        theta, dtheta, current = self._plant.sample()
        return theta, dtheta, self.torque_nm / self._config.kt if math.isnan(current) else current  # tau = kt i


def wrap_theta(theta: float) -> float:
    """theta in [-512, 512) turns."""
    return (theta + THETA_WRAP_RAD) % (2 * THETA_WRAP_RAD) - THETA_WRAP_RAD
