"""zenoh sessions of ours: what they listen to, whom they reach, and what their errors mean in one line.

Rules of this file: zenoh's own defaults listen on every interface and look for peers by multicast, so everything is set
here: loopback, no scouting, no gossip, no shared memory. What the configuration adds are zenoh's own keys, unchanged.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

import zenoh

from hoopd.files import InputError

DEVICE = "hoop"
ENDPOINT = "tcp/127.0.0.1:7447"
_LOOPBACK = re.compile(r"^[a-z]+/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d+")
_ADDRESS = re.compile(r"^(?:tcp|udp|tls|quic|ws)/(?:\[[^\]\s]+\]|[^\s/:\[]+):(\d{1,5})(?:[?#]\S*)?$")
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


def listening(endpoint: str, extras: Mapping[str, Any]) -> zenoh.Config:
    """Configuration of the daemon's peer: listens at the endpoint, connects nowhere; InputError for a wrong key."""
    keys = {"mode": "peer", "listen/endpoints": [_checked(endpoint)], "connect/endpoints": []}
    return _configured(keys, extras)


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
    endpoints = json.loads(config.get_json("listen/endpoints"))
    listed = endpoints if isinstance(endpoints, list) else [e for part in endpoints.values() for e in part]
    return [e for e in listed if not _LOOPBACK.match(e) and not e.startswith(_LOCAL_LINKS)]


def asks_who(config: zenoh.Config) -> bool:
    """Peers must prove who they are: user and password, or a certificate."""
    user = json.loads(config.get_json("transport/auth/usrpwd/dictionary_file"))
    mutual = json.loads(config.get_json("transport/link/tls/enable_mtls"))
    return bool(user) or bool(mutual)


def reason(error: Exception) -> str:
    """zenoh's error without the lines of its source."""
    text = re.split(r"\s+at /|\.\] at ", str(error).replace("\n", " "))[0].strip(" []!")
    known = (said for mark, said in _PLAIN_WORDS.items() if mark in text)
    return next(known, text[:200])


def _checked(endpoint: str) -> str:
    """The endpoint, if zenoh can understand it: it would say so only when it opens."""
    match = _ADDRESS.match(endpoint)
    if endpoint.startswith(_LOCAL_LINKS) or (match and 0 < int(match[1]) < 65536):
        return endpoint
    raise InputError("", "telemetry.endpoint", f"{endpoint!r}: expected something like {ENDPOINT}")


def _configured(keys: Mapping[str, Any], extras: Mapping[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (*_CLOSED.items(), *keys.items()):
        config.insert_json5(key, json.dumps(value))
    for key, value in _leaves(extras):
        try:
            config.insert_json5(key, json.dumps(value))
        except (zenoh.ZError, TypeError) as error:
            raise InputError("", f"telemetry.zenoh.{key}", f"zenoh refuses it: {reason(error)}") from None
    return config


def _leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Slash keys of a nested mapping; rules of access control belong together and stay whole."""
    for name, value in tree.items():
        key = f"{above}/{name}" if above else str(name)
        if isinstance(value, Mapping) and key != "access_control":
            yield from _leaves(value, key)
        else:
            yield key, value
