"""Programs beside the daemon that ask too much of it, as texts for an interpreter of their own.

Rules of this file: a text takes what it needs as arguments and is ended from outside; it imports `hoopd.shell` alone.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from harness.realrun import ENVIRONMENT

# Arguments: endpoint, command socket, seconds.
FLOOD = """
import sys, time, zenoh
from hoopd.shell.session import connecting
from hoopd.shell.operator import CommandError, ask
with zenoh.open(connecting(sys.argv[1], {}, 2.0)) as session:
    end = time.monotonic() + float(sys.argv[3])
    while time.monotonic() < end:
        for _ in range(20):
            session.get("hoopd/hoop/cmd/reference", zenoh.handlers.RingChannel(1), payload="0.1", timeout=0.5)
        try:
            ask({"command": "reference", "value": 0.1}, "hoop", sys.argv[2])
        except CommandError:
            pass
"""

# Argument: endpoint.
SUBSCRIBER = """
import sys, time, zenoh
from hoopd.shell.session import connecting
with zenoh.open(connecting(sys.argv[1], {}, 2.0)) as session:
    with session.declare_subscriber("hoopd/**", zenoh.handlers.FifoChannel(10)):
        print("ready", flush=True)
        time.sleep(30)
"""


# Queries far beyond what a message may have. Arguments: endpoint, bytes, settings of the session.
HUGE = """
import json, sys, zenoh
from hoopd.shell.session import connecting
with zenoh.open(connecting(sys.argv[1], json.loads(sys.argv[3]), 2.0)) as session:
    assert session.info.transports()
    for name in ("arm", "disarm"):
        for reply in session.get(f"hoopd/hoop/cmd/{name}", payload=bytes(int(sys.argv[2])), timeout=2.0):
            print(name, "taken" if reply.ok else reply.err.payload.to_string())
"""
# Connections that say nothing. Arguments: port, how many.
IDLE = """
import resource, socket, sys, time
hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
held = []
for _ in range(int(sys.argv[2])):
    one = socket.socket()
    one.settimeout(1.0)
    try:
        one.connect(("127.0.0.1", int(sys.argv[1])))
    except OSError:
        continue
    held.append(one)
print(len(held), flush=True)
time.sleep(60)
"""


@contextmanager
def neighbour(text: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process that talks to the daemon."""
    process = subprocess.Popen(
        [sys.executable, "-c", text, *arguments], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
