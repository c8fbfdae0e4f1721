"""Two controllers compared from the page: begun by who is logged in, watched by the server, decided by a person.

Rules of this file: one comparison at a time; it ends when the page that began it is closed; every beginning, end and
decision is written down, and the result is kept beside the jobs.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from hoopd.core.succession import ALIVE, CONTROLLER
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Login, LoginError, Operators
from hoopd.dashboard.orders import WrittenOrders
from hoopd.dashboard.requests import who
from hoopd.dashboard.turns import ComparisonSupervisor
from hoopd.dashboard.work.bench import Bench
from hoopd.design.alternation import Alternation
from hoopd.design.comparison import BALL, BETTER, MEANINGS, ControllerComparison, WantedCommand
from hoopd.design.yardstick import held_speed
from hoopd.files.controller import parse_controller
from hoopd.files.controller_folder import parse_key
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file

# The page asks every second; a browser slows down what nobody looks at.
ATTENTION_S = 5.0
UNWATCHED = f"the page that began it was closed, or hidden, for {ATTENTION_S:g} s"


class ComparisonOrder(msgspec.Struct, forbid_unknown_fields=True):
    """What somebody asks for."""

    device: str
    key: str
    blocks: int = 20
    settle_s: float = 2.0
    hold_s: float = 2.0
    amplitude_rad: float = 0.1
    by: str = BALL  # what decides, one of `MEASURES`
    seed: int = 0


class Decision(msgspec.Struct, forbid_unknown_fields=True):
    """What becomes of a candidate."""

    accept: bool
    key: str = ""  # of the candidate that who decides saw
    anyway: bool = False  # it was not better, and who decides was told so


class NoContent(msgspec.Struct, forbid_unknown_fields=True):
    """Nothing but the wish itself."""


@dataclass
class ShownComparison:
    """The one that goes on, or the last one."""

    login: Login
    address: str
    device: ShownDevice
    accepted: str  # NAME.yaml@SHA256
    comparison: ControllerComparison
    hoop_speed_counted: bool
    begun: float  # s since 1970
    attended: float = field(default_factory=time.monotonic)
    supervisor: ComparisonSupervisor | None = None
    decided: str = ""

    @property
    def running(self) -> bool:
        """It goes on, or brings the accepted law back."""
        return self.supervisor is not None and self.supervisor.alive

    def told(self) -> dict[str, Any]:
        """For the page, and for the file."""
        return {
            "device": self.device.identity,
            "who": self.login.user,
            "begun": self.begun,
            "running": self.running,
            "step": self.comparison.step,
            "share": self.comparison.share,
            "accepted": self.accepted,
            "hoop_speed_counted": self.hoop_speed_counted,
            "decided": self.decided,
            **self.comparison.result(),
        }


class Comparisons:
    """Routes over at most one comparison."""

    def __init__(self, feed: Feed, operators: Operators, audit: Audit, bench: Bench | None) -> None:
        self._feed, self._operators, self._audit, self._bench = feed, operators, audit, bench
        self._orders = WrittenOrders(operators, audit)
        self._lock = threading.Lock()
        self._last: ShownComparison | None = None

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [
            Route("/api/compare", self.look),
            Route("/api/compare/begin", self.begin, methods=["POST"]),
            Route("/api/compare/end", self.end, methods=["POST"]),
            Route("/api/compare/decide", self.decide, methods=["POST"]),
        ]

    async def look(self, request: Request) -> Response:
        """How it stands; whoever began it watches it by this."""
        shown = self._last
        if shown is None:
            return JSONResponse({"last": None})
        try:
            if who(request, self._operators) is shown.login:
                shown.attended = time.monotonic()
        except LoginError:
            pass  # everybody may look
        return JSONResponse({"last": shown.told()})

    async def begin(self, request: Request) -> Response:
        """Let two controllers take turns."""
        return await self._orders.done(request, ComparisonOrder, self._begin)

    async def end(self, request: Request) -> Response:
        """Cut it short."""
        return await self._orders.done(request, NoContent, self._end)

    async def decide(self, request: Request) -> Response:
        """Accept the candidate, or go back to what was accepted."""
        return await self._orders.done(request, Decision, self._decide)

    def close(self) -> None:
        """End what runs, with the accepted controller back."""
        shown = self._last
        if shown is not None and shown.supervisor is not None:
            shown.comparison.stop("the page's server ends")
            shown.supervisor.join(1.0)

    # ---- what is done

    def _begin(self, login: Login, address: str, order: ComparisonOrder) -> dict[str, Any]:
        device = self._feed.devices.get(order.device)
        if device is None:
            raise InputError("compare", "", "no such device")
        accepted = accepted_by(device)
        if parse_key(order.key).sha256 == parse_key(accepted).sha256:
            raise InputError("compare", "", "this controller acts already: choose another one")
        held = self._held(accepted)
        try:
            plan = Alternation(
                order.blocks, order.settle_s, order.hold_s, order.amplitude_rad, seed=order.seed & 0xFFFF
            )
            comparison = ControllerComparison(plan, order.key, held=held, by=order.by)
        except ValueError as error:
            raise InputError("compare", "", str(error)) from None
        shown = ShownComparison(login, address, device, accepted, comparison, held is not None, time.time())
        shown.supervisor = ComparisonSupervisor(shown.comparison, device, self._sending(shown), self._attending(shown))
        with self._lock:
            if self._last is not None and self._last.running:
                raise InputError("compare", "", "another comparison goes on")
            self._last = shown
            shown.supervisor.start()
        threading.Thread(target=self._follow, args=(shown,), daemon=True).start()
        return {"command": "compare", "device": device.identity, "key": order.key, "value": accepted}

    def _end(self, login: Login, address: str, nothing: NoContent) -> dict[str, Any]:
        shown = self._last
        if shown is None or not shown.running:
            raise InputError("compare", "", "none goes on")
        shown.comparison.stop(f"ended by {login.user}")
        return {"command": "compare ended", "device": shown.device.identity}

    def _decide(self, login: Login, address: str, decision: Decision) -> dict[str, Any]:
        shown = self._last
        if shown is None or shown.running:
            raise InputError("compare", "", "there is nothing to decide" if shown is None else "it goes on")
        if decision.key not in ("", shown.comparison.key):
            raise InputError("compare", "", "another candidate was tried meanwhile: look again")
        if decision.accept and not decision.anyway and shown.comparison.verdict != BETTER:
            by = MEANINGS[shown.comparison.by]
            raise InputError("compare", "", f"by {by} it is not better ({shown.comparison.verdict}): confirm it")
        key = shown.comparison.key if decision.accept else shown.accepted
        # what a device told may be from before the last decision, which would then stand
        if shown.decided or _acting(shown.device) != key:
            self._operators.command(login, shown.device.endpoint, shown.device.name, CONTROLLER, None, key)
        doubted = decision.accept and shown.comparison.verdict != BETTER
        anyway = f", though it was {shown.comparison.verdict}" if doubted else ""
        shown.decided = f"{'accepted' if decision.accept else 'rolled back'} by {login.user}{anyway}"
        self._keep(shown)
        return {
            "command": "candidate accepted" if decision.accept else "rolled back",
            "device": shown.device.identity,
            "key": key,
            "value": shown.comparison.verdict,
        }

    # ---- beside it

    def _held(self, accepted: str) -> Any:
        """How the hoop has to turn for a reference, where the accepted controller's file is at hand and tells it."""
        if self._bench is None or self._bench.controllers is None:
            return None
        try:
            return held_speed(parse_controller(self._bench.controllers.text(accepted), accepted).gains)
        except InputError:
            return None

    def _sending(self, shown: ShownComparison) -> Callable[[WantedCommand], Mapping[str, Any]]:
        def send(order: WantedCommand) -> Mapping[str, Any]:
            value = order.value if order.name == "reference" else None
            where = (shown.device.endpoint, shown.device.name)
            told: dict[str, Any] = {"device": shown.device.identity, "command": order.name}
            answer = self._operators.command(shown.login, *where, order.name, value, order.key)
            if order.name not in (ALIVE, "reference"):  # by the hundred: what they are for is written down
                self._audit.note(shown.login.user, shown.address, {**answer, **told})
            return answer

        return send

    def _attending(self, shown: ShownComparison) -> Callable[[], str]:
        return lambda: UNWATCHED if time.monotonic() - shown.attended > ATTENTION_S else ""

    def _follow(self, shown: ShownComparison) -> None:
        """Until its end, which is written down."""
        assert shown.supervisor is not None
        shown.supervisor.join()
        if shown.supervisor.error is not None:
            raise shown.supervisor.error
        result = shown.comparison
        told = {"device": shown.device.identity, "command": "comparison", "key": result.key}
        self._audit.note(shown.login.user, shown.address, {**told, "value": result.verdict, "reason": result.reason})
        self._keep(shown)

    def _keep(self, shown: ShownComparison) -> None:
        """A file among the results: a full disk loses it, and nothing else."""
        if self._bench is None:
            return
        try:
            content = msgspec.json.format(msgspec.json.encode(shown.told()))
            replace_file(self._bench.comparisons / f"{int(shown.begun)}.json", content + b"\n")
        except InputError as error:
            self._audit.note(shown.login.user, "", {"command": "comparison kept", "ok": False, "reason": str(error)})


def _acting(device: ShownDevice) -> str:
    """What a device told last, which may be a second old; empty when that was a trial."""
    try:
        return accepted_by(device)
    except InputError:
        return ""


def accepted_by(device: ShownDevice) -> str:
    """NAME.yaml@SHA256 of the controller that a device told as accepted; InputError while another one acts."""
    told = device.status.get("controller")
    if not isinstance(told, dict) or told.get("purpose") != CONTROLLER or told.get("next"):
        raise InputError("compare", "", "the device has to tell which controller is accepted, and none may be on trial")
    return f"{told.get('file')}@{told.get('sha256')}"
