"""From a word to a version that acts: on trial, weighed, accepted; what comes after that is another file's.

    decided -> asked -> trying -> weighing -> accepting -> settling ...     (`acceptance_watch`)
       ^         |         |          |
       |      refused  went back  went back
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
from hoopd.heal.acceptance_watch import AcceptanceWatch
from hoopd.heal.attempt import Attempt
from hoopd.heal.loop_watch import ANOTHER, TUNED
from hoopd.heal.plan import ALIVE_S, BACK_S, ENTER_S, PATIENCE_S, WEIGH_S
from hoopd.heal.weighing import gone_again, verdict

# The daemon's guard judges single seconds, in which another reference may cost as much as a bad law: what it took back
# for one, or because nobody was heard, is weighed by all of its seconds, and tried so often where these keep the
# promise; once more where they are too few. What a fault or a person ended is over.
TRIES_KEPT, TRIES_UNWEIGHED = 4, 2
LEAST_WEIGHED_S = 5.0
SOMEBODY = "somebody else changed the controller: begin again with what acts now"
SOMEBODY_TRIES = "somebody else tries another law"


def _is_one_of(keys: Iterable[str], sha256: str) -> bool:
    """Whether a controller of this hash is that of one of these keys, whose hashes may be cut off."""
    digits = [key.partition("@")[2] for key in keys]
    return any(one and sha256.startswith(one) for one in digits)


class Probation:
    """The second half of a version's way."""

    def __init__(self, attempt: Attempt, acceptance: AcceptanceWatch) -> None:
        self._in_hand, self._acceptance, self._alive_at = attempt, acceptance, 0.0
        self._unanswered = ""  # NAME.yaml@SHA256 of what was asked for, until the daemon tells what became of it
        self._taken_back = ""  # why the daemon took back what is being weighed

    @property
    def may_take_over(self) -> bool:
        """Whether the daemon may still put on trial what it was asked for, because no answer was heard."""
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
            hand.weigh(hand.since + ENTER_S)
        elif hand.phase == "weighing" and hand.passed_s > WEIGH_S:
            self.failed_to_weigh(f"it was not weighed within {WEIGH_S:g} s")
        if hand.on_trial and watch.t - self._alive_at >= ALIVE_S:
            self._alive_at = watch.t
            hand.order(ALIVE)

    def law_stops(self) -> None:
        """The law no longer acts: the daemon forgets who waits where none does, not beside another one or a hand."""
        if self._in_hand.phase == "asked" and not self._in_hand.watch.controlled:
            self._in_hand.end("went_back", "the law no longer acts")

    def law_fails(self, why: str) -> None:
        """A fault took the torque away: under what was accepted a bad round, one until the law acts again."""
        hand, watch = self._in_hand, self._in_hand.watch
        watched = hand.phase in ("settling", "weighing") and not hand.on_trial and not self._taken_back
        if watched and not watch.is_foreign(ANOTHER):
            self._acceptance.law_fails(why)

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
            self._acceptance.roll_back(why)

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

    # ------------------------------------------------------------------------------------------ what the daemon tells

    def took_over(self, fields: Mapping[str, Any]) -> str:
        """A controller acts from now on; why nothing more can be done here, empty otherwise."""
        hand, command, sha256 = self._in_hand, fields.get("command"), str(fields.get("sha256", ""))
        is_ours = self._was_asked_for(str(command), sha256)
        if is_ours and command == TRIAL:
            self._unanswered = ""
            self._trial_begins()
        elif is_ours:
            self._acceptance.rolled_back()
        elif command == CONTROLLER:
            having = [one.acts_as for one in hand.folder.every() if _is_one_of(one.keys, sha256)]
            return f"version {having[-1]} acts: begin again with it" if having else SOMEBODY
        else:
            self._somebody_tries()
        return ""

    def _trial_begins(self) -> None:
        """What was asked for acts; what was broken off in the very second goes back now."""
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

    def refused(self, command: str, reason: str, sha256: str = "") -> None:
        """The daemon did not take what was asked for; what acts stays. `sha256`: of which file, where it tells that;
        what somebody else asked for is nothing of ours."""
        hand = self._in_hand
        if sha256 and not self._was_asked_for(command, sha256):
            return
        if command == TRIAL:
            self._unanswered = ""
        if hand.phase == "asked" and command == TRIAL:
            hand.end("refused", f"the daemon: {reason}")
        elif hand.phase == "accepting" and command == ACCEPT:
            hand.end("went_back", f"it could not be accepted: {reason}")
        elif hand.phase == "rolling" and command == CONTROLLER:
            self._acceptance.stays(f"the daemon did not take the one of before: {reason}")

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
            hand.weigh(hand.since + ENTER_S)
        elif hand.phase != "weighing":
            self._try_again(TRIES_UNWEIGHED)

    def _was_asked_for(self, command: str, sha256: str) -> bool:
        """Whether a file that the daemon took or refused is the one that was asked for."""
        if command == TRIAL:
            return _is_one_of([self._unanswered], sha256)
        rolls = command == CONTROLLER and self._in_hand.phase == "rolling"
        return rolls and _is_one_of(self._acceptance.before.keys, sha256)

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
        self._acceptance.begin()
        hand.tell(f"version {version.number} is accepted: {version.reason}")

    # ------------------------------------------------------------------------------------------ what it costs

    def weighed(self, result: Mapping[str, Any]) -> None:
        """Keep it, or take it back; after it was accepted two bad rounds in a row are asked."""
        hand = self._in_hand
        evidence = hand.version.evidence
        bad = verdict(result, evidence.get("promise", {}), hand.plan.by) or gone_again(result, evidence)
        if not hand.on_trial and not self._taken_back:
            if bad and hand.watch.is_foreign(ANOTHER):
                hand.enter("settling")  # the daemon would refuse to bring another one back: weighed anew after that
            else:
                self._acceptance.weighed(result, bad)
            return
        hand.keep_round(result, bad)
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
