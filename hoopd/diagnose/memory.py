"""What is remembered of a device as the prior of the next diagnosis, with forgetting; what contradicts it.

Of a base parameter every entry has a value and a deviation by its own recordings. With a rate f the parameter walks by
f times its size in a day, and in n days by sqrt(n) times as much, whether the entry came before the recordings or after
them (`random_walk`): that walk is common to all entries beyond it. What follows is the Gaussian prior of the next fit,
each parameter's own: how two of them err together is forgotten, so that what is kept is less than what was known.

An effect that was confirmed raises the odds of its name, by at most three nats,

    log((a + sum_i p_i exp(-f T_i)) / a),        a = 0.05

T_i days away, with p_i by its own recordings: the odds that it had beforehand are taken out again. That one was not
seen says nothing: the recordings may not have reached it.

A parameter that these recordings alone put more than three deviations away has changed, or something else acts: its
memory does not count this time, and it is said.

Rules of this file: numbers in, numbers and sentences out; no file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, hypot, log, sqrt

from hoopd.diagnose.inputs import Source
from hoopd.diagnose.random_walk import DatedValue, walked
from hoopd.diagnose.record import Diagnosis, Quantity, UsedMemory
from hoopd.files.memory import Memory, RememberedDiagnosis, RememberedEffect, RememberedValue, days_between
from hoopd.ident.normal import Z95
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretch_scatter import interval
from hoopd.plants.scales import parameter_size

SIGMAS = 3.0
FIRST_BELIEF, MOST_NATS = 0.05, 3.0
# Share of a parameter's size by which its deviation grows in a day, as a walk: 11 % in a month, 38 % in a year.
FORGETTING = 0.02
# A deviation of a prior below this share of its size would hold a parameter against any data.
LEAST_SHARE = 1e-4


@dataclass(frozen=True)
class RememberedPrior:
    """What is believed before the recordings are looked at."""

    values: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of base parameters: mean, deviation
    effects: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of effects' parameters, by full name
    odds: Mapping[str, float] = field(default_factory=dict)  # of effects, nats

    def without(self, names: Sequence[str]) -> RememberedPrior:
        """Without some base parameters."""
        return replace(self, values={name: one for name, one in self.values.items() if name not in names})


def remembered_prior(memory: Memory, sizes: Mapping[str, float], date: str, rate: float) -> RememberedPrior:
    """Of all entries, as old as they are on a day.

    Parameters
    ----------
    memory : Memory
        Without what the recordings that are to be diagnosed have told already.
    sizes : mapping of str to float
        Usual sizes of the base parameters, in their units.
    date : str
        Of these recordings, YYYY-MM-DD; empty: all is of one day. What is dated after it is as far away.
    rate : float
        Forgetting: share of a size by which a deviation grows in a day; of effects the rate at which they fade, 1/day.

    Returns
    -------
    RememberedPrior
        Means and deviations in the parameters' units.

    Examples
    --------
    >>> from hoopd.files.memory import Memory, RememberedDiagnosis, RememberedValue
    >>> one = RememberedDiagnosis(recordings=["a"], parameters={"bh": RememberedValue(value=7e-4, sd=1e-5)})
    >>> remembered_prior(Memory(of="hoop rolling", diagnoses=[one]), {"bh": 7e-4}, "", 0.02).values
    {'bh': (0.0007, 1e-05)}
    """
    pairs = [(one, days_between(one.date, date)) for one in memory.diagnoses]
    values = {name: _dated((one.parameters.get(name), age) for one, age in pairs) for name in sizes}
    effects, sums = dict[str, list[DatedValue]](), dict[str, float]()
    for one, age in pairs:
        for name, effect in one.effects.items():
            sums[name] = sums.get(name, 0.0) + effect.probability * exp(-rate * abs(age))
            for key, value in effect.parameters.items():
                effects.setdefault(f"{name}.{key}", []).extend(_dated([(value, age)]))
    odds = {name: min(MOST_NATS, log((FIRST_BELIEF + total) / FIRST_BELIEF)) for name, total in sums.items()}
    return RememberedPrior(
        {name: walked(told, rate * sizes[name]) for name, told in values.items() if told},
        {name: walked(told, rate * max(abs(one.value) for one in told)) for name, told in effects.items()},
        odds,
    )


def _dated(told: Iterable[tuple[RememberedValue | None, float]]) -> list[DatedValue]:
    return [DatedValue(age, one.value, one.sd) for one, age in told if one is not None]


def dated_later(memory: Memory, date: str) -> str:
    """In a sentence, where entries are of a day after the recordings' own: they may be of a clock that was wrong."""
    later = sorted(one.date for one in memory.diagnoses if days_between(one.date, date) < 0.0)
    if not later:
        return ""
    count = "1 entry is" if len(later) == 1 else f"{len(later)} entries are"
    return f"{count} of a later day than these recordings ({later[-1]}, these {date}): as unsure as if it were before"


def sizes_of(plant: Plant) -> dict[str, float]:
    """Usual sizes of the parameters that a plant leaves free."""
    return {name: parameter_size(plant, name) for name in plant.free}


def believing(sources: Sequence[Source], known: RememberedPrior) -> list[Source]:
    """The recordings, their plants told what is remembered; what shared a plant goes on to share one."""
    told = dict[int, Plant]()

    def with_it(plant: Plant) -> Plant:
        return told.setdefault(id(plant), _told(plant, known))

    return [
        replace(one, stretches=tuple(replace(part, plant=with_it(part.plant)) for part in one.stretches))
        for one in sources
    ]


def _told(plant: Plant, known: RememberedPrior) -> Plant:
    values = {name: one for name, one in known.values.items() if name in plant.free}
    plant = replace(plant, values={**plant.values, **{name: mean for name, (mean, _) in values.items()}})
    sizes = {name: parameter_size(plant, name) for name in values}
    shares = {name: max(LEAST_SHARE, sd / sizes[name]) for name, (_, sd) in values.items()}
    return replace(plant, beliefs={**plant.beliefs, **shares})


def against_memory(
    sources: Sequence[Source], effects: Sequence[Effect], values: Mapping[str, float], known: RememberedPrior
) -> list[str]:
    """Base parameters that the recordings alone put more than `SIGMAS` deviations away from what is remembered."""
    alone = fit([one for source in sources for one in source.stretches], effects, values)
    found = []
    for name, (mean, sd) in known.values.items():
        ends = interval(alone, name) if name in alone.free else None
        if ends is not None and abs(alone.values[name] - mean) > SIGMAS * hypot(_deviation(ends), sd):
            found.append(name)
    return found


def used_memory(
    diagnosis: Diagnosis, sha256: str, known: RememberedPrior, counted: RememberedPrior, again: int
) -> UsedMemory:
    """What a diagnosis tells of the memory that was its prior.

    `known`: all that is remembered; `counted`: what was the prior; `again`: entries whose recordings came once more.
    """
    return UsedMemory(
        sha256=sha256,
        parameters={name: [mean, sd] for name, (mean, sd) in counted.values.items()},
        odds_nats=dict(counted.odds),
        left_out=[name for name in known.values if name not in counted.values],
        recordings_again=again,
        contradictions=contradictions(diagnosis, known, counted),
    )


def contradictions(diagnosis: Diagnosis, known: RememberedPrior, counted: RememberedPrior) -> list[str]:
    """In sentences: what these recordings say by themselves against what is remembered."""
    sentences = []
    for name, remembered in known.values.items():
        alone = alone_of(diagnosis.base.parameters.get(name), counted.values.get(name))
        sentences += _against(name, alone, remembered, _unit(diagnosis.base.parameters.get(name)))
    for effect in diagnosis.effects:
        for key, quantity in effect.parameters.items():
            name = f"{effect.name}.{key}"
            if name in known.effects:
                sentences += _against(name, alone_of(quantity, None), known.effects[name], quantity.unit)
    for name in known.odds:
        sentences += _gone(diagnosis, name, known)
    return sentences


def _gone(diagnosis: Diagnosis, name: str, known: RememberedPrior) -> list[str]:
    """An effect that was there and is not seen, though these recordings would show it."""
    seen, visible = {one.name for one in diagnosis.effects}, diagnosis.power.get(name)
    has = any(key.startswith(f"{name}.") for key in diagnosis.base.parameters)
    if name in seen or has or visible is None or visible.smallest is None:
        return []
    mean, sd = known.effects.get(f"{name}.{visible.parameter}", (0.0, 0.0))
    if abs(mean) - SIGMAS * sd <= visible.smallest:
        return []
    told = f"{mean:.3g} {visible.unit}".rstrip()
    return [f"{name} is remembered ({told}) and not seen, though {visible.smallest:.3g} would have been"]


def _against(name: str, alone: tuple[float, float] | None, remembered: tuple[float, float], unit: str) -> list[str]:
    if alone is None:
        return []
    off = abs(alone[0] - remembered[0]) / hypot(alone[1], remembered[1])
    if off <= SIGMAS:
        return []
    now, before = (f"{value:.4g} ± {Z95 * sd:.2g}" for value, sd in (alone, remembered))
    return [f"{name} is {now} {unit} by these recordings, {before} is remembered: {off:.1f} standard deviations"]


def alone_of(quantity: Quantity | None, prior: tuple[float, float] | None) -> tuple[float, float] | None:
    """Value and deviation by the recordings alone: what was known beforehand is taken out of an estimate again; None
    where nothing is left."""
    if quantity is None or quantity.value is None or quantity.ci95 is None:
        return None
    low, high = quantity.ci95
    if low is None or high is None or not high > low:
        return None
    sd = _deviation((low, high))
    if prior is None:
        return quantity.value, sd
    mean, before = prior
    # 1/sd^2 = 1/alone^2 + 1/before^2
    information = 1.0 / sd**2 - 1.0 / before**2
    if information <= 0.0:
        return None
    return (quantity.value / sd**2 - mean / before**2) / information, 1.0 / sqrt(information)


def remembered(
    diagnosis: Diagnosis, recordings: Sequence[str], date: str, counted: RememberedPrior
) -> RememberedDiagnosis:
    """What is to be remembered of a diagnosis: by its own recordings, of effects those that held-out data confirmed."""
    parameters, effects = dict[str, RememberedValue](), dict[str, RememberedEffect]()
    for name, quantity in diagnosis.base.parameters.items():
        alone = alone_of(quantity, counted.values.get(name))
        if alone is not None and "." not in name:
            parameters[name] = RememberedValue(value=alone[0], sd=alone[1], unit=quantity.unit)
    for one in diagnosis.effects:
        if one.status == "confirmed" and not one.is_unknown:
            told = {key: (alone_of(value, None), value.unit) for key, value in one.parameters.items() if "@" not in key}
            values = {key: RememberedValue(value=a[0], sd=a[1], unit=unit) for key, (a, unit) in told.items() if a}
            probability = _without_odds(one.probability or 0.0, counted.odds.get(one.name, 0.0))
            effects[one.name] = RememberedEffect(probability=probability, parameters=values)
    return RememberedDiagnosis(date=date, recordings=sorted(recordings), parameters=parameters, effects=effects)


def _without_odds(probability: float, nats: float) -> float:
    """A name's probability without the odds that it had beforehand."""
    return probability / (probability + (1.0 - probability) * exp(nats))


def _deviation(ends: tuple[float, float]) -> float:
    return (ends[1] - ends[0]) / (2.0 * Z95)


def _unit(quantity: Quantity | None) -> str:
    return "" if quantity is None else quantity.unit
