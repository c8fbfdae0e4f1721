"""From a word to a version that acts: on trial, weighed, accepted, watched for a while, given up when it fails.

    decided -> asked -> trying -> weighing -> accepting -> settling -> watching
       ^         |         |          |                        |
       |      refused  went back  went back              rolling -> rolled back
       +-------- taken back by the daemon, and as good as promised

A trial is the daemon's: it goes back inside the tick, and when nobody says for five seconds that it is watched.

Rules of this file: pure; it says what to command and what to weigh, others do.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from hoopd.core.succession import ACCEPT, ALIVE, CONTROLLER, REVERT, REVERTED, TRIAL
from hoopd.core.trial import DEAR, SILENT
from hoopd.design.comparison import REST_S
from hoopd.files.heal_versions import FOUND, HealVersion
from hoopd.heal.attempt import Attempt
from hoopd.heal.loop_watch import ANOTHER, TUNED
from hoopd.heal.plan import ALIVE_S, BACK_S, ENTER_S, PATIENCE_S, REMEMBERED, WEIGH_S
from hoopd.heal.weighing import SETTLING_ROUNDS, WeighedRounds, verdict

# The daemon's guard judges single seconds, in which another reference may cost as much as a bad law: what it took back
# for one, or because nobody was heard, is weighed by all of its seconds, and tried so often where these keep the
# promise; once more where they are too few. What a fault or a person ended is over.
TRIES_KEPT, TRIES_UNWEIGHED = 4, 2
LEAST_WEIGHED_S = 5.0
FAULT_S = 1.0  # a fault that is told so soon after the law stopped is what stopped it
SOMEBODY = "somebody else changed the controller: begin again with what acts now"
SOMEBODY_TRIES = "somebody else tries another law"
WATCHED = "watched"  # in a version's evidence: the watch over it is over


def _is_one_of(keys: Iterable[str], sha256: str) -> bool:
    """Whether a controller of this hash is that of one of these keys, whose hashes may be cut off."""
    digits = [key.partition("@")[2] for key in keys]
    return any(one and sha256.startswith(one) for one in digits)


class Probation:
    """The second half of a version's way."""

    def __init__(self, attempt: Attempt) -> None:
        self._in_hand, self._rounds, self._alive_at = attempt, WeighedRounds(), 0.0
        self._unanswered = ""  # NAME.yaml@SHA256 of what was asked for, until the daemon tells what became of it
        self._taken_back = ""  # why the daemon took back what is being weighed
        self._has_failed = False  # a fault took the torque away, and the law has not acted since

    def take_up(self) -> bool:
        """Go on with the watch over a version that acts, where the one before was broken off in it."""
        hand = self._in_hand
        every = list(hand.folder.every())
        for one in every:
            if one.evidence.get(WATCHED) and not one.evidence.get(REMEMBERED):
                hand.remember(one)  # the one before may have ended between the two, or had no memory
        for one in every[-1:]:
            watched = one.kind == FOUND or one.evidence.get(WATCHED)
            if one.state == "accepted" and not watched and one.acts_as == hand.folder.loop().acting:
                hand.take(one)
                hand.enter("settling")
                hand.tell(f"version {one.number} acts; its watch begins anew")
                return True
        return False

    @property
    def may_take_over(self) -> bool:
        """Whether the daemon may still put on trial what it was asked for: who waits can not be taken back."""
        return bool(self._unanswered) and self._in_hand.passed_s <= PATIENCE_S

    # ------------------------------------------------------------------------------------------ ticks

    def advance(self) -> None:
        """What the time has come for."""
        hand, watch = self._in_hand, self._in_hand.watch
        if hand.phase == "decided" and watch.running and watch.t - watch.acts_since >= REST_S:
            self._ask_for_trial()
        elif hand.phase == "asked" and hand.passed_s > PATIENCE_S:
            hand.end("refused", f"the daemon did not take it over within {PATIENCE_S:g} s")
        elif hand.phase == "accepting" and hand.passed_s > BACK_S:
            self._accepted()  # neither refused nor gone back: the word of it was lost
        elif hand.phase == "trying" and hand.passed_s >= ENTER_S + hand.plan.trial_s:
            self._weigh(hand.since + ENTER_S)
        elif hand.phase == "rolling" and hand.passed_s > PATIENCE_S:
            self._stays(f"the one of before did not take over within {PATIENCE_S:g} s")
        elif hand.phase == "weighing" and hand.passed_s > WEIGH_S:
            self.failed_to_weigh(f"it was not weighed within {WEIGH_S:g} s")
        elif hand.phase == "settling" and self._round_is_full:
            self._weigh(watch.t - hand.plan.round_s + (ENTER_S if self._rounds.count == 0 else 0.0))
        if hand.on_trial and watch.t - self._alive_at >= ALIVE_S:
            self._alive_at = watch.t
            hand.order(ALIVE)

    @property
    def _round_is_full(self) -> bool:
        """Whether the law acted for a whole round since the last one, and since it began to act."""
        hand, watch = self._in_hand, self._in_hand.watch
        acts_s = watch.t - watch.acts_since - ENTER_S if watch.running else 0.0
        return min(hand.passed_s, acts_s) >= hand.plan.round_s

    def law_begins(self) -> None:
        """The law acts again."""
        self._has_failed = False

    def law_stops(self) -> None:
        """The law no longer acts: the daemon forgets who waits where none does, not beside another one or a hand."""
        if self._in_hand.phase == "asked" and not self._in_hand.watch.controlled:
            self._in_hand.end("went_back", "the law no longer acts")

    def law_fails(self, why: str) -> None:
        """A fault took the torque away: under what was accepted a bad round, one until the law acts again."""
        hand, watch = self._in_hand, self._in_hand.watch
        acted = (watch.running or watch.t - watch.acts_since <= FAULT_S) and not watch.is_foreign(ANOTHER)
        watched = hand.phase in ("settling", "weighing") and not hand.on_trial and not self._taken_back
        if acted and watched and not self._has_failed:
            self._has_failed = True
            self._weighed_round({}, why)

    def begin(self, by: str) -> None:
        """Somebody said yes."""
        self._in_hand.version.decided_by = by
        self._in_hand.enter("decided")

    def leave(self, who: str) -> None:
        """Somebody said no after the yes of another, or of a policy: what is on trial goes back, what is accepted, too.

        What the daemon has been asked to try, to accept or to bring back is left when it has answered.
        """
        hand, why = self._in_hand, f"left by {who}"
        if self._taken_back:
            self._end_taken_back(why)
        elif hand.phase in ("trying", "weighing") and hand.on_trial:
            self.take_back(why)
        elif hand.phase == "settling":
            self._roll_back(why)

    def break_off(self, reason: str) -> None:
        """What is on trial goes back; a person who said yes is asked again."""
        hand = self._in_hand
        if hand.on_trial or hand.phase == "asked":  # it may act already
            hand.order(REVERT)
            hand.on_trial, hand.phase = False, "proposed"
            hand.folder.set_decision_aside(hand.version.number)
            hand.keep("proposed", f"its trial was broken off: {reason}")

    def _ask_for_trial(self) -> None:
        hand = self._in_hand
        hand.keep("trying", f"on trial, decided by {hand.version.decided_by}")
        hand.enter("asked")
        self._unanswered = hand.version.key
        hand.order(TRIAL, hand.version.key)

    def _weigh(self, from_s: float) -> None:
        self._in_hand.enter("weighing")
        self._in_hand.compute("weigh", from_s, self._in_hand.watch.t)

    # ------------------------------------------------------------------------------------------ what the daemon tells

    def took_over(self, fields: Mapping[str, Any]) -> str:
        """A controller acts from now on; why nothing more can be done here, empty otherwise."""
        hand, command, sha256 = self._in_hand, fields.get("command"), str(fields.get("sha256", ""))
        if command == TRIAL and _is_one_of([self._unanswered], sha256):
            self._unanswered = ""
            self._trial_begins()
        elif hand.phase == "rolling" and command == CONTROLLER and _is_one_of(self._before.keys, sha256):
            self._rolled_back()
        elif command == CONTROLLER:
            having = [one.acts_as for one in hand.folder.every() if _is_one_of(one.keys, sha256)]
            return f"version {having[-1]} acts: begin again with it" if having else SOMEBODY
        else:
            self._somebody_tries()
        return ""

    def _trial_begins(self) -> None:
        """What was asked for acts; what was broken off meanwhile goes back now, which it could not while it waited."""
        hand = self._in_hand
        if hand.phase == "asked":
            hand.on_trial, self._alive_at = True, hand.watch.t
            hand.enter("trying")
        else:
            hand.watch.is_not_own(ANOTHER)
            hand.order(REVERT)
            hand.tell("the trial that was broken off took over: it is taken back")

    def _somebody_tries(self) -> None:
        """A trial or an experiment that is not ours: its seconds are nobody's here, and none of ours is on trial."""
        hand = self._in_hand
        hand.watch.is_not_own(ANOTHER)
        if self._taken_back:
            self._end_taken_back(SOMEBODY_TRIES)
        elif hand.on_trial:  # the word of its end was lost
            hand.end("went_back", SOMEBODY_TRIES)

    def tuned(self, name: str) -> None:
        """Gains are of another size: those of what is on trial end the trial, those of what was accepted make it
        another law than the version's, until a controller is loaded."""
        hand, why = self._in_hand, f"{name} was tuned by hand"
        is_of_accepted = not hand.on_trial and not hand.watch.is_foreign(ANOTHER)
        self.break_off(why)
        if is_of_accepted and not hand.watch.is_foreign(TUNED):
            hand.watch.is_not_own(TUNED)
            back = f"hoopd heal restore {hand.folder.loop().acting}"
            hand.tell(f"{why}: nothing is learned, tried or weighed until a controller is loaded ({back})")

    def refused(self, command: str, reason: str) -> None:
        """The daemon did not take what was asked for; what acts stays."""
        hand = self._in_hand
        if command == TRIAL:
            self._unanswered = ""
        if hand.phase == "asked" and command == TRIAL:
            hand.end("refused", f"the daemon: {reason}")
        elif hand.phase == "accepting" and command == ACCEPT:
            hand.end("went_back", f"it could not be accepted: {reason}")
        elif hand.phase == "rolling" and command == CONTROLLER:
            self._stays(f"the daemon did not take the one of before: {reason}")

    def acts(self, key: str) -> None:
        """The controller that a status has as accepted: where the word of a roll-back was lost."""
        hand = self._in_hand
        if hand.phase == "rolling" and hand.passed_s > BACK_S and key in self._before.keys:
            self._rolled_back()

    @property
    def _before(self) -> HealVersion:
        """The version that acted before the one in hand."""
        return self._in_hand.folder.read(self._in_hand.version.before)

    def _rolled_back(self) -> None:
        self._in_hand.watch.law_changed()
        self._in_hand.end("rolled_back")

    def _stays(self, why: str) -> None:
        """What was accepted acts on, though it is bad."""
        hand = self._in_hand
        hand.folder.acts(hand.version.acts_as)
        hand.end("accepted", f"{hand.version.reason}; {why}")

    def returned(self, reason: str) -> None:
        """The daemon took the trial back."""
        hand, self._unanswered = self._in_hand, ""
        was_on_trial, hand.on_trial = hand.on_trial, False
        if not (was_on_trial or hand.phase == "asked"):
            hand.watch.is_own(ANOTHER)  # of somebody else
            return
        if not reason.startswith((DEAR, SILENT)):
            hand.end("went_back", "" if reason == REVERTED else reason)
            return
        hand.note(tries=self._tries + 1)
        hand.keep("proposed", f"the daemon took it back: {reason}")
        hand.watch.acts_since = hand.watch.t
        self._taken_back = reason
        if hand.phase == "trying" and hand.passed_s >= ENTER_S + LEAST_WEIGHED_S:
            self._weigh(hand.since + ENTER_S)
        elif hand.phase != "weighing":
            self._try_again(TRIES_UNWEIGHED)

    @property
    def _tries(self) -> int:
        """How often the daemon took it back."""
        return int(self._in_hand.version.evidence.get("tries", 0))

    def _try_again(self, most: int) -> None:
        if self._tries >= most:
            self._end_taken_back()
            return
        self._taken_back = ""
        self._in_hand.keep("proposed", "it is tried again")
        self._in_hand.enter("decided")

    def _end_taken_back(self, why: str = "") -> None:
        reason, self._taken_back = self._taken_back, ""
        self._in_hand.end("went_back", f"{reason}; {why}" if why else reason)

    def accepted(self) -> str:
        """The daemon tells that it holds what was on trial; why nothing more can be done here where that was another's,
        empty otherwise."""
        if self._in_hand.phase == "accepting":
            self._accepted()
        return SOMEBODY if self._in_hand.watch.is_foreign(ANOTHER) else ""

    def _accepted(self) -> None:
        """The version acts; what the daemon held against the model of before went with that model."""
        hand, version = self._in_hand, self._in_hand.version
        hand.on_trial = False
        version.accepted = hand.clock()
        hand.keep("accepted", f"accepted by {version.decided_by}: its cost is as promised")
        hand.folder.acts(version.acts_as)
        hand.watch.law_changed()
        self._rounds = WeighedRounds()
        hand.enter("settling")
        hand.tell(f"version {version.number} is accepted: {version.reason}")

    # ------------------------------------------------------------------------------------------ what it costs

    def weighed(self, result: Mapping[str, Any]) -> None:
        """Keep it, or take it back; after it was accepted two bad rounds in a row are asked."""
        hand = self._in_hand
        bad = verdict(result, hand.version.evidence.get("promise", {}), hand.plan.by)
        if not hand.on_trial and not self._taken_back:
            if bad and hand.watch.is_foreign(ANOTHER):
                hand.enter("settling")  # the daemon would refuse to bring another one back: weighed anew after that
            else:
                self._weighed_round(result, bad)
            return
        self._keep_round(result, bad)
        if self._taken_back:
            self._weighed_back(bad)
        elif bad:
            self.take_back(bad)
        else:
            hand.order(ACCEPT)
            hand.enter("accepting")

    def failed_to_weigh(self, error: str) -> None:
        """A computation came to nothing: what is on trial goes, what acts is weighed in the next round."""
        if self._taken_back:
            self._try_again(TRIES_UNWEIGHED)
        elif self._in_hand.on_trial:
            self.take_back(error)
        else:
            self._in_hand.enter("settling")

    def take_back(self, why: str) -> None:
        """The accepted law again."""
        self._in_hand.order(REVERT)
        self._in_hand.end("went_back", why)

    def _weighed_back(self, bad: str) -> None:
        """What the daemon took back: bad by all of its seconds, or by one of them alone."""
        if bad:
            self._end_taken_back(bad)
        else:
            self._try_again(TRIES_KEPT)

    def _keep_round(self, result: Mapping[str, Any], bad: str) -> None:
        self._in_hand.version.evidence.setdefault("rounds", []).append({**result, "bad": bad})

    def _weighed_round(self, result: Mapping[str, Any], bad: str) -> None:
        hand = self._in_hand
        self._keep_round(result, bad)
        self._rounds.add(bad)
        if self._rounds.is_given_up:
            self._roll_back(bad)
        elif self._rounds.is_settled:
            hand.note(**{WATCHED: True})
            hand.remember(hand.version)
            hand.let_go("accepted", f"watched over {SETTLING_ROUNDS} rounds")
        else:
            hand.keep("accepted")
            hand.enter("settling")

    def _roll_back(self, why: str) -> None:
        """The version of before, by one command."""
        hand, before = self._in_hand, self._before
        hand.version.reason = why
        hand.enter("rolling")
        hand.order(CONTROLLER, before.keys[0])
        hand.folder.acts(before.number)
