"""A test signal played from the page, on top of the law that acts, and the recording of it.

Rules of this file: the signal is made by `hoopd experiment` in a process of its own and loaded by the daemon as any
controller is; every number is inside the limits that the page shows; what was recorded is cut out of the daemon's own
recording, which is never changed.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from hoopd.core.modes import mode_words
from hoopd.core.succession import ALLOWED, EXPERIMENT
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.comparisons import accepted_by
from hoopd.dashboard.device import Seen, ShownDevice, fault_names
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Login, Operators
from hoopd.dashboard.orders import WrittenOrders
from hoopd.dashboard.work.background import background
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.controllers import SIGNAL
from hoopd.dashboard.work.recordings import Recordings
from hoopd.files.controller_folder import parse_key
from hoopd.files.reading import InputError, read_text
from hoopd.recording.mcap import read_header

MAKE_S, CUT_S = 60.0, 60.0
LOOK_S = 0.1
MARGIN_S = 0.5  # of the recording, before and after the signal
LOST_S = 20.0  # after its longest a signal of whose end nothing was heard is over: telemetry may drop an event
FLUSH_S = 1.0  # the recorder closes its chunks every quarter of a second
NO_FOLDER = "this server was started without --controllers: it cannot hand a signal to the daemon"


@dataclass(frozen=True, kw_only=True)
class SignalNumber:
    """One number of a signal, with the limits that the page shows and the server keeps."""

    name: str  # of the option
    label: str
    unit: str
    low: float
    high: float
    usual: float | None  # None: what the model lets through
    whole: bool = False


DURATION = SignalNumber(name="duration", label="Length", unit="s", low=2.0, high=120.0, usual=20.0)
AMPLITUDE = SignalNumber(name="amplitude", label="Torque", unit="N m", low=0.005, high=0.3, usual=None)
ANGLE = SignalNumber(name="max-angle", label="Ends beyond a ball angle of", unit="rad", low=0.05, high=1.25, usual=0.6)
LOW = SignalNumber(name="low", label="Lowest frequency", unit="Hz", low=0.05, high=10.0, usual=0.3)
HIGH = SignalNumber(name="high", label="Highest frequency", unit="Hz", low=0.1, high=20.0, usual=5.0)
CLOCK = SignalNumber(name="clock", label="Ticks of each value", unit="", low=1, high=100, usual=1, whole=True)
HOLD = SignalNumber(name="hold", label="Each step", unit="s", low=0.04, high=10.0, usual=0.4)
SEED = SignalNumber(name="seed", label="Seed", unit="", low=0, high=1e6, usual=0, whole=True)
SIGNALS: Mapping[str, tuple[SignalNumber, ...]] = {
    "prbs": (DURATION, AMPLITUDE, ANGLE, CLOCK, SEED),
    "multisine": (DURATION, AMPLITUDE, ANGLE, LOW, HIGH, SEED),
    "chirp": (DURATION, AMPLITUDE, ANGLE, LOW, HIGH, SEED),
    "steps": (DURATION, AMPLITUDE, ANGLE, HOLD, SEED),
}


class SignalOrder(msgspec.Struct, forbid_unknown_fields=True):
    """What somebody asks for."""

    device: str
    kind: str
    numbers: dict[str, float] = {}


class Experiments:
    """Routes over at most one test signal."""

    def __init__(self, feed: Feed, operators: Operators, audit: Audit, bench: Bench | None) -> None:
        self._feed, self._operators, self._audit, self._bench = feed, operators, audit, bench
        self._orders = WrittenOrders(operators, audit)
        self._lock = threading.Lock()
        self._told: dict[str, Any] | None = None  # the last one

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [Route("/api/experiment", self.look), Route("/api/experiment/begin", self.begin, methods=["POST"])]

    async def look(self, request: Request) -> Response:
        """What may be asked for, and how the last one stands."""
        offered = self._bench is not None and self._bench.controllers is not None
        signals = {kind: [asdict(one) for one in numbers] for kind, numbers in SIGNALS.items()}
        return JSONResponse({"offered": offered, "reason": NO_FOLDER, "signals": signals, "last": self._told})

    async def begin(self, request: Request) -> Response:
        """Make a signal and let the daemon play it."""
        return await self._orders.done(request, SignalOrder, self._begin)

    def _begin(self, login: Login, address: str, order: SignalOrder) -> dict[str, Any]:
        device, numbers = self._feed.devices.get(order.device), words_of_signal(order)
        if device is None:
            raise InputError("experiment", "", "no such device")
        if self._bench is None or self._bench.controllers is None:
            raise InputError("experiment", "", NO_FOLDER)
        controllers, accepted = self._bench.controllers, accepted_by(device)
        controllers.text(accepted)  # it lies there, and is the one that acts
        run, asked = device.run, time.time()
        check_playable(device, run, asked)
        with self._lock:
            if self._told is not None and self._told["state"] in ("making", "playing"):
                raise InputError("experiment", "", "another signal is being played")
            self._told = {"kind": order.kind, "state": "making", "device": device.identity, "recording": "", "why": ""}
        try:
            key = self._made(device, order.kind, numbers, controllers.folder / parse_key(accepted).name)
            seen = Seen(row=device.history.count)
            device.news(seen, 0)  # what was before is no news
            try:
                check_playable(device, run, asked)  # it took seconds: meanwhile somebody may have stopped it
                answer = self._operators.command(login, device.endpoint, device.name, EXPERIMENT, None, key)
            finally:
                controllers.drop(key)
        except Exception as error:  # whatever it was: the next signal may be made
            self._tell(state="refused", why=str(error))
            raise
        self._tell(state="playing")
        began = float(answer.get("t", math.nan))
        threading.Thread(target=self._follow, args=(login.user, address, device, seen, began), daemon=True).start()
        return {"command": f"experiment {order.kind}", "device": device.identity, "key": " ".join(numbers)}

    def _made(self, device: ShownDevice, kind: str, numbers: list[str], around: Path) -> str:
        """NAME.yaml@SHA256 of a signal in the daemon's folder, planned with the device's own configuration."""
        assert self._bench is not None and self._bench.controllers is not None
        configured = self._feed.connection_of(device).configuration(device.name)
        with tempfile.TemporaryDirectory(prefix="hoopd-signal-") as folder:
            path, config = Path(folder) / "signal.yaml", Path(folder) / "device.yaml"
            config.write_text(configured, encoding="utf-8")
            words = ["experiment", kind, *numbers, f"--around={around}", f"--signal-out={path}", f"--config={config}"]
            words.append("--set=device.model=''")  # told without its folder: that of the law which acts lies beside it
            _ran(words, MAKE_S, str(around.parent))
            return self._bench.controllers.add(f"{SIGNAL}{kind}-{time.time_ns()}.yaml", read_text(path))

    def _follow(self, user: str, address: str, device: ShownDevice, seen: Seen, began: float) -> None:
        """Until it is over, which is written down; then its recording."""
        ended, why = self._ended(device, seen)
        try:
            recording = self._cut(device, began, ended) if math.isfinite(began) and math.isfinite(ended) else ""
        except InputError as error:
            recording, why = "", f"{why}; no recording: {error}"
        self._tell(state="over", why=why, recording=recording)
        told = {"device": device.identity, "command": "experiment over", "value": recording, "reason": why}
        self._audit.note(user, address, {**told, "ok": why == "done"})

    def _ended(self, device: ShownDevice, seen: Seen) -> tuple[float, str]:
        """Run time of the signal's end, and why it ended."""
        run, until = device.run, time.monotonic() + DURATION.high + LOST_S
        while device.alive and device.run == run:
            if time.monotonic() > until:
                return math.nan, "nothing was heard of its end"
            for event in device.news(seen, 1).get("events", []):
                if event.get("event") == "experiment_ended":
                    t, fields = event.get("t"), event.get("fields") or {}
                    return (float(t) if isinstance(t, int | float) else math.nan), str(fields.get("reason", ""))[:200]
            time.sleep(LOOK_S)
        return math.nan, "the daemon is gone"

    def _cut(self, device: ShownDevice, began: float, ended: float) -> str:
        """The signal's own recording out of the one that the daemon writes; its name."""
        assert self._bench is not None and self._told is not None
        time.sleep(MARGIN_S + FLUSH_S)
        folder, whole = self._bench.recordings.folder, recording_of(device, self._bench.recordings)
        stem = f"{self._told['kind']}-{time.strftime('%Y%m%d-%H%M%S')}"
        words = ["convert", str(whole), str(folder / f"{stem}.mcap")]
        span = (f"--from={began - MARGIN_S:.3f}", f"--to={ended + MARGIN_S:.3f}")
        _ran([*words, *span], CUT_S, str(folder))
        return f"{stem}.mcap"

    def _tell(self, **changes: Any) -> None:
        with self._lock:
            self._told = {**(self._told or {}), **changes}


def check_playable(device: ShownDevice, run: str, since_s: float) -> None:
    """InputError unless a device could play a signal all the time from a moment on, in the same run.

    Who stopped it meanwhile and armed it again expects no signal any more.
    """
    if device.run != run:
        raise InputError("experiment", "", "the daemon was started again meanwhile: nothing was played")
    told = [one.get("fields") for one in device.events_since(since_s) if one.get("event") == "mode"]
    left = [one for one in told if isinstance(one, dict) and one.get("mode") not in ALLOWED[EXPERIMENT]]
    if left:
        words = mode_words(str(left[-1].get("mode")), fault_names(left[-1].get("because")), "was")
        raise InputError("experiment", "", f"{words} while it was planned: nothing was played")
    if device.mode not in ALLOWED[EXPERIMENT]:
        raise InputError("experiment", "", f"{device.mode_words}: arm it first")


def recording_of(device: ShownDevice, recordings: Recordings) -> Path:
    """The file that a device tells that it writes; InputError when the page's folder does not hold that very one.

    Another daemon's may have the same name: a recording tells of which run it is.
    """
    told = device.status.get("recorder")
    name = told.get("file") if isinstance(told, dict) else ""
    if not isinstance(name, str) or not name:
        raise InputError("experiment", "", "the daemon records nothing (--record)")
    elsewhere = InputError("experiment", name[:60], "the daemon records into another folder than the page's")
    try:
        path = recordings.path(name)
    except InputError:
        raise elsewhere from None
    if read_header(path).session != device.run:
        raise elsewhere
    return path


def words_of_signal(order: SignalOrder) -> list[str]:
    """Options of `hoopd experiment`; InputError for a number that is outside of what the page shows."""
    known = SIGNALS.get(order.kind)
    if known is None:
        raise InputError("experiment", order.kind[:40], f"unknown; known: {', '.join(SIGNALS)}")
    limits, words = {one.name: one for one in known}, []
    for name, value in order.numbers.items():
        limit = limits.get(name)
        if limit is None:
            raise InputError(order.kind, name[:40], f"unknown; known: {', '.join(limits)}")
        if not limit.low <= value <= limit.high or (limit.whole and value != int(value)):
            raise InputError(order.kind, name, f"must be {limit.low:g} to {limit.high:g}, not {value:g}")
        words.append(f"--{name}={int(value) if limit.whole else repr(float(value))}")
    if order.numbers.get("low", 0.0) >= order.numbers.get("high", math.inf):
        raise InputError(order.kind, "low", "must be below the highest frequency")
    return words


def _ran(words: list[str], patience_s: float, folder: str) -> None:
    """A command of ours; InputError with its own line when it failed."""
    command = [*background(waited_for=True), sys.executable, "-m", "hoopd", *words]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience_s, check=False, text=True
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(words[0], "", f"not done: {type(error).__name__}") from None
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.strip()] or ["failed"]
        raise InputError(words[0], "", said[-1].removeprefix("hoopd: ").replace(f"{folder}/", "")[:300])
