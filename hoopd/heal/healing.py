"""A loop that is followed: what comes in, and which half of a version's way it concerns.

    watching -> gathering -> diagnosing -> waiting -> proving -> proposed -> decided      (`proposal`)
                                 |                       |           |          |
                                left                    left        left        v
    watching <- settling <- weighing <- trying <--------------------------- asked         (`probation`,
                    |           |          |                                  |            `acceptance_watch`)
               rolled back  went back  went back                           refused

(`accepting` stands between weighing and settling, `rolling` between settling and rolled back: until the daemon tells.)

Rules of this room's machine: pure: its only clock is the ticks' own and a given one for dates; it says what to command
and what to compute, others do. What it knows lies in the folder of versions, so that another one goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hoopd.core.faulttable import BY_NAME, Action
from hoopd.core.succession import ACCEPT, CONTROLLER
from hoopd.design.comparison import WantedCommand
from hoopd.design.yardstick import TickSample
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import FOUND, HealVersion, VersionFolder
from hoopd.heal.acceptance_watch import AcceptanceWatch
from hoopd.heal.attempt import Attempt
from hoopd.heal.change import OF_THE_COMPUTER
from hoopd.heal.loop_watch import ANOTHER, DRIVEN
from hoopd.heal.plan import REMEMBER, REMEMBERED, HealPlan, HealWork
from hoopd.heal.probation import Probation
from hoopd.heal.proposal import VersionProposal
from hoopd.heal.told_controller import ToldController

DRIFT, POLICY = ("model_drift", "policy")
# A policy is asked again so often, and tries nothing that was proven longer ago: the device may be another by then.
ASK_S, PROOF_S = 60.0, 600.0
# A drift that is told right after a change of the law may be of the law before it.
UNHEARD_IN = ("settling", "rolling")
UNTRIED = ("proposed", "decided")
PHASE_OF_WORK: Mapping[str, str] = {"diagnose": "diagnosing", "prove": "proving", "weigh": "weighing"}


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
        self._in_hand = Attempt(folder, plan, clock, tell, run)
        self._proposal, self._acceptance = VersionProposal(self._in_hand), AcceptanceWatch(self._in_hand)
        self._probation = Probation(self._in_hand, self._acceptance)
        self._controller = ToldController(self._in_hand)
        self._policy, self._asked_at = policy, 0.0
        self._began = self._over = self._settled = False
        self.why = ""
        if not self._acceptance.take_up() and self._proposal.take_up():
            self._ask_policy()

    @property
    def phase(self) -> str:
        """How far it is, one of those above."""
        return self._in_hand.phase

    @property
    def version(self) -> HealVersion | None:
        """The one in hand."""
        return self._in_hand.version if self._in_hand.holds_one else None

    @property
    def over(self) -> bool:
        """Nothing more is wanted but the last orders."""
        return self._over

    @property
    def settled(self) -> bool:
        """The last orders were given, and nothing that was asked for can begin any more."""
        return self._settled

    # ------------------------------------------------------------------------------------------ what comes in

    def put(self, sample: TickSample) -> tuple[WantedCommand, ...]:
        """One tick; what is to be commanded now."""
        if self._in_hand.watch.tick(sample.t, sample.running):
            self._law_begins_or_stops()
        if not self._began:
            self._began = True
            self._in_hand.enter(self.phase)  # what was taken up begins with the first tick
        if not self.over:
            if self._policy is not None:
                self._ask_policy_again(self._policy)
            self._proposal.advance()
            self._probation.advance()
            self._acceptance.advance()
        orders, self._in_hand.orders = tuple(self._in_hand.orders), []
        self._settled = self._settled or (self.over and not self._probation.may_take_over)
        return orders

    def note(self, event: str, fields: Mapping[str, Any]) -> None:
        """One fact that the daemon tells."""
        if event == DRIFT:
            self._drifts()
        elif event == "fault":
            self._fault_begins(str(fields.get("fault")))
        elif event == "fault_cleared":
            self._in_hand.watch.fault_ends(str(fields.get("fault")))
        elif event == CONTROLLER:
            if why := self._probation.took_over(fields):
                self.stop(why)
        elif event == "operator" and fields.get("command") == ACCEPT:
            if why := self._probation.accepted():
                self.stop(why)
        elif event == "trial_returned":
            self._probation.returned(str(fields.get("reason", "")))
        elif event == "command_refused":
            told = (str(fields.get(name, "")) for name in ("command", "reason", "sha256"))
            self._probation.refused(*told)
        else:
            self._note_a_hand(event, fields)

    def _note_a_hand(self, event: str, fields: Mapping[str, Any]) -> None:
        """What a person does to the loop: minutes of it are none of the version's."""
        watch = self._in_hand.watch
        if event == "tuned":
            self._probation.tuned(str(fields.get("key", "")))
        elif event == "experiment_ended":
            watch.is_own(ANOTHER)
        elif event == "speed" and fields.get("speed"):
            watch.is_not_own(DRIVEN)
        elif event in ("speed", "speed_ended"):
            watch.is_own(DRIVEN)

    def see(self, faults: tuple[str, ...], acting: str | None = None) -> None:
        """Active faults and the accepted controller, as a status tells them: what began before anybody listened, and
        what was not heard. `acting`: NAME.yaml@SHA256, empty while another one acts, None where nobody tells."""
        if acting is not None:
            self._acceptance.acts(acting)
            if not self.over and (why := self._controller.see(acting)):
                self.stop(why)
        rows = [BY_NAME[name] for name in faults if name in BY_NAME]
        self._in_hand.watch.faults_are([row.name for row in rows if row.action > Action.NOTE])
        if DRIFT in faults:
            self._drifts()

    def refuse(self, order: WantedCommand, reason: str) -> None:
        """An order was not obeyed."""
        self._probation.refused(order.name, reason)

    def stop(self, reason: str) -> None:
        """End it; what is on trial goes back."""
        if not self.over:
            self._over, self.why = True, reason
            self._probation.break_off(reason)

    def take_work(self) -> HealWork | None:
        """What is to be computed, once."""
        return self._in_hand.take_work()

    def done(self, work: HealWork, result: Mapping[str, Any]) -> None:
        """What came of a computation; `error` in it: why nothing did."""
        if work.name == REMEMBER:
            self._remembered(work, result)
        elif self.over or not self._in_hand.waits_for(work) or self.phase != PHASE_OF_WORK[work.name]:
            return  # of a trial that went back meanwhile, or of a version that nobody has in hand any more
        elif error := result.get("error"):
            self._failed(work, str(error))
        elif work.name == "weigh":
            self._probation.weighed(result)
        elif work.name == "diagnose":
            self._proposal.diagnosed(result)
        elif self._proposal.proven(result):
            self._ask_policy()

    def decide(self, accept: bool, who: str) -> None:
        """A person's word about the version in hand, which may be told again and again: a yes is of what is proposed,
        a no of whatever has become of it meanwhile."""
        if not accept:
            self._leave(who)
        elif self.phase == "proposed":
            self._probation.begin(who)

    # ------------------------------------------------------------------------------------------ what follows

    def _leave(self, who: str) -> None:
        if self.phase in UNTRIED:
            self._in_hand.version.decided_by = who
            self._in_hand.end("left", f"left by {who}")
        elif self._in_hand.holds_one:
            self._probation.leave(who)

    def _law_begins_or_stops(self) -> None:
        """Minutes in which no law acts are none."""
        if self.phase == "gathering":
            self._in_hand.enter("watching")
        if self._in_hand.watch.running:
            self._acceptance.law_begins()
        else:
            self._probation.law_stops()

    def _fault_begins(self, name: str) -> None:
        self._in_hand.watch.fault_begins(name)
        row = BY_NAME.get(name)
        if row is not None and row.action >= Action.PAUSE and name not in OF_THE_COMPUTER:
            self._probation.law_fails(f"{name}: {row.meaning}")

    def _drifts(self) -> None:
        if self.phase not in UNHEARD_IN:
            self._in_hand.watch.drifts()

    def _remembered(self, work: HealWork, result: Mapping[str, Any]) -> None:
        """What is not is asked for again by the next that begins."""
        if error := result.get("error"):
            self._in_hand.tell(f"version {work.number} is not remembered: {error}")
        elif result.get(REMEMBERED):
            self._in_hand.remembered(work.number)

    def _failed(self, work: HealWork, error: str) -> None:
        """A computation came to nothing."""
        if work.name == "weigh":
            self._probation.failed_to_weigh(error)
        else:
            self._in_hand.end("left", error)

    def _ask_policy(self) -> None:
        """By the policy, or a person's business."""
        hand, version = self._in_hand, self._in_hand.version
        if self._policy is None:
            hand.tell(f"version {version.number} is proposed: {version.reason}; hoopd heal accept {version.number}")
            return
        self._asked_at = hand.watch.t
        if why := self._objection(self._policy, version):
            hand.keep("proposed", f"not by the policy: {why}")
            hand.tell(f"version {version.number} is left to a person: {why}")
            return
        self._begin_by_policy()

    def _ask_policy_again(self, policy: HealPolicy) -> None:
        """Its pause, or its day, may be over."""
        hand = self._in_hand
        if hand.phase == "proposed" and hand.watch.t - self._asked_at >= ASK_S:
            self._asked_at = hand.watch.t
            if not self._objection(policy, hand.version):
                self._begin_by_policy()

    def _begin_by_policy(self) -> None:
        """A trial; or a diagnosis of newer seconds, where nobody knows whether the proof still holds."""
        hand = self._in_hand
        age_s = hand.clock() - hand.version.evidence.get("proven_at", 0.0)
        if 0.0 <= age_s <= PROOF_S:
            self._probation.begin(POLICY)
            return
        version = hand.version
        told = f"{age_s:.0f} s old" if age_s > 0.0 else f"of a time to come: the clock was set back by {-age_s:.0f} s"
        version.reason = f"its proof is {told}, a policy tries nothing older than {PROOF_S:.0f} s"
        hand.let_go("left", version.reason)
        hand.tell(f"version {version.number}: left, {version.reason}")

    def _objection(self, policy: HealPolicy, version: HealVersion) -> str:
        """Why a policy does not let a version pass; what it has let pass once, or was found, is nothing new."""
        told, folder = version.evidence, self._in_hand.folder
        sizes = (told.get(name, {}) for name in ("effects", "probabilities", "parameters", "values"))
        restored = None if version.restores is None else folder.read(version.restores)
        is_known = restored is not None and (restored.kind == FOUND or restored.decided_by == POLICY)
        why = "" if is_known else policy.objection(*sizes)
        every = folder.every()
        accepted = [one.accepted for one in every if one.accepted is not None and one.kind != FOUND]
        return why or policy.too_often(accepted, self._in_hand.clock())
