"""What was accepted is watched for a while, and given up when it fails: the version of before acts again.

    settling -> weighing -> settling -> ... -> watched
                   |
                rolling -> rolled back

Rules of this file: pure; it says what to command and what to weigh, others do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hoopd.core.succession import CONTROLLER
from hoopd.files.heal_versions import FOUND, HealVersion
from hoopd.heal.attempt import Attempt
from hoopd.heal.plan import BACK_S, ENTER_S, PATIENCE_S, REMEMBERED
from hoopd.heal.weighing import WeighedRounds

FAULT_S = 1.0  # a fault that is told so soon after the law stopped is what stopped it
WATCHED = "watched"  # in a version's evidence: the watch over it is over


class AcceptanceWatch:
    """Over the version in hand, since it was accepted."""

    def __init__(self, attempt: Attempt) -> None:
        self._in_hand, self._rounds = attempt, WeighedRounds()
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

    def begin(self) -> None:
        """The version in hand was accepted now."""
        self._rounds = WeighedRounds()
        self._in_hand.enter("settling")

    def advance(self) -> None:
        """What the time has come for."""
        hand, watch = self._in_hand, self._in_hand.watch
        if hand.phase == "rolling" and hand.passed_s > PATIENCE_S:
            self.stays(f"the one of before did not take over within {PATIENCE_S:g} s")
        elif hand.phase == "settling" and self._round_is_full:
            hand.weigh(watch.t - hand.plan.round_s + (ENTER_S if self._rounds.count == 0 else 0.0))

    @property
    def _round_is_full(self) -> bool:
        """Whether the law acted for a whole round since the last one, and since it began to act."""
        hand, watch = self._in_hand, self._in_hand.watch
        acts_s = watch.t - watch.acts_since - ENTER_S if watch.running else 0.0
        return min(hand.passed_s, acts_s) >= hand.plan.round_s

    # ------------------------------------------------------------------------------------------ rounds

    def law_begins(self) -> None:
        """The law acts again."""
        self._has_failed = False

    def law_fails(self, why: str) -> None:
        """A fault took the torque away while the version acted: a bad round, one until the law acts again."""
        watch = self._in_hand.watch
        if (watch.running or watch.t - watch.acts_since <= FAULT_S) and not self._has_failed:
            self._has_failed = True
            self.weighed({}, why)

    def weighed(self, result: Mapping[str, Any], bad: str) -> None:
        """One more round; `bad`: why it is, empty when it is not. Two bad ones in a row are asked."""
        hand = self._in_hand
        hand.keep_round(result, bad)
        self._rounds.add(bad)
        if self._rounds.is_given_up:
            self.roll_back(bad)
        elif self._rounds.is_settled:
            hand.note(**{WATCHED: True})
            hand.remember(hand.version)
            hand.let_go("accepted", f"watched over {self._rounds.count} rounds")
        else:
            hand.keep("accepted")
            hand.enter("settling")

    # ------------------------------------------------------------------------------------------ the way back

    @property
    def before(self) -> HealVersion:
        """The version that acted before the one in hand."""
        return self._in_hand.folder.read(self._in_hand.version.before)

    def roll_back(self, why: str) -> None:
        """The version of before, by one command."""
        hand, before = self._in_hand, self.before
        hand.version.reason = why
        hand.enter("rolling")
        hand.order(CONTROLLER, before.keys[0])
        hand.folder.acts(before.number)

    def rolled_back(self) -> None:
        """It acts."""
        self._in_hand.watch.law_changed()
        self._in_hand.end("rolled_back")

    def acts(self, key: str) -> None:
        """The controller that a status has as accepted: where the word of a roll-back was lost."""
        hand = self._in_hand
        if hand.phase == "rolling" and hand.passed_s > BACK_S and key in self.before.keys:
            self.rolled_back()

    def stays(self, why: str) -> None:
        """What was accepted acts on, though it is bad."""
        hand = self._in_hand
        hand.folder.acts(hand.version.acts_as)
        hand.end("accepted", f"{hand.version.reason}; {why}")
