"""Who watches an alternating run: ticks and events of a device in, commands out, and an end whatever becomes silent."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh
from shell.peers import wait_until

from hoopd.core.succession import ALIVE, REVERT, TRIAL
from hoopd.dashboard import experiments
from hoopd.dashboard.audit import Audit
from hoopd.dashboard.comparisons import Comparisons, Decision, ShownComparison, accepted_by
from hoopd.dashboard.device import Seen, ShownDevice
from hoopd.dashboard.experiments import (
    SIGNALS,
    Experiments,
    SignalOrder,
    check_playable,
    recording_of,
    words_of_signal,
)
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Login, Operators
from hoopd.dashboard.turns import ComparisonSupervisor
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.recordings import Recordings
from hoopd.design.alternation import Alternation
from hoopd.design.comparison import STOPPED, ControllerComparison, WantedCommand
from hoopd.files.reading import InputError
from hoopd.recording.mcap import Header, Writer
from hoopd.shell.operator import CommandError

KEY = "other.yaml@" + "ab" * 32


TOLD = {
    TRIAL: ("controller", {"command": TRIAL, "sha256": "ab" * 32}),
    REVERT: ("trial_returned", {"reason": "reverted"}),
}
NOT_ACCEPTED: tuple[dict[str, Any], ...] = (
    {},
    {"controller": None},
    {"controller": {"purpose": "trial"}},
    {"controller": {"purpose": "controller", "next": "b.yaml"}},
)


class MadeUp:
    """A device that tells a hundred ticks in a moment, and takes what it is sent."""

    def __init__(self, attended: Any = lambda: "", refuse: str = "") -> None:
        self.device = ShownDevice("hoop", "tcp/127.0.0.1:1")
        self.sent: list[WantedCommand] = []
        self.reference, self._refuse, self._t = 0.0, refuse, 0.0
        self.tell("tick", t=0.0, mode="RUNNING")
        self.comparison = ControllerComparison(Alternation(blocks=6, settle_s=1.0, hold_s=0.5), KEY)
        self.watch = ComparisonSupervisor(self.comparison, self.device, self.send, attended)
        self.quiet, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run)

    def tell(self, kind: str, **fields: Any) -> None:
        self.device.take(kind, json.dumps(fields).encode(), "a run")

    def send(self, order: WantedCommand) -> dict[str, Any]:
        if order.name == self._refuse:
            raise CommandError(f"{order.name}: refused: the model does not fit")
        self.sent.append(order)
        if order.name == "reference":
            self.reference = order.value
        if order.name in (TRIAL, REVERT):
            event, fields = TOLD[order.name]
            self.tell("event", t=self._t, event=event, level="info", fields=fields)
        return {"ok": True}

    def _run(self) -> None:
        while not self._over.wait(0.02):
            for _ in range(0 if self.quiet.is_set() else 12):
                self._t = round(self._t + 0.02, 3)
                reading = {"u": 0.01, "dtheta": 0.0, "psi": self.reference + 0.01, "psi_t": self._t - 0.05}
                self.tell("tick", t=self._t, mode="RUNNING", reference=self.reference, **reading)

    def __enter__(self) -> MadeUp:
        self._thread.start()
        self.watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.comparison.stop("the test is over")
        self._over.set()
        self._thread.join()
        self.watch.join(5.0)
        assert not self.watch.alive


def names(made: MadeUp) -> list[str]:
    return [order.name for order in made.sent if order.name != ALIVE]


def test_a_whole_run_is_commanded_and_judged() -> None:
    with MadeUp() as made:
        assert wait_until(lambda: made.comparison.over, 20.0)
        assert len(made.comparison.pairs) == 3, made.comparison.result()
        assert names(made).count(TRIAL) == names(made).count(REVERT) == 3
        assert any(order.name == ALIVE for order in made.sent)
        assert wait_until(lambda: made.reference == 0.0)


def test_a_page_that_is_closed_ends_it_with_the_accepted_controller_back() -> None:
    closed: list[str] = []
    with MadeUp(lambda: closed[0] if closed else "") as made:
        assert wait_until(lambda: TRIAL in names(made), 10.0)
        closed.append("the page was closed")
        assert wait_until(lambda: REVERT in names(made), 5.0)
        assert (made.comparison.verdict, made.comparison.reason) == (STOPPED, "the page was closed")


def test_a_daemon_that_is_silent_or_new_ends_it() -> None:
    with MadeUp() as silent:
        silent.quiet.set()
        assert wait_until(lambda: "silent" in silent.comparison.reason, 6.0)
    with MadeUp() as restarted:
        restarted.quiet.set()
        time.sleep(0.1)
        restarted.device.take("tick", b"{}", "another run")
        assert wait_until(lambda: "started again" in restarted.comparison.reason, 5.0)


def test_what_the_daemon_refuses_ends_it_with_its_reason() -> None:
    with MadeUp(refuse=TRIAL) as made:
        assert wait_until(lambda: made.comparison.over, 10.0)
        assert "the model does not fit" in made.comparison.reason and TRIAL not in names(made)


def test_only_a_device_whose_controller_is_accepted_is_compared() -> None:
    device = ShownDevice("hoop", "tcp/127.0.0.1:1")
    for told in NOT_ACCEPTED:
        device.take("status", json.dumps(told).encode(), "")
        with pytest.raises(InputError, match="accepted"):
            accepted_by(device)
    acting = {"purpose": "controller", "file": "a.yaml", "sha256": "cd" * 32, "next": ""}
    device.take("status", json.dumps({"controller": acting}).encode(), "")
    assert accepted_by(device) == "a.yaml@" + "cd" * 32


def test_a_decision_that_is_taken_back_at_once_reaches_the_daemon(monkeypatch: pytest.MonkeyPatch) -> None:
    device, sent = ShownDevice("hoop", "tcp/127.0.0.1:1"), list[str]()
    before = {"purpose": "controller", "file": "a.yaml", "sha256": "cd" * 32, "next": ""}
    device.take("status", json.dumps({"controller": before}).encode(), "")  # and no news of it since
    operators, login = Operators({}), Login("operator", {}, 0.0, 0.0)
    monkeypatch.setattr(operators, "command", lambda *order: sent.append(order[-1]))
    comparisons = Comparisons(Feed([], {}), operators, Audit(), None)
    over = ControllerComparison(Alternation(), KEY)
    comparisons._last = ShownComparison(login, "", device, accepted_by(device), over, False, 0.0)
    with pytest.raises(InputError, match="not better"):
        comparisons._decide(login, "", Decision(True))
    assert sent == []
    for accept in (True, False):
        comparisons._decide(login, "", Decision(accept, anyway=accept))
    assert sent == [KEY, accepted_by(device)]


def recorded(folder: Path, session: str) -> None:
    """A recording's beginning, as a daemon writes it."""
    with (folder / "run-0001.mcap").open("wb") as file:
        writer = Writer(file, Header(session=session), sync=False)
        writer.finish()


def test_the_recording_is_the_one_that_the_device_tells_and_no_other_of_its_name(tmp_path: Path) -> None:
    device, (here, results) = ShownDevice("hoop", "tcp/127.0.0.1:1"), (tmp_path / "rec", tmp_path / "results")
    for folder in (here, results):
        folder.mkdir()
    recordings = Recordings(here, results)
    for status, why in (({}, "records nothing"), ({"recorder": {"file": "run-0001.mcap"}}, "another folder")):
        device.take("status", json.dumps(status).encode(), "this run")
        with pytest.raises(InputError, match=why):
            recording_of(device, recordings)
    recorded(here, "another run")  # another daemon's, newer than all
    with pytest.raises(InputError, match="another folder"):
        recording_of(device, recordings)
    recorded(here, "this run")
    assert recording_of(device, recordings) == here / "run-0001.mcap"
    recordings.close()


def test_a_signal_of_whose_end_nothing_is_heard_is_over_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    device = ShownDevice("hoop", "tcp/127.0.0.1:1")
    device.presence(True)
    monkeypatch.setattr(experiments, "LOST_S", -experiments.DURATION.high)
    monkeypatch.setattr(experiments, "LOOK_S", 0.01)
    signals, ended = Experiments(Feed([], {}), Operators({}), Audit(), None), list[str]()
    watch = threading.Thread(target=lambda: ended.append(signals._ended(device, Seen())[1]), daemon=True)
    watch.start()
    watch.join(2.0)
    assert ended == ["nothing was heard of its end"]


def test_a_signal_is_played_only_by_a_device_that_ran_all_the_while() -> None:
    device, begun = ShownDevice("hoop", "tcp/127.0.0.1:1"), time.time()
    status = {"controller": {"purpose": "controller", "file": "a.yaml", "sha256": "cd" * 32, "next": ""}}

    def tell(kind: str, **fields: Any) -> None:
        device.take(kind, json.dumps(fields).encode(), "a run")

    def why() -> str:
        try:
            check_playable(device, "a run", begun)
        except InputError as error:
            return str(error)
        return ""

    tell("status", **status, because=["link_lost"])
    tell("tick", t=0.0, mode="FAULT")
    assert why() == "experiment: the mode is FAULT (link_lost): arm it first"
    tell("tick", t=1.0, mode="RUNNING")
    tell("event", t=1.0, event="mode", fields={"mode": "READY", "because": ["ball_lost"]})
    assert why() == ""
    tell("event", t=1.1, event="mode", fields={"mode": "FAULT", "because": ["link_lost"]})
    assert why() == "experiment: the mode was FAULT (link_lost) while it was planned: nothing was played"
    device.take("tick", b"{}", "another run")
    assert why() == "experiment: the daemon was started again meanwhile: nothing was played"


def test_a_signal_is_not_sent_to_a_device_that_was_stopped_while_it_was_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, sent, feed = ShownDevice("hoop", "tcp/127.0.0.1:1"), list[Any](), Feed([], {})
    (tmp_path / "a.yaml").write_text("schema: hoopd.controller/1\n")
    sha256 = hashlib.sha256((tmp_path / "a.yaml").read_bytes()).hexdigest()
    acting = {"purpose": "controller", "file": "a.yaml", "sha256": sha256, "next": ""}
    device.take("status", json.dumps({"controller": acting}).encode(), "")
    device.take("tick", b'{"t":0.0,"mode":"RUNNING"}', "")
    operators, bench = Operators({}), Bench(tmp_path, tmp_path / "results", tmp_path)
    monkeypatch.setattr(operators, "command", lambda *order: sent.append(order))
    monkeypatch.setattr(Feed, "devices", {device.identity: device})

    def planned(*_: Any) -> str:
        stopped = {"t": 5.0, "event": "mode", "fields": {"mode": "DISARMED", "because": []}}
        device.take("event", json.dumps(stopped).encode(), "")
        return bench.controllers.add("signal-prbs-1.yaml", "a signal\n") if bench.controllers else ""

    signals = Experiments(feed, operators, Audit(), bench)
    monkeypatch.setattr(signals, "_made", planned)
    with pytest.raises(InputError, match="the mode was DISARMED while it was planned"):
        signals._begin(Login("operator", {}, 0.0, 0.0), "", SignalOrder(device.identity, "prbs"))
    assert sent == [] and not list(tmp_path.glob("signal-*"))
    assert signals._told is not None and signals._told["state"] == "refused"


def test_when_an_event_came_is_told_by_this_computer_and_by_no_stranger() -> None:
    device = ShownDevice("hoop", "tcp/127.0.0.1:1")
    device.take("event", json.dumps({"event": "experiment_ended", "wall": "never"}).encode(), "", now_s=5.0)
    assert [event["wall"] for event in device.events_since(5.0)] == [5.0] and device.events_since(6.0) == []


def test_a_connection_that_goes_meanwhile_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: Any, **__: Any) -> None:
        raise zenoh.ZError("closed")

    operators = Operators({})
    monkeypatch.setattr(operators, "_session", lambda *_: cast(zenoh.Session, SimpleNamespace(get=gone)))
    with pytest.raises(CommandError, match="no answer: closed"):
        operators.command(Login("operator", {}, 0.0, 0.0), "tcp/127.0.0.1:1", "hoop", "arm")


WRONG = {
    "unknown kind": ("noise", {}),
    "another number": ("prbs", {"hold": 1.0}),
    "too large": ("prbs", {"amplitude": 0.31}),
    "too long": ("chirp", {"duration": 1e9}),
    "not a whole number": ("prbs", {"clock": 1.5}),
    "not a number": ("steps", {"hold": float("nan")}),
    "the wrong way round": ("chirp", {"low": 5.0, "high": 1.0}),
    "an option of its own": ("prbs", {"around": 1.0}),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_signal_outside_of_what_the_page_shows_is_refused(name: str) -> None:
    kind, numbers = WRONG[name]
    with pytest.raises(InputError):
        words_of_signal(SignalOrder("hoop", kind, numbers))


def test_the_ends_of_every_limit_are_words_of_the_command() -> None:
    for kind, limits in SIGNALS.items():
        words = words_of_signal(SignalOrder("hoop", kind, {one.name: one.high for one in limits if one.name != "low"}))
        assert all(word.startswith("--") and "=" in word for word in words) and len(words) >= len(limits) - 1


def test_what_cannot_go_on_ends_with_its_reason_for_whoever_waits() -> None:
    full = InputError("version.json", "", "cannot be written: no space left on device")

    def attended() -> str:
        raise full

    with MadeUp(attended) as made:
        assert wait_until(lambda: not made.watch.alive, 5.0)
        assert made.watch.error is full
