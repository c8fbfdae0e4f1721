"""What was found and how sure it is in one plain sentence a finding, for who knows no nats.

Rules of this file: nothing is judged here, only said. Two questions are kept apart: whether something is missing there
at all, which the gain over what chance reaches tells, and which law it follows, which the probability tells.
"""

from __future__ import annotations

from hoopd.diagnose.record import NONE_OF_THESE, Diagnosis, EffectFinding
from hoopd.diagnose.report.headline import MOST_TOLD, beside_sentences, kept, verdict_sentence
from hoopd.diagnose.report.sentences import LEAST_LIKELY, lawless, laws_beside
from hoopd.plots.number_format import chance, listed, safe

# Nats beyond what is needed, from which on a doubt is one in 20 000, and one in 20.
CERTAIN_NATS, LIKELY_NATS = 10.0, 3.0
# What is weak as a law is there all the same where it explains so many times what is needed.
STRONG = 2.0
# A law that is likelier than this is as good as told.
TOLD = 0.95
RIVALS = 2


def summary(diagnosis: Diagnosis) -> str:
    """The plain sentences; where nothing is named, the verdict; and which readings jumped."""
    told = plain_sentence(diagnosis)
    return told + beside_sentences(diagnosis) if told else verdict_sentence(diagnosis)


def plain_sentence(diagnosis: Diagnosis) -> str:
    """One sentence for each finding that held-out data do not deny; empty without any."""
    told = kept(diagnosis)[:MOST_TOLD]
    places = [one.slot for one in told]
    return " ".join(_sentence(one, diagnosis, places[i] in places[:i]) for i, one in enumerate(told))


def _sentence(effect: EffectFinding, diagnosis: Diagnosis, again: bool) -> str:
    """`again`: something was told of this place already."""
    place = _place(effect)
    there = f"Something{' else' if again else ''} is {_sure(effect)} missing at the {place}{', too' if again else ''}"
    if effect.is_unknown and lawless(diagnosis):
        near = f"{safe(effect.nearest)} would describe it best" if effect.nearest else "no known law describes it"
        return f"{there}; {near}, and no law is proven."
    if effect.is_unknown:
        return f"{there}; no known law describes it."
    name, law = safe(effect.name), effect.probability
    if law is None:
        return f"{there}; of the known laws {name} describes it best."
    if law > TOLD:
        return f"{there}; which law it follows is known, too: {name}, {chance(law)} likely."
    alike = [
        safe(one.name)
        for one in sorted(diagnosis.candidates, key=lambda one: -(one.probability or 0.0))
        if one.counted_with == effect.name and (one.probability or 0.0) >= LEAST_LIKELY
    ]
    which = f"{name} (or {listed(alike[:RIVALS], 'or')}, which nothing here tells from it)" if alike else name
    return (
        f"{there}; that it is {which} is {chance(law)} likely, the other {chance(1.0 - law)} "
        f"{_rest(effect, diagnosis)}."
    )


def _place(effect: EffectFinding) -> str:
    """Where it is; where a law of another place is not excluded, that place, too."""
    if effect.is_unknown:
        return safe(effect.name.partition(".")[2])
    others = [
        slot for slot, dot, _ in (name.partition(".") for name in effect.not_excluded) if dot and slot != "unknown"
    ]
    return " or the ".join(map(safe, dict.fromkeys([effect.slot, *others])))


def _sure(effect: EffectFinding) -> str:
    """How sure it is that something is there, whatever it is called."""
    gain, needed = effect.evidence.log_likelihood_gain, effect.evidence.threshold
    if gain is None or needed is None or effect.status == "not_confirmed":
        return "probably"
    if effect.status not in (None, "confirmed") and gain < STRONG * needed:
        return "probably"
    beyond = gain - needed
    return "certainly" if beyond >= CERTAIN_NATS else "almost certainly" if beyond >= LIKELY_NATS else "probably"


def _rest(effect: EffectFinding, diagnosis: Diagnosis) -> str:
    """What it is otherwise: laws of the same place and those that are not excluded in others, the likeliest first, or
    none that is known.

    Without numbers: those of the candidates count whatever acts beside it, too, and add up to more.
    """
    rivals = [one.name for one in laws_beside(effect, diagnosis)[:RIVALS]]
    none = next((one.probability or 0.0 for one in diagnosis.candidates if one.name == NONE_OF_THESE), 0.0)
    if none >= LEAST_LIKELY and len(diagnosis.effects) == 1:
        rivals.append("a law that is not known here")
    return f"are mostly {listed(rivals, 'or')}" if rivals else "are shared among other laws that do much the same"
