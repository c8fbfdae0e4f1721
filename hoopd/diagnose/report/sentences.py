"""Sentences of a diagnosis in plain English, the same on the terminal and on the page.

Rules of this file: nothing is judged here, only said; a sentence about nothing is empty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from hoopd.diagnose.record import (
    NONE_OF_THESE,
    Candidate,
    DataQuality,
    Diagnosis,
    EffectFinding,
    Fit,
    Fits,
    FitTable,
    Location,
    NextExperiment,
    Number,
    Visible,
)
from hoopd.plots.number_format import chance, listed, nats, safe, share, short_names, value_text

# Above this many characters a list of names is no longer read.
MANY = 6
# Laws that are not named are told of from this share on.
LEAST_LIKELY = 0.1
# A window carries the error when it has so many times an even part of it, or half; of two one always has.
STANDS_OUT, HALF, FEWEST_WINDOWS = 3.0, 0.5, 3
# How a part of a recording that nothing was fitted to is called in a table of free runs, and what one decimal shows.
HELD_OUT, SHOWN = " (held out)", 0.1
# What a reason is of.
DOUBTS = {"weak": "Weak", "not_confirmed": "Not confirmed"}
# What a column of probabilities says.
LIKELY = (
    "Likely: how likely this very law is the one in its place, among all laws that could stand there and none that is "
    "known; that something is missing there at all is told by the nats."
)
NONE_IS_LIKELY = " No known law, in a place at least: that in one of the places, or more, what acts is none of them."
UNKNOWN_IS_LIKELY = " Of what has no name (unknown): that what acts there is no known law; a curve stands for it."
# Times in sentences: to this share of a window; of files that do not tell theirs it is the hoop's.
OF_A_WINDOW, HOOP_WINDOW_S = 0.05, 2.0


def each_fit(fits: Fits) -> Iterator[tuple[str, str, Fit]]:
    """Recording, channel, fit."""
    for recording, channels in fits.items():
        for channel, fit in channels.items():
            yield recording, channel, fit


def windows(window_s: Number) -> str:
    """In what a model is simulated: as long as the plant's motion asks for."""
    return "windows" if window_s is None else f"windows of {window_s:.3g} s"


def decimals(window_s: Number, share: float) -> int:
    """With how many a time in s is told to a share of a window."""
    return max(0, math.ceil(-math.log10(share * (window_s or HOOP_WINDOW_S))))


def location_sentence(location: Location, window_s: Number = None) -> str:
    """Where the mismatch sits; empty when there is none."""
    if location.slot is None:
        return ""
    channel = f", most visible in {location.channel}" if location.channel else ""
    follows = f" It follows {listed(location.depends_on)}." if location.depends_on else ""
    return f"The mismatch sits in slot {location.slot}{channel}, {_when(location, window_s)}.{follows}"


def _when(location: Location, window_s: Number) -> str:
    if location.segments is None:
        return "throughout the recordings"
    places = decimals(window_s, OF_A_WINDOW)
    spans = [f"{start:.{places}f} to {end:.{places}f} s" for start, end in location.segments]
    more = f" and {len(spans) - MANY} more intervals" if len(spans) > MANY else ""
    return f"at {listed(spans[:MANY])}{more}" if spans else "in no interval of its own"


def lawless(diagnosis: Diagnosis) -> bool:
    """Whether a disturbance far beyond the usual is all that was found."""
    rest = diagnosis.unexplained
    return rest is not None and rest.fires and rest.curve is None and any(one.is_unknown for one in diagnosis.effects)


def unexplained_sentence(diagnosis: Diagnosis) -> str:
    """What the library has no name for; empty when nothing is left."""
    rest = diagnosis.unexplained
    if rest is None or not rest.fires or lawless(diagnosis):
        return ""
    part = f"{share(rest.share)} of what the re-fitted base leaves unexplained" if rest.share is not None else "A part"
    where = f" in slot {rest.slot}" if rest.slot else ""
    curve = f"; a curve over {rest.curve.regressor} was fitted to it" if rest.curve is not None else ""
    denied = rest.carries_over is False
    other = ". The held-out recordings ask for another such curve: no model of it is kept" if denied else ""
    return f"{part} has no name in the library{where}{curve}{other}."


def remains_sentence(diagnosis: Diagnosis) -> str:
    """What the names leave to another law; empty where that is no more than noise, or stands as a finding."""
    rest = diagnosis.remains
    if rest is None or diagnosis.unexplained is not None:
        return ""
    laws = "it is the nearest known law" if len(diagnosis.effects) == 1 else "each of them is the nearest known law"
    return (
        f"Beside what was named something at the {rest.slot} still follows {rest.follows} "
        f"({nats(rest.log_likelihood_gain)} nats, {nats(rest.by_chance)} by chance): {laws}, not the whole answer."
    )


def experiment_sentence(planned: NextExperiment) -> str:
    """What to record next, and why."""
    settings = ", ".join(f"{safe(name)} {value_text(one)}" for name, one in planned.parameters.items())
    bring = f" ({nats(planned.expected_nats)} nats expected)" if planned.expected_nats is not None else ""
    inside = f" ({settings})" if settings else ""
    return f"Record {planned.signal}{inside}: that tells {listed(planned.tells_apart, 'from')}{bring}."


def rest_experiment_sentence(diagnosis: Diagnosis) -> str:
    """What a recording needs that shall show the law of what is left unexplained; empty where nothing is."""
    rest, named = diagnosis.unexplained, diagnosis.remains
    if rest is not None and rest.slot is not None:
        slot, follows = rest.slot, "" if rest.curve is None else rest.curve.regressor
    elif named is not None:
        slot, follows = named.slot, named.follows
    else:
        return ""
    if not follows:
        return ""
    return (
        f"For what is left without a name at the {slot}: a recording in which {safe(follows)} goes both ways over all "
        "that it can be, several times and with other signals, would show its law, and serve the proof of it."
    )


def statements(diagnosis: Diagnosis) -> list[str]:
    """What each finding is, in plain words; of one that is not confirmed, weak, or in no model, why."""
    return [f"{safe(one.name)}: {one.statement}{_law(one)}{_doubted(one)}" for one in diagnosis.effects]


def _doubted(effect: EffectFinding) -> str:
    return (
        f". {DOUBTS.get(effect.status or '', 'In no model that is written')}: {effect.reason}" if effect.reason else ""
    )


def _law(effect: EffectFinding) -> str:
    """Its formula, and the library's name that comes nearest; empty without either."""
    near = f"nearest in the library: {safe(effect.nearest)}" if effect.nearest else ""
    said = "; ".join(one for one in (effect.formula, near) if one)
    return f" [{said}]" if said else ""


def likely_sentence(diagnosis: Diagnosis) -> str:
    """What the column of probabilities says, and the laws in it that are no findings; empty without probabilities."""
    if all(one.probability is None for one in diagnosis.effects):
        return ""
    named = {NONE_OF_THESE, "parameters", *(one.name for one in diagnosis.effects)}
    likely = [one for one in diagnosis.candidates if one.name not in named and (one.probability or 0.0) >= LEAST_LIKELY]
    others = [_with_chance(one) for one in likely if one.counted_with is None]
    more = f" Others that could stand in one of their places: {listed(others)}." if others else ""
    for name in dict.fromkeys(one.counted_with for one in likely if one.counted_with is not None):
        alike = [_with_chance(one) for one in likely if one.counted_with == name]
        more += f" In what is said of {name}, because nothing here tells them apart: {listed(alike)}."
    none = NONE_IS_LIKELY if none_of_them(diagnosis) else ""
    unknown = UNKNOWN_IS_LIKELY if any(one.is_unknown for one in diagnosis.effects) else ""
    return f"{LIKELY}{none}{unknown}{more}"


def _with_chance(one: Candidate) -> str:
    return f"{one.name} ({chance(one.probability)})"


def laws_beside(effect: EffectFinding, diagnosis: Diagnosis) -> list[Candidate]:
    """Laws that are no findings and could be in a finding's place, or are not excluded in another one, the likeliest
    first; what nothing tells from it is counted with it, and is not among them.

    Their probabilities count whatever acts beside the finding, too: of two findings in a place they are of either.
    """
    named = {one.name for one in diagnosis.effects}
    found = [
        one
        for one in diagnosis.candidates
        if one.name not in named
        and one.counted_with != effect.name
        and (one.name.partition(".")[0] == effect.slot or one.name in effect.not_excluded)
        and (one.probability or 0.0) >= LEAST_LIKELY
    ]
    return sorted(found, key=lambda one: (-(one.probability or 0.0), one.name))


def none_of_them(diagnosis: Diagnosis) -> Number:
    """Probability that what no known law describes acts in one of the places; None where it is not worth a word, or a
    finding without a name says it itself."""
    if not diagnosis.effects or any(one.is_unknown for one in diagnosis.effects):
        return None
    known = next((one.probability for one in diagnosis.candidates if one.name == NONE_OF_THESE), None)
    return known if known is not None and known > LEAST_LIKELY else None


def compared_sentence(diagnosis: Diagnosis) -> str:
    """Which models the table of fits with and without each finding compares; empty where there is none."""
    tested = [one for one in diagnosis.effects if one.ablation is not None and one.ablation.heldout_with]
    if not tested:
        return ""
    denied = [one.name for one in tested if one.status == "not_confirmed"]
    among = f", {listed(denied)} among them, which no model that is written has" if denied else ""
    whole = f"all {len(tested)} findings{among}" if len(tested) > 1 else "the finding"
    return (
        f"With: the model of {whole}. Without: that finding taken out and all other numbers fitted again to the "
        "training data, so that others take over what they can."
    )


def numbers_of(fit: FitTable) -> dict[str, str]:
    """Numbers that stand for recordings, in their order."""
    return {name: f"({number})" for number, name in enumerate(fit.train, start=1)}


def numbers_sentence(diagnosis: Diagnosis) -> str:
    """Which recording a number in a table of effects stands for; empty where there is none."""
    choice = diagnosis.fit.free_run_choice
    shown = [*diagnosis.effects, *(choice.effects if choice is not None else ())]
    marked = any("@" in name for effect in shown for name in effect.parameters)
    if not marked or len(diagnosis.fit.train) == 1:
        return ""
    names = short_names(diagnosis.fit.train)
    return listed(f"{number}: of {names[name]} alone" for name, number in numbers_of(diagnosis.fit).items())


def free_run_sentence(fit: FitTable) -> str:
    """Which channels one run over held-out data repeats worse with the effects; empty where none is."""
    worse: dict[str, list[str]] = {}
    for name, channel, one in each_fit(fit.free_run):
        lost = (one.base_refit or 0.0) - (one.with_effects or 0.0)
        if name.endswith(HELD_OUT) and one.with_effects is not None and lost > SHOWN:
            worse.setdefault(name.removesuffix(HELD_OUT), []).append(f"{safe(channel)} by {lost:.1f}")
    names = short_names(worse)
    told = [f"{listed(points)} points ({names[name]})" for name, points in worse.items()]
    if not told:
        return ""
    return (
        f"One run over all of what was held out is worse with the effects: {listed(told)}. Windows are what a finding "
        "is judged by; a run of many seconds adds up whatever is left."
    )


def chosen_sentence(fit: FitTable) -> str:
    """What the set of a free run was chosen on; empty where none was."""
    choice = fit.free_run_choice
    return f"Chosen on {choice.chosen_on}." if choice is not None and choice.chosen_on else ""


def error_sentence(fit: FitTable) -> str:
    """Which windows carry the error that is left; empty where nothing was simulated."""
    each = [
        (r, channel, one)
        for r, channels in fit.error_windows.items()
        for channel, one in channels.items()
        if one.windows >= FEWEST_WINDOWS
    ]
    if not each:
        return ""
    names, places = short_names(fit.error_windows), decimals(fit.window_s, OF_A_WINDOW)
    alone = [one for one in each if (one[2].share or 0.0) >= min(STANDS_OUT / one[2].windows, HALF)]
    if not alone:
        r, channel, most = max(each, key=lambda one: one[2].share or 0.0)
        return (
            f"The error that is left is spread over the windows: the largest part of a channel's squared error is "
            f"{share(most.share)} ({safe(channel)} of {names[r]} at {most.t0:.{places}f} to {most.t1:.{places}f} s; "
            f"even: {share(1.0 / most.windows)})."
        )
    told = (
        f"{safe(channel)} of {names[r]} at {one.t0:.{places}f} to {one.t1:.{places}f} s "
        f"({share(one.share or 0.0)} of its squared error, in one of {one.windows} windows)"
        for r, channel, one in alone
    )
    return f"Windows that carry the error that is left: {listed(told)}."


def invisible_sentence(power: Mapping[str, Visible], effects: Sequence[EffectFinding]) -> str:
    """Effects of which these recordings show nothing beside the findings, however large; empty when there is none.

    What may be there in a finding's place shows as much as the finding does.
    """
    instead = {name for one in effects for name in one.not_excluded}
    blind = [name for name, one in power.items() if one.smallest is None and name not in instead]
    return f"Not visible in these recordings at any size expected: {listed(blind)}." if blind else ""


def source_sentence(fit: FitTable) -> str:
    """Where the samples of the channels come from; empty when nothing was said."""
    return "; ".join(f"{channel}: {source}" for channel, source in fit.channel_source.items())


def questions_sentence(quality: DataQuality) -> str:
    """What has to be answered before anything else is believed; empty where no note of a recording asks."""
    asked = [one for one in quality_notes(quality) if one.endswith("?")]
    return f"Answer this first, for it may be all of the mismatch: {' '.join(asked)}" if asked else ""


def quality_notes(quality: DataQuality) -> list[str]:
    """Sentences about the recordings."""
    of_each = [f"{name}: {note}" for name, one in quality.recordings.items() for note in one.notes]
    return [*quality.notes, *of_each]
