"""The host's judgement of answers: expected echo, plausible values, unwrapped angle, counts by kind.

Rules of this file: pure; time comes in as an argument; an answer that was not asked for is never a measurement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from hoopd.core.frames import ANSWER_BOUNDS, THETA_WRAP_RAD, Answer, Event, LinkFault, implausible_field
from hoopd.core.records import DriverSample, LinkCounts

NOTHING = LinkCounts()


class AnswerFilter:
    """Takes the decoder's events of one tick; gives the one answer that echoes the last request, and the counts."""

    def __init__(self, bounds: Mapping[str, float] = ANSWER_BOUNDS, has_seq: bool = True, unwrap: bool = True) -> None:
        """`has_seq` False: the layout carries no echo, then the first answer after a request is taken."""
        self._bounds = bounds
        self._has_seq = has_seq
        self._unwrap = unwrap
        self.reset()

    def reset(self) -> None:
        """Forget everything: after the port was reopened."""
        self._expected: int | None = None
        self._t_sample = 0.0
        self._sample: DriverSample | None = None
        self._counts = NOTHING
        self._theta_raw: float | None = None
        self._offset = 0.0

    def expect(self, seq: int, t_sample: float) -> None:
        """A request went out; its answer, and no older one, counts from now on. `t_sample`: when the board has it."""
        self._expected = seq & 0xFF
        self._t_sample = t_sample

    def take(self, events: Iterable[Event]) -> None:
        """Judge events in the order of the line."""
        for event in events:
            if isinstance(event, LinkFault):
                self._count(event.kind, event.amount)
            elif isinstance(event, Answer):
                self._judge(event)

    def collect(self, lost: bool = False) -> tuple[DriverSample | None, LinkCounts]:
        """The newest accepted answer and the counts since the last call."""
        sample, counts = self._sample, self._counts._replace(lost=True) if lost else self._counts
        self._sample, self._counts = None, NOTHING
        return sample, counts

    def _judge(self, answer: Answer) -> None:
        if self._expected is None or (self._has_seq and answer.seq != self._expected):
            self._count("unexpected_seq", 1)
        elif implausible_field(answer, self._bounds):
            self._count("implausible", 1)
        else:
            self._accept(answer)

    def _accept(self, answer: Answer) -> None:
        self._expected = None  # a second copy is not a second measurement
        self._count("good", 1)
        seq, status, errors, theta, dtheta, current, board_ms = answer
        theta = self._unwrapped(theta)
        self._sample = DriverSample(self._t_sample, seq, status, errors, theta, dtheta, current, board_ms)

    def _unwrapped(self, theta: float) -> float:
        """theta = raw + n * 1024 turns, the n that keeps it nearest to the previous answer's."""
        if self._unwrap and self._theta_raw is not None:
            step = theta - self._theta_raw
            if abs(step) > THETA_WRAP_RAD:
                self._offset -= 2 * THETA_WRAP_RAD * round(step / (2 * THETA_WRAP_RAD))
        self._theta_raw = theta
        return theta + self._offset

    def _count(self, kind: str, amount: int) -> None:
        name = "garbage_bytes" if kind == "garbage" else kind
        self._counts = self._counts._replace(**{name: getattr(self._counts, name) + amount})
