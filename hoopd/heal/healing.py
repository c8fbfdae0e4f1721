"""A loop that is followed: when the newest minutes are diagnosed, what is proposed, how a trial goes, what comes back.

    watching -> gathering -> diagnosing -> waiting -> proving -> proposed -> decided
                                 |                       |           |          |
                                left                    left        left        v
    watching <- settling <- weighing <- trying <--------------------------- asked
                    |           |          |                                  |
               rolled back  went back  went back                           refused

(`accepting` stands between weighing and settling, `rolling` between settling and rolled back: until the daemon tells.)

A change is told by the daemon's own drift: by then at least `CERTAIN_S` seconds are of the changed loop, so that the
minutes which are diagnosed begin there. What takes processor time (`HealWork`) is done by somebody else, at low
priority, while the loop goes on; the seconds that pass meanwhile are the ones that nobody fitted, and prove it. A trial
is the daemon's: it goes back inside the tick, and when nobody says for five seconds that it is watched.

Rules of this file: pure: its only clock is the ticks' own and a given one for dates; it says what to command and what
to compute, others do. What it knows lies in the folder of versions, so that another one goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from hoopd.core.drift import BLOCK_S, BLOCKS
from hoopd.core.succession import ACCEPT, ALIVE, CONTROLLER, REVERT, REVERTED, TRIAL
from hoopd.design.comparison import BALL, REST_S, WantedCommand
from hoopd.design.yardstick import TickSample
from hoopd.files.heal_policy import HealPolicy
from hoopd.heal.versions import OVER, HealVersion, VersionFolder

DRIFT = "model_drift"
# The median of the blocks is beyond its bound when half of them are: of these all but the first are of the changed loop
# from their beginning on.
CERTAIN_S = (BLOCKS // 2 - 1) * BLOCK_S
ALIVE_S = 1.0
PATIENCE_S = 25.0  # until a candidate has taken over
BACK_S = 5.0  # until the daemon has told that the law changed
ENTER_S = 3.0  # of a trial or of a new version: the filter settles, the ball comes to where it is wanted
# A cost of so much more than what was promised is no promise kept; of more than the law of before would have: worse.
KEPT, WORSE = 1.2, 1.05
SETTLING_ROUNDS, BAD_ROUNDS = 4, 2
# The daemon's guard judges single seconds, in which another reference may cost as much as a bad law.
TRIES = 2
# What comes to nothing again and again is looked at ever more seldom: every pause is twice the one before, so often.
MOST_DOUBLED = 4


@dataclass(frozen=True, kw_only=True)
class HealPlan:
    """How long things take, s."""

    window_s: float = 40.0  # that are diagnosed
    fresh_s: float = 20.0  # that prove it
    trial_s: float = 30.0
    round_s: float = 30.0  # of the watch over what was accepted
    pause_s: float = 300.0  # after something that came to nothing
    every_s: float = 0.0  # diagnose so often without a drift, too; 0: only then
    by: str = BALL


class HealWork(NamedTuple):
    """What is to be computed of seconds that were recorded."""

    name: str  # diagnose, prove or weigh
    number: int  # of the version
    from_s: float
    to_s: float


@dataclass
class _Watched:
    """What was seen of the loop that the next diagnosis needs."""

    drift_at: float | None = None
    gathered_from: float | None = None
    faults: dict[str, list[tuple[float, float | None]]] = field(default_factory=dict)


class Healing:
    """One run of a daemon, followed."""

    def __init__(
        self,
        folder: VersionFolder,
        plan: HealPlan,
        policy: HealPolicy | None,
        clock: Callable[[], float],
        run: str = "",
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`clock`: s, of dates; `run`: name of the daemon's run; `tell`: a line for whoever looks."""
        self.folder, self.plan, self.policy, self.clock, self.run = folder, plan, policy, clock, run
        self.phase = "watching"
        self._over_now = self._settled = False
        self.why = ""
        self.version: HealVersion | None = None
        self._tell, self._seen = tell, _Watched()
        self._t = self._since = self._alive_at = self._quiet_until = self._acts_since = 0.0
        self._running, self._on_trial, self._rounds, self._bad, self._fruitless = False, False, 0, 0, 0
        self._last_look: float | None = None
        self._work: HealWork | None = None
        self._orders: list[WantedCommand] = []
        self._take_up()

    @property
    def over(self) -> bool:
        """Nothing more is wanted but the last orders."""
        return self._over_now

    @property
    def settled(self) -> bool:
        """The last orders were given."""
        return self._settled

    # ------------------------------------------------------------------------------------------ what comes in

    def put(self, sample: TickSample) -> tuple[WantedCommand, ...]:
        """One tick; what is to be commanded now."""
        self._t = sample.t
        if sample.running != self._running:
            self._running = sample.running
            self._enter_or_leave()
        if self._last_look is None:
            self._last_look = sample.t
        if not self.over:
            self._advance()
            if self._on_trial and self._t - self._alive_at >= ALIVE_S:
                self._alive_at = self._t
                self._orders.append(WantedCommand(ALIVE))
        orders, self._orders = tuple(self._orders), []
        if self.over:
            self._settled = True
        return orders

    def note(self, event: str, fields: Mapping[str, Any]) -> None:
        """One fact that the daemon tells."""
        if event == DRIFT:
            self._drifts()
        elif event == "fault":
            self._seen.faults.setdefault(str(fields.get("fault")), []).append((self._t, None))
        elif event == "fault_cleared":
            self._fault_ends(str(fields.get("fault")))
        elif event == CONTROLLER:
            self._took_over(fields)
        elif event == "operator" and fields.get("command") == ACCEPT and self.phase == "accepting":
            self._accepted()
        elif event == "trial_returned":
            self._returned(str(fields.get("reason", "")))
        elif event == "command_refused":
            self._refused(str(fields.get("command")), str(fields.get("reason", "")))

    def see(self, faults: tuple[str, ...]) -> None:
        """Active faults, as a status tells them: what began before anybody listened."""
        if DRIFT in faults:
            self._drifts()

    def refuse(self, order: WantedCommand, reason: str) -> None:
        """An order was not obeyed."""
        self._refused(order.name, reason)

    def stop(self, reason: str) -> None:
        """End it; what is on trial goes back."""
        if not self.over:
            self._over_now, self.why = True, reason
            if self._on_trial or self.phase == "asked":  # it may act already
                self._orders.append(WantedCommand(REVERT))
                self._on_trial = False
                self.phase = "proposed"
                self._keep("proposed", f"its trial was broken off: {reason}")

    def take_work(self) -> HealWork | None:
        """What is to be computed, once."""
        work, self._work = self._work, None
        return work

    def done(self, work: HealWork, result: Mapping[str, Any]) -> None:
        """What came of a computation; `error` in it: why nothing did."""
        if self.version is None or work.number != self.version.number or self.over:
            return
        if error := result.get("error"):
            self._failed(work, str(error))
            return
        {"diagnose": self._diagnosed, "prove": self._proven, "weigh": self._weighed}[work.name](result)

    def decide(self, accept: bool, who: str) -> None:
        """A person's word about what is proposed."""
        if self.phase == "proposed" and self.version is not None:
            self.version.decided_by = who
            if accept:
                self._try()
            else:
                self._end("left", f"left by {who}")

    def faults_s(self, from_s: float, to_s: float) -> dict[str, float]:
        """For how long each row was active between two times."""
        found = {}
        for name, spans in self._seen.faults.items():
            inside = [min(to_s, to_s if end is None else end) - max(from_s, begin) for begin, end in spans]
            if (seconds := sum(one for one in inside if one > 0.0)) > 0.0:
                found[name] = seconds
        return found

    # ------------------------------------------------------------------------------------------ what follows

    def _take_up(self) -> None:
        """Where the one before was broken off."""
        open_ones = [one for one in self.folder.every() if one.state not in OVER]
        for one in open_ones[:-1]:
            self._keep_other(one, "left", "another attempt was begun since")
        if not open_ones:
            return
        self.version = one = open_ones[-1]
        self._tell(f"going on with version {one.number}: {one.state}")
        if one.state == "trying":
            self._keep("proposed", "its trial was broken off: the daemon went back by itself")
        if one.state == "proposed":
            self.phase = "proposed"
            self._ask_policy()
        elif one.run == self.run or (self.folder.of(one.number) / "evidence.mcap").exists():
            self.phase = "diagnosing"
            self._work = HealWork("diagnose", one.number, one.from_s, one.to_s)
        else:
            self._end("left", "its minutes were lost when it was broken off")

    def _enter_or_leave(self) -> None:
        """The law begins to act, or no longer does: minutes without it are none."""
        self._acts_since = self._t
        self._seen.gathered_from = self._seen.drift_at = None
        if self.phase == "gathering":
            self.phase = "watching"
        if not self._running and self.phase == "asked":
            self._end("went_back", "the law no longer acts")

    def _drifts(self) -> None:
        """The model no longer fits; what is told right after a change may be of the law before it."""
        told_anew = self.phase not in ("settling", "rolling") and self._t >= self._quiet_until
        if told_anew and self._seen.drift_at is None:
            self._seen.drift_at = self._t

    def _fault_ends(self, name: str) -> None:
        spans = self._seen.faults.get(name)
        if spans and spans[-1][1] is None:
            spans[-1] = (spans[-1][0], self._t)

    def _advance(self) -> None:
        """What the time has come for."""
        passed = self._t - self._since
        if self.phase == "watching" and self._running and self._t >= self._quiet_until:
            self._begin_gathering()
        elif self.phase == "gathering" and self._seen.gathered_from is not None:
            if self._t - self._seen.gathered_from >= self.plan.window_s:
                self._diagnose()
        elif self.phase == "waiting" and self._running and self._t >= self._fresh_until():
            self._prove()
        elif self.phase == "decided" and self._running and self._t - self._acts_since >= REST_S:
            self._ask_for_trial()
        elif self.phase == "asked" and passed > PATIENCE_S:
            self._end("refused", f"the daemon did not take it over within {PATIENCE_S:g} s")
        elif self.phase == "accepting" and passed > BACK_S:
            self._accepted()  # neither refused nor gone back: the word of it was lost
        elif self.phase == "trying" and passed >= ENTER_S + self.plan.trial_s:
            self._weigh(self._since + ENTER_S)
        elif self.phase == "settling" and passed >= self.plan.round_s:
            self._weigh(self._t - self.plan.round_s + (ENTER_S if self._rounds == 0 else 0.0))

    def _begin_gathering(self) -> None:
        drift_at, last = self._seen.drift_at, self._last_look
        if drift_at is not None:
            self._seen.gathered_from = drift_at - CERTAIN_S
        elif self.plan.every_s > 0.0 and last is not None and self._t - last >= self.plan.every_s:
            self._seen.gathered_from = self._t - self.plan.window_s
        else:
            return
        self.phase = "gathering"
        why = "the model drifts" if drift_at is not None else f"{self.plan.every_s:.0f} s have passed"
        self._tell(f"{why}: gathering {self.plan.window_s:.0f} s")

    def _diagnose(self) -> None:
        to_s = self._t
        from_s = max(0.0, to_s - self.plan.window_s)
        acting = self.folder.loop().acting
        faults = self.faults_s(from_s, to_s)
        self.version = self.folder.add(
            self.clock(), run=self.run, from_s=from_s, to_s=to_s, before=acting, faults_s=faults
        )
        self._enter("diagnosing")
        self._work = HealWork("diagnose", self.version.number, from_s, to_s)
        self._tell(f"version {self.version.number}: diagnosing {from_s:.0f} to {to_s:.0f} s")

    def _diagnosed(self, result: Mapping[str, Any]) -> None:
        assert self.version is not None
        version = self.version
        version.kind, version.reason = str(result["kind"]), str(result["reason"])
        version.evidence |= {key: result[key] for key in ("effects", "probabilities", "parameters") if key in result}
        if not result["learn"]:
            self._end("left", version.reason)
            return
        self._keep("proving", f"{version.kind}: {version.reason}")
        self._enter("waiting")

    def _fresh_until(self) -> float:
        """When enough was recorded that nobody fitted."""
        assert self.version is not None
        begin = self.version.to_s if self.version.run == self.run else self._since
        return begin + self.plan.fresh_s

    def _prove(self) -> None:
        assert self.version is not None
        self._enter("proving")
        begin = max(self._t - self.plan.window_s, self._fresh_until() - self.plan.fresh_s)
        self._work = HealWork("prove", self.version.number, begin, self._t)

    def _proven(self, result: Mapping[str, Any]) -> None:
        assert self.version is not None
        version = self.version
        version.evidence |= {key: result[key] for key in ("gain", "promise", "earlier") if key in result}
        version.restores, version.key = result.get("restores"), str(result.get("key", ""))
        version.sha256 = self.folder.hashes(version.number)
        if not result["proven"]:
            self._end("left", str(result["why"]))
            return
        self._keep("proposed", f"proven: {result['why']}")
        self._enter("proposed")
        self._ask_policy()

    def _ask_policy(self) -> None:
        """By the policy, or a person's business."""
        assert self.version is not None
        told, version = self.version.evidence, self.version
        if self.policy is None:
            self._tell(f"version {version.number} is proposed: {version.reason}; hoopd heal accept {version.number}")
            return
        accepted = [one.accepted for one in self.folder.every() if one.accepted is not None and one.kind != "found"]
        sizes = told.get("effects", {}), told.get("probabilities", {}), told.get("parameters", {})
        why = "" if version.restores is not None else self.policy.objection(*sizes)
        why = why or self.policy.too_often(accepted, self.clock())
        if why:
            self._keep("proposed", f"not by the policy: {why}")
            self._tell(f"version {version.number} is left to a person: {why}")
            return
        version.decided_by = "policy"
        self._try()

    def _try(self) -> None:
        assert self.version is not None
        self._enter("decided")

    def _ask_for_trial(self) -> None:
        assert self.version is not None
        self._keep("trying", f"on trial, decided by {self.version.decided_by}")
        self._enter("asked")
        self._orders.append(WantedCommand(TRIAL, key=self.version.key))

    def _took_over(self, fields: Mapping[str, Any]) -> None:
        """A controller acts from now on."""
        sha256 = self.version.key.partition("@")[2] if self.version is not None else "-"
        ours = bool(sha256) and str(fields.get("sha256", "")).startswith(sha256)
        if self.phase == "asked" and ours and fields.get("command") == TRIAL:
            self._on_trial, self._alive_at = True, self._t
            self._enter("trying")
        elif self.phase == "rolling":
            self._end("rolled_back", self.version.reason if self.version else "")
        elif fields.get("command") == CONTROLLER:
            self.stop("somebody else changed the controller: begin again with what acts now")
        elif self.phase in ("settling", "weighing") and not self._on_trial:
            self._settle("no longer watched: somebody else tries another law")

    def _refused(self, command: str, reason: str) -> None:
        """The daemon did not take what was asked for; what acts stays."""
        if self.phase == "asked" and command == TRIAL:
            self._end("refused", f"the daemon: {reason}")
        elif self.phase == "accepting" and command == ACCEPT:
            self._on_trial = False
            self._end("went_back", f"it could not be accepted: {reason}")
        elif self.phase == "rolling" and command == CONTROLLER:
            assert self.version is not None
            self.folder.acts(self.version.acts_as)
            self._end("accepted", f"{self.version.reason}; the daemon did not take the one of before: {reason}")

    def _returned(self, reason: str) -> None:
        on_trial, self._on_trial = self._on_trial, False
        if not (on_trial or self.phase == "asked") or self.version is None:
            return
        tries = self.version.evidence["tries"] = int(self.version.evidence.get("tries", 0)) + 1
        if reason == REVERTED or tries >= TRIES:
            self._end("went_back", "" if reason == REVERTED else reason)
            return
        self._keep("proposed", f"the daemon took it back, it is tried once more: {reason}")
        self._acts_since = self._t
        self._enter("decided")

    def _weigh(self, from_s: float) -> None:
        assert self.version is not None
        self.phase = "weighing"
        self._work = HealWork("weigh", self.version.number, from_s, self._t)

    def _weighed(self, result: Mapping[str, Any]) -> None:
        """Keep it, or take it back; after it was accepted two rounds in a row are asked."""
        assert self.version is not None
        bad = verdict(result, self.version.evidence.get("promise", {}))
        rounds = self.version.evidence.setdefault("rounds", [])
        rounds.append({**result, "bad": bad})
        if self._on_trial:
            if bad:
                self._orders.append(WantedCommand(REVERT))
                self._on_trial = False
                self._end("went_back", bad)
            else:
                self._orders.append(WantedCommand(ACCEPT))
                self._enter("accepting")
            return
        self._rounds, self._bad = self._rounds + 1, self._bad + 1 if bad else 0
        if self._bad >= BAD_ROUNDS:
            self._roll_back(bad)
        elif self._rounds >= SETTLING_ROUNDS:
            self._settle(f"watched over {SETTLING_ROUNDS} rounds")
        else:
            self._keep("accepted")
            self._enter("settling")

    def _accepted(self) -> None:
        """The daemon has it; what it held against the model of before is over."""
        assert self.version is not None
        self._on_trial = False
        self._orders.append(WantedCommand("clear"))
        self.version.accepted = self.clock()
        self._keep("accepted", f"accepted by {self.version.decided_by}: its cost is as promised")
        self.folder.acts(self.version.acts_as)
        self._seen = _Watched(faults=self._seen.faults)
        self._rounds = self._bad = self._fruitless = 0
        self._enter("settling")
        self._tell(f"version {self.version.number} is accepted: {self.version.reason}")

    def _roll_back(self, why: str) -> None:
        """The version of before, by one command."""
        assert self.version is not None
        before = self.folder.read(self.version.before)
        self.version.reason = why
        self._enter("rolling")
        self._orders += [WantedCommand(CONTROLLER, key=before.key), WantedCommand("clear")]
        self.folder.acts(before.number)

    def _settle(self, what: str) -> None:
        assert self.version is not None
        self._keep("accepted", what)
        self.version = None
        self._enter("watching")

    def _failed(self, work: HealWork, error: str) -> None:
        """A computation came to nothing."""
        if work.name != "weigh":
            self._end("left", error)
        elif self._on_trial:
            self._orders.append(WantedCommand(REVERT))
            self._on_trial = False
            self._end("went_back", error)
        else:
            self._enter("settling")

    # ------------------------------------------------------------------------------------------ what is kept

    def _end(self, state: Any, reason: str) -> None:
        """Nothing more comes of the version; the loop is watched again, after a pause."""
        assert self.version is not None
        self.version.reason = reason or self.version.reason
        self._keep(state, self.version.reason)
        self._tell(f"version {self.version.number}: {state.replace('_', ' ')}, {self.version.reason}")
        self._seen = _Watched(faults=self._seen.faults)
        self._acts_since = self._t
        self._last_look, self._quiet_until = self._t, self._t + self.plan.pause_s * 2**self._fruitless
        self._fruitless = min(self._fruitless + 1, MOST_DOUBLED)
        self.version = None
        self._enter("watching")

    def _keep(self, state: Any, what: str = "") -> None:
        assert self.version is not None
        self.version.state = state
        self.folder.keep(self.version, self.clock(), what)

    def _keep_other(self, version: HealVersion, state: Any, what: str) -> None:
        version.state = state
        self.folder.keep(version, self.clock(), what)

    def _enter(self, phase: str) -> None:
        self.phase, self._since = phase, self._t


def verdict(costs: Mapping[str, Any], promise: Mapping[str, Any]) -> str:
    """Why a loop is worse than it was promised to be; empty when it keeps the promise.

    `costs`: `measured` beside what simulation says of the new law (`new`) and of the one of before (`before`) for the
    same references; `promise`: the same of the minutes in which the law of before acted. What the device costs more
    than the model says in either is not the new law's fault.
    """
    scale = max(1.0, promise["measured"] / promise["before"]) if promise.get("before") else 1.0
    measured, new, before = costs["measured"], costs["new"] * scale, costs["before"] * scale
    if measured > KEPT * new and measured > WORSE * before:
        return f"it costs {measured:.3g}, {new:.3g} were promised, and the law of before would cost {before:.3g}"
    return ""
