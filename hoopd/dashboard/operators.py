"""Who is logged in: the daemons' own users, each with a session of zenoh that the daemons let in.

Rules of this file: a password is judged by the daemons alone and kept no longer than the login; a login ends by itself;
who guesses has to wait. Calls but `find` wait for a daemon, so they belong into a thread.
"""

from __future__ import annotations

import contextlib
import hmac
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import zenoh

from hoopd.core.operator import SPEED
from hoopd.core.succession import ALIVE, LOADED
from hoopd.shell.commands import ALWAYS
from hoopd.shell.operator import CommandError
from hoopd.shell.remote import ask
from hoopd.shell.session import connecting, reason

IDLE_S = 15 * 60.0  # without a command
LONGEST_S = 8 * 3600.0  # a working day
AT_ONCE = 8  # logins: each holds a session of every daemon
GUESSES = 5  # that fail, of one address within GUESSES_S
ALL_GUESSES = 20  # of all addresses
GUESSES_S = 60.0
NAME_CHARACTERS = 64
PASSWORD_CHARACTERS = 256
CONNECT_S = 3.0
COMMAND_S = 3.0
HOLD_S = 30.0  # after somebody's last command nobody else drives the device; everybody may stop it
TOKEN_BYTES = 32
WRONG = "no daemon lets this user in with this password, or none answers"  # zenoh tells both alike
COMMANDS = ("arm", "disarm", "stop", "clear", "reference", SPEED, "tune", "accept", "revert", *LOADED, ALIVE)
_USER, _PASSWORD = "transport/auth/usrpwd/user", "transport/auth/usrpwd/password"


class LoginError(Exception):
    """Why somebody is not let in, in one line; `status` is the answer's."""

    def __init__(self, reason: str, status: int = 401) -> None:
        super().__init__(reason)
        self.status = status


@dataclass
class Login:
    """Somebody who is let in."""

    user: str
    configs: Mapping[str, zenoh.Config]  # by endpoint of telemetry
    begun: float  # s, monotonic
    used: float
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES))  # in the cookie
    proof: str = field(
        default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES)
    )  # in a header: no other page knows it
    sessions: dict[str, zenoh.Session] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)  # of the sessions

    def close(self) -> None:
        """Let the daemons go."""
        while self.sessions:
            with contextlib.suppress(Exception):
                self.sessions.popitem()[1].close()  # type: ignore[no-untyped-call]


class Operators:
    """Everybody who is logged in."""

    def __init__(
        self, controls: Mapping[str, tuple[str, Mapping[str, Any]]], clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`controls`: by endpoint of telemetry, the endpoint of control and zenoh's own keys for it."""
        self._controls, self._clock, self._lock = dict(controls), clock, threading.Lock()
        self._logins: dict[str, Login] = {}
        self._holders: dict[tuple[str, str], tuple[str, float]] = {}  # by device: token of a login, its last command
        self._guesses: deque[tuple[float, str]] = deque(maxlen=ALL_GUESSES)
        for endpoint in self._controls:
            self._config(endpoint, "", "")  # InputError now, not when somebody logs in

    @property
    def possible(self) -> bool:
        """Some daemon takes commands of those who say who they are."""
        return bool(self._controls)

    def login(self, user: str, password: str, address: str) -> Login:
        """Somebody whom at least one daemon lets in; LoginError for everybody else."""
        if not self.possible:
            raise LoginError("no daemon here takes commands over zenoh (telemetry.control)", 403)
        if not (0 < len(user) <= NAME_CHARACTERS and 0 < len(password) <= PASSWORD_CHARACTERS):
            raise LoginError("user and password, please")
        self._guess(address)
        configs = {endpoint: self._config(endpoint, user, password) for endpoint in self._controls}
        now = self._clock()
        login = Login(user, configs, now, now)
        let_in = [endpoint for endpoint in configs if self._session(login, endpoint) is not None]
        if not let_in:
            login.close()
            raise LoginError(WRONG)
        self._forgive(address)
        self._keep(login)
        return login

    def find(self, token: str, proof: str | None = None) -> Login:
        """Who has this cookie; with `proof`, who also knows what his own page was told. LoginError otherwise.

        Waits for nothing: whose time is over is let go by `sweep`.
        """
        with self._lock:
            login = self._logins.get(token)
        if login is None or self._over(login):
            raise LoginError("not logged in, or for too long")
        if proof is not None and not hmac.compare_digest(proof.encode(), login.proof.encode()):
            raise LoginError("this does not come from the page that logged in", 403)
        return login

    def seen(self, login: Login) -> None:
        """Somebody works: the login goes on."""
        login.used = self._clock()

    def logout(self, login: Login) -> None:
        """End it."""
        with self._lock:
            self._logins.pop(login.token, None)
        login.close()

    def command(
        self, login: Login, endpoint: str, device: str, name: str, value: float | None = None, key: str = ""
    ) -> dict[str, Any]:
        """The daemon's answer to somebody; CommandError when it refuses or none answers."""
        self.seen(login)
        if name not in COMMANDS:
            raise CommandError(f"unknown command; known: {', '.join(COMMANDS)}")
        session = self._session(login, endpoint)
        if session is None:
            raise CommandError(f"no daemon at {endpoint} takes commands of {login.user}")
        if name not in ALWAYS:
            self._hold(login, (endpoint, device))
        try:
            return ask(session, name, value, endpoint, device, COMMAND_S, key=key)
        except zenoh.ZError as error:  # the connection went meanwhile
            raise CommandError(f"no answer: {reason(error)}") from None

    def _hold(self, login: Login, device: tuple[str, str]) -> None:
        """Let somebody have a device; CommandError while another login has it."""
        now = self._clock()
        with self._lock:
            token, since = self._holders.get(device, ("", now))
            holder, left = self._logins.get(token, login), HOLD_S - (now - since)
            if holder is not login and left > 0.0 and not self._over(holder):
                raise CommandError(
                    f"{holder.user} drives it from another login: for {left:.0f} s, or until its log-out"
                )
            self._holders[device] = (login.token, now)

    def sweep(self) -> None:
        """End what has lasted for too long."""
        with self._lock:
            over = [one for one in self._logins.values() if self._over(one)]
        for login in over:
            self.logout(login)

    def _over(self, login: Login) -> bool:
        now = self._clock()
        return now - login.used > IDLE_S or now - login.begun > LONGEST_S

    def close(self) -> None:
        """End all of them."""
        for login in list(self._logins.values()):
            self.logout(login)

    def _keep(self, login: Login) -> None:
        self.sweep()
        with self._lock:
            self._logins[login.token] = login
            oldest = sorted(self._logins.values(), key=lambda one: one.used)[: max(0, len(self._logins) - AT_ONCE)]
        for one in oldest:
            self.logout(one)

    def _guess(self, address: str) -> None:
        """Count a try before it is judged, so that many at once are not free; LoginError for one too many."""
        now = self._clock()
        with self._lock:
            recent = [(t, whence) for t, whence in self._guesses if now - t < GUESSES_S]
            if len(recent) >= ALL_GUESSES or sum(whence == address for _, whence in recent) >= GUESSES:
                raise LoginError(f"too many tries: wait {GUESSES_S:g} s", 429)
            self._guesses.append((now, address))

    def _forgive(self, address: str) -> None:
        """A try that was right does not count."""
        with self._lock:
            for entry in reversed(self._guesses):
                if entry[1] == address:
                    self._guesses.remove(entry)
                    return

    def _session(self, login: Login, endpoint: str) -> zenoh.Session | None:
        """Somebody's session with a daemon, opened again after a restart; None where he is not let in."""
        with login.lock:
            return self._opened(login, endpoint)

    def _opened(self, login: Login, endpoint: str) -> zenoh.Session | None:
        session = login.sessions.get(endpoint)
        if session is not None and session.info.transports():
            return session
        if session is not None:
            with contextlib.suppress(Exception):
                session.close()  # type: ignore[no-untyped-call]
            del login.sessions[endpoint]
        if endpoint not in login.configs:
            return None
        with contextlib.suppress(zenoh.ZError):
            fresh = zenoh.open(login.configs[endpoint])
            if fresh.info.transports():
                login.sessions[endpoint] = fresh
                return fresh
            fresh.close()  # type: ignore[no-untyped-call]
        return None

    def _config(self, endpoint: str, user: str, password: str) -> zenoh.Config:
        control, keys = self._controls[endpoint]
        extras = {**dict(_client_keys(keys)), _USER: user, _PASSWORD: password}
        return connecting(control, extras, CONNECT_S)


def _client_keys(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Of zenoh's keys what a client shares with a daemon: certificates and the like, and nobody's name."""
    for name, value in tree.items():
        key = f"{above}/{name}" if above else name
        if key.startswith("transport/auth/usrpwd"):
            continue
        if isinstance(value, Mapping):
            yield from _client_keys(value, key)
        elif key.startswith("transport/"):
            yield key, value
