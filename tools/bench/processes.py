"""Processes of the benches: started here, ended here, and gone when the bench is killed.

Rules of this file: nothing is measured here; only processes that were started here are ended here.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
FIFO = ("chrt", "--fifo", "50")
END_PATIENCE_S = 10.0
# A pure loop of the interpreter that looks now and then whether the bench still lives.
BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    for _ in range(1_000_000): pass"
_QUIET: dict[str, Any] = {"stdout": subprocess.DEVNULL}


def fifo_granted() -> bool:
    """A child may have real-time priority here."""
    with contextlib.suppress(OSError):
        return subprocess.call([*FIFO, "true"], stderr=subprocess.DEVNULL) == 0
    return False


def free_port() -> int:
    """A port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def process(command: list[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A child that ends with the block: asked first, killed when it does not listen."""
    child = subprocess.Popen(command, **options)
    try:
        yield child
    finally:
        if child.stdin is not None:
            child.stdin.close()
        else:
            child.terminate()
        try:
            child.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


@contextmanager
def busy_processes(count: int, nice: int = 0) -> Iterator[None]:
    """Processes that want a whole core each, with ordinary priority at this niceness."""
    with contextlib.ExitStack() as stack:
        for _ in range(count):
            stack.enter_context(process(["nice", "-n", str(nice), sys.executable, "-c", BUSY]))
        yield


@contextmanager
def witness(out: Path) -> Iterator[None]:
    """The independent witness (witness.py); its file is there after the block."""
    command = [sys.executable, str(HERE / "witness.py"), str(out)]
    with process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()  # all of its watchers are up
        yield


def daemon_command(seconds: float, *arguments: str, fifo: bool = False) -> list[str]:
    """The daemon against the rig, without a port that another one could hold."""
    endpoint = f"telemetry.endpoint=tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "hoopd", "--sim", "--duration", str(seconds), "--set", endpoint, *arguments]
    return [*FIFO, *command] if fifo else command


@contextmanager
def daemon(command: list[str], errors: IO[bytes] | None = None, root: Path = ROOT) -> Iterator[subprocess.Popen[bytes]]:
    """A running daemon of the tree `root`; what it logs goes to `errors`."""
    log = subprocess.DEVNULL if errors is None else errors
    with process(command, cwd=root, stderr=log, **_QUIET) as child:
        yield child


def wait_for(child: subprocess.Popen[bytes], seconds: float, patience_s: float = 30.0) -> None:
    """Wait for its end with a line of progress; RuntimeError when it does not come."""
    begun = time.monotonic()
    while child.poll() is None:
        elapsed = time.monotonic() - begun
        if elapsed > seconds + patience_s:
            raise RuntimeError("the daemon did not end by itself")
        progress(f"{elapsed:6.0f} of {seconds:.0f} s")
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(1.0)
    progress("")


def progress(text: str) -> None:
    """One line on a terminal that the next one replaces."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[2K{text}")
        sys.stderr.flush()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
