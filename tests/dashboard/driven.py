"""A daemon with its rig, its page in a browser, and an operator who drives it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from dashboard.served import Served, served
from harness.browser import Page, opened
from harness.realrun import Daemon, fifo_granted
from shell.peers import controlled, wait_until

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guide.guide import NOT_KEPT, KeptCalibrations
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench

BUSY_S = 90.0
TRIES = 20


def log_in(page: Page) -> None:
    """As the operator of `shell.peers.controlled`."""
    page.wait_for("!document.querySelector('#login').hidden", BUSY_S)
    page.click("#login")
    page.type("input[name=user]", "operator")
    page.type("input[name=password]", "turn")
    page.key("Enter")
    page.wait_for("document.body.classList.contains('may-drive')")


def arm(page: Page) -> None:
    """Until it runs: on a busy machine the rig's own faults may disarm it meanwhile."""
    for _ in range(TRIES):
        if page.text("#mode") == "RUNNING":
            return
        page.click("#arm")
        time.sleep(1.0)
    raise AssertionError("the rig does not run")


class Driven(NamedTuple):
    """What a test of driving has."""

    web: Served
    page: Page
    daemon: Daemon
    folder: Path  # of the daemon's files

    @property
    def status(self) -> Any:
        """What the daemon itself told last; empty before it told anything."""
        devices = [*self.web.feed.devices.values()]
        return devices[0].status if devices else {}

    def answered(self, script: str) -> str:
        """What the page shows as the answer to what this script sends."""
        self.page.ask("void (document.querySelector('#answer').innerText = '')")
        self.page.ask(script)
        self.page.wait_for(
            "(t => t && !t.endsWith('sent \N{HORIZONTAL ELLIPSIS}'))(document.querySelector('#answer').innerText)",
            BUSY_S,
        )
        return self.page.text("#answer")

    def until(self, done: Callable[[], bool], step: Callable[[], Any], why: str) -> None:
        """Take a step again and again until it is done."""
        for _ in range(TRIES):
            step()
            if done():
                return
        raise AssertionError(f"{why}: {self.page.text('#answer')}")


@contextlib.contextmanager
def driven(
    folder: Path, bench: Bench | None = None, kept: KeptCalibrations = NOT_KEPT, *, direct: bool = True, **settings: Any
) -> Iterator[Driven]:
    """`folder` gets the daemon's files and `audit.jsonl`; `settings` are keys of its configuration."""
    control, sim = controlled(folder), settings.pop("sim", {})
    telemetry = {
        "endpoint": control.endpoint,
        "commands": True,
        "control": {"endpoint": control.control_endpoint, "zenoh": dict(control.control_zenoh)},
    }
    operators = Operators({control.endpoint: (control.control_endpoint, control.control_zenoh)})
    with (
        Daemon(
            folder, direct=direct, fifo=fifo_granted(), config={"telemetry": telemetry, **settings}, **sim
        ) as daemon,
        served(Feed([control.endpoint], {}), operators, Audit(folder / "audit.jsonl"), bench, kept=kept) as web,
        opened(folder, web.origin, 1440, 900) as page,
    ):
        rig = Driven(web, page, daemon, folder)
        assert wait_until(lambda: bool(rig.status), BUSY_S)  # a login needs a daemon that answers
        yield rig
