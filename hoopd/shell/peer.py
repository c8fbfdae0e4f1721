"""A zenoh session of the daemon, and the queries that it answers.

Rules of this file: used by one helper thread only; what cannot be opened is one warning and is tried again; whatever
goes wrong with a query is its asker's answer, not our end; what waits is bounded.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgspec
import zenoh

from hoopd.shell.commands import RefusedError, Ticket
from hoopd.shell.session import device_key, reason

RETRY_S = 10.0  # between tries to open
QUERIES_PER_TURN = 4  # of one key: a flood costs at most a fraction of a millisecond per tick
QUERY_RING = 16  # waiting queries of one key, 64 KiB each at most; beyond it the oldest go without an answer
TICKETS = 64  # commands whose senders wait for the outcome; the next ones are told that they were taken
JSON = "application/json"

OnEvent = Callable[[str, str, Mapping[str, Any]], None]
Answer = Callable[[zenoh.Query], bytes | Ticket]


class _Waiting(NamedTuple):
    """A query whose command the loop has not settled yet."""

    key: str
    query: zenoh.Query
    ticket: Ticket
    until: float  # s, monotonic


class ZenohPeer:
    """Opens when it can, publishes, and answers queries of keys below a device."""

    def __init__(
        self,
        name: str,
        config: zenoh.Config,
        device: str,
        answers: Mapping[str, Answer],
        *,
        endpoint: str,
        retry_s: float = RETRY_S,
        on_event: OnEvent | None = None,
    ) -> None:
        """`name`: of its facts in the log; `answers`: by key below the device, the safe ones first."""
        self.session: zenoh.Session | None = None
        self.answers = dict(answers)
        self.errors = self.queries = 0
        self._name, self._config, self._device = name, config, device
        self._endpoint, self._retry_s, self._on_event = endpoint, retry_s, on_event
        self._queryables: dict[str, zenoh.Queryable[Any]] = {}
        self._waiting: list[_Waiting] = []
        self._open_at, self._warned = 0.0, False

    def try_open(self, declare: Callable[[zenoh.Session], None] = lambda session: None) -> None:
        """Open when it is time to; one warning for a row of failures."""
        if self.session is not None or time.monotonic() < self._open_at:
            return
        self._open_at = time.monotonic() + self._retry_s
        try:
            self.session = zenoh.open(self._config)
            declare(self.session)
            self._declare_queryables(self.session)
        except Exception as error:
            self.shut()
            self.errors += 1
            if not self._warned:
                self._warned = True
                self.tell("unavailable", "warning", reason=reason(error))
            return
        self._warned = False
        self.tell("open", "info")

    def serve(self) -> None:
        """Answer what waits, and what the loop has settled."""
        for name, queryable in self._queryables.items():
            for _ in range(QUERIES_PER_TURN):
                if not self._serve_one(name, queryable):
                    break
        if self._waiting:
            self._waiting = [waiting for waiting in self._waiting if not self._settled(waiting)]

    def shut(self) -> None:
        """Close the session, whatever state it is in."""
        session, self.session = self.session, None
        self._queryables, self._waiting = {}, []
        if session is not None:
            with contextlib.suppress(Exception):
                session.close()  # type: ignore[no-untyped-call]

    def tell(self, what: str, level: str, **fields: Any) -> None:
        """A fact about this session for the log."""
        if self._on_event is not None:
            with contextlib.suppress(Exception):
                self._on_event(f"{self._name}_{what}", level, {"endpoint": self._endpoint, **fields})

    def _declare_queryables(self, session: zenoh.Session) -> None:
        for name in self.answers:
            ring: Any = zenoh.handlers.RingChannel(QUERY_RING)
            self._queryables[name] = session.declare_queryable(device_key(self._device, *name.split("/")), ring)

    def _serve_one(self, name: str, queryable: zenoh.Queryable[Any]) -> bool:
        try:
            query = queryable.try_recv()
        except zenoh.ZError:
            return False
        if query is None:
            return False
        self.queries += 1
        key = device_key(self._device, *name.split("/"))
        self._reply(key, query, lambda: self.answers[name](query))
        return True

    def _reply(self, key: str, query: zenoh.Query, answer: Callable[[], bytes | Ticket]) -> None:
        """Answer now, or keep the query until its command is settled."""
        wrong, content = "", b""  # type: tuple[str, bytes | Ticket]
        try:
            content = answer()
        except RefusedError as refusal:
            wrong = str(refusal)
        except Exception as error:
            self.errors += 1
            wrong = f"internal error: {type(error).__name__}"
        if wrong:
            self._say(query, lambda: query.reply_err(wrong, encoding="text/plain"))
        elif isinstance(content, Ticket):
            self._keep(_Waiting(key, query, content, time.monotonic() + content.patience_s))
        else:
            self._say(query, lambda: query.reply(key, content, encoding=JSON))

    def _keep(self, waiting: _Waiting) -> None:
        if len(self._waiting) < TICKETS:
            self._waiting.append(waiting)
            return
        taken = {"ok": True, "command": waiting.ticket.command.name}
        query = waiting.query
        self._say(query, lambda: query.reply(waiting.key, msgspec.json.encode(taken), encoding=JSON))

    def _settled(self, waiting: _Waiting) -> bool:
        """Tell the sender once it is known what became of its command, or no longer to be expected."""
        if waiting.ticket.outcome is None and time.monotonic() < waiting.until:
            return False
        self._reply(waiting.key, waiting.query, lambda: msgspec.json.encode(waiting.ticket.answer()))
        return True

    def _say(self, query: zenoh.Query, reply: Callable[[], None]) -> None:
        try:
            with query:
                reply()
        except zenoh.ZError:  # the asker is gone
            self.errors += 1
