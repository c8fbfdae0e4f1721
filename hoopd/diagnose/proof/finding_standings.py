"""How each finding stands: its probability, the nearest name, its share of the mismatch, and what remains beside it.

Rules of this file: it puts together what `rivals_in_place`, `remainder` and `probabilities` say; verdicts stay what
they are.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import log

from hoopd.diagnose.curves.unknown_effects import Survey, Unknown
from hoopd.diagnose.proof.probabilities import (
    DENIED,
    MOST_NATS,
    UNLISTED,
    Likely,
    Option,
    among_what_acts,
    likely,
    too_small,
)
from hoopd.diagnose.proof.remainder import Remainder, explained, remainder
from hoopd.diagnose.proof.rivals_in_place import EffectTakenOut, nearest
from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS
from hoopd.diagnose.search.candidates import surprise_of
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Screen
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.likelihood.fitting import HypothesisFit

# A name is counted with a finding where so much of its own probability stands in that place.
COUNTED_PART = 0.5


@dataclass(frozen=True)
class Standing:
    """Of one finding."""

    probability: float | None = None
    nearest: str | None = None
    explained: float | None = None
    caveat: str = ""  # what is said before its statement


@dataclass(frozen=True)
class Standings:
    """Of all findings, and of every candidate."""

    findings: Mapping[str, Standing] = field(default_factory=dict)
    candidates: Mapping[str, float] = field(default_factory=dict)
    counted_with: Mapping[str, str] = field(default_factory=dict)  # candidates that nothing tells from a finding -> it
    rest: Remainder | None = None


@dataclass(frozen=True)
class Asked:
    """What is asked of: the names that were accepted, and the grammar (empty: it was not looked at)."""

    named: Named
    library: Mapping[str, Effect]
    mechanisms: Sequence[Mechanism]
    base: Survey
    beside: Survey | None  # of curves, beside the final fit
    unknown: Unknown | None
    threshold: float
    odds: Mapping[str, float] = field(default_factory=dict)  # nats by which names are likelier beforehand
    denied: Collection[str] = ()  # names that held-out data deny

    def believed(self, options: Sequence[Option]) -> list[Option]:
        """With what was believed beforehand."""
        return [one._replace(worth=one.worth + self.odds.get(one.name, 0.0)) for one in options]


def standings(asked: Asked) -> Standings:
    """Of every finding of a diagnosis."""
    named, unknown = asked.named, asked.unknown
    screen = _grammar_beside(asked)
    rest = remainder(screen, asked.beside if named.accepted else None)
    findings: dict[str, Standing] = {}
    likelies: list[Likely] = []
    counted_with: dict[str, tuple[str, float]] = {}
    total = named.base.criterion - named.final.criterion
    shares = explained([named.losses[one.effect.name] for one in named.accepted], total, rest)
    if unknown is not None:
        shares = [share * (1.0 - unknown.share) for share in shares]
    for one, share in zip(named.accepted, shares, strict=True):
        place = EffectTakenOut(named, one, asked.library, asked.mechanisms)
        left = _left_of(named.losses[one.effect.name], rest, unknown)
        curves = asked.base if len(named.accepted) == 1 else None
        unlisted = DENIED if one.effect.name in asked.denied else UNLISTED
        found = likely(asked.believed(place.options(asked.threshold, curves)), left, unlisted)
        near = place.nearest() if one.effect.name not in asked.library else None
        caveat = _caveat(one.effect.name, share, rest, len(named.accepted)) if rest is not None and rest.fires else ""
        findings[one.effect.name] = Standing(found.named, near, share, caveat)
        counted_with |= {name: (one.effect.name, found.shares[name]) for name in found.alike & set(found.shares)}
        likelies.append(found)
    if not likelies:
        likelies.append(likely(asked.believed(_unnamed(asked, screen)), _left(None, unknown)))
    if unknown is not None:
        none = 1.0 - _product([1.0 - one.none for one in likelies])
        near = nearest(_library_beside(unknown.beside, asked), unknown.score.vector)
        findings[unknown.name] = Standing(none, near, unknown.share)
    candidates = among_what_acts(likelies)
    # what stands in another place for the most part is a rival there
    alike = {
        name: one
        for name, (one, share) in counted_with.items()
        if name not in findings and share >= COUNTED_PART * candidates[name]
    }
    return Standings(findings, candidates, alike, rest)


def _grammar_beside(asked: Asked) -> MechanismScreen:
    """All mechanisms beside the final fit."""
    final, known = asked.named.final, asked.named.grammar
    if known is not None and known.fit is final:
        return known
    return MechanismScreen(final, [one for one in asked.mechanisms if one.name not in final.names])


def _left_of(gain: float, rest: Remainder | None, unknown: Unknown | None) -> float:
    """Log odds that what remains belongs into the place of a name that explains `gain` nats.

    Of a wrong name that lies at an angle a to what acts, cos^2 a of its nats are explained and sin^2 a remain; what is
    small beside a name's own nats is a second thing, or a correction of the law, sooner than another law in its place.
    """
    beyond = max(rest.beyond if rest is not None else 0.0, unknown.gain if unknown is not None else 0.0)
    if beyond <= 0.0 or gain <= 0.0:
        return _left(rest, unknown)
    return min(_left(rest, unknown), log(beyond / gain))


def _left(rest: Remainder | None, unknown: Unknown | None) -> float:
    """Log odds that something acts beside the names which has none."""
    found = [-MOST_NATS] if rest is None else [rest.log_odds]
    if unknown is not None:
        found.append(unknown.surprise - unknown.threshold)
    return max(found)


def _unnamed(asked: Asked, screen: MechanismScreen) -> list[Option]:
    """Where nothing was accepted: everything beside the re-fitted base."""
    stretches = [track.stretch for track in asked.named.base.tracks]
    gains = {s.member.effect.name: surprise_of(s, s.gain, stretches) for s in asked.named.scores}
    gains |= {one.effect.name: one.surprise for one in asked.named.tried}
    costs = {one.effect.name: one.worth for one in screen.proposals}
    curves = [Option(NONE_OF_THESE, asked.base.curves[0].surprise)] if asked.base.curves else []
    names = [Option(name, worth) for name, worth in {**costs, **gains}.items()]
    return [*names, Option(PARAMETERS, asked.threshold), *curves, too_small(asked.threshold)]


def _library_beside(fit: HypothesisFit, asked: Asked) -> Screen:
    known = asked.named.screens.get(id(fit))
    return known if known is not None else Screen(fit, [*asked.library.values()])


def _product(values: Sequence[float]) -> float:
    found = 1.0
    for one in values:
        found *= one
    return found


def _caveat(name: str, share: float, rest: Remainder, names: int) -> str:
    """The name is the nearest known one and not the whole answer; of several, what all of them leave is told once."""
    of_all = f"explains {100.0 * share:.0f} % of the mismatch, counted in nats"
    if names > 1:
        return f"{of_all} (what is lost without it; findings overlap, so that shares need not add up)"
    return f"{of_all}; {name} is the nearest known name, and what remains follows {rest.follows}"
