"""Telemetry: a zenoh peer on a thread of its own, behind a slot that the tick fills and never waits for.

Rules of this file: the tick's side puts and returns; only the helper thread touches zenoh, and it polls Rust-side rings
instead of taking callbacks (a callback holds a thread that keeps the process alive for ever, and a flood of them holds
the interpreter); a full slot drops its oldest; whatever fails is counted, answered and retried; closing has a deadline.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec
import zenoh

from hoopd.core.records import TickRecord
from hoopd.files import InputError
from hoopd.recording.mcap import without_secrets
from hoopd.recording.rows import encode_event, encode_tick
from hoopd.recording.schemas import Event
from hoopd.shell.commands import NAMES, Gate, RefusedError
from hoopd.shell.helpers import start_helper
from hoopd.shell.session import DEVICE, ENDPOINT, asks_who, device_key, exposed, listening, reason

SLOT_ROWS = 64  # 1.3 s of ticks: telemetry is for now, the recording keeps the rest
POLL_S = 0.01  # how long a row or a query may wait for us: waking a thread would cost the tick 4 us, polling nothing
STATUS_S = 1.0
RETRY_S = 10.0  # between tries to open
QUERIES_PER_TURN = 4  # of one key: a flood costs at most a fraction of a millisecond per tick
QUERY_RING = 64  # waiting queries of one key; beyond it the oldest go without an answer
BAD_PUTS = 20  # in a row: the session is broken, open another
JSON = "application/json"
COMMANDS_OFF = "commands are off: set telemetry.commands to true in the daemon's configuration"

OnEvent = Callable[[str, str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Settings:
    """What the configuration says about telemetry; `zenoh` holds zenoh's own keys (TLS, users, access)."""

    device: str = DEVICE
    endpoint: str = ENDPOINT
    commands: bool = False
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    retry_s: float = RETRY_S


class TelemetryCounts(NamedTuple):
    """What telemetry did so far."""

    open: bool
    published: int
    dropped: int  # rows that the slot pushed out
    errors: int  # calls of zenoh and answers of ours that failed
    queries: int
    commands_accepted: int
    commands_refused: int


@dataclass
class _Summary:
    """What the status message says about the ticks since the last one."""

    last: TickRecord | None = None
    ticks: int = 0
    lateness_s: float = 0.0
    execution_s: float = 0.0
    begun: float = field(default_factory=time.monotonic)

    def add(self, record: TickRecord) -> None:
        """Count one tick."""
        self.last, self.ticks = record, self.ticks + 1
        self.lateness_s = max(self.lateness_s, record.lateness_s)
        self.execution_s = max(self.execution_s, record.execution_s)

    def close(self, now: float) -> dict[str, Any]:
        """Fields of the status message; counting begins anew."""
        elapsed_s, last = now - self.begun, self.last
        fields = {
            "t": last.t if last else None,
            "id": last.id if last else None,
            "mode": last.mode if last else None,
            "tick_rate_hz": round(self.ticks / elapsed_s, 3) if elapsed_s > 0.0 else None,
            "lateness_worst_s": self.lateness_s,
            "execution_worst_s": self.execution_s,
        }
        self.ticks, self.lateness_s, self.execution_s, self.begun = 0, 0.0, 0.0, now
        return fields


class Telemetry:
    """Publishes ticks, events and status; answers queries; hands commands to the tick."""

    def __init__(
        self, settings: Settings, gate: Gate, *, config_text: str = "", on_event: OnEvent | None = None
    ) -> None:
        self._settings, self._on_event = settings, on_event
        self._config_text = without_secrets(config_text)
        self._zenoh_config = listening(settings.endpoint, settings.zenoh)
        _refuse_open_door(settings, self._zenoh_config)
        self.gate = gate
        self._slot: deque[TickRecord | Event] = deque()
        self._summary, self._extra, self._status = _Summary(), {}, b"{}"  # type: tuple[_Summary, Mapping[str, Any], bytes]
        self._published = self._dropped = self._errors = self._queries = self._bad_puts = 0
        self._dropped_before, self._dropping, self._warned = 0, False, False
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._queryables: dict[str, zenoh.Queryable[Any]] = {}
        self._kept: list[Any] = []  # declarations that live as long as the session
        self._open_at, self._status_at = 0.0, time.monotonic() + STATUS_S
        self._answers = self._answer_table()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Open and serve in a helper thread; returns at once."""
        self._thread = start_helper("telemetry", self._run)

    @property
    def trouble(self) -> bool:
        """Rows were dropped in the last second, or the slot is full."""
        return self._dropping or len(self._slot) >= SLOT_ROWS

    @property
    def counts(self) -> TelemetryCounts:
        """Counters for the status line."""
        gate, is_open = self.gate, self._session is not None
        return TelemetryCounts(
            is_open, self._published, self._dropped, self._errors, self._queries, gate.accepted, gate.refused
        )

    def put(self, record: TickRecord) -> None:
        """One tick to publish; never waits."""
        self._offer(record)

    def event(self, t: float, event: str, level: str = "info", **fields: Any) -> None:
        """One event to publish; never waits, from any thread."""
        self._offer(Event(t, event, level, fields))

    def set_status(self, fields: Mapping[str, Any]) -> None:
        """Further fields of the status message (faults, recorder, link ...); do not change the mapping afterwards."""
        self._extra = fields

    def close(self, timeout_s: float = 2.0) -> bool:
        """Close the session; False when zenoh did not let go in time (the caller should then end with os._exit)."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout_s)
            return not self._thread.is_alive()
        return True

    def _offer(self, item: TickRecord | Event) -> None:
        if len(self._slot) >= SLOT_ROWS:
            with contextlib.suppress(IndexError):  # just taken: there is room
                self._slot.popleft()
                self._dropped += 1
        self._slot.append(item)

    # ---- helper thread ----

    def _run(self) -> None:
        try:
            while not self._stop.wait(POLL_S):
                self._turn()
            if self._session is not None:
                self._turn()  # the last facts of a run are the ones that somebody waits for
        finally:
            self._shut()

    def _turn(self) -> None:
        """Open if needed, publish what comes, answer what waits."""
        if self._session is None and time.monotonic() >= self._open_at:
            self._try_open()
        with contextlib.suppress(IndexError):  # the tick's side takes the oldest of a full slot
            for _ in range(len(self._slot)):
                self._publish(self._slot.popleft())
                time.sleep(0)  # lets a waiting tick in: no batch may hold the interpreter
        for name, queryable in self._queryables.items():
            self._serve(name, queryable)
        if time.monotonic() >= self._status_at:
            self._publish_status()

    def _try_open(self) -> None:
        self._open_at = time.monotonic() + self._settings.retry_s
        try:
            self._session = zenoh.open(self._zenoh_config)
            self._declare(self._session)
        except Exception as error:
            self._shut()
            self._errors += 1
            if not self._warned:
                self._warned = True
                self._tell("telemetry_unavailable", "warning", endpoint=self._settings.endpoint, reason=reason(error))
            return
        self._warned, self._bad_puts = False, 0
        self._tell("telemetry_open", "info", endpoint=self._settings.endpoint, commands=self._settings.commands)

    def _declare(self, session: zenoh.Session) -> None:
        def key(*chunks: str) -> str:
            return device_key(self._settings.device, *chunks)

        drop = zenoh.CongestionControl.DROP
        for name in ("tick", "event", "status"):
            self._publishers[name] = session.declare_publisher(key(name), encoding=JSON, congestion_control=drop)
        for name in self._answers:
            ring: Any = zenoh.handlers.RingChannel(QUERY_RING)
            self._queryables[name] = session.declare_queryable(key(*name.split("/")), ring)
        self._kept.append(session.liveliness().declare_token(key("alive")))

    def _publish(self, item: TickRecord | Event) -> None:
        if isinstance(item, TickRecord):
            self._summary.add(item)
        if self._session is None:
            return
        if isinstance(item, TickRecord):
            self._send("tick", lambda: encode_tick(item))
        else:
            self._send("event", lambda: encode_event(item))

    def _send(self, name: str, encode: Callable[[], bytes]) -> None:
        try:
            self._publishers[name].put(encode())
            self._published, self._bad_puts = self._published + 1, 0
        except Exception:
            self._errors, self._bad_puts = self._errors + 1, self._bad_puts + 1
            if self._bad_puts >= BAD_PUTS:
                self._tell("telemetry_lost", "warning", endpoint=self._settings.endpoint)
                self._shut()

    def _publish_status(self) -> None:
        now = time.monotonic()
        self._status_at = now + STATUS_S
        self._dropping, self._dropped_before = self._dropped > self._dropped_before, self._dropped
        fields = {**self._summary.close(now), "telemetry": self.counts._asdict(), **self._extra}
        try:
            self._status = msgspec.json.encode(fields, enc_hook=str)
        except Exception:  # a status that cannot be written is not worth a thread
            self._errors += 1
            return
        if self._session is not None:
            self._send("status", lambda: self._status)

    def _serve(self, name: str, queryable: zenoh.Queryable[Any]) -> None:
        """Answer the queries that wait; whatever goes wrong is the asker's answer, not our end."""
        for _ in range(QUERIES_PER_TURN):
            try:
                query = queryable.try_recv()
            except zenoh.ZError:
                return
            if query is None:
                return
            self._queries += 1
            with query:
                self._reply(name, query)

    def _reply(self, name: str, query: zenoh.Query) -> None:
        try:
            try:
                key = device_key(self._settings.device, *name.split("/"))
                query.reply(key, self._answers[name](query), encoding=JSON)
            except RefusedError as refusal:
                query.reply_err(str(refusal), encoding="text/plain")
            except Exception as error:
                self._errors += 1
                query.reply_err(f"internal error: {type(error).__name__}", encoding="text/plain")
        except zenoh.ZError:  # the asker is gone
            self._errors += 1

    def _answer_table(self) -> dict[str, Callable[[zenoh.Query], bytes]]:
        """Key below the device -> answer; safe commands first."""
        commands = {f"cmd/{name}": self._command_answer(name) for name in NAMES}
        return {**commands, "config": self._config_answer, "snapshot": self._snapshot_answer}

    def _command_answer(self, name: str) -> Callable[[zenoh.Query], bytes]:
        exact = device_key(self._settings.device, "cmd", name)

        def answer(query: zenoh.Query) -> bytes:
            if str(query.key_expr) != exact:  # a curious `hoopd/**` must not arm anything
                raise RefusedError("a command needs its exact key")
            payload = query.payload
            trusted = "" if self._settings.commands else COMMANDS_OFF
            command = self.gate.offer(name, b"" if payload is None else payload.to_bytes(), trusted=trusted).command
            return msgspec.json.encode(
                {"ok": True, "command": command.name, "value": command.value, "key": command.key}
            )

        return answer

    def _config_answer(self, _query: zenoh.Query) -> bytes:
        return msgspec.json.encode({"config": self._config_text})

    def _snapshot_answer(self, _query: zenoh.Query) -> bytes:
        last = self._summary.last
        tick = msgspec.Raw(encode_tick(last)) if last is not None else None
        return msgspec.json.encode({"tick": tick, "status": msgspec.Raw(self._status)})

    def _shut(self) -> None:
        """Close the session, whatever state it is in."""
        session, self._session = self._session, None
        self._publishers, self._queryables, self._kept = {}, {}, []
        if session is not None:
            with contextlib.suppress(Exception):
                session.close()  # type: ignore[no-untyped-call]

    def _tell(self, event: str, level: str, **fields: Any) -> None:
        if self._on_event is not None:
            with contextlib.suppress(Exception):
                self._on_event(event, level, fields)


def _refuse_open_door(settings: Settings, config: zenoh.Config) -> None:
    """Commands from other machines need a proof of who sends them."""
    doors = exposed(config)
    if settings.commands and doors and not asks_who(config):
        raise InputError(
            "",
            "telemetry.commands",
            f"{doors[0]} is open to other machines: set users or certificates in telemetry.zenoh",
        )
