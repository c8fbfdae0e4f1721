"""Who takes part in a run beside the loop and commands it: what every such guest has.

Rules of this file: nothing here waits or makes torque; what is asked for is given with the next tick.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from hoopd.core.records import Command
from hoopd.shell.loop import Loop


class AttendingGuest:
    """There while the loop runs."""

    trouble = False

    def __init__(self, loads: Sequence[str] = ()) -> None:
        """`loads`: keys of the files that its commands name."""
        self.loads = loads
        self._orders: list[Command] = []
        self._loop: Loop | None = None

    @contextmanager
    def attend(self, loop: Loop) -> Iterator[None]:
        """Be there while the loop runs."""
        self._loop = loop
        with contextlib.suppress(KeyboardInterrupt):
            yield

    def ask(self, command: Command) -> None:
        """Command something with the next tick."""
        self._orders.append(command)

    def commands(self, t: float) -> tuple[Command, ...]:
        """What it asked for since the last tick."""
        orders, self._orders = self._orders, []
        return tuple(orders)
