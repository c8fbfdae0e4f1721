"""Tables of a diagnosis, cell by cell as text: drawn on the terminal and on the page alike.

Rules of this file: every cell is ready to be read; a table without rows is not shown. Nothing is rounded here that
`readable` does not round.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from hoopd.diagnose.record import (
    DataQuality,
    Diagnosis,
    EffectFinding,
    Fit,
    Fits,
    FitTable,
    FreeRunEffect,
    Number,
    Quantity,
    RecordingQuality,
    Visible,
)
from hoopd.diagnose.report.sentences import HELD_OUT, decimals, each_fit, none_of_them, numbers_of
from hoopd.plots.number_format import (
    NOTHING,
    amount,
    chance,
    counted,
    interval_text,
    listed,
    nats,
    percent,
    safe,
    share,
    short_names,
    value_text,
)

Row = tuple[str, ...]
# Times in tables: to this share of a window.
OF_A_WINDOW = 0.01
STATUSES = {"confirmed": "confirmed", "weak": "weak", "untested": "untested", "not_confirmed": "denied"}


@dataclass(frozen=True)
class Table:
    """Rows of as many cells as the head; `align`: a letter a column, l for words, r for numbers.

    An empty cell of the first column belongs to the row above.
    """

    title: str
    head: Row
    align: str
    rows: list[Row]


def effects(diagnosis: Diagnosis) -> Table:
    """One row a parameter of each named effect; how likely each is where that is known."""
    head = ("effect", "parameter", "value", "95 % interval", "nats", "needed", "likely")
    rows = [row for effect in diagnosis.effects for row in _effect_rows(effect, numbers_of(diagnosis.fit))]
    if (none := none_of_them(diagnosis)) is not None:
        rows.append(("no known law, in a place at least", *[NOTHING] * 5, chance(none)))
    last = len(head) - all(one.probability is None for one in diagnosis.effects)
    return Table("What the model leaves out", head[:last], "llrrrrr"[:last], [row[:last] for row in rows])


def _effect_rows(effect: EffectFinding, numbers: Mapping[str, str]) -> list[Row]:
    evidence = effect.evidence
    denied = " (curve not confirmed)" if effect.is_unknown else " (not confirmed)"
    name = safe(effect.name) + (denied if effect.status == "not_confirmed" else "")
    gain, needed = nats(evidence.log_likelihood_gain), nats(evidence.threshold)
    like = _sizes(effect.parameters)
    sizes = [
        (label, value_text(one, like=like[label.split()[0]]), interval_text(one, like=like[label.split()[0]]))
        for label, one in _labelled(effect.parameters, numbers)
    ]
    first, *others = sizes or [(NOTHING, NOTHING, NOTHING)]
    return [(name, *first, gain, needed, chance(effect.probability)), *(("", *size, *[""] * 3) for size in others)]


def _sizes(parameters: Mapping[str, Quantity]) -> dict[str, Number]:
    """The largest value of each parameter, by its name: what several recordings have for themselves is in one unit."""
    found: dict[str, Number] = {}
    for label, one in parameters.items():
        name = safe(label.split("@")[0])
        found[name] = max(abs(found.get(name) or 0.0), abs(one.value or 0.0))
    return found


def _labelled(parameters: Mapping[str, Quantity], numbers: Mapping[str, str]) -> list[tuple[str, Quantity]]:
    """With the number of a recording in place of its name; of what each has for itself the first stands there twice."""
    several = {label.split("@")[0] for label in parameters if "@" in label}
    parts = [(*label.partition("@")[::2], one) for label, one in parameters.items() if label not in several]
    alone = len(numbers) == 1
    return [
        (safe(f"{name} {numbers.get(recording, recording)}" if recording and not alone else name), one)
        for name, recording, one in parts
    ]


def checks(diagnosis: Diagnosis) -> Table:
    """What became of each finding when it was put to the test."""
    head = ("effect", "held out", "fit", "readings", "taken out", "shuffled")
    rows = [_check(one) for one in diagnosis.effects]
    tested = [row for row in rows if any(cell != NOTHING for cell in row[1:])]
    return _without_empty(Table("How each finding was tested", head, "llrrrl", tested))


def _check(effect: EffectFinding) -> Row:
    gain, without, placebo = effect.evidence.heldout_gain_percent, effect.ablation, effect.placebo
    better = NOTHING if gain is None else f"{gain:+.1f} points"
    loss = NOTHING if without is None else f"-{nats(without.log_likelihood_loss)} nats"
    held = NOTHING if placebo is None else "gains nothing" if placebo.held else "GAINS TOO"
    known = NOTHING if without is None or without.heldout_nats is None else f"{without.heldout_nats:+.1f} nats"
    status = NOTHING if effect.status is None else STATUSES[effect.status]
    return (safe(effect.name), status, better, known, loss, held)


def refused(diagnosis: Diagnosis) -> Table:
    """What was beyond the threshold, and why it is not named."""
    rows: list[Row] = [(safe(one.name), nats(one.log_likelihood_gain), safe(one.reason)) for one in diagnosis.refused]
    return Table("Beyond the threshold, and refused", ("effect", "nats", "because"), "lrl", rows)


def ablations(diagnosis: Diagnosis) -> Table:
    """What becomes of the held-out data when a finding is taken out again."""
    rows = [
        (safe(one.name), safe(channel), percent(before), percent(one.ablation.heldout_without.get(channel)))
        for one in diagnosis.effects if one.ablation is not None
        for channel, before in one.ablation.heldout_with.items()
    ]  # fmt: skip
    known = [row for row in rows if NOTHING not in row[2:]]
    title = "Fit of held-out data with each finding and without it (NRMSE %)"
    return Table(title, ("effect", "channel", "with", "without"), "llrr", _without_repeats(known))


def fit(title: str, fits: Fits) -> Table:
    """Fit before and after."""
    head = ("recording", "channel", "nominal", "re-fitted", "+ effects", "saved model", "noise floor", "free curves")
    names = short_names(fits)
    every = [(names[recording], safe(channel), *_fit_cells(one)) for recording, channel, one in each_fit(fits)]
    rows = [row for row in every if any(cell != NOTHING for cell in row[2:])]
    return _without_empty(Table(title, head, "llrrrrrr", _without_repeats(rows)))


def free_run(title: str, fits: Fits) -> Table:
    """The same of runs over whole parts: those that were fitted to are told from those that were held out."""
    return fit(title, {name if name.endswith(HELD_OUT) else f"{name} (fitted to)": one for name, one in fits.items()})


def free_run_choice(fit: FitTable) -> Table:
    """What one free run is better with: no names of the verdict."""
    head = ("effect", "parameters", "error taken", "by chance", "named")
    chosen = fit.free_run_choice.effects if fit.free_run_choice is not None else []
    rows = [_chosen(one, numbers_of(fit)) for one in chosen]
    return Table("What simulates better (evidence of free runs, no verdict)", head, "llrrl", rows)


def _chosen(one: FreeRunEffect, numbers: Mapping[str, str]) -> Row:
    sizes = listed([f"{name} {value_text(value)}" for name, value in _labelled(one.parameters, numbers)])
    taken = NOTHING if one.error_share is None else f"{100.0 * one.error_share:.1f} %"
    chance = NOTHING if one.chance is None else f"{100.0 * one.chance:.2g} %"
    return (safe(one.name), sizes, taken, chance, "yes" if one.named else "no")


def _fit_cells(one: Fit) -> Row:
    return tuple(
        map(percent, (one.nominal, one.base_refit, one.with_effects, one.written, one.noise_floor, one.ceiling))
    )


def _without_empty(table: Table) -> Table:
    """Columns in which nothing is known are left out."""
    kept = [index for index in range(len(table.head)) if any(row[index] != NOTHING for row in table.rows)]
    rows = [tuple(row[index] for index in kept) for row in table.rows]
    return Table(table.title, tuple(table.head[i] for i in kept), "".join(table.align[i] for i in kept), rows)


def _without_repeats(rows: Iterable[Row]) -> list[Row]:
    """The first column stands once for each group."""
    kept: list[Row] = []
    last = ""
    for row in rows:
        kept.append(("", *row[1:]) if kept and row[0] == last else row)
        last = row[0]
    return kept


def alternatives(diagnosis: Diagnosis) -> Table:
    """What explains the recordings nearly as well."""
    rows = [row for effect in diagnosis.effects for row in _alternative_rows(effect)]
    return Table("Not excluded", ("alternative", "instead of", "nats against it", "why"), "llrl", rows)


def _alternative_rows(effect: EffectFinding) -> list[Row]:
    known = {one.name: one for one in effect.alternatives}
    bare = [(name, None, "") for name in effect.not_excluded if name not in known]
    entries = [*((one.name, one.behind_nats, one.reason) for one in known.values()), *bare]
    return [(safe(name), safe(effect.name), _against(behind), safe(why)) for name, behind, why in entries]


def _against(behind: Number) -> str:
    """By how much an alternative explains less (-) or more (+)."""
    return NOTHING if behind is None else f"{0.0 - round(behind, 1):+.1f}"


def parameters(diagnosis: Diagnosis) -> Table:
    """The base, re-estimated, and the effects."""
    rows = [_parameter("base", name, one, one.value) for name, one in diagnosis.base.parameters.items()]
    for effect in diagnosis.effects:
        like = _sizes(effect.parameters)
        rows += [
            _parameter(effect.name, name, one, like[safe(name.split("@")[0])])
            for name, one in effect.parameters.items()
        ]
    head = ("of", "parameter", "value", "95 % interval", "nominal")
    return Table("Parameters", head, "llrrr", _without_repeats(rows))


def _parameter(of: str, name: str, one: Quantity, like: Number) -> Row:
    sizes = value_text(one, like=like), interval_text(one, like=like), amount(one.nominal, one.unit, like=like)
    return (safe(of), safe(name), *sizes)


def power(diagnosis: Diagnosis) -> Table:
    """Smallest sizes that would have been seen."""
    head = ("effect", "parameter", "smallest seen", "largest expected")
    return Table("What would have been seen", head, "llrr", [_visible(*item) for item in diagnosis.power.items()])


def _visible(name: str, one: Visible) -> Row:
    smallest = "not at any size" if one.smallest is None else amount(one.smallest, one.unit, 2)
    return (safe(name), safe(one.parameter), smallest, amount(one.largest, one.unit, 2))


def quality(diagnosis: Diagnosis) -> Table:
    """Bad samples: each recording where that is known, and all together."""
    whole = diagnosis.data_quality
    names = short_names(whole.recordings)
    of_each = [(names[name], one) for name, one in whole.recordings.items()]
    parts: list[tuple[str, RecordingQuality | DataQuality]] = [*of_each, ("all", whole)]
    rows: list[Row] = [(name, *_bad(one)) for name, one in parts]
    return Table("Data quality", ("recording", "missing", "late frames", "outliers"), "lrrr", rows)


def _bad(one: RecordingQuality | DataQuality) -> Row:
    """Counts with their share, where it is known of how many."""
    parts = ((one.missing, one.samples), (one.late_frames, one.frames), (one.outliers, one.samples))
    return tuple(f"{counted(bad)} ({share(bad / of)})" if bad and of else counted(bad) for bad, of in parts)


def ignored(diagnosis: Diagnosis) -> Table:
    """Intervals that were set aside."""
    whole = diagnosis.data_quality
    names = short_names(whole.recordings)
    parts = [(names[name], one) for name, part in whole.recordings.items() for one in part.segments_ignored]
    spans = parts or [("", one) for one in whole.segments_ignored]
    places = decimals(diagnosis.fit.window_s, OF_A_WINDOW)
    rows: list[Row] = [
        (f"{start:.{places}f}", f"{end:.{places}f}", safe(reason), name) for name, (start, end, reason) in spans
    ]
    return Table("Set aside", ("from (s)", "to (s)", "because", "recording"), "rrll", rows)
