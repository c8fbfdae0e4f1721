"""A simulated board with plants that a test steers, and a host that asks.

Rules of this file: no clock; the log of torque is kept in memory.
"""

from __future__ import annotations

import math

import numpy as np

from hoopd.core.frames import DEFAULT_LAYOUT, Answer, Decoder, encode_request
from hoopd.sim.board import BoardConfig, DriverBoard
from hoopd.sim.torque_log import TorqueLog, TorqueRow


class Wheel:
    """Plant stub: a free inertia."""

    def __init__(self, theta: float = 0.0) -> None:
        self.t, self.theta, self.dtheta = 0.0, theta, 0.0

    def advance(self, t: float, torque_nm: float) -> None:
        step = max(t - self.t, 0.0)
        self.theta += self.dtheta * step
        self.dtheta += 500.0 * torque_nm * step
        self.t = max(t, self.t)

    def sample(self) -> tuple[float, float, float]:
        return self.theta, self.dtheta, math.nan

    @property
    def state(self) -> tuple[float, float, float, float]:
        return self.theta, self.dtheta, 0.0, 0.0


class Pushed(Wheel):
    """A hoop that turns as it is told, with a current of its own."""

    current = 0.0

    def advance(self, t: float, torque_nm: float) -> None:
        self.t = max(t, self.t)

    def sample(self) -> tuple[float, float, float]:
        return self.theta, self.dtheta, self.current


QUIET = BoardConfig(dtheta_noise=0.0, current_noise=0.0)


class Bench:
    """A board with its log and a host that asks."""

    def __init__(self, config: BoardConfig = QUIET, plant: Wheel | None = None) -> None:
        self.rows: list[TorqueRow] = []
        self.plant = plant or Wheel()
        rng = np.random.default_rng(1)
        self.board = DriverBoard(self.plant, rng, config=config, sink=self.rows.append)
        self.decoder = Decoder(DEFAULT_LAYOUT)
        self.seq = 0

    def ask(self, t: float, torque: float = 0.0, enable: bool = True, clear: bool = False) -> Answer:
        self.seq = (self.seq + 1) & 0xFF
        self.board.receive(t, encode_request(DEFAULT_LAYOUT, self.seq, enable, clear, torque))
        ((ready, data),) = self.board.outgoing(t)
        assert ready == t
        (answer,) = self.decoder.feed(data)
        assert isinstance(answer, Answer)
        assert answer.seq == self.seq
        return answer

    @property
    def log(self) -> TorqueLog:
        return TorqueLog(self.rows)
