"""A container whose first process is systemd: booted above a root that stays as it is, and spoken to by nsenter.

Rules of this file: knows nothing of the daemon; the container is registered nowhere, and whatever runs in it ends
with it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from pi.steps import StepError, demand, run, wait_until

BOOT_S = 60.0
POWER_OFF_S = 15.0
COMMAND_S = 60.0
# systemd 252 takes a machine's cgroups of either version; its own controllers need the second one.
UNIFIED = {"SYSTEMD_NSPAWN_UNIFIED_HIERARCHY": "1"}
# What `systemctl is-system-running` says at the end of a boot; a container has no devices, so that units may fail.
BOOTED = ("running", "degraded")
_ENTER = ("--mount", "--uts", "--ipc", "--pid", "--cgroup", "--root", "--wd")
ENVIRONMENT = {
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
    "LANG": "C.UTF-8",
}


class Container:
    """A running one."""

    def __init__(self, pid: int) -> None:
        self._pid = pid

    def run(
        self,
        *command: str,
        seconds: float = COMMAND_S,
        codes: tuple[int, ...] = (0,),
        environment: Mapping[str, str] | None = None,
    ) -> str:
        """What a command inside printed."""
        words = ["nsenter", f"--target={self._pid}", *_ENTER, *command]
        return run(words, seconds, environment={**ENVIRONMENT, **(environment or {})}, codes=codes)

    def shell(self, text: str, seconds: float = COMMAND_S) -> str:
        """The same for a line of the shell."""
        return self.run("sh", "-euc", text, seconds=seconds)

    def properties(self, unit: str, *names: str) -> dict[str, str]:
        """What systemd says of a unit."""
        lines = self.run("systemctl", "show", unit, *(f"--property={name}" for name in names)).splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)


@contextmanager
def booted(root: Path, read_only: Mapping[str, Path]) -> Iterator[Container]:
    """Boot this root with these folders of ours in it (name inside -> folder), until the block ends."""
    command = ["systemd-nspawn", "--quiet", "--boot", "--register=no", "--keep-unit", "--console=pipe", "-D", str(root)]
    command += ["--system-call-filter=bpf"]  # systemd's filters of devices and addresses are programs of that call
    command += [f"--bind-ro={folder}:{name}" for name, folder in read_only.items()]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **UNIFIED},
        start_new_session=True,
    ) as nspawn:
        try:
            container = Container(_first_process(nspawn))
            wait_until(lambda: _has_booted(container), BOOT_S, "the container has booted")
            yield container
        finally:
            _power_off(nspawn)


def _first_process(nspawn: subprocess.Popen[bytes]) -> int:
    """Process 1 of the container as we see it: the child of nspawn that is the first of its own name space."""
    deadline = time.monotonic() + BOOT_S
    while time.monotonic() < deadline:
        demand(nspawn.poll() is None, f"systemd-nspawn ended with code {nspawn.returncode}")
        for pid in _children(nspawn.pid):
            with contextlib.suppress(OSError, StopIteration):
                lines = Path(f"/proc/{pid}/status").read_text().splitlines()
                if next(line for line in lines if line.startswith("NSpid:")).split()[-1] == "1":
                    return pid
        time.sleep(0.1)
    raise StepError("no first process in the container")


def _children(pid: int) -> list[int]:
    """Descendants of a process."""
    with contextlib.suppress(OSError):
        mine = [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
        return [*mine, *(below for child in mine for below in _children(child))]
    return []


def _has_booted(container: Container) -> bool:
    with contextlib.suppress(StepError):
        text = container.run("systemctl", "is-system-running", seconds=10.0, codes=tuple(range(256)))
        return text.strip() in BOOTED
    return False


def _power_off(nspawn: subprocess.Popen[bytes]) -> None:
    """Ask for a power-off, then end it: the container's processes go with its first one."""
    for number, patience_s in ((signal.SIGTERM, POWER_OFF_S), (signal.SIGKILL, POWER_OFF_S)):
        with contextlib.suppress(OSError):
            nspawn.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            nspawn.wait(patience_s)
            return
