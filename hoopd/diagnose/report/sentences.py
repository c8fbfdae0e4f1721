"""Sentences of a diagnosis in plain English, the same on the terminal and on the page.

Rules of this file: nothing is judged here, only said; a sentence about nothing is empty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from hoopd.diagnose.record import (
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
from hoopd.plots.number_format import listed, nats, safe, share, short_names, value_text

TITLES = {
    "consistent": "Consistent",
    "parameters": "Parameters, not physics",
    "missing_physics": "Missing physics found",
    "unknown_physics": "Unknown physics",
}
# Above this many characters a list of names is no longer read.
MANY = 6
# Points of fit that a figure with one decimal shows.
SHOWN = 0.1
# A window carries the error when it has so many times an even part of it, or half; of two one always has.
STANDS_OUT, HALF, FEWEST_WINDOWS = 3.0, 0.5, 3
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


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    gained = _gain_clause(diagnosis.fit.heldout, named=bool(kept(diagnosis)))
    if diagnosis.verdict == "consistent":
        return "The model explains these recordings: nothing is missing that they could show."
    if diagnosis.verdict == "parameters" and diagnosis.refused:
        found = listed(one.name for one in diagnosis.refused)
        return (
            f"The parameters are off, and re-estimating them is as much as held-out data bear out{gained}: "
            f"more was found ({found}), and not confirmed."
        )
    if diagnosis.verdict == "parameters":
        return f"The physics is complete but its parameters are off: re-estimating them removes the mismatch{gained}."
    if diagnosis.verdict == "unknown_physics":
        known = [one for one in kept(diagnosis) if not one.is_unknown]
        beside = f" beside {listed(map(_finding, known))}" if known else ""
        return f"Something that is not in the library acts {_unknown_place(diagnosis)}{beside}{gained}."
    if not kept(diagnosis):
        denied = listed(f"{_finding(one)}: {one.reason}" for one in diagnosis.effects)
        return (
            f"Physics is missing, and no name for it is confirmed{gained}. "
            f"What explains most of it, and is in no model that is written: {denied}."
        )
    return f"The model leaves out {listed(map(_finding, kept(diagnosis)))}{gained}."


def kept(diagnosis: Diagnosis) -> list[EffectFinding]:
    """Findings that held-out data do not deny."""
    return [one for one in diagnosis.effects if one.status != "not_confirmed"]


def _finding(effect: EffectFinding) -> str:
    """A name with its first size, and what cannot be told from it."""
    sizes = [f"{name} = {value_text(one)}" for name, one in effect.parameters.items() if one.value is not None]
    inside = [*sizes[:1], *([f"{listed(effect.not_excluded)} not excluded"] if effect.not_excluded else [])]
    return effect.name + (f" ({'; '.join(inside)})" if inside else "")


def _unknown_place(diagnosis: Diagnosis) -> str:
    rest = diagnosis.unexplained
    if rest is None or rest.slot is None:
        return "in a slot that could not be located"
    own = [] if rest.curve is None else [rest.curve.regressor]
    located = bool(diagnosis.effects) and diagnosis.effects[0].is_unknown
    follows = diagnosis.location.depends_on if located else own
    return f"in slot {rest.slot}" + (f" and follows {listed(follows)}" if follows else "")


def _gain_clause(fits: Fits, *, named: bool) -> str:
    """What the held-out data gained over the better of the user's and the re-fitted model in the channel that gained
    most, and every channel that lost; means over the recordings. Of the re-fitted model where nothing is `named`."""
    means = _channel_means(fits, named=named)
    if not means:
        return ""
    channel, (before, after, _) = max(means.items(), key=lambda one: one[1][1] - one[1][0])
    gain = f"; the fit of held-out {channel} goes from {before:.1f} to {after:.1f} %" if after > before else ""
    lost = [f"{name} ({one:.1f} against {best:.1f} %)" for name, (best, one, _) in means.items() if best - one > SHOWN]
    whose = {of for best, one, of in means.values() if best - one > SHOWN}
    return gain + (f"; on held-out data worse than {' and '.join(sorted(whose))}: {listed(lost)}" if lost else "")


def _channel_means(fits: Fits, *, named: bool) -> dict[str, tuple[float, float, str]]:
    """By channel: fit of the better of the user's and the re-fitted model, of what is told, and which the better is.

    What is told are the effects, or the re-fitted model where there are none.
    """
    each: dict[str, list[Fit]] = {}
    for _, channel, fit in each_fit(fits):
        each.setdefault(channel, []).append(fit)
    found = {}
    for channel, rows in each.items():
        nominal, base, final = (
            _mean_known([getattr(one, name) for one in rows]) for name in ("nominal", "base_refit", "with_effects")
        )
        has_effects = named and final is not None
        last = final if has_effects else base
        before = {"your model": nominal} | ({"the re-fitted model": base} if has_effects else {})
        known = {name: value for name, value in before.items() if value is not None}
        if known and last is not None:
            best = max(known, key=lambda name: known[name])
            found[channel] = known[best], last, best
    return found


def _mean_known(values: Sequence[Number]) -> float | None:
    """None where any is not known."""
    known = [one for one in values if one is not None]
    return _mean(known) if known and len(known) == len(values) else None


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


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


def unexplained_sentence(diagnosis: Diagnosis) -> str:
    """What the library has no name for; empty when nothing is left."""
    rest = diagnosis.unexplained
    if rest is None or not rest.fires:
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


def statements(diagnosis: Diagnosis) -> list[str]:
    """What each finding is, in plain words; of one that is not confirmed, why."""
    return [f"{safe(one.name)}: {one.statement}{_law(one)}{_denied(one)}" for one in diagnosis.effects]


def _denied(effect: EffectFinding) -> str:
    return f". Not confirmed: {effect.reason}" if effect.reason else ""


def _law(effect: EffectFinding) -> str:
    """Its formula, and the library's name that comes nearest; empty without either."""
    near = f"nearest in the library: {safe(effect.nearest)}" if effect.nearest else ""
    said = "; ".join(one for one in (effect.formula, near) if one)
    return f" [{said}]" if said else ""


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
        most = max(one.share or 0.0 for _, _, one in each)
        return f"The error that is left is spread over the windows: none has more than {share(most)} of a channel's."
    told = (
        f"{safe(channel)} of {names[r]} at {one.t0:.{places}f} to {one.t1:.{places}f} s "
        f"({share(one.share or 0.0)} of its squared error, in one of {one.windows} windows)"
        for r, channel, one in alone
    )
    return f"Windows that carry the error that is left: {listed(told)}."


def invisible_sentence(power: Mapping[str, Visible]) -> str:
    """Effects of which these recordings show nothing, however large; empty when there is none."""
    blind = [name for name, one in power.items() if one.smallest is None]
    return f"Not visible in these recordings at any size expected: {listed(blind)}." if blind else ""


def source_sentence(fit: FitTable) -> str:
    """Where the samples of the channels come from; empty when nothing was said."""
    return "; ".join(f"{channel}: {source}" for channel, source in fit.channel_source.items())


def quality_notes(quality: DataQuality) -> list[str]:
    """Sentences about the recordings."""
    of_each = [f"{name}: {note}" for name, one in quality.recordings.items() for note in one.notes]
    return [*quality.notes, *of_each]
