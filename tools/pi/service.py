"""The installed service under a real systemd: its start, its end, and everything that may go wrong between them.

Rules of this file: the daemon is what `make install` put there; its board and camera are the rig's, in the same
container; what is judged is what systemd, the journal and the board's own log say.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pi import machine, rights, roots
from pi.container import Container, booted
from pi.machine import ROOT
from pi.steps import Step, demand, run, wait_until

INSTALL_S = 600.0
PORT = "/dev/hoop-driver"
RIG = "/run/rig"
CONFIG = f"""camera: {{command: [{rights.PYTHON}, -m, hoopd.sim.camera, --rig, {RIG}/camera.json]}}
faults: {{torque_constant_nm_per_a: 0.37}}
log: {{format: json}}
"""
KEEP_UP = "while sleep 0.2; do pgrep -f hoopd.sim.camera | xargs -r -n1 chrt --all-tasks --fifo --pid 40; done"
# More tries than systemd's own limit (5 in 10 s), and more than any that a person would set by hand.
TRIES = 7
TRIES_S = 120.0
START_S = 40.0
ARM_S = 20.0
WATCHDOG_S = 2.0
RESTART_S = 40.0
BOARD_TIMEOUT_S = 0.1
MARGIN_S = 0.1
# Installed files that an uninstallation leaves, and such that it takes.
KEPT = ("/etc/hoopd/hoop.yaml", "/var/lib/hoopd")
TAKEN = ("/opt/hoopd", "/usr/local/bin/hoopd", "/etc/systemd/system/hoopd.service", "/etc/udev/rules.d/99-hoopd.rules")


class Service:
    """The service in its container."""

    def __init__(self, container: Container) -> None:
        self._in = container
        self._hung_s = 0.0

    def steps(self) -> list[Step]:
        """All of them, in order."""
        return [
            Step("systemd: boots as process 1", self._look, needed=True),
            Step("systemd: make install", self._install, needed=True),
            Step("systemd: no port: exit code 3, tried again without end", self._miss_port),
            Step("systemd: the port comes late: READY, DISARMED", self._plug_in, needed=True),
            Step("systemd: priority, limits, user as granted", lambda: rights.granted(self._in)),
            Step("systemd: locked memory", lambda: rights.locked(self._in)),
            Step("systemd: operators are the group hoopd", lambda: rights.operators(self._in)),
            Step("systemd: arms on command", self._arm),
            Step("systemd: a hung loop is ended by the watchdog, torque zero", self._hang),
            Step("systemd: started again, DISARMED", self._restarted),
            Step("systemd: journal holds the log", self._journal),
            Step("systemd: stop is clean and leaves a recording that replays", self._stop),
            Step("systemd: hoopd check", self._check),
            Step("systemd: CPUAffinity holds it to a core, hoopd check tells", lambda: rights.own_core(self._in)),
            Step("systemd: sandbox reaches what it must and nothing else", lambda: rights.sandbox(self._in)),
            Step("systemd: sandbox leaves real-time priority", lambda: rights.sandbox_realtime(self._in)),
            Step("systemd: what spins at real-time priority is ended", lambda: rights.spinning(self._in)),
            Step("systemd: make uninstall leaves recordings and configuration", self._uninstall),
            Step("systemd: make uninstall PURGE=1 leaves nothing", self._purge),
        ]

    def _look(self) -> str:
        version = self._in.run("systemctl", "--version").splitlines()[0]
        demand("systemd" in self._in.run("cat", "/proc/1/comm"), "process 1 is not systemd")
        return version

    def _install(self) -> str:
        self._make("install")
        self._in.shell(f"cat > /etc/hoopd/hoop.yaml <<'EOF'\n{CONFIG}EOF")
        demand("enabled" in self._in.run("systemctl", "is-enabled", "hoopd"), "not enabled")
        self._in.run("id", "hoopd")
        return "from wheels of the lock file; unit enabled, user hoopd"

    def _make(self, *words: str) -> None:
        offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "/wheels", "PYTHONDONTWRITEBYTECODE": "1"}
        self._in.run("make", "-C", "/src", *words, "PYTHON=/usr/bin/python3", seconds=INSTALL_S, environment=offline)

    def _state(self) -> dict[str, str]:
        names = ("ActiveState", "SubState", "Result", "MainPID", "ExecMainStatus", "NRestarts", "StatusText")
        return self._in.properties("hoopd", *names)

    def _miss_port(self) -> str:
        self._in.run("systemctl", "start", "--no-block", "hoopd")
        took = wait_until(lambda: int(self._state()["NRestarts"]) >= TRIES, TRIES_S, f"{TRIES} tries", 1.0)
        state = self._state()
        demand(state["ExecMainStatus"] == "3" or state["SubState"] != "auto-restart", f"exit {state['ExecMainStatus']}")
        said = self._log_lines("serial.port")
        demand(bool(said), "the journal does not name the port")
        demand(len(self._log_lines("Traceback")) == 0, "a traceback in the journal")
        return f"{TRIES} tries in {took:.0f} s, {state['SubState']}; says: {said[-1]}"

    def _plug_in(self) -> str:
        self._start_rig()
        took = wait_until(lambda: self._state()["ActiveState"] == "active", START_S, "active")
        text = wait_until_status(self, "DISARMED", START_S)
        return f"{took:.0f} s after the port came: {text}"

    def _start_rig(self) -> None:
        """The board and its port, with the rights that udev's rule would give it."""
        fifo = ("--property=CPUSchedulingPolicy=fifo", "--property=CPUSchedulingPriority=40")
        rig = (rights.PYTHON, "/src/tools/pi/rig.py", PORT, RIG)
        self._in.run("systemd-run", "--unit=rig", "--quiet", *fifo, *rig)
        # The service's children begin at ordinary priority, and the rig has to keep up beside any load.
        self._in.run("systemd-run", "--unit=rig-priority", "--quiet", "sh", "-c", KEEP_UP)
        wait_until(lambda: bool(self._in.shell(f"readlink {PORT} || true").strip()), START_S, "the rig's port")
        self._in.shell(f"chgrp dialout $(readlink -f {PORT}); chmod 660 $(readlink -f {PORT})")

    def _arm(self) -> str:
        rights.arm(self._in)
        return wait_until_status(self, "RUNNING", ARM_S)

    def _hang(self) -> str:
        """A stopped process ticks no more, as one that hangs."""
        before = self._state()["MainPID"]
        hung = time.monotonic()
        self._in.run("kill", "-STOP", before)
        self._hung_s = hung
        wait_until(lambda: bool(self._log_lines("Watchdog timeout")), WATCHDOG_S + 10.0, "the watchdog")
        ended = wait_until(lambda: self._state()["MainPID"] != before, RESTART_S, "the hung process is gone")
        after = [row["t"] - hung for row in self._torque() if row["t"] > hung and row["torque_nm"] != 0.0]
        last = max(after, default=0.0)
        demand(last <= BOARD_TIMEOUT_S + MARGIN_S, f"torque {last:.3f} s after the loop hung")
        armed = any(row["torque_nm"] != 0.0 for row in self._torque() if hung - 1.0 < row["t"] <= hung)
        demand(armed, "no torque before the hang")
        return f"board: zero after {last:.3f} s at the latest; process gone {ended + 0.0:.0f} s after the watchdog"

    def _restarted(self) -> str:
        wait_until(lambda: self._state()["ActiveState"] == "active", RESTART_S, "active again")
        text = wait_until_status(self, "DISARMED", RESTART_S)
        time.sleep(1.0)
        begun = self._hung_s + 1.0
        demand(all(row["torque_nm"] == 0.0 for row in self._torque() if row["t"] > begun), "torque after the restart")
        return text

    def _torque(self) -> list[dict[str, Any]]:
        """The board's own log; times are of the machine's monotonic clock."""
        return [json.loads(line) for line in self._in.run("cat", f"{RIG}/torque.jsonl").splitlines()]

    def _journal(self) -> str:
        lines = [json.loads(line) for line in self._journal_lines() if line.startswith("{")]
        modes = [line["mode"] for line in lines if line.get("event") == "mode"]
        demand("RUNNING" in modes, f"modes in the journal: {modes}")
        trouble = self._in.run("journalctl", "--unit=hoopd", "--priority=warning", "--output=cat", "--no-pager")
        told = [json.loads(line) for line in trouble.splitlines() if line.startswith("{")]
        demand(all(fact["level"] != "info" for fact in told), "plain facts among the trouble")
        wanted = [fact for fact in lines if fact["level"] != "info"]
        demand(len(told) == len(wanted), f"{len(told)} of {len(wanted)} warnings have their priority")
        return f"{len(lines)} facts as JSON, {len(told)} of them trouble (-p warning), modes {', '.join(modes)}"

    def _journal_lines(self) -> list[str]:
        return self._in.run("journalctl", "--unit=hoopd", "--output=cat", "--no-pager").splitlines()

    def _log_lines(self, part: str) -> list[str]:
        return [line for line in self._journal_lines() if part in line]

    def _stop(self) -> str:
        self._in.run("systemctl", "stop", "hoopd")
        state = self._state()
        demand((state["ActiveState"], state["Result"]) == ("inactive", "success"), f"{state}")
        demand(self._torque()[-1]["torque_nm"] == 0.0, "torque after the stop")
        paths = self._in.shell("ls -tr /var/lib/hoopd/*.mcap").split()
        self._in.run("hoopd", "replay", paths[0], seconds=INSTALL_S)
        return f"{len(paths)} recordings, the first replays bit for bit"

    def _check(self) -> str:
        rows = rights.checks(self._in)
        failed = [f"{row['name']}: {row['granted']}" for row in rows if row["verdict"] == "fail"]
        demand(not failed, "; ".join(failed))
        return ", ".join(f"{row['name']} {row['verdict']}" for row in rows)

    def _uninstall(self) -> str:
        self._make("uninstall")
        self._there(KEPT, TAKEN)
        return f"kept {', '.join(KEPT)}; taken {', '.join(TAKEN)}"

    def _purge(self) -> str:
        self._make("uninstall", "PURGE=1")
        self._there((), (*KEPT, *TAKEN))
        demand("hoopd" not in self._in.run("cat", "/etc/passwd"), "the user is still there")
        return "recordings, configuration and user are gone"

    def _there(self, kept: tuple[str, ...], taken: tuple[str, ...]) -> None:
        found = self._in.shell(f"ls -d {' '.join((*kept, *taken))} 2>/dev/null || true").split()
        demand(sorted(found) == sorted(kept), f"left: {', '.join(found) or 'nothing'}")

    def status(self) -> str:
        """The service's own line."""
        return self._state()["StatusText"]


def wait_until_status(service: Service, mode: str, seconds: float) -> str:
    """The service's line once it tells this mode."""
    wait_until(lambda: service.status().startswith(mode), seconds, f"status {mode}")
    return service.status()


@contextmanager
def running(scratch: Path) -> Iterator[Service]:
    """A booted container for the service, above the kept root."""
    machine.need("debootstrap", "systemd-nspawn", "nsenter")
    root = machine.overlay(roots.userland("amd64"), scratch / "amd64")
    run(["rm", "-f", root / "etc/machine-id"], 20)  # a new one at each boot, as a fresh machine
    with booted(root, {"/src": ROOT, "/wheels": roots.wheels("amd64")}) as container:
        yield Service(container)
