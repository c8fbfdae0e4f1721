"""The names that the training data ask for: of the library, then of the grammar.

Rules of this file: it calls the steps in their order; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from hoopd.diagnose.case import Case, stretches_of
from hoopd.diagnose.counted_data import as_given, proving, training
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.replacement import replace_denied
from hoopd.diagnose.search.bounded_disturbance import likeliest
from hoopd.diagnose.search.candidates import Judge
from hoopd.diagnose.search.excluded_intervals import CountedData, looked_at_again, start_ups
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, leave_out_worthless, name_effects
from hoopd.diagnose.search.simpler_names import tell_simply
from hoopd.diagnose.search.told_by_intervals import told_by_intervals
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.likelihood.fitting import fit


@dataclass(frozen=True)
class Searched:
    """What was found in the training data, and what counts of all data."""

    named: Named
    data: CountedData
    data_held: CountedData
    runs: HeldOut
    grammar: Sequence[Mechanism]  # that was looked for
    library: Mapping[str, Effect]  # the case's, and the mechanisms that were named


def searched(case: Case) -> Searched:
    """Base, names, mechanisms; what held-out data deny gives its place to what they do not."""
    train, held = stretches_of(case.train), stretches_of(case.heldout)
    case.progress("base parameters")
    nominal = as_given(case, train)
    data, nominal, base = training(case, train, nominal)
    data_held = proving(held, base, case.settings.threshold)
    named = name_effects(data.kept, case.library, nominal, base, case.settings)
    named, data, data_held = _started(case, named, data, data_held)
    named, data = looked_at_again(named, data, case.settings.threshold)
    named, data = told_by_intervals(named, data, Judge(data.kept, case.library, case.settings))
    grammar = _mechanisms(case, data)
    library = with_mechanisms(case, named, data, grammar)
    data_held, runs = _heldout_again(named, data_held, HeldOut(data_held.kept))
    replace_denied(named, runs, Judge(data.kept, case.library, case.settings), case.seed)
    return Searched(named, data, data_held, runs, grammar, library)


def _started(case: Case, named: Named, data: CountedData, held: CountedData) -> tuple[Named, CountedData, CountedData]:
    """Named again without the start-ups of the drive that were named as pushes; the held-out data judged anew."""
    early = start_ups(named, {source.name: float(source.stretches[0].t[0]) for source in case.train})
    if not early:
        return named, data, held
    case.progress("without a start-up")
    data = data.begun_later(early)
    base = likeliest(fit(data.kept, case.effects, case.values))
    nominal = fit(data.kept, case.effects, case.values, move=False)
    # the inputs of these are as the drive had them already
    held = replace(proving(list(held.whole), base, case.settings.threshold), unheard=held.unheard)
    return name_effects(data.kept, case.library, nominal, base, case.settings), data, held


def _mechanisms(case: Case, data: CountedData) -> list[Mechanism]:
    """Of the grammar, those that are looked for."""
    if not case.settings.grammar:
        return []
    plant = max((one.plant for one in data.kept), key=lambda one: len(one.coordinates))
    return [one for one in mechanisms(plant).values() if one.name not in case.without]


def with_mechanisms(case: Case, named: Named, data: CountedData, wanted: Sequence[Mechanism]) -> Mapping[str, Effect]:
    """The library with the mechanisms beyond it that the recordings ask for, put among the names."""
    judge = Judge(data.kept, case.library, case.settings)
    if wanted:
        name_mechanisms(named, judge, wanted)
    tell_simply(named, judge, wanted)
    leave_out_worthless(named, judge)
    return {**case.library, **{one.effect.name: one.effect for one in named.accepted}}


def _heldout_again(named: Named, data: CountedData, held: HeldOut) -> tuple[CountedData, HeldOut]:
    """Held-out intervals that the names explain come back, too."""
    final = held.of(named.final) if named.accepted and data.aside else None
    more = data if final is None else data.brought_back(final)
    return (data, held) if more is data else (more, HeldOut(more.kept))
