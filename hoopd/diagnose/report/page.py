"""The page of a diagnosis: verdict in one sentence, then the evidence, each part only where there is one.

Rules of this file: order and words only; tables come from `tables`, curves from `hoopd.plots`, markup from
`markup`. No wall time, no host: the same diagnosis gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from hoopd.diagnose.record import Diagnosis, Quantity
from hoopd.diagnose.record_file import canonical
from hoopd.diagnose.report import headline, plain_words, sentences as words, table_notes, tables
from hoopd.diagnose.report.markup import document, drawing, paragraph, section, table, text
from hoopd.diagnose.report_curves import Comparison, Harmonics, MissingForce, Shown
from hoopd.plots import diagnosis as figures, diagnosis_curves as curves
from hoopd.plots.number_format import listed, nats

FITS = "NRMSE percent, 100 is perfect, in {windows}; each starts from its own estimated state."
# Where nats, slots and the rest are explained.
WORDS = ("words", "What the words mean")
NOTHING_ELSE = "Nothing else in the library explains the recordings nearly as well."
FREE = "As long as a disturbance may be anything, no law of the library explains the recordings better."
MOST_COMPARISONS = 6  # a page that is sent by mail has no room for more
Part = Callable[[Diagnosis, Shown], str]


def page(diagnosis: Diagnosis, shown: Shown) -> bytes:
    """The whole page as UTF-8."""
    diagnosis = canonical(diagnosis)
    parts = [(name, title, make(diagnosis, shown)) for name, title, make in SECTIONS]
    kept = [(name, title, body) for name, title, body in parts if body]
    body = f'<main class="{diagnosis.verdict}">\n{_header(diagnosis)}{_contents(kept)}'
    body += "".join(section(*part) for part in kept) + f"{_footer(diagnosis)}</main>\n"
    return document(f"Diagnosis: {headline.TITLES[diagnosis.verdict]}", body)


def _header(diagnosis: Diagnosis) -> str:
    title = headline.TITLES[diagnosis.verdict]
    facts = "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>\n" for name, value in _facts(diagnosis) if value)
    return (
        f'<header>\n<p class="kicker">hoopd diagnose</p>\n<h1>{text(title)}</h1>\n'
        f"{paragraph(headline.verdict_sentence(diagnosis), 'verdict')}"
        f"{paragraph(words.questions_sentence(diagnosis.data_quality))}"
        f"{paragraph(plain_words.plain_sentence(diagnosis))}"
        f"{paragraph(headline.certainty_sentence(diagnosis))}"
        f"{paragraph(headline.fit_sentence(diagnosis))}"
        f"{paragraph(words.unexplained_sentence(diagnosis))}"
        f"{paragraph(words.remains_sentence(diagnosis))}"
        f'{paragraph(headline.next_sentence(diagnosis), "next")}<dl class="facts">\n{facts}</dl>\n</header>\n'
    )


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [
        ("Fitted to", listed(diagnosis.fit.train)),
        ("Held out", listed(diagnosis.fit.heldout)),
        ("Base model", diagnosis.base.model),
    ]


def _contents(kept: Sequence[tuple[str, str, str]]) -> str:
    places = [*((name, title) for name, title, _ in kept), WORDS]
    links = "".join(f'<li><a href="#{name}">{text(title)}</a></li>' for name, title in places)
    return f'<nav aria-label="Contents"><ul>{links}</ul></nav>\n'


def _effects(diagnosis: Diagnosis, shown: Shown) -> str:
    """The names, their sizes, and how each was tested."""
    said = "".join(map(paragraph, words.statements(diagnosis)))
    numbers = paragraph(words.likely_sentence(diagnosis), "note") + paragraph(words.numbers_sentence(diagnosis))
    tested = table(tables.checks(diagnosis)) + paragraph(table_notes.checks_sentence(diagnosis), "note")
    tested += table(tables.ablations(diagnosis))
    tested += paragraph(words.compared_sentence(diagnosis), "note") + table(tables.refused(diagnosis))
    return said + table(tables.effects(diagnosis), caption=False) + numbers + tested


def _where(diagnosis: Diagnosis, shown: Shown) -> str:
    """Slots and times."""
    body = paragraph(words.location_sentence(diagnosis.location, diagnosis.fit.window_s) or "No slot stands out.")
    if any(gain is not None for gain in diagnosis.location.evidence.values()):
        drawn = figures.draw_evidence_by_slot(diagnosis.location.evidence)
        title = f"Evidence by slot: {_pairs(diagnosis.location.evidence)}"
        body += drawing(
            drawn,
            "slots",
            title,
            "How surprising the best law or curve of each slot would be over the re-fitted base: "
            "its gain less what chance gives so many looks.",
        )
    strips = [one for one in shown.strips if len(one.t_s)]
    if strips:
        caption = (
            "Of a body: the smoothed disturbance that the re-fitted base needs; of a sensor: what it leaves of the "
            "readings; each as a multiple of what is usual in the last model. A body is dark, too, where a sensor errs "
            "that reads it: the model blames the motion. "
            "Hatched: set aside, with no part in the verdict."
        )
        body += drawing(figures.draw_strips(strips), "strips", "Where in time the mismatch sits", caption)
    return body


def _pairs(evidence: dict[str, float | None]) -> str:
    return ", ".join(f"{slot} {nats(gain)} nats" for slot, gain in evidence.items())


def _force(diagnosis: Diagnosis, shown: Shown) -> str:
    """What is missing, against what it depends on."""
    body = "".join(_one_force(index, one) for index, one in enumerate(shown.forces) if len(one.t_s))
    body += "".join(_one_spectrum(index, one) for index, one in enumerate(shown.harmonics))
    rest = diagnosis.unexplained
    if rest is not None and rest.curve is not None:
        caption = "The fitted curve of what has no name in the library: usable as it is, until somebody names it."
        body += drawing(curves.draw_curve(rest.curve), "curve", f"Unknown effect over {rest.curve.regressor}", caption)
    return body


def _one_force(index: int, force: MissingForce) -> str:
    laws = dict.fromkeys(one.law.label for one in force.regressors if one.law is not None)
    scattered = any(one.law is not None and not one.law.is_curve for one in force.regressors)
    over = listed(one.name for one in force.regressors)
    what = "Error of the readings" if force.reading else "Missing force"
    title = f"{what} in slot {force.slot}" + (f" over {over}" if over else "")
    dots = ", as dots, because it follows more than one variable, or changes within a sample" if scattered else ""
    drawn = f" In orange: {listed(laws)} with its fitted parameters{dots}." if laws else ""
    place = f" ({force.recording})" if force.recording else ""
    caption = f"What the model without the effect needs in addition, smoothed, at every sample{place}.{drawn}"
    return drawing(curves.draw_force(force), f"force{index}", title, caption)


def _one_spectrum(index: int, harmonics: Harmonics) -> str:
    title = f"Harmonics of the missing force in {harmonics.slot} over {harmonics.angle}"
    caption = "How often the missing force repeats in one turn."
    return drawing(curves.draw_harmonics(harmonics), f"harmonics{index}", title, caption)


def _proof(diagnosis: Diagnosis, shown: Shown) -> str:
    """Before and after, on data that no parameter was fitted to."""
    fit = diagnosis.fit
    body = paragraph(fit.how_heldout) + table(tables.fit("Fit of held-out data (NRMSE %)", fit.heldout))
    body += paragraph(FITS.format(windows=words.windows(fit.window_s)), "note") if body else ""
    body += paragraph(table_notes.columns_sentence(fit), "note")
    body += paragraph(words.error_sentence(fit)) + paragraph(words.source_sentence(fit), "note")
    drawn = [one for one in shown.comparisons if any(len(trace.t_s) for trace in one.traces)]
    body += "".join(_one_comparison(index, one) for index, one in enumerate(drawn[:MOST_COMPARISONS]))
    if len(drawn) > MOST_COMPARISONS:
        body += paragraph(f"{len(drawn) - MOST_COMPARISONS} more are in the table only.", "note")
    body += table(tables.free_run("One free run over the whole of each part (NRMSE %)", fit.free_run))
    body += paragraph(words.free_run_sentence(fit))
    if fit.free_run_choice is not None:
        body += table(tables.free_run_choice(fit))
        body += table(tables.fit("One free run with these", fit.free_run_choice.fits)) + paragraph(
            words.chosen_sentence(fit)
        )
    return body + table(tables.fit("Fit of the data fitted to (NRMSE %)", fit.train))


def _one_comparison(index: int, comparison: Comparison) -> str:
    title = f"{comparison.recording}: measured and simulated, {comparison.how}"
    cut = curves.cut_s(comparison)
    part = f", its first {cut:.0f} s" if cut is not None else ""
    both = any(one.after is not None for one in comparison.traces)
    models = "by the re-fitted model, and by the model with the effects" if both else "by the re-fitted model"
    caption = f"{comparison.recording}, {comparison.how}{part}: measured and simulated {models}; below each the rest."
    return drawing(curves.draw_comparison(comparison), f"comparison{index}", title, caption)


def _alternatives(diagnosis: Diagnosis, shown: Shown) -> str:
    """What else was tried, and what the data do not exclude."""
    effects = diagnosis.effects
    open_names = [name for one in effects for name in (*one.not_excluded, *(other.name for other in one.alternatives))]
    body = table(tables.alternatives(diagnosis))
    if effects and not body:
        body = paragraph(FREE if words.lawless(diagnosis) else NOTHING_ELSE)
    if any(one.log_likelihood_gain is not None for one in diagnosis.candidates):
        drawn = figures.draw_candidates(diagnosis.candidates, effects, open_names)
        caption = (
            "What each explanation gains on its own, and a bar at what it needs. One that stays left of its bar "
            "explains nothing. A finding stands there twice: hollow, what it gains on its own; full, what the model of "
            "all findings loses without it, as in the table."
        )
        body += drawing(drawn, "candidates", "Explanations that were tried, by evidence", caption)
    return body


def _next(diagnosis: Diagnosis, shown: Shown) -> str:
    rest = paragraph(words.rest_experiment_sentence(diagnosis))
    if (planned := diagnosis.next_experiment) is None:
        return rest
    body = paragraph(words.experiment_sentence(planned)) + paragraph(planned.reason) + rest
    command = f"<pre><code>{text(planned.command)}</code></pre>\n" if planned.command else ""
    return body + command


def _parameters(diagnosis: Diagnosis, shown: Shown) -> str:
    """Base and effects, with intervals."""
    named: dict[str, Quantity] = dict(diagnosis.base.parameters)
    for effect in diagnosis.effects:
        named |= {f"{effect.name} {name}": one for name, one in effect.parameters.items()}
    if not named:
        return ""
    body = table(tables.parameters(diagnosis), caption=False)
    if any(one.value for one in named.values()):
        caption = "Intervals relative to the estimated value; the diamond is the value that the model started from."
        body += drawing(figures.draw_parameters(named), "intervals", "Parameters with 95 % intervals", caption)
    return body


def _power(diagnosis: Diagnosis, shown: Shown) -> str:
    """How much could hide."""
    if not diagnosis.power:
        return ""
    body = paragraph("An effect smaller than this could be there without these recordings showing it.")
    body += paragraph(words.invisible_sentence(diagnosis.power, diagnosis.effects))
    if any(one.largest for one in diagnosis.power.values()):
        caption = "From the smallest size that would have been seen to the largest that is expected."
        body += drawing(figures.draw_power(diagnosis.power), "visible", "Smallest visible size of each effect", caption)
    return body + table(tables.power(diagnosis), caption=False)


def _quality(diagnosis: Diagnosis, shown: Shown) -> str:
    notes = "".join(map(paragraph, words.quality_notes(diagnosis.data_quality)))
    body = table(tables.quality(diagnosis), caption=False) + table(tables.ignored(diagnosis))
    return body + notes + "".join(map(paragraph, diagnosis.notes))


def _footer(diagnosis: Diagnosis) -> str:
    lines = (
        "Nats: gain in log-likelihood over the base model with its parameters re-estimated; an effect is named only "
        "above the gain that chance would reach.",
        "Needed: the gain that chance reaches once in some hundred thousand looks, more for an effect with more "
        "numbers; tables and the figure of explanations tell the same gains and needs.",
        "Surprise: a gain less what chance gives it, the same scale for laws and curves.",
        "Slot: the place in the device where an effect acts. Shuffled: a placebo, the effect with its cause put in "
        "another order, the best of several such shuffles, and what it may gain by chance. Where it gains more (GAINS "
        "TOO), what the effect needs grows as many times; with less than that it is weak.",
        f"{words.LIKELY}",
        "Held-out data confirm an effect "
        "where its readings gain and no simulation is surely worse (a loss within its scatter is no denial); they say "
        "little of it where it barely passes or is weak (the training data themselves may be simulated worse with it: "
        "no model that is written has it then), never test it where they do not reach what it acts on, and "
        "deny it where they refute it reading by reading, or where a simulation of them is worse with it, by more than "
        "their own scatter or by more than a point: then it is in no model that is written.",
        "Free curves: the fit that free curves over one variable each reach in place of laws; no bound: laws may "
        "reach more.",
        "The noise floor is the fit that a perfect model would have; a finding has to beat the re-fitted base, not the "
        "nominal one.",
        f"Schema {diagnosis.schema}, seed {diagnosis.seed}.",
    )
    name, title = WORDS
    return f'<footer id="{name}">\n<h2>{text(title)}</h2>\n{"".join(map(paragraph, lines))}</footer>\n'


# Anchor, heading, what stands there.
SECTIONS: tuple[tuple[str, str, Part], ...] = (
    ("effects", "What the model leaves out", _effects),
    ("where", "Where the mismatch sits", _where),
    ("force", "The missing force and what it follows", _force),
    ("proof", "Before and after on held-out data", _proof),
    ("alternatives", "Alternatives", _alternatives),
    ("next", "Next experiment", _next),
    ("parameters", "Parameters", _parameters),
    ("power", "What these recordings would have shown", _power),
    ("quality", "Data quality", _quality),
)
