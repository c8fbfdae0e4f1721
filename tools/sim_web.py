#!/usr/bin/env python3
"""The rig and the web page beside it, in one command: prints the page's address, ends both with Ctrl-C.

Rules of this file: it only starts what a person would type in two terminals, in a folder that goes with it; it ends no
process but those two. Usage: tools/sim_web.py [--listen 127.0.0.1:8765] [--recordings FOLDER]
[--controllers FOLDER] [--camera direct] [--set KEY=VALUE ...] [--seconds N]
"""

from __future__ import annotations

import argparse
import contextlib
import json
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from hoopd.files.shipped import defaults_folder

END_S = 8.0  # a controlled stop
WATCH_S = 0.2
USER = "operator"
CALIBRATION = "calibration"


def free_endpoint() -> str:
    """A loopback port that nobody has: a daemon of the machine keeps its own."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def configuration(folder: Path, password: str) -> Path:
    """What both processes read: one user who may drive from the page."""
    users, path = folder / "users.txt", folder / "web.yaml"
    users.touch(mode=0o600)
    users.write_text(f"{USER}:{password}\n", encoding="utf-8")
    proof = {
        "user": "hoop",
        "password": "unused",
        "dictionary_file": str(users),
    }  # zenoh wants the daemon to have a name
    control = {"endpoint": free_endpoint(), "zenoh": {"transport": {"auth": {"usrpwd": proof}}}}
    (folder / CALIBRATION).mkdir()
    content = {
        "telemetry": {"endpoint": free_endpoint(), "commands": True, "control": control},
        "calibration": {"folder": str(folder / CALIBRATION)},
    }
    path.write_text(json.dumps(content), encoding="utf-8")  # JSON is YAML, too
    return path


def controllers(folder: Path) -> tuple[str, ...]:
    """The shipped controllers in a folder that the page may lay others into, and the one that the rig begins with."""
    folder.mkdir(exist_ok=True)
    for path in (defaults_folder() / "controllers").glob("*.yaml"):
        if not (folder / path.name).exists():
            shutil.copyfile(path, folder / path.name)
    return "--set", f"control.file={folder / 'lqg.yaml'}"


def started(*words: str, first: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    """A command of ours, as a process that takes the same Ctrl-C; `first`: a program that starts it."""
    return subprocess.Popen([*first, sys.executable, "-m", "hoopd", *words])


def ended(processes: list[subprocess.Popen[bytes]]) -> int:
    """Ask all to end, the rig first; the worst exit code of those that ended by themselves."""
    code = max((process.poll() or 0 for process in processes), default=0)
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
    for process in processes:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    return code


def main() -> int:
    """Exit code 0 when it was told to end, else that of the process that ended first."""
    parser = argparse.ArgumentParser(description="Run the rig and its web page.")
    parser.add_argument("--listen", default="127.0.0.1:8765", help="where the page is served")
    parser.add_argument("--seconds", type=float, help="end after this time")
    parser.add_argument(
        "--recordings", type=Path, help="where the rig records and the page works; goes with it unless told"
    )
    parser.add_argument("--controllers", type=Path, help="folder of controllers of the rig; goes with it unless told")
    parser.add_argument("--camera", choices=("direct",), help="direct: the ball's angle without rendered pictures")
    parser.add_argument("--set", dest="sets", action="append", default=[], help="a key of the rig's configuration")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="hoopd-web-") as folder:
        password = secrets.token_hex(4)
        shared = ("--config", str(configuration(Path(folder), password)))
        print(f"to drive from the page, log in as {USER} with the password {password}", flush=True)
        recordings = options.recordings or Path(folder) / "recordings"
        recordings.mkdir(exist_ok=True)
        loaded = (options.controllers or Path(folder) / "controllers").resolve()
        eye = () if options.camera is None else ("--camera", options.camera)
        own = [*controllers(loaded), *eye, *(word for one in options.sets for word in ("--set", one))]
        bench = ("--recordings", str(recordings), "--controllers", str(loaded))
        processes = [
            started("--sim", "--record", str(recordings), *shared, *own),
            started("dashboard", *shared, "--listen", options.listen, *bench),
        ]
        until = None if options.seconds is None else time.monotonic() + options.seconds
        with contextlib.suppress(KeyboardInterrupt):
            while all(process.poll() is None for process in processes) and (until is None or time.monotonic() < until):
                time.sleep(WATCH_S)
        return ended(processes)


if __name__ == "__main__":
    sys.exit(main())
