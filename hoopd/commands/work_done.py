"""How much of a long command's work is done, by the steps that it tells.

A step that is known stands where it usually begins, in shares of the processor's time; any other step takes a part of
what is left until the next known one. The fraction only grows.

Rules of this file: an estimate for who waits; nothing is measured here.
"""

from __future__ import annotations

from collections.abc import Mapping

# Where the steps of a diagnosis begin (concealed cases of two recordings of 30 s with an effect and without).
DIAGNOSIS: Mapping[str, float] = {
    "reading the recordings": 0.02,
    "base parameters": 0.05,
    "screening the library": 0.10,
    "screening mechanisms": 0.55,
    "what no name explains": 0.68,
    "proof on held-out data": 0.80,
    "what else could explain it": 0.88,
    "drawing and writing": 0.98,
}
# Of what is left until the next known step, what a step in between takes.
BETWEEN = 0.1


class WorkDone:
    """The fraction of a command's work that is behind it.

    Examples
    --------
    >>> from hoopd.commands.work_done import WorkDone
    >>> done = WorkDone({"reading": 0.0, "searching": 0.2, "proving": 0.8})
    >>> [round(done.at(step), 3) for step in ("reading", "searching", "trying this", "proving", "reading")]
    [0.0, 0.2, 0.26, 0.8, 0.82]
    """

    def __init__(self, begins: Mapping[str, float]) -> None:
        self._begins, self._done = begins, 0.0

    def at(self, step: str) -> float:
        """Where a step begins, 0 to 1."""
        begin = self._begins.get(step, -1.0)
        if begin < self._done or step not in self._begins:
            ahead = min((one for one in self._begins.values() if one > self._done), default=1.0)
            begin = self._done + BETWEEN * (ahead - self._done)
        self._done = begin
        return begin
