"""The verdict in words: what is sure, what is less sure and why, and the fit of held-out data before and after.

Rules of this file: nothing is judged here, only said; what held-out data deny is in no headline that names anything.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence

from hoopd.diagnose.record import (
    NONE_OF_THESE,
    PARAMETERS,
    Diagnosis,
    EffectFinding,
    Fit,
    Fits,
    NextExperiment,
    Number,
    Quantity,
)
from hoopd.diagnose.report.sentences import each_fit, lawless, laws_beside, none_of_them, questions_sentence
from hoopd.plots.number_format import chance, listed, nats, percent, safe, short_names, value_text

TITLES = {
    "consistent": "Consistent",
    "parameters": "Parameters, not physics",
    "missing_physics": "Missing physics found",
    "unknown_physics": "Unknown physics",
}
# A law that is less likely than this is more likely another one.
SURE = 0.5
# One that is less likely than this is no more than one of many: the place is told first.
OPEN = 0.2
# Two laws that are so many nats apart are told from one another (20 : 1).
EXCLUDED_NATS = 3.0
# Of recordings that differ so many are told.
MOST_DIFFERENT = 6
# Points of fit that a figure with one decimal shows.
SHOWN = 0.1


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, names that are sure before those that are not; and in another one what no model of
    the plant explains, a reading that jumps."""
    return _verdict(diagnosis) + beside_sentences(diagnosis)


def beside_sentences(diagnosis: Diagnosis) -> str:
    """What no model of all recordings explains, each with a space before it: readings that jump, and recordings that
    differ."""
    return jump_sentence(diagnosis) + disagreement_sentence(diagnosis)


def disagreement_sentence(diagnosis: Diagnosis) -> str:
    """In which number the recordings differ, with a space before it; empty where they agree."""
    found = diagnosis.disagreement
    if found is None:
        return ""
    like = max((abs(one) for one in found.by_recording.values() if one is not None), default=0.0)
    short = short_names(found.by_recording)
    each = [
        f"{value_text(Quantity(value, found.unit, None, None), like=like)} in {safe(short[name])}"
        for name, value in [*found.by_recording.items()][:MOST_DIFFERENT]
    ]
    more = len(found.by_recording) - len(each)
    alike = f" ({listed(found.not_excluded, 'or')} may be what differs, too)" if found.not_excluded else ""
    return (
        f" But the recordings disagree: with one of its own in each of them, {safe(found.name)} would be "
        f"{listed([*each, f'so on in {more} more'] if more else each)}, and they would be "
        f"{nats(found.log_likelihood_gain)} nats likelier ({nats(found.needed)} needed){alike}. Something was "
        "not the same in all of them, or a law that the model leaves out makes it seem so; one value for all lies "
        "between them."
    )


def jump_sentence(diagnosis: Diagnosis) -> str:
    """Which readings jumped, with a space before it; empty where none did."""
    total: Counter[str] = Counter()
    for one in diagnosis.data_quality.recordings.values():
        total.update(one.jumps)
    if not total:
        return ""
    often = {1: "once", 2: "twice"}
    each = listed(f"{name} jumped {often.get(count, f'{count} times')}" for name, count in total.items())
    return (
        f" Beside that, {each} and went on from there (lost counts, or what slipped): taken out, and the recordings' "
        "notes say when."
    )


def _verdict(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "consistent":
        return "The model explains these recordings: nothing is missing that they could show."
    if diagnosis.verdict == "parameters":
        return _parameters_sentence(diagnosis)
    if diagnosis.verdict == "unknown_physics":
        if lawless(diagnosis):
            return f"Something acts that the model leaves out: {safe(diagnosis.effects[0].statement)}."
        known = [one for one in kept(diagnosis) if not one.is_unknown]
        beside = f" beside {_names(known, diagnosis)}" if known else ""
        return f"Something that is not in the library acts {_unknown_place(diagnosis)}{beside}."
    return _missing_sentence(diagnosis)


def _parameters_sentence(diagnosis: Diagnosis) -> str:
    if not diagnosis.refused:
        return (
            "The parameters are off, and re-estimating them removes the mismatch: beyond them nothing is missing that "
            "these recordings could show."
        )
    return (
        "The parameters are off, and re-estimating them is as much as held-out data bear out: "
        f"more was found ({listed(one.name for one in diagnosis.refused)}), and not confirmed."
    )


def _missing_sentence(diagnosis: Diagnosis) -> str:
    if not kept(diagnosis):
        denied = listed(f"{_finding(one, diagnosis)}: {one.reason}" for one in diagnosis.effects)
        return (
            "Physics is missing, and no name for it is confirmed. "
            f"What explains most of it, and is in no model that is written: {denied}."
        )
    if all(map(doubt, kept(diagnosis))):
        open_laws = listed(_finding(one, diagnosis) for one in kept(diagnosis))
        return f"Physics is missing, and which law it follows is not sure: {open_laws}."
    said = [one for one in kept(diagnosis) if not doubt(one) and one.statement]
    meaning = safe(said[0].statement).rstrip(".") if len(said) == len(diagnosis.effects) == 1 else ""
    more = f" {meaning[0].upper()}{meaning[1:]}." if meaning else ""
    return f"The model leaves out {_names(kept(diagnosis), diagnosis)}.{more}"


def kept(diagnosis: Diagnosis) -> list[EffectFinding]:
    """Findings that held-out data do not deny."""
    return [one for one in diagnosis.effects if one.status != "not_confirmed"]


def doubt(effect: EffectFinding) -> str:
    """Why a finding is less sure than others; empty for one that is confirmed and likelier than all other laws."""
    if effect.status == "untested":
        return "held-out data never test it"
    if effect.status == "weak":
        return "weak: a shuffled cause gains too" if effect.placebo and not effect.placebo.held else "weak"
    is_likely = effect.probability is None or effect.probability > SURE
    return "" if is_likely else f"{chance(effect.probability)} likely"


def _names(findings: Sequence[EffectFinding], diagnosis: Diagnosis) -> str:
    """Those that are sure; the others behind them."""
    sure = listed(_finding(one, diagnosis) for one in findings if not doubt(one))
    doubted = listed(_finding(one, diagnosis) for one in findings if doubt(one))
    return "; ".join([*([sure] if sure else []), *([f"less sure: {doubted}"] if doubted else [])])


def _finding(effect: EffectFinding, diagnosis: Diagnosis) -> str:
    """A name with its first size, why it is doubted, what is likelier in its place and what cannot be told from it; of
    a law that is hardly the one in its place, the place, and the likeliest law first."""
    likelier = _likelier(effect, diagnosis)
    if effect.status != "not_confirmed" and effect.probability is not None and effect.probability < OPEN:
        laws = [*likelier, f"{effect.name}: {doubt(effect)}"]
        return f"something at the {effect.slot} whose law is open ({'; '.join(laws)})"
    why = [doubt(effect)] if effect.status != "not_confirmed" and doubt(effect) else []
    rivals = [f"{listed(effect.not_excluded)} not excluded"] if effect.not_excluded else []
    inside = [*_first_size(effect), *why, *likelier, *rivals]
    return effect.name + (f" ({'; '.join(inside)})" if inside else "")


def _likelier(effect: EffectFinding, diagnosis: Diagnosis) -> list[str]:
    """The likeliest law of a finding's place where that is another one; of two findings in a place nobody says which
    of them it would replace."""
    if effect.probability is None or sum(one.slot == effect.slot for one in diagnosis.effects) > 1:
        return []
    others = laws_beside(effect, diagnosis)[:1]
    return [
        f"{one.name}: {chance(one.probability)} likely"
        for one in others
        if (one.probability or 0.0) > effect.probability
    ]


def _first_size(effect: EffectFinding) -> list[str]:
    """The first of a finding's sizes; of what acts in some recordings alone, or begins with a time of its own in each,
    the first that holds for all of them and the first of a recording in which it acts: a push has a force and a time.
    """
    sizes = {name: one for name, one in effect.parameters.items() if one.value is not None}
    each = {name: one for name, one in sizes.items() if "@" in name}
    split = {name.partition("@")[0] for name in each}
    whole = [f"{name} = {value_text(one)}" for name, one in sizes.items() if name not in each and name not in split]
    acts = {name: one for name, one in each.items() if one.ci95 is not None}
    if not acts or (len(acts) == len(each) and next(iter(sizes)) not in split):
        return [f"{name} = {value_text(one)}" for name, one in sizes.items()][:1]
    name, time = next(iter(acts.items()))
    own, _, recording = name.partition("@")
    short = short_names(one.partition("@")[2] for one in each)
    more = sum(one.startswith(f"{own}@") for one in acts) - 1
    where = f" in {short[recording]}" * (len(short) > 1) + f" and {more} more" * (more > 0)
    return [*whole[:1], f"{own} = {value_text(time)}{where}"]


def _unknown_place(diagnosis: Diagnosis) -> str:
    rest = diagnosis.unexplained
    if rest is None or rest.slot is None:
        return "in a slot that could not be located"
    own = [] if rest.curve is None else [rest.curve.regressor]
    located = bool(diagnosis.effects) and diagnosis.effects[0].is_unknown
    follows = diagnosis.location.depends_on if located else own
    return f"in slot {rest.slot}" + (f" and follows {listed(follows)}" if follows else "")


# ------------------------------------------------------------------------------------------- held-out data


def fit_sentence(diagnosis: Diagnosis) -> str:
    """Fit of held-out data by your model, re-fitted and with effects, of the channel that gained most, and every
    channel that lost; means over the recordings. Empty where nothing was held out."""
    means = _channel_means(diagnosis.fit.heldout, named=bool(kept(diagnosis)))
    if not means:
        return ""
    channel = max(means, key=lambda name: means[name]["last"] - means[name]["best"])
    figures = ", ".join(f"{name} {percent(value)}" for name, value in means[channel].items() if name in COLUMNS)
    lost: dict[str, list[str]] = {}
    for name, one in means.items():
        if one["best"] - one["last"] > SHOWN:
            whose = "your model" if one["best"] == one.get("your model") else "the re-fitted model"
            lost.setdefault(whose, []).append(f"{name} ({one['last']:.1f} against {one['best']:.1f} %)")
    worse = "".join(f"; worse than {whose}: {listed(names)}" for whose, names in lost.items())
    saved = _mean_known([one.written for _, name, one in each_fit(diagnosis.fit.heldout) if name == channel])
    model = "" if saved is None else f", with those that --write saves {percent(saved)}"
    return f"Fit of held-out {channel}: {figures}{model} %{worse}."


COLUMNS = ("your model", "re-fitted", "with effects")


def _channel_means(fits: Fits, *, named: bool) -> dict[str, dict[str, float]]:
    """By channel: the fits that are known by COLUMNS, the `last` of them, and the `best` before it.

    What comes last are the effects, or the re-fitted model where nothing is `named`.
    """
    each: dict[str, list[Fit]] = {}
    for _, channel, fit in each_fit(fits):
        each.setdefault(channel, []).append(fit)
    found = {}
    for channel, rows in each.items():
        parts = ("nominal", "base_refit", "with_effects")
        means = [_mean_known([getattr(one, name) for one in rows]) for name in parts]
        # without effects their column is that of the re-fitted model
        shown = means if named and means[2] is not None else means[:2]
        known = {name: value for name, value in zip(COLUMNS, shown, strict=False) if value is not None}
        if len(known) > 1 and shown[-1] is not None:
            *before, last = known.values()
            found[channel] = {**known, "last": last, "best": max(before)}
    return found


def _mean_known(values: Sequence[Number]) -> float | None:
    """None where any is not known."""
    known = [one for one in values if one is not None]
    return math.fsum(known) / len(known) if known and len(known) == len(values) else None


# ------------------------------------------------------------------------------------------- how sure, what next

# So many findings are read in a headline; the table has all.
MOST_TOLD = 3
HELD_OUT = {
    "confirmed": "confirmed by held-out data", "weak": "held-out data say little of it",
    "untested": "never tested by held-out data", "not_confirmed": "denied by held-out data",
}  # fmt: skip


def certainty_sentence(diagnosis: Diagnosis) -> str:
    """How sure each finding is; without one, how near the best explanation came. Empty where nothing is known."""
    told = (kept(diagnosis) or diagnosis.effects)[:MOST_TOLD]
    if told:
        none = none_of_them(diagnosis)
        one, them = ("one of them", "them") if len(told) > 1 else ("it", "it")
        which = one if diagnosis.remains is None else f"{one}, or what remains beside {them},"
        other = "" if none is None else f"; that {which} is no known law at all: {chance(none)}"
        each = "; ".join(map(_certainty, told))
        law = "" if lawless(diagnosis) else ", and that it is this very law"
        return f"How sure that something acts there{law}: {each}{other}."
    tried = [(one.log_likelihood_gain, one.needed, one.name) for one in diagnosis.candidates]
    known = [(gain / needed, gain, needed, name) for gain, needed, name in tried if gain is not None and needed]
    sure = _nothing_is_missing(diagnosis)
    if not known:
        return f"How sure: {sure}." if sure else ""
    _, gain, needed, name = max(known)
    near = f"{safe(name)} comes nearest, with {nats(gain)} of the {nats(needed)} nats that it needs"
    parts = [part for part in (sure, f"of all explanations {near}" if gain < needed else "") if part]
    return f"How sure: {'; '.join(parts)}." if parts else ""


def _nothing_is_missing(diagnosis: Diagnosis) -> str:
    """How likely it is; empty where that was not asked."""
    known = {one.name: one.probability for one in diagnosis.candidates}
    alone, other = known.get(PARAMETERS), known.get(NONE_OF_THESE)
    if alone is None or other is None:
        return ""
    return (
        f"that nothing acts beside the model, {chance(alone)}, and that something does which is too small for these "
        f"recordings or follows no known law, {chance(other)}"
    )


def _certainty(effect: EffectFinding) -> str:
    """That something is there, that it is this law, and what held-out data say."""
    evidence, law = effect.evidence, effect.probability
    gain, needed = evidence.log_likelihood_gain, evidence.threshold
    sure = [] if gain is None else [f"{nats(gain)} nats" + ("" if needed is None else f" ({nats(needed)} needed)")]
    sure += [chance(law)] if law is not None and not effect.is_unknown else []
    held = f", {_held_out(effect)}" if effect.status is not None else ""
    return f"{safe(effect.name)} {' and '.join(sure)}{held}"


def _held_out(effect: EffectFinding) -> str:
    """What held-out data say of it; of what is weak, what makes it so."""
    if effect.status == "weak" and effect.reason:
        return f"weak: {effect.reason}"
    if effect.status == "weak" and effect.placebo is not None and not effect.placebo.held:
        return "weak, for a shuffled cause gains too"
    if effect.is_unknown and effect.status == "not_confirmed":
        return "its curve denied by held-out data"  # that something is there nobody denies
    left_out = ", but in no model that is written" if is_only_told(effect) else ""
    return HELD_OUT[effect.status or "untested"] + left_out


def is_only_told(effect: EffectFinding) -> bool:
    """Whether nothing speaks against it, and a model that is written is without it all the same."""
    return effect.in_model is False and not effect.is_unknown and not doubt(effect)


# Names of laws over the time, and of those that hold ever since.
OF_TIME, LASTS = re.compile(r"_of_t(_|$)"), re.compile(r"\.change_")


def next_sentence(diagnosis: Diagnosis) -> str:
    """What to do now; a question comes before everything that stands on its answer."""
    told = _next(diagnosis)
    if diagnosis.verdict == "consistent" or not questions_sentence(diagnosis.data_quality):
        return told
    return f"Next: answer what is asked above, and diagnose again where it was so; else {told.removeprefix('Next: ')}"


def _next(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "consistent":
        return (
            "Next: nothing has to be done; how much could hide stands under “What these recordings would have shown”."
        )
    record = _recording(diagnosis.next_experiment)
    if diagnosis.verdict == "parameters":
        more = f" To be surer that nothing is missing, {record}." if record else ""
        return f"Next: keep the re-estimated parameters (--write FILE.yaml), and use that model.{more}"
    sure = [one for one in kept(diagnosis) if not doubt(one) and not one.is_unknown]
    again = record or words_of_remains(diagnosis) or "record again, with another signal"
    if not sure:
        return f"Next: {again}, before a model is written."
    written = [one.name for one in kept(diagnosis) if _is_written(one)]
    if not any(one.name in written for one in sure):
        names = listed(one.name for one in sure)
        return (
            f"Next: {again}; a model that is written (--write FILE.yaml) is without {names} until it simulates better."
        )
    more = f" To be surer, {record}." if record and not _is_told_apart(diagnosis.next_experiment) else ""
    timed = [name for name in written if OF_TIME.search(name) and not LASTS.search(name)]
    but = f", which has no use for {listed(timed)}: the time of these recordings does not come again" if timed else ""
    return f"Next: keep the model with {listed(written)} (--write FILE.yaml), and design with it{but}.{more}"


def _is_written(effect: EffectFinding) -> bool:
    """Whether a model that is written has it; of older files, where it is sure."""
    return not effect.is_unknown and (not doubt(effect) if effect.in_model is None else effect.in_model)


def _is_told_apart(planned: NextExperiment | None) -> bool:
    """Whether the recordings that are there exclude what the next one would."""
    return planned is not None and (planned.apart_nats or 0.0) >= EXCLUDED_NATS


def _recording(planned: NextExperiment | None) -> str:
    """What to record, and what for; empty where nothing is planned."""
    if planned is None or not planned.signal:
        return ""
    why = "as a further proof" if _is_told_apart(planned) else f"which tells {listed(planned.tells_apart, 'from')}"
    return f"record {safe(planned.signal)}, {why}"


def words_of_remains(diagnosis: Diagnosis) -> str:
    """What recording would show the law of what has no name."""
    if lawless(diagnosis):
        return "record the same once more, and again at other speeds (a law comes back, chance does not)"
    rest = diagnosis.unexplained
    follows = [rest.curve.regressor] if rest is not None and rest.curve is not None else diagnosis.location.depends_on
    if [*follows] == ["t"]:
        return "record the same once more (a law of the time comes back, what happened once does not)"
    values = [name for name in follows if name != "t"]
    return f"record {listed(values)} over all that it can be" if values else ""
