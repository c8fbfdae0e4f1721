"""The report: sentences and numbers a person reads, 80 columns, one page that stands alone and is always the same."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from diagnose import examples
from diagnose.examples import EXAMPLES, HELDOUT, TRAIN, bad_data, consistent, coulomb, renamed, unknown
from rich.console import Console

from hoopd.diagnose.proof.not_excluded import one_body_notes
from hoopd.diagnose.record import (
    Candidate,
    DataQuality,
    Diagnosis,
    EffectFinding,
    ErrorWindow,
    Evidence,
    Fit,
    FitTable,
    FreeRunChoice,
    FreeRunEffect,
    NextExperiment,
    Placebo,
    Quantity,
    RecordingQuality,
    Refused,
)
from hoopd.diagnose.report import headline, markup, plain_words, table_notes, tables
from hoopd.diagnose.report import sentences as words
from hoopd.diagnose.report.page import page
from hoopd.diagnose.report.terminal import WIDTH, report_console, report_text
from hoopd.diagnose.report_curves import Comparison, MissingForce, Regressor, Shown, Strip, Trace
from hoopd.plots import style
from hoopd.plots.diagnosis import draw_candidates
from hoopd.plots.number_format import chance, interval_text, percent, short_names, value_text

# Drawings are looked at by these; the others read words, and half a second a figure would be most of their time.
DRAWN = re.compile("drawn|draws|curve|figure")
TRUE_SVG = markup.svg

VOID = {"meta", "link", "br", "img"}


@pytest.fixture(autouse=True)
def drawn_where_it_is_looked_at(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """One and the same drawing for all figures of a page whose words are read."""
    if not DRAWN.search(request.node.name):
        drawing = one_drawing()
        monkeypatch.setattr(markup, "svg", lambda figure: drawing)


@cache
def one_drawing() -> str:
    return TRUE_SVG(style.figure())


def made(name: str) -> bytes:
    """The page of an example with its true drawings, whichever test asks first."""
    with pytest.MonkeyPatch.context() as true:
        true.setattr(markup, "svg", TRUE_SVG)
        return examples.made(name)


def printed(diagnosis: Diagnosis, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    report_text(diagnosis, console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert isinstance(text, str)
    return text


class Page(HTMLParser):
    """Tags of a page, checked for balance, with what the tests ask about."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(data.decode())
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def squeezed(text: str) -> str:
    return " ".join(text.split())


# ------------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("value", "unit", "ci95", "expected"),
    [
        (5.1e-3, "N m", (4.87e-3, 5.33e-3), ("5.10 mN m", "4.87 to 5.33 mN m")),
        (586.37, "1/(kg m^2)", (580.0, 592.0), ("586.4 1/(kg m²)", "580.0 to 592.0 1/(kg m²)")),
        (2.2e-5, "N m s2", (2.1e-5, 2.3e-5), ("22.0 µN m s²", "21.0 to 23.0 µN m s²")),
        (-0.0419, "rad", None, ("-41.9 mrad", "-")),
        (0.0, "N m", (-1e-3, 1e-3), ("0.0000 N m", "-0.0010 to 0.0010 N m")),
        (1.2e-4, "kg m^2", (1.1e-4, 1.3e-4), ("0.000120 kg m²", "0.000110 to 0.000130 kg m²")),
        (123456.0, "1/s", (100000.0, 150000.0), ("123000 1/s", "100000 to 150000 1/s")),
        (3e-12, "m2", None, ("3e-12 m²", "-")),
        (None, "s", None, ("-", "-")),
        (0.5, "-", (None, 0.6), ("0.5", "-")),
    ],
)
def test_a_quantity_has_the_digits_that_its_interval_allows(
    value: float | None, unit: str, ci95: Any, expected: tuple[str, str]
) -> None:
    quantity = Quantity(value=value, unit=unit, ci95=ci95, nominal=None)
    assert (value_text(quantity), interval_text(quantity)) == expected


def test_recordings_are_called_by_their_last_name_only_where_that_tells_them_apart() -> None:
    names = ["a/x.mcap", "b/x.mcap", "b/y.mcap"]
    assert short_names(names) == {"a/x.mcap": "a/x.mcap", "b/x.mcap": "b/x.mcap", "b/y.mcap": "y.mcap"}


# ------------------------------------------------------------------------------------------- sentences


def test_the_verdict_of_a_named_effect_has_its_size_what_is_not_excluded_and_the_gain() -> None:
    assert headline.verdict_sentence(coulomb()[0]) == (
        "The model leaves out hoop.coulomb_friction (Fc = 5.10 mN m; hoop.stribeck_friction not excluded). "
        "Dry friction holds the hoop back with a constant torque of 5.1 mN m against its motion."
    )
    assert headline.fit_sentence(coulomb()[0]) == (
        "Fit of held-out dtheta: your model 78.2, re-fitted 87.0, with effects 97.6 %."
    )


def test_what_a_saved_model_has_and_how_well_it_does_stands_beside_what_was_found() -> None:
    diagnosis, _ = coulomb()
    sure = msgspec.structs.replace(diagnosis.effects[0], status="confirmed", in_model=True)
    more = msgspec.structs.replace(sure, name="hoop.untested", status="untested")
    left = msgspec.structs.replace(sure, name="hoop.left_out", in_model=False)
    own = {
        recording: {channel: msgspec.structs.replace(one, written=91.5) for channel, one in channels.items()}
        for recording, channels in diagnosis.fit.heldout.items()
    }
    table = msgspec.structs.replace(diagnosis.fit, heldout=own)
    told = msgspec.structs.replace(diagnosis, effects=[sure, more, left], fit=table)
    # what is in the model is told, sure or not; what is not in it is not
    assert "keep the model with hoop.coulomb_friction and hoop.untested (--write" in headline.next_sentence(told)
    assert "with those that --write saves 91.5 %" in headline.fit_sentence(told)
    assert "saves" not in headline.fit_sentence(diagnosis)
    assert (
        "saved model" in tables.fit("Fit", own).head
        and "saved model" not in tables.fit("Fit", diagnosis.fit.heldout).head
    )
    assert "saved model: " in table_notes.columns_sentence(table)


def test_what_is_less_sure_stands_behind_what_is_sure_and_says_why() -> None:
    diagnosis, _ = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed", not_excluded=[])

    def other(name: str, **more: Any) -> EffectFinding:
        return msgspec.structs.replace(first, **{"name": name, "parameters": {}, **more})

    shuffled = Placebo(log_likelihood_gain=2.0, held=False)
    doubted = [
        other("a.weak", status="weak", placebo=None),
        other("a.shuffled", status="weak", placebo=shuffled),
        other("a.untested", status="untested"),
        other("a.unlikely", probability=0.004),
        other("a.half", probability=0.5),
    ]
    less = (
        "a.weak (weak), a.shuffled (weak: a shuffled cause gains too), a.untested (held-out data never test it), "
        "something at the hoop whose law is open (a.unlikely: < 1 % likely) and a.half (50 % likely)."
    )
    both = msgspec.structs.replace(diagnosis, effects=[*doubted, first])
    sure = "The model leaves out hoop.coulomb_friction (Fc = 5.10 mN m); less sure: "
    assert headline.verdict_sentence(both) == f"{sure}{less}"
    none = msgspec.structs.replace(diagnosis, effects=doubted)
    assert headline.verdict_sentence(none) == f"Physics is missing, and which law it follows is not sure: {less}"


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, "< 1 %"), (1e-9, "< 1 %"), (0.0099, "< 1 %"), (0.01, "1 %"), (0.93, "93 %"), (0.998, "> 99 %"), (None, "-")],
)
def test_no_probability_is_told_as_nothing_or_all(value: float | None, expected: str) -> None:
    assert chance(value) == expected


def test_that_none_of_the_known_laws_is_likely_stands_in_the_table_and_so_do_others_in_words() -> None:
    diagnosis, _ = coulomb()
    more = [("none of these", 0.998), ("hoop.dahl", 0.39), ("hoop.small", 0.05), ("parameters", 0.3)]
    likely = [Candidate(name=name, log_likelihood_gain=None, probability=share) for name, share in more]
    told = msgspec.structs.replace(diagnosis, candidates=[*diagnosis.candidates, *likely])
    assert tables.effects(told).rows[-1] == ("no known law, in a place at least", "-", "-", "-", "-", "-", "> 99 %")
    sentence = words.likely_sentence(told)
    assert sentence.endswith("Others that could stand in one of their places: hoop.dahl (39 %).")
    for text in (printed(told, 120), Page(page(told, Shown())).text):
        assert "no known law, in a place at least" in text and squeezed(sentence) in squeezed(text)
    for few in (likely[1:], [msgspec.structs.replace(likely[0], probability=0.1)]):
        rows = tables.effects(msgspec.structs.replace(told, candidates=few)).rows
        assert all(row[0] != "no known law, in a place at least" for row in rows)
    with_it = msgspec.structs.replace(likely[1], counted_with="hoop.coulomb_friction")
    counted = msgspec.structs.replace(told, candidates=[likely[0], with_it])
    own = msgspec.structs.replace(counted.effects[0], probability=0.6)
    plain = plain_words.plain_sentence(msgspec.structs.replace(counted, effects=[own]))
    assert "that it is hoop.coulomb_friction (or hoop.dahl, which nothing here tells from it) is 60 % likely" in plain
    assert "are mostly a law that is not known here" in plain
    alike = words.likely_sentence(counted)
    assert alike.endswith(
        "In what is said of hoop.coulomb_friction, because nothing here tells them apart: hoop.dahl (39 %)."
    )
    assert words.likely_sentence(consistent()[0]) == ""


def test_the_table_of_fits_without_each_finding_says_which_models_it_compares() -> None:
    diagnosis, shown = coulomb()
    assert words.compared_sentence(diagnosis).startswith("With: the model of the finding.")
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed")
    denied = msgspec.structs.replace(first, name="actuator.cogging", status="not_confirmed")
    both = msgspec.structs.replace(diagnosis, effects=[first, denied])
    told = "With: the model of all 2 findings, actuator.cogging among them, which no model that is written has."
    for text in (printed(both), Page(page(both, shown)).text):
        assert told in squeezed(text)
    assert words.compared_sentence(consistent()[0]) == ""


def test_a_verdict_of_parameters_compares_with_the_nominal_model() -> None:
    diagnosis, _ = EXAMPLES["parameters"]()
    assert "re-estimating" in headline.verdict_sentence(diagnosis)
    assert re.fullmatch(
        r"Fit of held-out \w+: your model 61\.\d, re-fitted 97\.\d %\.", headline.fit_sentence(diagnosis)
    )


def test_a_fit_that_did_not_rise_is_not_called_a_gain() -> None:
    diagnosis, _ = coulomb()
    worse = {
        recording: {name: msgspec.structs.replace(one, with_effects=50.0) for name, one in channels.items()}
        for recording, channels in diagnosis.fit.heldout.items()
    }
    fit = msgspec.structs.replace(diagnosis.fit, heldout=worse)
    told = headline.fit_sentence(msgspec.structs.replace(diagnosis, fit=fit))
    assert "with effects 50.0 %; worse than the re-fitted model: " in told


def test_the_headline_compares_with_the_better_of_both_models() -> None:
    """The user's own model had 74, the re-fitted one 31: 48 is no gain."""
    diagnosis, _ = coulomb()
    row = Fit(nominal=74.1, base_refit=31.1, with_effects=48.1, noise_floor=99.0)
    fit = msgspec.structs.replace(diagnosis.fit, heldout={HELDOUT: {"psi": row}})
    told = headline.fit_sentence(msgspec.structs.replace(diagnosis, fit=fit))
    assert told.endswith("worse than your model: psi (48.1 against 74.1 %).")
    fit = msgspec.structs.replace(diagnosis.fit, heldout={HELDOUT: {"psi": msgspec.structs.replace(row, nominal=31.0)}})
    told = headline.fit_sentence(msgspec.structs.replace(diagnosis, fit=fit))
    assert told == "Fit of held-out psi: your model 31.0, re-fitted 31.1, with effects 48.1 %."


def test_what_held_out_data_deny_is_in_the_table_and_not_in_the_headline() -> None:
    diagnosis, _ = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed")
    denied = msgspec.structs.replace(first, name="actuator.cogging", status="not_confirmed")
    refused = [Refused(name="frame.tilt", log_likelihood_gain=33.0, reason="it loses 9.0 nats")]
    told = msgspec.structs.replace(diagnosis, effects=[first, denied], refused=refused)
    assert "cogging" not in headline.verdict_sentence(told) and first.name in headline.verdict_sentence(told)
    for text in (printed(told), Page(page(told, Shown())).text):
        assert "actuator.cogging" in text and "denied" in text and "confirmed" in text
        assert "frame.tilt" in text and "it loses 9.0 nats" in text
    alone = headline.verdict_sentence(msgspec.structs.replace(told, verdict="parameters", effects=[]))
    assert "frame.tilt" in alone and "not confirmed" in alone and "complete" not in alone


def test_where_no_name_is_confirmed_the_headline_says_what_was_found_and_why_it_is_not() -> None:
    diagnosis, shown = coulomb()
    why = "with it the simulation of the held-out data is worse: psi by 0.7 points"
    only = msgspec.structs.replace(diagnosis.effects[0], status="not_confirmed", reason=why)
    told = msgspec.structs.replace(diagnosis, effects=[only])
    sentence = headline.verdict_sentence(told)
    assert sentence.startswith("Physics is missing, and no name for it is confirmed. ")
    assert headline.fit_sentence(told) == "Fit of held-out dtheta: your model 78.2, re-fitted 87.0 %."
    assert f"hoop.coulomb_friction (Fc = 5.10 mN m; hoop.stribeck_friction not excluded): {why}." in sentence
    for text in (printed(told), Page(page(told, shown)).text):
        assert f"Not confirmed: {why}" in " ".join(text.split())
    assert tables.effects(told).rows[0][0] == "hoop.coulomb_friction (not confirmed)"


def test_parameters_alone_are_compared_with_the_users_model_where_the_table_has_a_column_of_effects() -> None:
    """As a diagnosis writes it: without effects their column is that of the re-fitted model."""
    diagnosis, _ = EXAMPLES["parameters"]()
    row = Fit(nominal=60.0, base_refit=90.0, with_effects=90.0, noise_floor=99.0)
    fit = msgspec.structs.replace(diagnosis.fit, heldout={HELDOUT: {"psi": row}})
    told = headline.fit_sentence(msgspec.structs.replace(diagnosis, fit=fit))
    assert told == "Fit of held-out psi: your model 60.0, re-fitted 90.0 %."
    worse = msgspec.structs.replace(row, nominal=95.0)
    fit = msgspec.structs.replace(diagnosis.fit, heldout={HELDOUT: {"psi": worse}})
    told = headline.fit_sentence(msgspec.structs.replace(diagnosis, fit=fit))
    assert told.endswith("worse than your model: psi (90.0 against 95.0 %).")


def test_an_unknown_effect_has_its_slot_and_what_it_follows() -> None:
    sentence = headline.verdict_sentence(unknown()[0])
    assert "not in the library" in sentence and "slot hoop" in sentence and "follows theta" in sentence


def test_of_what_has_no_name_held_out_data_deny_a_curve_and_not_that_it_is_there() -> None:
    diagnosis, _ = unknown()
    denied = msgspec.structs.replace(diagnosis.effects[0], status="not_confirmed", probability=0.999)
    told = msgspec.structs.replace(diagnosis, effects=[denied])
    assert "its curve denied by held-out data" in headline.certainty_sentence(told)
    assert tables.effects(told).rows[0][0] == f"{denied.name} (curve not confirmed)"
    assert "what acts there is no known law" in words.likely_sentence(told)


def test_what_has_no_name_follows_its_own_variable_and_not_that_of_a_law_in_the_same_slot() -> None:
    """The law is drawn over dtheta, the curve over theta."""
    law, rest = coulomb()[0], unknown()[0]
    diagnosis = msgspec.structs.replace(
        law, verdict="unknown_physics", unexplained=rest.unexplained, effects=[*law.effects, *rest.effects]
    )
    assert diagnosis.location.slot == "hoop" and diagnosis.location.depends_on == ["dtheta"]
    assert "acts in slot hoop and follows theta beside" in headline.verdict_sentence(diagnosis)


def test_the_windows_that_carry_the_error_are_told() -> None:
    diagnosis, shown = coulomb()
    each = {
        "psi": ErrorWindow(t0=4.0, t1=6.0, share=0.42, windows=10),
        "dtheta": ErrorWindow(t0=0.0, t1=2.0, share=0.2, windows=10),
    }
    fit = msgspec.structs.replace(diagnosis.fit, error_windows={HELDOUT: each})
    told = msgspec.structs.replace(diagnosis, fit=fit)
    for text in (printed(told), Page(page(told, shown)).text):
        said = " ".join(text.split())
        where = f"psi of {short_names([HELDOUT])[HELDOUT]} at 4.0 to 6.0 s"
        assert f"{where} (42.0 % of its squared error, in one of 10 windows)." in said
        assert "dtheta of" not in said
    even = msgspec.structs.replace(fit, error_windows={HELDOUT: {"dtheta": each["dtheta"]}})
    assert words.error_sentence(even).endswith("is 20.0 % (dtheta of prbs_b.mcap at 0.0 to 2.0 s; even: 10.0 %).")
    assert words.error_sentence(diagnosis.fit) == ""
    # half of the error in one of four, and one of two, which always has half
    few = {
        "psi": ErrorWindow(t0=4.0, t1=6.0, share=0.6, windows=4),
        "dtheta": ErrorWindow(t0=0.0, t1=2.0, share=0.7, windows=2),
    }
    said = words.error_sentence(msgspec.structs.replace(fit, error_windows={HELDOUT: few}))
    assert "psi of " in said and "dtheta of " not in said


def test_the_figure_of_explanations_has_the_gains_and_needs_of_the_tables() -> None:
    diagnosis, _ = coulomb()
    first = msgspec.structs.replace(diagnosis.candidates[0], surprise=900.0, threshold=12.0, needed=31.0)
    other = msgspec.structs.replace(diagnosis.candidates[1], surprise=800.0, threshold=12.0, needed=33.0)
    (axes,) = draw_candidates([first, other], diagnosis.effects, ()).axes
    (row,) = (one for one in tables.effects(diagnosis).rows if one[0] == first.name)
    assert row[4] in [one.get_text() for one in axes.texts]
    marks = sorted(float(one.get_xdata()[0]) for one in axes.lines if one.get_label() == "needed")
    assert marks == [31.0, 33.0] and row[5] == "31"


def test_what_simulates_better_is_told_with_what_it_was_chosen_on() -> None:
    diagnosis, _ = coulomb()
    phase = Quantity(value=0.3, unit="rad", ci95=None, nominal=0.0)
    own = {"phi": phase, f"phi@{TRAIN}": phase}
    wave = FreeRunEffect(name="hoop.imbalance", named=False, parameters=own, error_share=0.31, chance=0.002)
    choice = FreeRunChoice(effects=[wave], heldout_share=0.2, fits={}, chosen_on="the training stretches")
    told = msgspec.structs.replace(diagnosis, fit=msgspec.structs.replace(diagnosis.fit, free_run_choice=choice))
    for text in (printed(told), Page(page(told, Shown())).text):
        assert all(part in text for part in ("hoop.imbalance", "31.0 %", "0.2 %", "Chosen on the training stretches."))
        assert f"phi@{TRAIN}" not in text


def test_numbers_of_recordings_are_explained_whichever_table_has_them() -> None:
    diagnosis, _ = coulomb()
    phase = Quantity(value=0.3, unit="rad", ci95=None, nominal=0.0)
    own = {"phi": phase, f"phi@{TRAIN}": phase, "phi@other.csv": phase}
    wave = FreeRunEffect(name="hoop.imbalance", named=False, parameters=own)
    assert words.numbers_sentence(diagnosis) == ""
    fit = msgspec.structs.replace(
        diagnosis.fit, train={**diagnosis.fit.train, "other.csv": {}}, free_run_choice=FreeRunChoice(effects=[wave])
    )
    assert "(2): of other" in words.numbers_sentence(msgspec.structs.replace(diagnosis, fit=fit))


def test_what_remains_beside_a_named_effect_is_said() -> None:
    diagnosis = msgspec.structs.replace(
        coulomb()[0], verdict="unknown_physics", unexplained=unknown()[0].unexplained,
        effects=[*coulomb()[0].effects, *unknown()[0].effects],
    )  # fmt: skip
    said = headline.verdict_sentence(diagnosis)
    assert "not in the library acts in slot" in said and "beside hoop.coulomb_friction" in said
    assert "83.0 % of what the re-fitted base leaves" in printed(diagnosis).replace("\n", "")


# ------------------------------------------------------------------------------------------- terminal


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_terminal_s_report_starts_with_the_verdict_and_fits_80_columns(name: str) -> None:
    diagnosis, _ = EXAMPLES[name]()
    text = printed(diagnosis)
    assert text.startswith(headline.TITLES[diagnosis.verdict] + "\n")
    assert squeezed(headline.verdict_sentence(diagnosis)) in squeezed(text)
    assert max(map(len, text.splitlines())) <= 80
    for _, _, fit in words.each_fit(diagnosis.fit.free_run):
        assert percent(fit.base_refit) in text  # whole: never cut or folded


def test_the_terminal_s_report_has_every_part_of_a_finding() -> None:
    text = printed(coulomb()[0])
    for part in (
        "4.87 to 5.33 mN m", "1342", "31", "gains nothing", "-1319 nats", "+61.0 points", "prbs_b.mcap",
        "windows of 2 s", "One free run", "Not excluded", "hoop.stribeck_friction", "Next experiment",
        "hoopd experiment --signal ramp --amplitude 0.02 --duration 30", "late frames", "a hand moved the ball",
        "97.7 87.4", "93 %", "[-Fc sign(theta')]",
    ):  # fmt: skip
        assert part in squeezed(text), part
    # the base stands beside it, so that a number that cannot be is seen
    for name in coulomb()[0].base.parameters:
        assert f" {name} " in squeezed(text), name


def test_a_counter_that_jumped_stands_behind_the_verdict() -> None:
    diagnosis = coulomb()[0]
    each = {
        TRAIN: RecordingQuality(0, 0, 0, jumps={"theta": 3}),
        HELDOUT: RecordingQuality(0, 0, 0, jumps={"theta": 1, "x": 1}),
    }
    lost = msgspec.structs.replace(diagnosis, data_quality=DataQuality(0, 0, 0, [], recordings=each))
    said = headline.verdict_sentence(lost)
    assert said.endswith(
        " Beside that, theta jumped 4 times and x jumped once and went on from there (lost counts, or what slipped): "
        "taken out, and the recordings' notes say when."
    )
    assert plain_words.summary(lost).endswith(
        "the recordings' notes say when."
    ) and "jumped" not in plain_words.summary(diagnosis)
    assert "jumped" not in headline.verdict_sentence(diagnosis)


def test_windows_are_as_long_as_the_plant_s_motion_asks_for() -> None:
    diagnosis, shown = coulomb()
    for window_s, said in ((0.05, "windows of 0.05 s"), (None, "windows")):
        other = msgspec.structs.replace(diagnosis, fit=msgspec.structs.replace(diagnosis.fit, window_s=window_s))
        text = squeezed(printed(other))
        assert f"Fit of held-out data, {said} (NRMSE %)" in text and "2 s" not in text.partition("Next experiment")[0]
        assert f"in {said}; each starts" in squeezed(Page(page(other, Shown(shown.comparisons[:1]))).text)


def test_times_are_told_to_a_share_of_a_window() -> None:
    """Of a circuit that moves within milliseconds, and of a tank that moves within minutes."""
    diagnosis, _ = bad_data()
    location = msgspec.structs.replace(diagnosis.location, slot="hoop", segments=[(0.01234, 0.02345)])
    part = msgspec.structs.replace(
        diagnosis.data_quality, recordings={}, segments_ignored=[(0.01234, 123.45, "a spark")]
    )
    for window_s, said, rows in (
        (0.02, "at 0.012 to 0.023 s", ("0.0123", "123.4500")),
        (2.0, "at 0.0 to 0.0 s", ("0.01", "123.45")),
        (200.0, "at 0 to 0 s", ("0", "123")),
    ):
        assert said in words.location_sentence(location, window_s)
        fit = msgspec.structs.replace(diagnosis.fit, window_s=window_s)
        other = msgspec.structs.replace(diagnosis, data_quality=part, fit=fit)
        assert tables.ignored(other).rows[0][:2] == rows


def test_how_likely_a_finding_is_stands_beside_it_and_what_comes_nearest_to_what_has_no_name() -> None:
    diagnosis, _ = coulomb()
    first = diagnosis.effects[0]
    assert tables.effects(diagnosis).head[-1] == "likely" and tables.effects(diagnosis).rows[0][-1] == "93 %"
    odd = msgspec.structs.replace(first, probability=None, nearest="hoop.quadratic_drag")
    unsaid = msgspec.structs.replace(diagnosis, effects=[odd])
    assert tables.effects(unsaid).head[-1] == "needed"
    assert "nearest in the library: hoop.quadratic_drag" in words.statements(unsaid)[0]


def test_intervals_set_aside_and_notes_on_the_data_are_printed() -> None:
    text = squeezed(printed(bad_data()[0]))
    assert "14.20 17.10 a hand moved the ball" in text
    assert "the derivative was used" in text and "The last third of every recording was held out." in text


def test_bad_samples_are_counted_and_their_share_said_where_it_is_known() -> None:
    text = squeezed(printed(coulomb()[0]))
    assert "prbs_a.mcap 50 (1.1 %) 7 (0.47 %) 0" in text
    assert "prbs_b.mcap 12 2 6" in text
    assert "all 62 (0.83 %) 9 (0.36 %) 6 (0.08 %)" in text


def test_a_placebo_that_gains_too_is_called_so() -> None:
    diagnosis, _ = coulomb()
    placebo = msgspec.structs.replace(diagnosis.effects[0].placebo, held=False)
    effect = msgspec.structs.replace(diagnosis.effects[0], placebo=placebo)
    assert "GAINS TOO" in printed(msgspec.structs.replace(diagnosis, effects=[effect]))


NASTY = "[red]<script>alert(1)<b>&\"'$x$\x1b[31m\u202egnp.\udcff [bold] ${a}.mcap"


def test_a_recording_s_name_is_text_wherever_it_stands() -> None:
    diagnosis, shown = coulomb()
    diagnosis = renamed(diagnosis, HELDOUT, "NAME")
    heldout = {NASTY: diagnosis.fit.heldout["NAME"]}
    diagnosis = msgspec.structs.replace(diagnosis, fit=msgspec.structs.replace(diagnosis.fit, heldout=heldout))
    text = printed(diagnosis, 200)
    assert "[red]<script>" in text and "\x1b" not in text and "\u202e" not in text
    strips = [Strip(NASTY, one.slot, one.t_s, one.strength) for one in shown.strips]
    comparisons = [Comparison(NASTY, one.traces) for one in shown.comparisons]
    data = page(diagnosis, Shown(comparisons, (), strips))
    seen = Page(data)
    assert not seen.all("script") and b"<script" not in data and b"\x1b" not in data
    assert "[red]<script>alert(1)<b>&\"'$x$\\x1b[31m\\u202egnp.\\udcff [bold] ${a}.mcap" in seen.text


# ------------------------------------------------------------------------------------------- page


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_page_is_well_formed_says_the_verdict_and_needs_nothing_but_itself(name: str) -> None:
    """All of a page at once: a page with its drawings takes seconds."""
    diagnosis, _ = EXAMPLES[name]()
    data = made(name)
    seen = Page(data)
    judge_words(seen, headline.verdict_sentence(diagnosis))
    judge_drawings(data.decode())
    judge_alone(seen)


def judge_words(seen: Page, verdict: str) -> None:
    assert squeezed(verdict) in seen.text
    names = [one["id"] for _, one in seen.tags if "id" in one]
    assert len(names) == len(set(names))
    links = [one["href"] for one in seen.all("a")]
    assert links and all(link is not None and link[1:] in names for link in links)
    assert [level for level, _ in seen.tags if level in ("h1", "h2")][:2] == ["h1", "h2"]
    assert all(one.get("scope") in ("col", "row") for one in seen.all("th"))


def judge_drawings(data: str) -> None:
    """Every drawing has a title, and only names that are its own."""
    drawings = re.findall(r"<svg\b.*?</svg>", data, re.DOTALL)
    assert drawings
    for drawing in drawings:
        (labelled,) = re.findall(r'aria-labelledby="([^"]+)"', drawing)
        assert re.search(rf'<title id="{labelled}">[^<]{{5,}}</title>', drawing)
        inside = set(re.findall(r'\bid="([^"]+)"', drawing))
        used = set(re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', drawing))
        assert used <= inside


def judge_alone(seen: Page) -> None:
    policy = [one["content"] for one in seen.all("meta") if one.get("http-equiv") == "Content-Security-Policy"]
    assert policy == ["default-src 'none'; style-src 'unsafe-inline'; img-src data:"]
    for tag, attributes in seen.tags:
        for key in ("src", "href", "xlink:href"):
            value = attributes.get(key)
            assert value is None or value.startswith(("#", "data:image/png;base64,")), (tag, key, value)
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in seen.tags}


def test_a_finding_s_page_has_its_parts_in_their_order() -> None:
    seen = Page(made("coulomb"))
    assert [one["id"] for one in seen.all("section")] == [
        "effects", "where", "force", "proof", "alternatives", "next", "parameters", "power", "quality"
    ]  # fmt: skip
    figures = {one["id"] for one in seen.all("figure")}
    assert figures == {"slots", "strips", "force0", "comparison0", "candidates", "intervals", "visible"}


def test_what_is_not_there_leaves_no_hole() -> None:
    diagnosis, _ = consistent()
    no_data = DataQuality(missing=None, late_frames=None, outliers=None, segments_ignored=[])
    base = msgspec.structs.replace(diagnosis.base, parameters={})
    bare = msgspec.structs.replace(
        diagnosis, power={}, candidates=[], fit=FitTable(train={}, heldout={}), base=base, data_quality=no_data,
        location=msgspec.structs.replace(diagnosis.location, evidence={}),
    )  # fmt: skip
    seen = Page(page(bare, Shown()))
    assert [one["id"] for one in seen.all("section")] == ["where", "quality"]
    assert not seen.all("svg") and "nan" not in seen.text.lower()
    assert printed(bare).startswith("Consistent\n")


def test_an_unknown_effect_s_page_has_its_curve_and_its_harmonics() -> None:
    figures = {one["id"] for one in Page(made("unknown")).all("figure")}
    assert {"curve", "harmonics0"} <= figures


def test_of_an_exact_class_the_other_name_stands_on_the_page() -> None:
    seen = Page(made("exact_class"))
    assert "camera.angle_offset" in seen.text and "the same by its equations" in seen.text


def test_undetermined_numbers_and_empty_curves_do_not_stop_the_page() -> None:
    diagnosis, _ = coulomb()
    blank = np.full(5, np.nan)
    t = np.arange(5.0)
    shown = Shown(
        [Comparison("a", [Trace("psi", "rad", t, blank, blank, blank)]), Comparison("b", [])],
        [MissingForce("hoop", "N m", t, blank, [Regressor("dtheta", "rad/s", blank)]), MissingForce("ball", "N", t, t)],
        [Strip("a", "hoop", t, blank), Strip("b", "hoop", t[:1], t[:1])],
    )
    odd = Quantity(value=float("nan"), unit="N m", ci95=(None, None), nominal=float("inf"))
    effect = msgspec.structs.replace(diagnosis.effects[0], parameters={"Fc": odd})
    base = msgspec.structs.replace(diagnosis.base, parameters={"K1": odd})
    candidates = [msgspec.structs.replace(one, log_likelihood_gain=-3.0) for one in diagnosis.candidates]
    diagnosis = msgspec.structs.replace(diagnosis, effects=[effect], base=base, candidates=candidates)
    seen = Page(page(diagnosis, shown))
    assert {"comparison0", "force0", "force1", "strips"} <= {one["id"] for one in seen.all("figure")}
    assert "nan" not in seen.text.lower() and "nan" not in printed(diagnosis).lower()


def test_the_same_diagnosis_gives_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib; from diagnose.examples import unknown;"
        "from hoopd.diagnose.report.page import page; pathlib.Path(sys.argv[1]).write_bytes(page(*unknown()))"
    )
    there = tmp_path / "there.html"
    paths = os.pathsep.join([str(Path(__file__).parents[2]), str(Path(__file__).parents[1])])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONHASHSEED": "17", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", code, str(there)], check=True, env=environment, timeout=300)
    assert there.read_bytes() == made("unknown")


def test_a_page_of_a_usual_case_can_be_sent_by_mail() -> None:
    assert len(made("coulomb")) < 2_000_000
    assert TRAIN in made("coulomb").decode()


def test_the_first_lines_say_how_sure_a_finding_is_and_what_to_do_next() -> None:
    diagnosis, shown = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed")
    told = msgspec.structs.replace(diagnosis, effects=[first])
    sure, then = headline.certainty_sentence(told), headline.next_sentence(told)
    assert sure == (
        "How sure that something acts there, and that it is this very law: hoop.coulomb_friction 1342 nats (31 needed) "
        "and 93 %, confirmed by held-out data."
    )
    assert then.startswith("Next: keep the model with hoop.coulomb_friction (--write FILE.yaml)")
    for text in (printed(told), Page(page(told, shown)).text):
        assert squeezed(sure) in squeezed(text) and squeezed(then) in squeezed(text)
    doubted = msgspec.structs.replace(told, effects=[msgspec.structs.replace(first, status="weak")])
    assert "--write" not in headline.next_sentence(doubted)
    assert headline.next_sentence(doubted).endswith("before a model is written.")


PLAIN: dict[str, tuple[dict[str, Any], dict[str, float], str]] = {
    "which law is open": (
        {"probability": 0.59, "status": "confirmed"},
        {"hoop.stribeck_friction": 0.3, "camera.latency": 0.5, "none of these": 0.02},
        "Something is certainly missing at the hoop; that it is hoop.coulomb_friction is 59 % likely, the other 41 % "
        "are mostly hoop.stribeck_friction.",
    ),
    "no law is known": (
        {"probability": 0.5},
        {"none of these": 0.4},
        "Something is certainly missing at the hoop; that it is hoop.coulomb_friction is 50 % likely, the other 50 % "
        "are mostly a law that is not known here.",
    ),
    "many laws": (
        {"probability": 0.5, "status": "weak"},
        {"hoop.stribeck_friction": 0.05},
        "Something is certainly missing at the hoop; that it is hoop.coulomb_friction is 50 % likely, the other 50 % "
        "are shared among other laws that do much the same.",
    ),
    "weak, and little of it": (
        {
            "probability": 0.97,
            "status": "weak",
            "evidence": Evidence(log_likelihood_gain=52.0, threshold=31.0, heldout_gain_percent=0.0),
        },
        {},
        "Something is probably missing at the hoop; which law it follows is known, too: hoop.coulomb_friction, 97 % "
        "likely.",
    ),
    "sure of both": (
        {"probability": 0.97},
        {},
        "Something is certainly missing at the hoop; which law it follows is known, too: hoop.coulomb_friction, 97 % "
        "likely.",
    ),
    "barely": (
        {"probability": 0.97, "evidence": Evidence(log_likelihood_gain=36.0, threshold=31.0, heldout_gain_percent=1.0)},
        {},
        "Something is almost certainly missing at the hoop; which law it follows is known, too: "
        "hoop.coulomb_friction, 97 % likely.",
    ),
}


@pytest.mark.parametrize("case", PLAIN)
def test_a_plain_sentence_keeps_what_is_there_apart_from_which_law_it_is(case: str) -> None:
    changes, probabilities, says = PLAIN[case]
    diagnosis, shown = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], **changes)
    known = [Candidate(name=name, log_likelihood_gain=1.0, probability=p) for name, p in probabilities.items()]
    told = msgspec.structs.replace(diagnosis, effects=[first], candidates=known)
    assert plain_words.summary(told) == says
    for text in (squeezed(printed(told)), squeezed(Page(page(told, shown)).text)):
        assert 0 < text.index(squeezed(says)) < text.index(squeezed("How sure"))


def test_what_has_no_name_and_what_is_denied_are_told_plainly_too() -> None:
    assert plain_words.summary(unknown()[0]).startswith("Something is certainly missing at the hoop; no known law")
    diagnosis, _ = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], status="not_confirmed", reason="worse")
    assert plain_words.summary(msgspec.structs.replace(diagnosis, effects=[first])).startswith("Physics is missing")
    assert plain_words.summary(consistent()[0]) == headline.verdict_sentence(consistent()[0])


def test_what_is_confirmed_and_in_no_model_is_not_told_to_be_kept() -> None:
    diagnosis, shown = coulomb()
    why = "held-back blocks are not surely simulated better with it"
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed", in_model=False, reason=why)
    told = msgspec.structs.replace(diagnosis, effects=[first])
    assert headline.certainty_sentence(told).endswith("confirmed by held-out data, but in no model that is written.")
    assert "keep the model with" not in headline.next_sentence(told)
    assert "(--write FILE.yaml) is without hoop.coulomb_friction" in headline.next_sentence(told)
    assert f"In no model that is written: {why}" in Page(page(told, shown)).text
    kept = msgspec.structs.replace(told, effects=[msgspec.structs.replace(first, in_model=True, reason="")])
    assert headline.next_sentence(kept).startswith("Next: keep the model with hoop.coulomb_friction")


def test_a_question_to_the_reader_stands_before_what_it_may_explain() -> None:
    """Another unit is no physics; a note at the end of a page comes after the belief."""
    diagnosis, shown = coulomb()
    asked = "u reaches 103, the drive's limit is 0.7 N m: another unit?"
    recordings = {TRAIN: RecordingQuality(missing=0, late_frames=0, outliers=0, segments_ignored=[], notes=[asked])}
    quality = msgspec.structs.replace(diagnosis.data_quality, recordings=recordings)
    told = msgspec.structs.replace(diagnosis, data_quality=quality)
    for text in (squeezed(printed(told)), squeezed(Page(page(told, shown)).text)):
        assert 0 < text.index(squeezed("Answer this first")) < text.index(squeezed("How sure"))
        assert text.count(squeezed(asked)) == 2
    assert words.questions_sentence(msgspec.structs.replace(quality, recordings={}, notes=["nothing."])) == ""


@pytest.mark.parametrize(
    ("reason", "held", "told"),
    [("psi is worse", True, "weak: psi is worse"), ("", False, "a shuffled cause"), ("", True, "say little of it")],
)
def test_a_weak_finding_says_what_makes_it_weak(reason: str, held: bool, told: str) -> None:
    diagnosis, _ = coulomb()
    placebo = Placebo(log_likelihood_gain=1.0, held=held, shuffles=8, most=6.0, limit=3.7)
    first = msgspec.structs.replace(diagnosis.effects[0], status="weak", reason=reason, placebo=placebo)
    assert told in headline.certainty_sentence(msgspec.structs.replace(diagnosis, effects=[first]))


def test_nobody_is_sent_to_tell_apart_what_is_told_apart() -> None:
    diagnosis, _ = coulomb()
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed", not_excluded=[])
    planned = NextExperiment(
        signal="a multisine", parameters={}, tells_apart=("a.b", "c.d"), expected_nats=176.0, apart_nats=114.0
    )
    told = msgspec.structs.replace(diagnosis, effects=[first], next_experiment=planned)
    assert "To be surer" not in headline.next_sentence(told)
    near = msgspec.structs.replace(told, next_experiment=msgspec.structs.replace(planned, apart_nats=1.0))
    assert headline.next_sentence(near).endswith("To be surer, record a multisine, which tells a.b from c.d.")
    weak = msgspec.structs.replace(told, effects=[msgspec.structs.replace(first, status="weak")])
    assert headline.next_sentence(weak).startswith("Next: record a multisine, as a further proof, before a model")


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_verdict_says_what_to_do_next(name: str) -> None:
    diagnosis, _ = EXAMPLES[name]()
    assert headline.next_sentence(diagnosis).startswith("Next: ")


def test_without_a_finding_the_nearest_explanation_is_told() -> None:
    diagnosis, _ = EXAMPLES["parameters"]()
    near = Candidate(name="frame.tilt", log_likelihood_gain=4.0, needed=12.0)
    far = Candidate(name="actuator.lag", log_likelihood_gain=5.0, needed=20.0)
    told = msgspec.structs.replace(diagnosis, candidates=[far, near], effects=[])
    assert headline.certainty_sentence(told) == (
        "How sure: of all explanations frame.tilt comes nearest, with 4.0 of the 12 nats that it needs."
    )
    alone, other = (
        Candidate(name=name, log_likelihood_gain=None, probability=share)
        for name, share in (("parameters", 0.8), ("none of these", 0.19))
    )
    sure = headline.certainty_sentence(msgspec.structs.replace(told, candidates=[near, alone, other]))
    assert sure.startswith("How sure: that nothing acts beside the model, 80 %, and that something does which is too ")
    assert ", 19 %; of all explanations frame.tilt comes nearest" in sure
    bare = headline.certainty_sentence(msgspec.structs.replace(told, candidates=[alone, other]))
    assert bare.endswith(" or follows no known law, 19 %.")


def test_what_is_left_without_a_name_has_an_experiment_too() -> None:
    diagnosis, _ = unknown()
    alone = msgspec.structs.replace(diagnosis, next_experiment=None)
    said = words.rest_experiment_sentence(alone)
    assert said.startswith("For what is left without a name at the hoop: a recording in which theta goes both ways")
    assert squeezed(said) in squeezed(printed(alone)) and said in Page(page(alone, Shown())).text


def test_what_several_recordings_have_for_themselves_is_in_one_unit() -> None:
    diagnosis, _ = coulomb()
    large, small = (Quantity(value=v, unit="rad", ci95=(v - 0.3, v + 0.3), nominal=0.0) for v in (-0.11, 0.0999))
    effect = msgspec.structs.replace(diagnosis.effects[0], parameters={f"phi@{TRAIN}": large, "phi@other.csv": small})
    told = msgspec.structs.replace(diagnosis, effects=[effect])
    values = [row[2] for row in [*tables.effects(told).rows, *tables.parameters(told).rows] if row[1].startswith("phi")]
    assert len(values) == 4 and all(one.endswith(" rad") for one in values), values


def test_a_run_over_all_that_was_held_out_and_is_worse_with_the_effects_is_told() -> None:
    diagnosis, shown = coulomb()
    runs = {
        "a.csv": {"psi": Fit(nominal=1.0, base_refit=90.0, with_effects=80.0, noise_floor=None)},
        "b.csv (held out)": {
            "psi": Fit(nominal=1.0, base_refit=90.3, with_effects=89.6, noise_floor=None),
            "dtheta": Fit(nominal=1.0, base_refit=90.3, with_effects=90.25, noise_floor=None),
        },
    }
    told = msgspec.structs.replace(diagnosis, fit=msgspec.structs.replace(diagnosis.fit, free_run=runs))
    said = words.free_run_sentence(told.fit)
    assert said.startswith(
        "One run over all of what was held out is worse with the effects: psi by 0.7 points (b.csv). "
    )
    assert squeezed(said) in squeezed(printed(told)) and said in Page(page(told, shown)).text


def test_runs_over_whole_parts_say_which_were_fitted_to() -> None:
    rows = tables.free_run("", coulomb()[0].fit.free_run).rows
    assert rows and all(row[0].endswith((" (fitted to)", " (held out)", "")) for row in rows)
    assert any(row[0].endswith("(fitted to)") for row in rows)


def test_a_placebo_is_told_by_the_gain_that_was_judged() -> None:
    """The best of the shuffles, and what it may be: a mean of 1 nat beside GAINS TOO says nothing."""
    diagnosis, _ = coulomb()
    for most, held, told in (
        (2.5, True, "gains 2.5 nats for hoop.coulomb_friction, by chance up to 3.7)"),
        (6.0, False, "gains 6.0 nats for hoop.coulomb_friction, by chance up to 3.7, so that it needs 50)"),
    ):
        placebo = Placebo(log_likelihood_gain=1.0, held=held, shuffles=8, most=most, limit=3.7)
        effect = msgspec.structs.replace(diagnosis.effects[0], placebo=placebo)
        one = msgspec.structs.replace(diagnosis, effects=[effect])
        assert told in table_notes.checks_sentence(one)
        assert tables.checks(one).rows[0][-1] == ("gains nothing" if held else "GAINS TOO")


def test_the_words_of_the_page_are_explained_on_it() -> None:
    seen = Page(made("coulomb"))
    text = seen.text
    assert "#words" in {one.get("href") for one in seen.all("a")} and seen.all("footer")[0]["id"] == "words"
    for word in ("Nats:", "Needed:", "Slot:", "Shuffled:", "Held-out data confirm", "Free curves:", "Likely:"):
        assert word in text


def test_a_file_gets_names_on_one_line_and_a_terminal_its_own_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    assert report_console().width == WIDTH
    monkeypatch.setenv("COLUMNS", "77")
    assert report_console().width == 77


def test_two_findings_that_swing_at_one_frequency_may_be_one_body() -> None:
    def swinging(name: str, w: float, half: float) -> EffectFinding:
        parameters = {"w": Quantity(value=w, unit="rad/s", ci95=(w - half, w + half), nominal=None)}
        return msgspec.structs.replace(coulomb()[0].effects[0], name=name, parameters=parameters)

    ball, hoop = swinging("ball.swing_of_dpsi", 26.2, 0.3), swinging("hoop.swing_of_dtheta", 26.3, 0.3)
    (note,) = one_body_notes([ball, hoop])
    assert note.startswith("ball.swing_of_dpsi and hoop.swing_of_dtheta swing at one and the same frequency (26.20")
    assert one_body_notes([ball, swinging("hoop.swing_of_dtheta", 31.0, 0.3)]) == []
    assert one_body_notes([ball, swinging("ball.other", 26.2, 0.3)]) == [] == one_body_notes([ball])


@pytest.mark.parametrize(
    ("follows", "said"),
    [
        (["u", "t"], "record u over all that it can be"),
        (["t"], "record the same once more (a law of the time comes back, what happened once does not)"),
        ([], ""),
    ],
)
def test_nobody_records_all_values_of_the_time(follows: list[str], said: str) -> None:
    diagnosis = coulomb()[0]
    place = msgspec.structs.replace(diagnosis.location, depends_on=follows)
    assert headline.words_of_remains(msgspec.structs.replace(diagnosis, location=place, unexplained=None)) == said
