"""Helper threads run below the loop."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hoopd.shell.helpers import start_helper
from hoopd.shell.service import HELPER_PRIORITY, granted_realtime

REALTIME = """
import os
from hoopd.shell.helpers import start_helper
from hoopd.shell.service import granted_realtime, raise_thread_priority

def tell():
    facts = granted_realtime()
    print(facts["policy"], facts["priority"], flush=True)

if {reset_on_fork}:
    granted = raise_thread_priority(50)
else:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        granted = True
    except OSError:
        granted = False
if not granted:
    print("refused")
    raise SystemExit
start_helper("a", tell).join()
start_helper("b", lambda: start_helper("c", tell).join()).join()
start_helper("d", lambda: os.system("chrt -p $$ | head -1 1>&2")).join()
tell()
"""


def test_an_ordinary_maker_has_ordinary_helpers() -> None:
    seen: list[str] = []
    start_helper("test", lambda: seen.append(granted_realtime()["policy"])).join()
    assert seen == ["other"]


@pytest.mark.parametrize("reset_on_fork", [True, False])
def test_a_realtime_maker_has_helpers_a_little_below_it(reset_on_fork: bool) -> None:
    code = REALTIME.format(reset_on_fork=reset_on_fork)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=20)
    if done.stdout == "refused\n":
        pytest.skip("no right to real-time priority here")
    assert done.stdout.splitlines() == [f"fifo {HELPER_PRIORITY}"] * 2 + ["fifo 50"]
    assert "SCHED_OTHER" in done.stderr  # a program that a helper starts (the camera's) is an ordinary one
