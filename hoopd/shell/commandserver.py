"""The command socket: a line of JSON in, a line of JSON out, on a thread of its own.

Rules of this file: the loop is never waited for and never waits; lines, connections, their time and the work of a turn
are bounded; whoever holds most and says nothing makes room for the others, so that nobody is kept out. What goes wrong
with a connection ends it and nothing else. Who may open the socket may command: the file's rights are the access rules.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

import msgspec

from hoopd.shell.commands import LOGGED, REFUSED, SETTLE_S, Gate, RefusedError, Ticket
from hoopd.shell.descriptors import RESERVE, opened
from hoopd.shell.helpers import start_helper
from hoopd.shell.socketfile import ListeningSocket

LINE_BYTES = 4096
CONNECTIONS = 8
ACCEPTS_PER_TURN = 32  # of connections: about half a millisecond of this thread
POLL_S = 0.01  # a request may wait so long: waking this thread would cost the tick more than it costs to look
TALK_S = 2.0  # for a line to come and for an answer to be taken
TELL_S = 1.0
STATUS = "status"
NAME_CHARS = 32  # of a command that is not known, in the log
KEY_CHARS = 120  # of a file's name and the first digits of its hash
ONE_LINE = 'expected one line of JSON: {"command": name, "value": number, "key": text}'

OnEvent = Callable[[str, str, Mapping[str, Any]], None]


class CommandRequest(msgspec.Struct, forbid_unknown_fields=True):
    """What a client may ask."""

    command: str
    value: float | None = None
    key: str = ""


class Peer(NamedTuple):
    """Who is at the other end, as the kernel tells."""

    pid: int
    uid: int
    gid: int

    def __str__(self) -> str:
        return f"user {self.uid}, process {self.pid}"


@dataclass
class StatusTicket:
    """A wish to know how the daemon stands; the loop fills it in its next tick."""

    fields: dict[str, Any] | None = None


@dataclass
class _Client:
    """One connection: what it said, what it waits for, what it is still to be told."""

    socket: socket.socket
    peer: Peer
    since: float = field(default_factory=time.monotonic)  # it came, or asked
    heard: bytes = b""
    ticket: Ticket | StatusTicket | None = None
    to_say: bytes = b""

    @property
    def patience_s(self) -> float:
        """How long it may stay: for a file to be loaded longer than to talk."""
        return TALK_S - SETTLE_S + self.settle_s

    @property
    def settle_s(self) -> float:
        """How long it waits for what became of its request."""
        return self.ticket.patience_s if isinstance(self.ticket, Ticket) else SETTLE_S

    @property
    def silent(self) -> bool:
        """It has asked nothing yet."""
        return self.ticket is None and not self.to_say


class CommandServer:
    """Takes commands from the socket to the gate, and the outcomes back."""

    def __init__(
        self,
        listening: ListeningSocket,
        gate: Gate,
        ask_status: Callable[[StatusTicket], None],
        *,
        session: str = "",
        on_event: OnEvent | None = None,
    ) -> None:
        self._listening, self._gate, self._ask_status = listening, gate, ask_status
        self._session, self._on_event = session, on_event
        self._clients: list[_Client] = []
        self._told: dict[tuple[int, str], float] = {}
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Serve in a helper thread; returns at once."""
        self._thread = start_helper("commands", self._run)

    def close(self, timeout_s: float = 1.0) -> bool:
        """Stop serving and take the socket away; False when the thread did not end in time."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout_s)
        self._listening.close()
        return self._thread is None or not self._thread.is_alive()

    # ---- helper thread ----

    def _run(self) -> None:
        try:
            while not self._stop.wait(POLL_S):
                self._turn()
            self._turn()  # whoever asked for the end may learn that it came
        finally:
            for client in self._clients:
                client.socket.close()

    def _turn(self) -> None:
        for _ in range(ACCEPTS_PER_TURN):
            if not self._accept():
                break
        RESERVE.refill()
        for client in list(self._clients):
            self._serve(client)
            time.sleep(0)  # lets a waiting tick in

    def _accept(self) -> bool:
        """Take one connection; what it says first is heard at once, so that idle ones can be told apart."""
        try:
            connection, _ = opened(self._listening.socket.accept, 1)
        except OSError:  # nobody waits, or not even the reserve has a descriptor
            return False
        connection.setblocking(False)
        client = _Client(connection, _peer(connection))
        self._clients.append(client)
        self._serve(client)
        if len(self._clients) > CONNECTIONS:
            self._drop(self._greediest())
        return True

    def _greediest(self) -> _Client:
        """Who has to go: of the user and then the process that hold most connections the oldest that asked nothing."""
        users = Counter(client.peer.uid for client in self._clients)
        processes = Counter(client.peer.pid for client in self._clients)

        def rank(client: _Client) -> tuple[int, int, bool, float]:
            return -users[client.peer.uid], -processes[client.peer.pid], not client.silent, client.since

        return min(self._clients, key=rank)

    def _serve(self, client: _Client) -> None:
        try:
            self._attend(client)
        except Exception:  # an end of this thread would keep everybody out
            self._drop(client)

    def _attend(self, client: _Client) -> None:
        if client.silent:
            self._hear(client)
        if client.ticket is not None:
            self._settle(client)
        if client.to_say:
            self._say(client)
        if client in self._clients and time.monotonic() - client.since > client.patience_s:
            self._drop(client)

    def _hear(self, client: _Client) -> None:
        """Read what came; a whole line is a request."""
        try:
            data = client.socket.recv(LINE_BYTES + 1 - len(client.heard))
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        client.heard += data
        line, end, _ = client.heard.partition(b"\n")
        if end:
            self._ask(client, line)
        elif len(client.heard) > LINE_BYTES:
            self._refuse(client, "", f"more than {LINE_BYTES} bytes in a line")

    def _ask(self, client: _Client, line: bytes) -> None:
        client.since = time.monotonic()  # who took his time to ask waits as long for the loop as everybody
        try:
            request = msgspec.json.decode(line, type=CommandRequest)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            self._refuse(client, "", ONE_LINE)
            return
        if request.command == STATUS:
            client.ticket = StatusTicket()
            self._ask_status(client.ticket)
            return
        try:
            client.ticket = self._gate.offer(request.command, _payload(request), by=str(client.peer))
        except RefusedError as refusal:
            self._refuse(client, request.command, str(refusal))
            self._tell(client.peer, REFUSED, "warning", command=request.command[:NAME_CHARS], reason=str(refusal))
        else:
            key = {"key": request.key[:KEY_CHARS]} if request.key else {}
            self._tell(client.peer, "command", "info", command=request.command, **key)

    def _settle(self, client: _Client) -> None:
        """Answer once the loop has told what became of it, or has been silent for too long."""
        ticket = client.ticket
        over = time.monotonic() - client.since > client.settle_s
        if isinstance(ticket, StatusTicket):
            if ticket.fields is not None:
                self._answer(client, {"ok": True, "command": STATUS, "status": ticket.fields})
            elif over:
                self._refuse(client, STATUS, f"the loop has not ticked for {SETTLE_S:g} s")
        elif ticket is not None and (ticket.outcome is not None or over):
            try:
                self._answer(client, ticket.answer())
            except RefusedError as refusal:
                self._refuse(client, ticket.command.name, str(refusal))

    def _refuse(self, client: _Client, command: str, reason: str) -> None:
        self._answer(client, {"ok": False, "command": command, "reason": reason})

    def _answer(self, client: _Client, fields: dict[str, Any]) -> None:
        client.ticket = None
        client.to_say = msgspec.json.encode({**fields, "session": self._session}, enc_hook=str) + b"\n"
        self._say(client)

    def _say(self, client: _Client) -> None:
        try:
            sent = client.socket.send(client.to_say)
        except BlockingIOError:
            return
        except OSError:
            sent = len(client.to_say)  # the asker is gone
        client.to_say = client.to_say[sent:]
        if not client.to_say:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
        client.socket.close()

    def _tell(self, peer: Peer, event: str, level: str, **fields: str) -> None:
        """Who asked for what goes to the log, once a second of the same user, for a flood would push out the rest; who
        changes the controller always does: they are few."""
        now, same = time.monotonic(), (peer.uid, event if event == REFUSED else fields["command"])
        rare = event != REFUSED and fields["command"] in LOGGED
        if self._on_event is not None and (rare or now - self._told.get(same, -inf) > TELL_S):
            self._told[same] = now
            with contextlib.suppress(Exception):
                self._on_event(event, level, {**fields, "uid": peer.uid, "pid": peer.pid})


def _payload(request: CommandRequest) -> bytes:
    return msgspec.json.encode({"value": request.value, "key": request.key})


def _peer(connection: socket.socket) -> Peer:
    size = struct.calcsize("3i")
    return Peer(*struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)))
