"""From zenoh to devices: one thread for each endpoint, which connects, listens, and connects again.

Rules of this file: samples are taken from a ring that drops its oldest, never by a callback; a daemon that is not there
is asked again, for ever; the names of devices come from strangers and are checked before they become keys.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import zenoh

from hoopd.dashboard.device import ShownDevice
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import ask, configuration, send
from hoopd.shell.session import connecting, reason

RING = 500  # messages: ten seconds of ticks
POLL_S = 0.01
RETRY_S = 1.0
CONNECT_S = 3.0  # to another machine; this one answers at once or not at all
COMMAND_S = 3.0
TRIES = 2  # what everybody may send does no harm twice: one that nobody confirmed is sent again
DEVICES = 8  # of one endpoint, which is one daemon's as a rule
FORGOTTEN_S = 600.0  # silent and gone for so long: its place may be another's
KINDS = ("tick", "event", "status")
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")


class Connection:
    """A client of one endpoint."""

    def __init__(self, endpoint: str, extras: Mapping[str, Any]) -> None:
        """`extras`: zenoh's own keys. InputError for an endpoint or a key that zenoh does not understand."""
        self.endpoint, self.extras = endpoint, dict(extras)
        self.trouble = "not connected yet"  # empty while it is connected
        self.refused = 0  # messages of devices that cannot be: names that are no keys, or too many
        self.devices: dict[str, ShownDevice] = {}
        self._config = connecting(endpoint, self.extras, CONNECT_S)
        self._session: zenoh.Session | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"feed {endpoint}", daemon=True)

    def start(self) -> None:
        """Listen in a thread of its own; returns at once."""
        self._thread.start()

    def close(self, timeout_s: float = 2.0) -> None:
        """End the thread and its session."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)

    def command(self, device: str, name: str, value: float | None = None, key: str = "") -> dict[str, Any]:
        """The daemon's answer to a command that everybody may give; CommandError when it refuses or none answers."""
        session = self._session
        if session is not None and session.info.transports():
            return ask(session, name, value, self.endpoint, device, COMMAND_S, key=key)
        return send(name, value, self.endpoint, device, COMMAND_S, key=key, extras=self.extras)

    def configuration(self, device: str) -> str:
        """A daemon's configuration as it tells it, without secrets; CommandError when none answers."""
        if self._session is None:
            raise CommandError(f"configuration: {self.trouble}")
        return configuration(self._session, self.endpoint, device, COMMAND_S)

    @property
    def session(self) -> zenoh.Session | None:
        """What it listens with; another one after each loss, and none between."""
        return self._session

    # ---- its thread ----

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with zenoh.open(self._config) as session:
                    self._listen(session)
                self.trouble = self.trouble or "the connection was lost"
            except (zenoh.ZError, OSError) as error:
                self.trouble = f"no daemon answers: {reason(error)}"
            self._session = None
            for device in list(self.devices.values()):
                device.presence(False)
            self._stop.wait(RETRY_S)

    def _listen(self, session: zenoh.Session) -> None:
        """Take what comes until the connection is gone."""
        if not session.info.transports():
            self.trouble = "the daemon does not let us in (user, password or certificate?)"
            return
        rings = [
            session.declare_subscriber("hoopd/*/*", zenoh.handlers.RingChannel(RING)),
            session.liveliness().declare_subscriber("hoopd/*/alive", zenoh.handlers.RingChannel(RING), history=True),
        ]
        self._session, self.trouble = session, ""
        while not self._stop.wait(POLL_S) and session.info.transports():
            for ring in rings:
                self._drain(ring)

    def _drain(self, ring: Any) -> None:
        for _ in range(RING):  # a flood comes back to the other ring, and to the end
            sample = ring.try_recv()
            if sample is None:
                return
            _, name, kind = str(sample.key_expr).split("/", 2)
            device = self._device(name)
            if device is None:
                self.refused += 1
            elif kind == "alive":
                device.presence(sample.kind == zenoh.SampleKind.PUT)
            elif kind in KINDS:
                run = "" if sample.attachment is None else sample.attachment.to_bytes()[:64].decode("utf-8", "replace")
                device.take(kind, sample.payload.to_bytes(), run)

    def _device(self, name: str) -> ShownDevice | None:
        if name not in self.devices and _NAME.fullmatch(name):
            if len(self.devices) >= DEVICES:
                self._forget()
            if len(self.devices) < DEVICES:
                self.devices[name] = ShownDevice(name, self.endpoint)
        return self.devices.get(name)

    def _forget(self) -> None:
        """Make room: who is gone and has been silent for long."""
        now = time.time()
        gone = [name for name, one in self.devices.items() if not one.alive and now - one.heard_s > FORGOTTEN_S]
        for name in gone:
            del self.devices[name]


class Feed:
    """All endpoints, and the devices that they tell of."""

    def __init__(self, endpoints: Sequence[str], extras: Mapping[str, Any]) -> None:
        self.connections = [Connection(endpoint, extras) for endpoint in dict.fromkeys(endpoints)]

    def start(self) -> None:
        """Listen to all of them."""
        for connection in self.connections:
            connection.start()

    def close(self) -> None:
        """Let all of them go."""
        for connection in self.connections:
            connection.close()

    @property
    def devices(self) -> dict[str, ShownDevice]:
        """By what tells them apart."""
        known = (device for connection in self.connections for device in list(connection.devices.values()))
        return {device.identity: device for device in known}

    def troubles(self) -> dict[str, str]:
        """Endpoints, and why nothing comes from them; empty for those that are well."""
        return {connection.endpoint: connection.trouble for connection in self.connections}

    def connection_of(self, device: ShownDevice) -> Connection:
        """The connection that tells of a device."""
        return next(one for one in self.connections if one.endpoint == device.endpoint)

    def send(self, device: ShownDevice, name: str) -> dict[str, Any]:
        """What became of a command that everybody may give, as the page shows it; waits for the answer."""
        connection = self.connection_of(device)
        told = {"device": device.identity, "command": name}
        for _ in range(TRIES):
            answer = _tried(connection, device.name, name)
            if answer["ok"]:
                break
        return {**answer, **told}


def _tried(connection: Connection, device: str, name: str) -> dict[str, Any]:
    try:
        answer = connection.command(device, name)
        return {**answer, "ok": answer.get("ok") is True}
    except CommandError as error:
        return {"ok": False, "reason": str(error)}
    except Exception as error:  # of one device: the others are stopped and answer all the same
        return {"ok": False, "reason": f"no answer: {type(error).__name__}"}
