"""What is believed after a diagnosis, and what is still open.

A diagnosis keeps a share for laws that are in no vocabulary. No recording lowers it, so that what has to reach the
confidence that was asked for is the probability among the laws that are known; the other share is told beside it.

A law is proven where a simulation of held-out data is better with it. A slip, or another law that acts for moments, may
never be: the likelihood sees it and the error of a simulation hardly moves ("untested"). It is proven as well where
recordings that were made after it was named have raised its evidence by what it takes to name a law.

A drive's lag and its delay are told apart by how a torque begins, which few recordings show, and filter and law take
either for so much delay: where they are less than a nat apart they count together.

A name is not enough for a controller. A signal of two levels shows that a drive saturates, or has a dead zone, and not
how much: a smaller gain gives the same two levels. A law is open as long as all its numbers may be zero.

Rules of this file: diagnosis in, words and numbers out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hoopd.diagnose.proof.probabilities import DENIED, UNLISTED
from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS, Diagnosis, EffectFinding

# Nothing is missing: one signal alone may never have reached what it acts on, and too little is seen in a single run.
QUIET_KINDS = 3
# A candidate that is so surprising, in nats, is looked for: the best of thirty is by chance in two of five recordings.
LOOKED_FOR_NATS = 4.0
# What is believed less than so is not drawn or listed.
LEAST_SHOWN = 0.01
MOST_SHOWN = 6
REFUTED = ("weak", "not_confirmed")
UNPROVEN = (*REFUTED, "untested")
# Laws of one slot that make the same controller, and the nats from which on the data tell them apart all the same.
SAME_TO_A_LAW = frozenset({"lag", "delay"})
TOLD_APART_NATS = 1.0
# Numbers of a law that say how it runs and not how much of it there is.
NO_SIZES = frozenset({"phi", "n", "w", "follows", "t0", "t1", "vs", "T"})


@dataclass(frozen=True)
class Belief:
    """After one diagnosis.

    `laws`: findings, the strongest first; `probability`: of the least sure of them among the laws that are known, or of
    nothing being missing; `unknown`: of a law that nobody knows; `open`: why it is not settled, in sentences; `shares`:
    probabilities by name as the diagnosis tells them, the largest first; `unproven`: laws that no fresh
    data confirm; `alike`: laws that count with those that were found, and make the same controller; `unsure`: laws that
    have not the probability that is asked for.
    """

    laws: tuple[str, ...]
    probability: float
    unknown: float
    open: tuple[str, ...]
    shares: tuple[tuple[str, float], ...]
    unproven: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()

    @property
    def lacks_probability_alone(self) -> bool:
        """Whether all that is open is which of several laws it is that acts."""
        return bool(self.unsure) and len(self.open) == len(self.unsure)

    @property
    def lacks_proof_alone(self) -> bool:
        """Whether everything that is named is sure, and data that were not fitted have not confirmed it yet."""
        return bool(self.unproven) and len(self.open) == len(self.unproven)

    @property
    def settled(self) -> bool:
        """Whether nothing is open."""
        return not self.open

    @property
    def explanation(self) -> str:
        """In words."""
        if not self.laws:
            return "nothing that these signals show is missing"
        alike = f" (or {', '.join(self.alike)}: the same delay to filter and law)" if self.alike else ""
        return " and ".join(self.laws) + alike


def belief_of(diagnosis: Diagnosis, confidence: float, kinds: int, before: Sequence[Diagnosis] = ()) -> Belief:
    """What is believed; `confidence`: the probability that is asked for; `kinds`: of signals that were recorded;
    `before`: the diagnoses of fewer recordings, in their order."""
    shares = {one.name: one.probability or 0.0 for one in diagnosis.candidates}
    unknown = shares.get(NONE_OF_THESE, 0.0)
    if not diagnosis.effects:
        sure = _among_known(shares.get(PARAMETERS, 1.0 - unknown), unknown)
        missing = _unsure("that nothing is missing", sure, confidence)
        if kinds < QUIET_KINDS:
            missing += (f"{kinds} of {QUIET_KINDS} kinds of signal have not shown it: another may",)
        missing += tuple(f"{name} may be there ({nats:.1f} nats)" for name, nats in _nearly_seen(diagnosis))
        return Belief((), sure, unknown, missing, _shown(shares))
    shares |= {one.name: one.probability or 0.0 for one in diagnosis.effects}
    each = {
        one.name: _among_known(_probability(one, diagnosis, shares), _share_of_none(one, unknown, diagnosis))
        for one in diagnosis.effects
    }
    found = tuple(one.name for one in diagnosis.effects)
    unproven = tuple(one.name for one in diagnosis.effects if _lacks_proof(one, diagnosis, before))
    alike = tuple(name for one in diagnosis.effects for name in _alike(one))
    doubts = {
        one.name: _unsure(one.name, each[one.name], confidence) for one in diagnosis.effects if not one.is_unknown
    }
    sentences = _open(diagnosis, doubts, unproven)
    unsure = tuple(name for name, said in doubts.items() if said)
    return Belief(found, min(each.values()), unknown, sentences, _shown(shares), unproven, alike, unsure)


def _lacks_proof(finding: EffectFinding, diagnosis: Diagnosis, before: Sequence[Diagnosis]) -> bool:
    """Whether nothing that was not fitted confirms a law."""
    if finding.is_unknown or finding.status not in UNPROVEN:
        return False
    return finding.status in REFUTED or not _shown_again(finding, diagnosis, before)


def _shown_again(finding: EffectFinding, diagnosis: Diagnosis, before: Sequence[Diagnosis]) -> bool:
    """Whether what was recorded after a law was named first raised its evidence by what it takes to be named.

    Evidence is a law's beside the others: it is compared where the same laws were named, all fitted anew. What held-out
    data once spoke against is not shown by this.
    """
    if any(one.status in REFUTED for told in before for one in told.effects if one.name == finding.name):
        return False
    same = next((told for told in before if _names(told) == _names(diagnosis)), None)
    if same is None:
        return False
    first = next(one for one in same.effects if one.name == finding.name).evidence.log_likelihood_gain
    now, needed = finding.evidence.log_likelihood_gain, finding.evidence.threshold
    return first is not None and now is not None and needed is not None and now - first >= needed


def _names(diagnosis: Diagnosis) -> set[str]:
    return {one.name for one in diagnosis.effects}


def _probability(finding: EffectFinding, diagnosis: Diagnosis, shares: Mapping[str, float]) -> float:
    """Of a finding with those that count with it; one without a law has that of what is unexplained."""
    rest = diagnosis.unexplained
    told = rest.probability if finding.probability is None and finding.is_unknown and rest is not None else None
    counted = {one.name for one in diagnosis.candidates if one.counted_with == finding.name}
    more = sum(shares.get(name, 0.0) for name in _alike(finding) if name not in counted)
    return min(1.0, (finding.probability or told or 0.0) + more)


def _alike(finding: EffectFinding) -> tuple[str, ...]:
    """Laws that these data do not tell from one that was found, and that make the same controller."""
    slot, _, kind = finding.name.partition(".")
    same = {f"{slot}.{other}" for other in SAME_TO_A_LAW - {kind}} if kind in SAME_TO_A_LAW else set()
    behind = {one.name: one.behind_nats for one in finding.alternatives if one.name in same}
    return tuple(name for name, nats in behind.items() if nats is not None and nats < TOLD_APART_NATS)


def _nearly_seen(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """The likeliest of what was not named, where it is worth a look."""
    seen = [(one.name, one.surprise or 0.0) for one in diagnosis.candidates]
    return [one for one in sorted(seen, key=lambda one: -one[1])[:1] if one[1] >= LOOKED_FOR_NATS]


def _share_of_none(finding: EffectFinding, unknown: float, diagnosis: Diagnosis) -> float:
    """Of what stands in a finding's place; what has no name is itself what nobody knows, and that another law is denied
    makes this one no surer: it is taken as it would be told were none denied."""
    if finding.is_unknown:
        return 0.0
    denied = sum(one.status == "not_confirmed" for one in diagnosis.effects)
    if finding.status == "not_confirmed" or not denied:
        return unknown
    return 1.0 - min((1.0 - unknown) * ((1.0 - UNLISTED) / (1.0 - DENIED)) ** denied, 1.0)


def _among_known(probability: float, unknown: float) -> float:
    return min(1.0, probability / (1.0 - unknown)) if unknown < 1.0 else 0.0


def _unsure(what: str, sure: float, confidence: float) -> tuple[str, ...]:
    return () if sure >= confidence else (f"{what} is {sure:.0%} sure, {confidence:.0%} are asked for",)


def _open(diagnosis: Diagnosis, doubts: Mapping[str, Sequence[str]], unproven: Sequence[str]) -> tuple[str, ...]:
    sentences: list[str] = []
    for one in diagnosis.effects:
        if one.is_unknown:
            sentences.append(f"{one.name} has no law yet")
            continue
        sentences += doubts[one.name]
        if (loosest := _may_be_zero(one)) is not None:
            sentences.append(f"{one.name} is there and nobody knows how much: {loosest}")
        if one.name in unproven:
            sentences.append(f"{one.name} is {str(one.status).replace('_', ' ')}")
    if diagnosis.unexplained is not None and diagnosis.unexplained.fires:
        sentences.append(f"something without a name acts at {diagnosis.unexplained.slot}")
    if diagnosis.remains is not None:
        sentences.append(f"what remains at {diagnosis.remains.slot} follows {diagnosis.remains.follows}")
    return tuple(sentences)


def _may_be_zero(finding: EffectFinding) -> str | None:
    """The number of a law none of whose sizes is told from zero, with its interval; None where one is."""
    told = {name: one for name, one in finding.parameters.items() if one.ci95 is not None}
    sizes = ["A"] if "A" in told else [name for name in told if name not in NO_SIZES] or [*told]
    ends = {name: ci95 for name in sizes if (ci95 := told[name].ci95) is not None}
    if not ends or any(
        (low is not None and low > 0.0) or (high is not None and high < 0.0) for low, high in ends.values()
    ):
        return None
    name, (low, high) = next(iter(ends.items()))
    one, (first, last) = told[name], ("?" if end is None else f"{end:.3g}" for end in (low, high))
    return f"{name} = {one.value:.3g} {one.unit} (95 %: {first} to {last})"


def _shown(shares: dict[str, float]) -> tuple[tuple[str, float], ...]:
    ordered = sorted(shares.items(), key=lambda one: (-one[1], one[0]))
    return tuple((name, share) for name, share in ordered if share >= LEAST_SHOWN)[:MOST_SHOWN]
