"""What the installed unit grants its service, and what it keeps from it.

Rules of this file: what is judged is what the kernel says of the service's process, and what a program finds that runs
in the daemon's place with every other line of the unit as it is.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pi import machine
from pi.container import Container
from pi.steps import SkippedError, StepError, demand, last_line, wait_until

PYTHON = "/opt/hoopd/bin/python"
UNIT = "/etc/systemd/system/hoopd.service"
PROBE = "hoopd-probe"
DROP_IN = "/etc/systemd/system/hoopd.service.d/cores.conf"
START_S = 40.0
ARM_S = 60.0
# LimitRTTIME is 5 s of processor time; more of the clock beside a load.
SPIN_S = 40.0
SIGXCPU = 24


def granted(inside: Container) -> str:
    """Priority, limits, user."""
    pid = inside.properties("hoopd", "MainPID")["MainPID"]
    policy = inside.run("chrt", "-p", pid)
    demand("SCHED_FIFO" in policy and "priority: 50" in policy, policy.replace("\n", "; "))
    lines = inside.run("cat", f"/proc/{pid}/limits").splitlines()
    limits = {line[:26].strip(): line[26:].split()[0] for line in lines}
    demand(limits["Max realtime timeout"].isdigit(), "no limit of time in real time")
    user = inside.run("ps", "-o", "user=", "-p", pid).strip()
    demand(user == "hoopd", f"runs as {user}")
    return f"FIFO 50, user hoopd, may spin for {limits['Max realtime timeout']} us"


def locked(inside: Container) -> str:
    """The daemon's memory stays in memory."""
    _need_limits()
    pid = inside.properties("hoopd", "MainPID")["MainPID"]
    words = inside.shell(f"grep VmLck /proc/{pid}/status").split()
    demand(int(words[1]) > 0, "no memory is locked")
    return f"{int(words[1]) // 1024} MiB of mappings"


def _need_limits() -> None:
    if not machine.may_raise_limits():
        raise SkippedError("this machine's root may not raise limits (CAP_SYS_RESOURCE): LimitRTPRIO, LimitMEMLOCK")


def operators(inside: Container) -> str:
    """The group hoopd commands, a stranger does not."""
    inside.shell("id engineer >/dev/null 2>&1 || useradd --groups hoopd engineer")
    inside.run("runuser", "-u", "engineer", "--", "hoopd", "status")
    said = arm(inside, "runuser", "-u", "engineer", "--")
    refused = inside.run("runuser", "-u", "nobody", "--", "hoopd", "arm", codes=(2,))
    inside.run("runuser", "-u", "engineer", "--", "hoopd", "disarm")
    return f"group hoopd: {said.strip()}; a stranger: {last_line(refused)}"


def arm(inside: Container, *before: str) -> str:
    """What the daemon answered to an arm that it took; beside a load the rig may have to come back first."""
    said: list[str] = []

    def taken() -> bool:
        said.append(inside.run(*before, "hoopd", "arm", codes=(0, 2)))
        return "refused" not in said[-1] and "DISARMED" not in said[-1]

    with contextlib.suppress(StepError):
        wait_until(taken, ARM_S, "armed", 1.0)
        return said[-1]
    raise StepError(f"not armed within {ARM_S:.0f} s: {last_line(said[-1])}")


def own_core(inside: Container) -> str:
    """A drop-in holds every thread to a core, and `hoopd check` tells."""
    core = max(int(name) for name in inside.shell("ls -d /sys/devices/system/cpu/cpu[0-9]* | tr -dc '0-9\\n'").split())
    inside.shell(
        f"mkdir -p {DROP_IN.rpartition('/')[0]}; printf '[Service]\\nCPUAffinity={core}\\n' > {DROP_IN};"
        "systemctl daemon-reload; systemctl start hoopd"
    )
    try:
        pid = inside.properties("hoopd", "MainPID")["MainPID"]
        allowed = set(inside.shell(f"grep -h Cpus_allowed_list /proc/{pid}/task/*/status | cut -f2").split())
        demand(allowed == {str(core)}, f"threads may run on {', '.join(sorted(allowed))}")
        inside.run("systemctl", "stop", "hoopd")
        row = {row["name"]: row for row in checks(inside)}["cores"]
        demand(f"may run on {core} (the unit)" in row["granted"], row["granted"])
        return f"{row['granted']}: {row['verdict']}, {row['advice']}"
    finally:
        inside.shell(f"systemctl stop hoopd; rm -f {DROP_IN}; systemctl daemon-reload")


def checks(inside: Container) -> list[dict[str, str]]:
    """Rows of `hoopd check`, while the service does not run."""
    inside.run("hoopd", "check", "--config", "/etc/hoopd/hoop.yaml", "--json", "/tmp/check.json", codes=(0, 1))
    rows: list[dict[str, str]] = json.loads(inside.run("cat", "/tmp/check.json"))["checks"]
    return rows


def spinning(inside: Container) -> str:
    """A thread that spins at a helper's priority is ended by the kernel."""
    with _in_its_place(inside, f"{PYTHON} -c 'while True: pass'", "CPUSchedulingPriority=1"):
        inside.run("systemctl", "start", PROBE)
        took = wait_until(lambda: _probe(inside)["ActiveState"] == "failed", SPIN_S, "the end of what spins", 0.5)
        state = _probe(inside)
    demand(state["ExecMainStatus"] == str(SIGXCPU), f"{state}")
    return f"ended after {took:.0f} s by SIGXCPU ({state['Result']})"


def sandbox(inside: Container) -> str:
    """What a program in the daemon's place reaches."""
    told = _look_around(inside)
    demand(not told["wrong"], "; ".join(told["wrong"]))
    refused = ", ".join(f"{name} ({reason})" for name, reason in told["must_not"].items())
    return f"reaches {', '.join(told['must'])}; not {refused}"


def sandbox_realtime(inside: Container) -> str:
    """Whether a program in the daemon's place has real-time priority and locked memory for the asking."""
    _need_limits()
    told = _look_around(inside, "realtime")
    demand(not told["wrong"], "; ".join(told["wrong"]))
    return f"reaches {', '.join(told['must'])}"


def _look_around(inside: Container, *words: str) -> dict[str, Any]:
    """What the probe found."""
    inside.shell("cp /src/tools/pi/probe.py /opt/probe.py; rm -f /dev/probe-kmsg; mknod -m 666 /dev/probe-kmsg c 1 11")
    with _in_its_place(inside, f"{PYTHON} /opt/probe.py {' '.join(words)}"):
        with contextlib.suppress(StepError):
            inside.run("systemctl", "start", PROBE)
        wait_until(lambda: _probe(inside)["ActiveState"] in ("inactive", "failed"), START_S, "the end of the probe")
        lines = inside.run("journalctl", f"--unit={PROBE}", "--output=cat", "--no-pager").splitlines()
    inside.shell("rm -f /opt/probe.py /dev/probe-kmsg")
    told = [json.loads(line) for line in lines if line.startswith("{")]
    demand(bool(told), last_line("\n".join(lines)))
    return dict(told[-1])


def _probe(inside: Container) -> dict[str, str]:
    return inside.properties(PROBE, "ActiveState", "Result", "ExecMainStatus")


@contextmanager
def _in_its_place(inside: Container, command: str, *changes: str) -> Iterator[None]:
    """A unit as the service's, with another program (and these lines); gone afterwards."""
    path = f"/etc/systemd/system/{PROBE}.service"
    lines = (f"ExecStart={command}", "Type=exec", "Restart=no", "WatchdogSec=0", *changes)
    edits = " ".join(f'-e "s|^{line.split("=")[0]}=.*|{line}|"' for line in lines)
    inside.shell(f"sed {edits} {UNIT} > {path}; systemctl daemon-reload")
    try:
        yield
    finally:
        inside.shell(f"systemctl stop {PROBE}; systemctl reset-failed {PROBE} || true; rm -f {path}")
        inside.shell("systemctl daemon-reload")
