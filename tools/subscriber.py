"""Watch a running daemon: one live line a second, or every message as JSON lines.

An example to copy from. It shows the five things that a subscriber should do: connect as a client to one endpoint
(no scouting), take samples from a ring instead of a callback (a callback's thread keeps the process alive), always
close the session (`with`), read null as "missing", and tell daemons apart by the name of their run, the attachment.

    python tools/subscriber.py                      # until Ctrl-C
    python tools/subscriber.py --seconds 10 --json  # JSON lines, at most ten seconds
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import zenoh

RING = 500  # ten seconds of ticks: a slow terminal loses the oldest, the daemon never waits for it


def connect(endpoint: str, extras: dict[str, Any]) -> zenoh.Session:
    """A client session; `extras` are zenoh's own keys (user, certificate)."""
    config = zenoh.Config()
    base = {"mode": "client", "connect/endpoints": [endpoint], "scouting/multicast/enabled": False}
    for key, value in {**base, **extras}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Line:
    """What the live line shows of the messages of the last second."""

    def __init__(self) -> None:
        self.ticks, self.begun = 0, time.monotonic()
        self.fresh = True  # something came since the line before
        self.tick: dict[str, Any] = {}
        self.status: dict[str, Any] = {}

    def add(self, kind: str, message: dict[str, Any]) -> None:
        """Take one message."""
        self.fresh = True
        if kind == "tick":
            self.ticks, self.tick = self.ticks + 1, message
        elif kind == "status":
            self.status = message

    def text(self, run: str) -> str:
        """The line; counting begins anew."""
        rate = self.ticks / max(1e-9, time.monotonic() - self.begun)
        self.ticks, self.begun, self.fresh = 0, time.monotonic(), self.ticks > 0
        dropped = self.status.get("telemetry", {}).get("dropped", "-")
        psi, torque = _number(self.tick.get("psi"), "rad"), _number(self.tick.get("u"), "N m")
        mode = self.tick.get("mode", "-")
        return f"{run[:8]:8} {rate:5.1f} ticks/s  {mode:<9} psi {psi}  torque {torque}  dropped {dropped}"


def _number(value: float | None, unit: str) -> str:
    return f"{'-':>7} {unit}" if value is None else f"{value:+7.3f} {unit}"


def watch(session: zenoh.Session, options: argparse.Namespace) -> int:
    """Print what comes until enough has come; the number of ticks seen."""
    begun, shown, seen = time.monotonic(), time.monotonic(), 0
    lines: dict[str, Line] = {}  # by run: two daemons of one name are two lines
    ring = session.declare_subscriber(f"hoopd/{options.device}/*", zenoh.handlers.RingChannel(RING))
    while (options.count is None or seen < options.count) and not _over(begun, options.seconds):
        sample = ring.try_recv()
        if sample is None:
            time.sleep(0.005)
        else:
            kind, message = str(sample.key_expr).rsplit("/", 1)[1], json.loads(sample.payload.to_bytes())
            run = sample.attachment.to_string() if sample.attachment is not None else ""
            seen += kind == "tick"
            lines.setdefault(run, Line()).add(kind, message)
            if options.json:
                print(json.dumps({"key": kind, "session": run, **message}), flush=True)
        if not options.json and time.monotonic() - shown >= 1.0:
            shown = time.monotonic()
            end = "\r" if sys.stdout.isatty() and len(lines) == 1 else "\n"
            for run, line in lines.items():
                print(line.text(run), end=end, flush=True)
            lines = {run: line for run, line in lines.items() if line.fresh}
    return seen


def _over(begun: float, seconds: float | None) -> bool:
    return seconds is not None and time.monotonic() - begun >= seconds


def main() -> int:
    """Exit code 0 when ticks were seen, 1 without any, 2 when no daemon answers."""
    parser = argparse.ArgumentParser(description="watch a running hoopd")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447", help="where the daemon listens")
    parser.add_argument("--device", default="hoop", help="device.name of its configuration")
    parser.add_argument("--count", type=int, help="end after this many ticks")
    parser.add_argument("--seconds", type=float, help="end after this time")
    parser.add_argument("--json", action="store_true", help="every message as one line of JSON")
    parser.add_argument("--zenoh", type=Path, help="JSON file of zenoh's own keys (user, certificate)")
    options = parser.parse_args()
    extras = json.loads(options.zenoh.read_text(encoding="utf-8")) if options.zenoh else {}
    try:
        with connect(options.endpoint, extras) as session:
            seen = watch(session, options)
        if sys.stdout.isatty():
            print()
        return 0 if seen else 1
    except zenoh.ZError as error:
        print(f"no daemon answers at {options.endpoint}: {str(error).split(' at /')[0]}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print()
        return 0


if __name__ == "__main__":
    sys.exit(main())
