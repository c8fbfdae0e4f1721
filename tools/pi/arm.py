"""Debian's arm64 userland by emulation: wheels, unit tests, and runs that must have the bytes of x86-64.

Rules of this file: emulation is 5 to 20 times slower than the machine, so nothing here is about time; the checkout is
seen read-only; what is compared are the bytes of files.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pi import machine, roots
from pi.machine import ROOT
from pi.steps import Step, demand, last_line, run

# Beside a load these take many times the ten minutes of an idle machine.
INSTALL_S, TESTS_S, RUN_S = 1800.0, 3600.0, 1800.0
SUITES = ("tests/core", "tests/vision", "tests/recording")
# A release from rest, pictures of the rig's camera, a reference: every room of the tick takes part.
RUN_SIM_S = 10.0
LOCKSTEP = (
    *("-m", "hoopd", "--sim", "--speed", "max", "--seed", "7", "--duration", f"{RUN_SIM_S:g}"),
    *("--record", ".", "--set", "sim.directory=.", "--json", "summary.json"),
    *("--set", "sim.commands=[{at_s: 4, name: reference, value: 0.05}]"),
)
COMPARED = ("*.mcap", "torque.jsonl", "truth.csv")
PLAIN = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/tmp", "LANG": "C.UTF-8", "OPENBLAS_NUM_THREADS": "1"}


class Emulated:
    """An arm64 root that may be written to, with the checkout and the wheels in it."""

    def __init__(self, scratch: Path) -> None:
        self._scratch = scratch
        self._root = Path()

    def steps(self) -> list[Step]:
        """All of them, in order."""
        return [
            Step("arm64: tools", lambda: machine.need("debootstrap", "qemu-aarch64-static"), needed=True),
            Step("arm64: userland (debootstrap, second stage by qemu)", self._make_root, needed=True),
            Step("arm64: aarch64 wheels install from the lock files", self._install, needed=True),
            Step("arm64: imports of the daemon's path and of the bench", self._import),
            Step("arm64: unit tests of core, vision, recording", self._test),
            Step("arm64: lock-step with pictures has the bytes of x86-64", self._lockstep),
            Step("arm64: replay of the recording made on x86-64", self._replay),
        ]

    def _make_root(self) -> str:
        place = roots.userland("arm64")
        self._root = machine.overlay(place, self._scratch / "arm64")
        for source, name in ((ROOT, "src"), (roots.wheels("arm64"), "wheels")):
            (self._root / name).mkdir()
            run(["mount", "--bind", "-o", "ro", source, self._root / name], 20)
        for kind, name in (("proc", "proc"), ("tmpfs", "tmp"), ("tmpfs", "dev/shm")):
            (self._root / name).mkdir(exist_ok=True)
            run(["mount", "-t", kind, kind, self._root / name], 20)
        return f"{self._inside(['uname', '-m'], 20).strip()}, {place}"

    def _install(self) -> str:
        self._inside(["python3", "-m", "venv", "/venv"], INSTALL_S)
        pip = ["/venv/bin/python", "-m", "pip", "install", "--quiet", "--no-input", "--disable-pip-version-check"]
        # Compiled when imported: compiling everything would take minutes.
        pip += ["--no-index", "--find-links", "/wheels", "--no-deps", "--no-compile"]
        for lock in roots.LOCKS:
            self._inside([*pip, "-r", f"/src/{lock}"], INSTALL_S)
        # A recording names the program's version, which is known of what is installed only.
        self._inside([*pip, "--no-build-isolation", "/src"], INSTALL_S)
        self._inside(["/venv/bin/python", "-m", "pip", "check", "--disable-pip-version-check"], INSTALL_S)
        count, native = roots.count_wheels(self._root / "wheels", "aarch64")
        return f"{count} wheels, {native} of them compiled for aarch64; pip check: nothing is missing"

    def _import(self) -> str:
        names = "casadi, cv2, h5py, matplotlib, mcap, msgspec, numpy, scipy, serial, structlog, zenoh, hoopd.daemon.app"
        code = f"import platform, {names}; print(platform.machine(), platform.python_version(), numpy.__version__)"
        return last_line(self._python("-c", code, seconds=RUN_S))

    def _test(self) -> str:
        words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "--timeout=900", *SUITES)
        return last_line(self._python(*words, seconds=TESTS_S, folder="/src"))

    def _lockstep(self) -> str:
        here, there = self._scratch / "x86-64", self._root / "tmp/arm64"
        here.mkdir()
        there.mkdir()
        run([sys.executable, *LOCKSTEP], RUN_S, environment={**os.environ, "PYTHONPATH": str(ROOT)}, folder=here)
        begun = time.monotonic()
        self._python(*LOCKSTEP, seconds=RUN_S, folder="/tmp/arm64")
        took = time.monotonic() - begun
        ours, theirs = digests(here), digests(there)
        demand(len(ours) == len(COMPARED), f"only {', '.join(ours)}")
        wrong = [name for name in ours if ours[name] != theirs.get(name)]
        demand(not wrong and ours.keys() == theirs.keys(), f"other bytes: {', '.join(wrong or theirs)}")
        return f"{', '.join(ours)} identical; {took:.0f} s for {RUN_SIM_S:g} s, {took / RUN_SIM_S:.1f} times real time"

    def _replay(self) -> str:
        [path] = (self._scratch / "x86-64").glob("*.mcap")
        (self._root / "tmp/x86.mcap").write_bytes(path.read_bytes())
        self._python("-m", "hoopd", "replay", "x86.mcap", "--json", "replay.json", seconds=RUN_S, folder="/tmp")
        text = (self._root / "tmp/replay.json").read_text()
        demand('"equal": true' in text, text[:160])
        return "every command recomputed bit for bit"

    def _python(self, *words: str, seconds: float, folder: str = "/tmp") -> str:
        return self._inside(["/venv/bin/python", *words], seconds, folder)

    def _inside(self, command: Sequence[str], seconds: float, folder: str = "/") -> str:
        environment = {**PLAIN, "PYTHONPATH": "/src:/src/tests", "PYTHONDONTWRITEBYTECODE": "1"}
        return run(["chroot", self._root, "env", "-C", folder, *command], seconds, environment=environment)


def digests(folder: Path) -> dict[str, str]:
    """Pattern -> SHA-256 of what the files of that name hold."""
    found = {pattern: sorted(folder.glob(pattern)) for pattern in COMPARED}
    return {
        pattern: hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()
        for pattern, paths in found.items()
        if paths
    }
