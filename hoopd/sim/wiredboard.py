"""Board, wire and scripted faults together, without a clock: bytes in at their time, bytes out at theirs.

Rules of this file: the same code serves real time (boardprocess.py asks it at the clock's time) and lock-step (the rig
asks it at virtual time); everything happens in the order of time, however coarse the steps of the caller.
"""

from __future__ import annotations

import heapq
import math

from hoopd.core.frames import DEFAULT_LAYOUT
from hoopd.core.layout import Layout
from hoopd.sim.board import BYTE_S, RigBoard
from hoopd.sim.faults import BoardFaults, Delivery, FaultScript, FaultyWire

_Queue = list[tuple[float, int, bytes]]  # heap: arrival of the last byte, order of entry, bytes


class WiredBoard:
    """A board at the end of a UART; times in s on the board's clock."""

    def __init__(
        self,
        board: RigBoard,
        script: FaultScript | None = None,
        *,
        layout: Layout = DEFAULT_LAYOUT,
        byte_s: float = BYTE_S,
        shift_s: float = 0.0,
    ) -> None:
        """`shift_s`: run time minus board's clock, for the script's times."""
        script = script or FaultScript()
        self.board = board
        self._wire = FaultyWire(script, layout)
        self._faults = BoardFaults(script)
        self._byte_s = byte_s
        self._request_bytes = layout.request.length
        self._shift = shift_s
        self._edges = sorted({e - shift_s for f in script.faults for e in (f.at_s, f.at_s + f.for_s)}, reverse=True)
        self._rx: _Queue = []
        self._tx: _Queue = []
        self._rx_free = self._tx_free = -math.inf  # when each direction's last byte is through
        self._order = 0

    def write(self, t: float, data: bytes) -> None:
        """The host wrote these bytes at `t`; they follow whatever is still on the wire."""
        self._rx_free = max(t, self._rx_free) + len(data) * self._byte_s
        for arrival, chunk in self._wire.request(self._rx_free + self._shift, data):
            self._push_request(arrival - self._shift, chunk)

    def advance(self, t: float) -> None:
        """Let everything up to `t` happen."""
        while (step := self._next_step()) <= t:
            if self._edges and self._edges[-1] <= step:
                self._edges.pop()
                self._faults.update(step + self._shift, self.board, step)
            else:
                self.board.receive(step, heapq.heappop(self._rx)[2])
            self._collect(step)
        self.board.advance(t)
        self._collect(t)

    def arrived(self, t: float) -> list[Delivery]:
        """Answers whose last byte the host has by `t`; each is given once."""
        found = []
        while self._tx and self._tx[0][0] <= t:
            arrival, _, chunk = heapq.heappop(self._tx)
            found.append((arrival, chunk))
        return found

    def next_event(self) -> float:
        """When bytes arrive next at either side; inf when the wire is empty."""
        return min([queue[0][0] for queue in (self._rx, self._tx) if queue], default=math.inf)

    def _next_step(self) -> float:
        return min(self._rx[0][0] if self._rx else math.inf, self._edges[-1] if self._edges else math.inf)

    def _collect(self, t: float) -> None:
        """Put the board's answers on the wire."""
        for ready, frame in self.board.outgoing(t):
            self._tx_free = max(ready, self._tx_free) + len(frame) * self._byte_s
            for arrival, chunk in self._wire.answer(self._tx_free + self._shift, frame):
                self._push(self._tx, arrival - self._shift, chunk)

    def _push_request(self, t: float, chunk: bytes) -> None:
        """One frame as a whole; anything else byte by byte, because a frame may end inside it."""
        if len(chunk) == self._request_bytes:
            return self._push(self._rx, t, chunk)
        for i in range(len(chunk)):
            self._push(self._rx, t - (len(chunk) - 1 - i) * self._byte_s, chunk[i : i + 1])
        return None

    def _push(self, queue: _Queue, t: float, chunk: bytes) -> None:
        self._order += 1
        heapq.heappush(queue, (t, self._order, chunk))
