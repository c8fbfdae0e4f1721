"""Telemetry: zenoh peers on a thread of its own, behind a slot that the tick fills and never waits for.

Rules of this file: the tick's side puts and returns; only the helper thread touches zenoh, and it polls Rust-side rings
instead of taking callbacks (a callback holds a thread that keeps the process alive for ever, and a flood of them holds
the interpreter); a full slot drops its oldest; whatever fails is counted, answered and retried; closing has a deadline.

Two sessions: the one of telemetry asks nobody who he is and takes `disarm` and `stop` only; every other command comes
over the one of control, which lets nobody in without a password or a certificate.
"""

from __future__ import annotations

import atexit
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
from hoopd.files.reading import InputError
from hoopd.recording.mcap import without_secrets
from hoopd.recording.rows import encode_event, encode_tick_message
from hoopd.recording.schemas import LogEvent
from hoopd.shell.commands import LOGGED, NAMES, NO_CONTROL, PAYLOAD_BYTES, Gate, RefusedError, Ticket
from hoopd.shell.helpers import start_helper
from hoopd.shell.live_picture import LivePicture
from hoopd.shell.peer import JSON, RETRY_S, Answer, OnEvent, ZenohPeer
from hoopd.shell.session import CONTROL, DEVICE, ENDPOINT, asks_who, device_key, listening

SLOT_ROWS = 64  # 1.3 s of ticks: telemetry is for now, the recording keeps the rest
POLL_S = 0.01  # how long a row or a query may wait for us: waking a thread would cost the tick 4 us, polling nothing
STATUS_S = 1.0
BAD_PUTS = 20  # in a row: the session is broken, open another
ANONYMOUS = "over zenoh this needs telemetry.control, with a password or a certificate; on the daemon's machine: hoopd"

NOBODY_ASKED = (
    "lets in who does not say who he is: give users (transport.auth.usrpwd.dictionary_file, with a line user:password) "
    "or demand certificates (transport.link.tls.enable_mtls on a tls/ endpoint)"
)


@dataclass(frozen=True)
class TelemetrySettings:
    """What the configuration says about telemetry; `zenoh` holds zenoh's own keys (TLS, users, access)."""

    device: str = DEVICE
    endpoint: str = ENDPOINT
    zenoh: Mapping[str, Any] = field(default_factory=dict)
    commands: bool = False  # over the session of control
    control_endpoint: str = ""
    control_zenoh: Mapping[str, Any] = field(default_factory=dict)
    session: str = ""  # tells this run from every other: beside each message, proof of nothing
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
        self,
        settings: TelemetrySettings,
        gate: Gate,
        *,
        config_text: str = "",
        on_event: OnEvent | None = None,
        picture: LivePicture | None = None,
    ) -> None:
        """`picture`: of the camera, where there is one."""
        self._settings, self.gate, self._on_event = settings, gate, on_event
        self._config_text, self._picture = without_secrets(config_text), picture
        self._peer = ZenohPeer(
            "telemetry",
            listening(settings.endpoint, settings.zenoh),
            settings.device,
            {**self._commands(ANONYMOUS), "config": self._answer_config, "snapshot": self._answer_snapshot},
            endpoint=settings.endpoint,
            retry_s=settings.retry_s,
            on_event=on_event,
        )
        self._control = self._make_control(on_event) if settings.commands else None
        self._slot: deque[TickRecord | LogEvent] = deque()
        self._summary, self._extra, self._status = _Summary(), {}, b"{}"  # type: tuple[_Summary, Mapping[str, Any], bytes]
        self._published = self._dropped = self._errors = self._bad_puts = 0
        self._dropped_before, self._dropping = 0, False
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._kept: list[Any] = []  # declarations that live as long as the session
        self._status_at = time.monotonic() + STATUS_S
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Open and serve in a helper thread; returns at once."""
        self._thread = start_helper("telemetry", self._run)
        # an interpreter that ends beneath a thread inside zenoh takes the process along ("exception not rethrown")
        atexit.register(self.close)

    @property
    def trouble(self) -> bool:
        """Rows were dropped in the last second, or the slot is full."""
        return self._dropping or len(self._slot) >= SLOT_ROWS

    @property
    def counts(self) -> TelemetryCounts:
        """Counters for the status line."""
        gate, peers = self.gate, self._peers
        errors = self._errors + sum(peer.errors for peer in peers)
        queries = sum(peer.queries for peer in peers)
        is_open = all(peer.session is not None for peer in peers)
        return TelemetryCounts(is_open, self._published, self._dropped, errors, queries, gate.accepted, gate.refused)

    def put(self, record: TickRecord) -> None:
        """One tick to publish; never waits."""
        self._offer(record)

    def event(self, t: float, event: str, level: str = "info", **fields: Any) -> None:
        """One event to publish; never waits, from any thread."""
        self._offer(LogEvent(t, event, level, fields))

    def set_status(self, fields: Mapping[str, Any]) -> None:
        """Further fields of the status message (faults, recorder, link ...); do not change the mapping afterwards."""
        self._extra = fields

    def close(self, timeout_s: float = 2.0) -> bool:
        """Close the sessions; False when zenoh did not let go in time (the caller should then end with os._exit)."""
        atexit.unregister(self.close)
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout_s)
            return not self._thread.is_alive()
        return True

    @property
    def _peers(self) -> list[ZenohPeer]:
        return [self._peer] if self._control is None else [self._peer, self._control]

    def _make_control(self, on_event: OnEvent | None) -> ZenohPeer:
        """The session of those who prove who they are; InputError when it would ask nobody."""
        settings = self._settings
        if not settings.control_endpoint:
            raise InputError("", "telemetry.commands", NO_CONTROL)
        config = listening(settings.control_endpoint, settings.control_zenoh, CONTROL)
        if not asks_who(config):
            raise InputError("", f"{CONTROL}.zenoh", NOBODY_ASKED)
        return ZenohPeer(
            "control",
            config,
            settings.device,
            self._commands(""),
            endpoint=settings.control_endpoint,
            retry_s=settings.retry_s,
            on_event=on_event,
        )

    def _offer(self, item: TickRecord | LogEvent) -> None:
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
            if self._peer.session is not None:
                self._turn()  # the last facts of a run are the ones that somebody waits for
        finally:
            if self._picture is not None:
                self._picture.close()
            for peer in self._peers:
                peer.shut()

    def _turn(self) -> None:
        """Open if needed, publish what comes, answer what waits."""
        self._peer.try_open(self._declare)
        if self._control is not None:
            self._control.try_open()
        with contextlib.suppress(IndexError):  # the tick's side takes the oldest of a full slot
            for _ in range(len(self._slot)):
                self._publish(self._slot.popleft())
                time.sleep(0)  # lets a waiting tick in: no batch may hold the interpreter
        for peer in self._peers:
            peer.serve()
        if self._picture is not None and self._peer.session is not None:
            self._serve_picture(self._picture)
        if time.monotonic() >= self._status_at:
            self._publish_status()

    def _serve_picture(self, picture: LivePicture) -> None:
        try:
            picture.serve(self._settings.session)
        except Exception:  # ticks that cannot be put tell whether the session is broken
            self._errors += 1

    def _declare(self, session: zenoh.Session) -> None:
        self._bad_puts = 0
        drop = zenoh.CongestionControl.DROP
        for name in ("tick", "event", "status"):
            key = device_key(self._settings.device, name)
            self._publishers[name] = session.declare_publisher(key, encoding=JSON, congestion_control=drop)
        if self._picture is not None:
            self._picture.declare(session, self._settings.device)
        self._kept = [session.liveliness().declare_token(device_key(self._settings.device, "alive"))]

    def _publish(self, item: TickRecord | LogEvent) -> None:
        if isinstance(item, TickRecord):
            self._summary.add(item)
        if self._peer.session is None:
            return
        if isinstance(item, TickRecord):
            self._send("tick", lambda: encode_tick_message(item))
        else:
            self._send("event", lambda: encode_event(item))

    def _send(self, name: str, encode: Callable[[], bytes]) -> None:
        try:
            self._publishers[name].put(encode(), attachment=self._settings.session or None)
            self._published, self._bad_puts = self._published + 1, 0
        except Exception:
            self._errors, self._bad_puts = self._errors + 1, self._bad_puts + 1
            if self._bad_puts >= BAD_PUTS:
                self._peer.tell("lost", "warning")
                self._publishers, self._kept = {}, []
                self._peer.shut()

    def _publish_status(self) -> None:
        now = time.monotonic()
        self._status_at = now + STATUS_S
        self._dropping, self._dropped_before = self._dropped > self._dropped_before, self._dropped
        told = {"session": self._settings.session, "telemetry": self.counts._asdict()}
        fields = {**self._summary.close(now), **told, **self._extra}
        try:
            self._status = msgspec.json.encode(fields, enc_hook=str)
        except Exception:  # a status that cannot be written is not worth a thread
            self._errors += 1
            return
        if self._peer.session is not None:
            self._send("status", lambda: self._status)

    def _commands(self, untrusted: str) -> dict[str, Answer]:
        """Key below the device -> answer, the safe ones first; `untrusted`: why the others are refused."""
        return {f"cmd/{name}": self._command_answer(name, untrusted) for name in NAMES}

    def _command_answer(self, name: str, untrusted: str) -> Answer:
        exact = device_key(self._settings.device, "cmd", name)

        def answer(query: zenoh.Query) -> Ticket:
            if str(query.key_expr) != exact:  # a curious `hoopd/**` must not arm anything
                raise RefusedError("a command needs its exact key")
            payload = query.payload
            if payload is not None and len(payload) > PAYLOAD_BYTES:  # said before a byte is copied
                raise RefusedError(f"more than {PAYLOAD_BYTES} bytes")
            content = b"" if payload is None else payload.to_bytes()
            ticket = self.gate.offer(name, content, untrusted=untrusted, by=CONTROL)
            if name in LOGGED and self._on_event is not None:
                with contextlib.suppress(Exception):
                    self._on_event("command", "info", {"command": name, "key": ticket.command.key, "by": CONTROL})
            return ticket

        return answer

    def _answer_config(self, _query: zenoh.Query) -> bytes:
        return msgspec.json.encode({"config": self._config_text})

    def _answer_snapshot(self, _query: zenoh.Query) -> bytes:
        last = self._summary.last
        tick = msgspec.Raw(encode_tick_message(last)) if last is not None else None
        return msgspec.json.encode(
            {"session": self._settings.session, "tick": tick, "status": msgspec.Raw(self._status)}
        )
