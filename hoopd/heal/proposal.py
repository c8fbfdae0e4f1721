"""From a change to a version that waits for a word: minutes are gathered, diagnosed, and proven on fresh ones.

    watching -> gathering -> diagnosing -> waiting -> proving -> proposed
                                 |                       |
                                left                    left

What takes processor time is done by somebody else, at low priority, while the loop goes on; the seconds that pass
meanwhile are the ones that nobody fitted, and prove it.

Rules of this file: pure; it says what to compute, and commands nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hoopd.files.heal_versions import OVER
from hoopd.heal.attempt import Attempt

# Of a diagnosis, and of a proof, what is kept as evidence.
OF_A_DIAGNOSIS, OF_A_PROOF = ("effects", "probabilities", "parameters", "values"), ("gain", "promise", "earlier")


class VersionProposal:
    """The first half of a version's way."""

    def __init__(self, attempt: Attempt) -> None:
        self._in_hand = attempt

    def take_up(self) -> bool:
        """Go on where the one before was broken off; whether a version waits for a word."""
        hand = self._in_hand
        open_ones = [one for one in hand.folder.every() if one.state not in OVER]
        for one in open_ones[:-1]:
            one.state = "left"
            hand.folder.keep(one, hand.clock(), "another attempt was begun since")
        if not open_ones:
            return False
        one = open_ones[-1]
        hand.take(one)
        hand.tell(f"going on with version {one.number}: {one.state}")
        if one.before != (acting := hand.folder.loop().acting):
            hand.end("left", f"it was found beside version {one.before}, and version {acting} acts")
            return False
        if one.state == "trying":
            hand.keep("proposed", "its trial was broken off: the daemon went back by itself")
        if one.state == "proposed":
            hand.enter("proposed")
            return True
        if one.run == hand.run or (hand.folder.of(one.number) / "evidence.mcap").exists():
            hand.enter("diagnosing")
            hand.compute("diagnose", one.from_s, one.to_s)
        else:
            hand.end("left", "its minutes were lost when it was broken off")
        return False

    def advance(self) -> None:
        """What the time has come for."""
        hand, watch = self._in_hand, self._in_hand.watch
        if hand.phase == "watching" and (why := watch.begin(hand.plan)):
            hand.enter("gathering")
            hand.tell(f"{why}: gathering {hand.plan.window_s:.0f} s")
        elif hand.phase == "gathering" and watch.gathered(hand.plan):
            self._diagnose()
        elif hand.phase == "waiting" and watch.running and watch.t >= self._fresh_from() + hand.plan.fresh_s:
            self._prove()

    def _diagnose(self) -> None:
        hand = self._in_hand
        to_s = hand.watch.t
        from_s = max(0.0, to_s - hand.plan.window_s)
        told = {"before": hand.folder.loop().acting, "faults_s": hand.watch.faults_s(from_s, to_s)}
        hand.take(hand.folder.add(hand.clock(), run=hand.run, from_s=from_s, to_s=to_s, **told))
        hand.enter("diagnosing")
        hand.compute("diagnose", from_s, to_s)
        hand.tell(f"version {hand.version.number}: diagnosing {from_s:.0f} to {to_s:.0f} s")

    def diagnosed(self, result: Mapping[str, Any]) -> None:
        """What the minutes say."""
        hand = self._in_hand
        hand.version.kind, hand.version.reason = str(result["kind"]), str(result["reason"])
        hand.note(**{key: result[key] for key in OF_A_DIAGNOSIS if key in result})
        if not result["learn"]:
            hand.end("left")
            return
        hand.keep("proving", f"{hand.version.kind}: {hand.version.reason}")
        hand.enter("waiting")

    def _fresh_from(self) -> float:
        """Since when it is recorded what nobody fitted, with the law in force."""
        hand = self._in_hand
        begin = hand.version.to_s if hand.version.run == hand.run else hand.since
        return max(begin, hand.watch.acts_since)

    def _prove(self) -> None:
        hand = self._in_hand
        begin = max(hand.watch.t - hand.plan.window_s, self._fresh_from())
        hand.enter("proving")
        hand.compute("prove", begin, hand.watch.t)

    def proven(self, result: Mapping[str, Any]) -> bool:
        """What the fresh seconds say; whether it waits for a word now."""
        hand = self._in_hand
        hand.note(**{key: result[key] for key in OF_A_PROOF if key in result})
        hand.version.restores, hand.version.key = result.get("restores"), str(result.get("key", ""))
        hand.version.sha256 = hand.folder.hashes(hand.version.number)
        if not result["proven"]:
            hand.end("left", str(result["why"]))
            return False
        hand.note(proven_at=hand.clock())
        hand.keep("proposed", f"proven: {result['why']}")
        hand.enter("proposed")
        return True
