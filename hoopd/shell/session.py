"""zenoh sessions of ours: what they listen to, whom they reach, and what their errors mean in one line.

Rules of this file: zenoh's own defaults listen on every interface and look for peers by multicast, so everything is set
here: loopback, no scouting, no gossip, no shared memory. What the configuration adds are zenoh's own keys, unchanged.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh

from hoopd.files.reading import InputError, read_text

DEVICE = "hoop"
ENDPOINT = "tcp/127.0.0.1:7447"
TELEMETRY, CONTROL = "telemetry", "telemetry.control"  # sections of the configuration
_LOOPBACK = re.compile(r"^[a-z]+/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+")
_ADDRESS = re.compile(r"^(?:tcp|udp|tls|quic|ws)/(?:\[[^\]\s]+\]|[^\s/:\[]+):(\d{1,5})(?:[?#]\S*)?$")
_CERTIFIED = ("tls/", "quic/")  # links that show certificates
_LOCAL_LINKS = ("unixsock-stream/", "unixpipe/")
_CHUNK = re.compile(r"^[A-Za-z0-9_.-]+$")
_PLAIN_WORDS = {
    "Address already in use": "the address is already in use: commands sent there go to another program, not here",
    "Unable to connect": "nothing listens there, or it does not let us in",
}
_CLOSED = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,  # messages are 300 bytes; the unit needs no /dev/shm
}
# What peers may cost a daemon. A command has below 1000 bytes; fragments beyond the size are thrown away as they come,
# in zenoh's own threads. A connection that says nothing is closed after the time-out, and so many wait at once.
MESSAGE_BYTES = 65536
_BOUNDED = {
    "transport/link/rx/max_message_size": MESSAGE_BYTES,
    "transport/unicast/max_sessions": 32,
    "transport/unicast/accept_pending": 32,
    "transport/unicast/accept_timeout": 2000,  # ms
}


def listening(endpoint: str, extras: Mapping[str, Any], section: str = TELEMETRY) -> zenoh.Config:
    """Configuration of a peer of the daemon: listens at the endpoint, connects nowhere; InputError for a wrong key."""
    keys = {"mode": "peer", "listen/endpoints": [_checked(endpoint, section)], "connect/endpoints": [], **_BOUNDED}
    return _configured(keys, extras, section)


def connecting(endpoint: str, extras: Mapping[str, Any], timeout_s: float) -> zenoh.Config:
    """Configuration of a client of one endpoint; InputError for a wrong key."""
    # On this machine a daemon is there or not; with a time-out zenoh would keep trying until it is over.
    wait_ms = 0 if _LOOPBACK.match(endpoint) else round(timeout_s * 1e3)
    keys = {"mode": "client", "connect/endpoints": [_checked(endpoint)], "connect/timeout_ms": wait_ms}
    return _configured(keys, extras)


def device_key(device: str, *chunks: str) -> str:
    """`hoopd/{device}/...`; InputError for a name that is no single key chunk."""
    if not _CHUNK.match(device):
        raise InputError("", "device.name", f"{device!r}: letters, digits, '_', '-' and '.' only")
    return "/".join(("hoopd", device, *chunks))


def exposed(config: zenoh.Config) -> list[str]:
    """Endpoints that other machines reach."""
    return [e for e in _listened(config) if not _LOOPBACK.match(e) and not e.startswith(_LOCAL_LINKS)]


def _listened(config: zenoh.Config) -> list[str]:
    """Endpoints that a configuration listens at."""
    endpoints = json.loads(config.get_json("listen/endpoints"))
    return endpoints if isinstance(endpoints, list) else [e for part in endpoints.values() for e in part]


def asks_who(config: zenoh.Config) -> bool:
    """Peers must prove who they are, at every endpoint: user and password, or a certificate."""
    users = json.loads(config.get_json("transport/auth/usrpwd/dictionary_file"))
    mutual = json.loads(config.get_json("transport/link/tls/enable_mtls"))
    return _has_users(users) or (bool(mutual) and all(e.startswith(_CERTIFIED) for e in _listened(config)))


def _has_users(path: str | None) -> bool:
    """The file of users has one: with an empty one zenoh lets everybody in."""
    try:
        return path is not None and any(":" in line for line in read_text(Path(path)).splitlines())
    except InputError:
        return True  # then zenoh does not open at all, and says why


def reason(error: Exception) -> str:
    """zenoh's error without the lines of its source."""
    text = re.split(r"\s+at /|\.\] at ", str(error).replace("\n", " "))[0].strip(" []!")
    known = (said for mark, said in _PLAIN_WORDS.items() if mark in text)
    return next(known, text[:200])


def _checked(endpoint: str, section: str = TELEMETRY) -> str:
    """The endpoint, if zenoh can understand it: it would say so only when it opens."""
    match = _ADDRESS.match(endpoint)
    if endpoint.startswith(_LOCAL_LINKS) or (match and 0 < int(match[1]) < 65536):
        return endpoint
    raise InputError("", f"{section}.endpoint", f"{endpoint!r}: expected something like {ENDPOINT}")


def _configured(keys: Mapping[str, Any], extras: Mapping[str, Any], section: str = TELEMETRY) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (*_CLOSED.items(), *keys.items()):
        config.insert_json5(key, json.dumps(value))
    for key, value in _leaves(extras):
        try:
            config.insert_json5(key, json.dumps(value))
        except (zenoh.ZError, TypeError) as error:
            raise InputError("", f"{section}.zenoh.{key}", f"zenoh refuses it: {reason(error)}") from None
    return config


def _leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Slash keys of a nested mapping; rules of access control belong together and stay whole."""
    for name, value in tree.items():
        key = f"{above}/{name}" if above else str(name)
        if isinstance(value, Mapping) and key != "access_control":
            yield from _leaves(value, key)
        else:
            yield key, value
