"""`hoopd heal` as a process beside a daemon on the clock: killed in a trial, the loop is back on what was accepted."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from harness.healed_rig import controllers_of
from harness.realrun import ENVIRONMENT, Daemon, fifo_granted

from hoopd.files.controller_folder import key_of
from hoopd.files.heal_versions import VersionFolder
from hoopd.shell.operator import CommandError

pytestmark = pytest.mark.realtime
# Until a process has begun and a trial acts: imports at low priority beside whatever else this machine does.
PATIENCE_S, START_S = 150.0, 60.0


def waited(until: Callable[[], bool], seconds: float) -> bool:
    """Whether it came to be so in time."""
    end = time.monotonic() + seconds
    while not until() and time.monotonic() < end:
        time.sleep(0.1)
    return until()


def kept_running(daemon: Daemon) -> bool:
    """Whether it controls; one whose rig had no processor time on a busy machine, and went off, is armed again."""
    if not daemon.socket.exists():
        return False
    mode = daemon.command("status")["status"]["mode"]
    for command in ("clear", "arm") if mode in ("FAULT", "DISARMED") else ():
        with contextlib.suppress(CommandError):
            daemon.command(command)
    return bool(mode == "RUNNING")


def times_off(daemon: Daemon) -> int:
    """How often it went off so far."""
    return sum(one.get("event") == "mode" and one.get("was") == "RUNNING" for one in daemon.log())


def proposed(folder: Path, controllers: Path) -> VersionFolder:
    """A loop as it was found, and one version that waits for a person: the same law, told to be weaker."""
    law = (controllers / "lqg.yaml").read_text()
    model = (controllers / "models" / "hoop.yaml").read_text()
    other = controllers / "heal-1.yaml"
    other.write_text(law.replace("k_psi: 0.12387277", "k_psi: 0.11"))
    versions = VersionFolder(folder)
    versions.begin("hoop")
    versions.first(key_of(controllers / "lqg.yaml"), law, model, 0.0, "ann")
    version = versions.add(1.0, key=key_of(other), kind="physics", reason="told", before=0)
    (versions.of(1) / "model.yaml").write_text(model)
    (versions.of(1) / "controller.yaml").write_text(other.read_text())
    version.sha256 = versions.hashes(1)
    version.evidence = {"promise": {"measured": 1.0, "before": 1.0, "new": 1.0}}
    version.state = "proposed"
    versions.keep(version, 1.0, "proposed")
    return versions


@pytest.mark.timeout(600)
def test_killed_in_a_trial_the_loop_goes_back_and_it_resumes_and_restores(tmp_path: Path) -> None:
    controllers = controllers_of(tmp_path)
    versions = proposed(tmp_path / "healed", controllers)
    config = {"control": {"file": str(controllers / "lqg.yaml")}}
    with Daemon(tmp_path, config=config, psi_rad=0.0, fifo=fifo_granted()) as daemon:

        def acting() -> str:
            kept_running(daemon)
            return str(daemon.command("status")["status"]["controller"]["file"])

        assert waited(lambda: kept_running(daemon), PATIENCE_S)
        sets = ["--set", f"commands.socket={daemon.socket}"]
        out = ["--out", str(versions.folder)]
        line = [sys.executable, "-m", "hoopd", "heal", "--recordings", str(daemon.record), "--connect", daemon.endpoint]
        line += ["--controllers", str(controllers), *out, *sets, "--trial", "20"]
        told = (tmp_path / "told.txt").open("w")
        process = subprocess.Popen(line, stdout=told, stderr=subprocess.STDOUT, env=ENVIRONMENT, cwd=tmp_path)
        try:
            subprocess.run(
                [*line[:4], "accept", "1", *out], check=True, env=ENVIRONMENT, cwd=tmp_path, timeout=PATIENCE_S
            )
            assert waited(lambda: acting() == "heal-1.yaml", PATIENCE_S), (tmp_path / "told.txt").read_text()
            off = times_off(daemon)
            time.sleep(6.0)  # it says that it watches
            assert acting() == "heal-1.yaml" or times_off(daemon) > off
        finally:
            os.kill(process.pid, signal.SIGKILL)
            process.wait(10.0)
        assert waited(lambda: acting() == "lqg.yaml", 10.0)
        assert (versions.read(1).state == "trying" or times_off(daemon) > off) and versions.loop().acting == 0
        process = subprocess.Popen(line, stdout=told, stderr=subprocess.STDOUT, env=ENVIRONMENT, cwd=tmp_path)
        try:
            # the person's word still lies there: it is tried once more, from the beginning
            assert waited(lambda: versions.read(1).state == "trying" and acting() == "heal-1.yaml", PATIENCE_S)
            process.send_signal(signal.SIGINT)
            process.wait(15.0)
        finally:
            process.kill()
            process.wait(10.0)
        assert waited(lambda: acting() == "lqg.yaml", 3.0) and versions.read(1).state == "proposed"
        restore = [*line[:4], "restore", "0", *out, *sets]
        done = subprocess.run(
            restore, check=False, capture_output=True, text=True, env=ENVIRONMENT, cwd=tmp_path, timeout=PATIENCE_S
        )
        assert done.returncode == 0, done.stderr
        # by a copy with its model beside it, whatever became of lqg.yaml meanwhile
        assert acting() == f"{versions.copy_name(0)}.yaml"
        assert versions.read(0).history[-1][1].startswith("restored by")
        told.close()
