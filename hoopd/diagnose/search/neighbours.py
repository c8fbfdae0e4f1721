"""Other laws of a name's slot, fitted in its place.

Rules of this file: no name of an effect is written here.
"""

from __future__ import annotations

from hoopd.diagnose.search.candidates import Judge, Tried
from hoopd.diagnose.search.naming import Named

# Neighbours that are fitted, the first of the screen.
MOST_TRIED = 3


def neighbours(named: Named, judge: Judge, one: Tried) -> list[Tried]:
    """Effects of the same slot fitted in its place, most evidence first."""
    mine, without = one.effect, named.without[one.effect.name]
    near = {
        name: effect for name, effect in judge.library.items()
        if effect.slot == mine.slot and name != mine.name and name not in mine.same_as
    }  # fmt: skip
    asked = Judge(judge.train, near, judge.settings)
    found = []
    for score in asked.proposals(without, without.names)[:MOST_TRIED]:
        judge.settings.progress(f"{score.member.effect.name} in place of {mine.name}")
        found.append(asked.tried(without, score))
    return sorted(found, key=lambda other: -other.surprise)
