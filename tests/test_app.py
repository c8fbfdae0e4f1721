"""The composition root: how a daemon that is asked to end early ends, and what its start costs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from hoopd.app import _signals_unwind

HEAVY = ("scipy", "matplotlib", "control", "hoopd.design", "hoopd.sim")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_end_before_the_loop_listens_everything_open_is_closed(number: int) -> None:
    closed: list[str] = []
    before = signal.getsignal(number)
    with pytest.raises(SystemExit) as end, ExitStack() as stack:
        stack.enter_context(_signals_unwind())
        stack.callback(closed.append, "camera")
        os.kill(os.getpid(), number)
    assert (closed, end.value.code) == (["camera"], 0)
    assert signal.getsignal(number) is before


def test_the_path_of_the_daemon_imports_nothing_heavy() -> None:
    program = (
        "import sys, hoopd.cli, hoopd.app, hoopd.shell.telemetry, hoopd.shell.videodevices\n"
        "from hoopd.build import build_tick, read_texts\n"
        "from hoopd.shell.config import load\n"
        "config = load(None, sim=False, overrides=[])\n"
        "build_tick(config, read_texts(config, None))\n"
        f"print([m for m in sys.modules if m.startswith({HEAVY!r})])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"
