"""Which controller a daemon has accepted, as its statuses tell it, beside the version that is believed to act.

An event may be lost, or told before anybody listens; a status comes every second. One may be older than the last event,
so that what it tells counts once it has been told for longer than that.

Rules of this file: pure; it says what is so, and commands nothing.
"""

from __future__ import annotations

from hoopd.heal.attempt import Attempt
from hoopd.heal.loop_watch import ANOTHER

TOLD_S = 3.0  # two statuses, and one of them may be lost
# Between an order and the daemon's word about it both controllers are ours.
BETWEEN = ("asked", "accepting", "rolling")
OWN, NONE, FOREIGN = ("own", "none", "foreign")


class ToldController:
    """What the statuses of one run tell."""

    def __init__(self, attempt: Attempt) -> None:
        self._in_hand = attempt
        self._told, self._since = "", 0.0  # s, run time: told so since then
        self._known: dict[tuple[int, str], str] = {}

    def see(self, key: str) -> str:
        """One look at the newest status; why nothing more can be done here, empty otherwise.

        `key`: NAME.yaml@SHA256 of what is accepted; empty while something else acts, or is about to.
        """
        hand, watch = self._in_hand, self._in_hand.watch
        told = "" if hand.on_trial or hand.phase in BETWEEN else self._meaning(key)
        if told != self._told:
            self._told, self._since = told, watch.t
        if not told or watch.t - max(self._since, watch.changed_at) < TOLD_S:
            return ""
        if told == FOREIGN:
            return self._another(key)
        if (told == NONE) is not watch.is_foreign(ANOTHER):
            (watch.is_not_own if told == NONE else watch.is_own)(ANOTHER)
        return ""

    def _meaning(self, key: str) -> str:
        """Whether a key is that of the version that acts."""
        if not key:
            return NONE
        acting = self._in_hand.folder.loop().acting
        if (acting, key) not in self._known:
            ours = {
                one for version in self._in_hand.folder.every() if version.acts_as == acting for one in version.keys
            }
            self._known[acting, key] = OWN if key in ours else FOREIGN
        return self._known[acting, key]

    def _another(self, key: str) -> str:
        """What acts instead: an earlier version, by a person or by a roll-back that came late, or none of them."""
        having = [one.acts_as for one in self._in_hand.folder.every() if key in one.keys]
        what = f"version {having[-1]} acts" if having else f"{key.partition('@')[0]} acts, which is no version here"
        return f"{what}: begin again with it"
