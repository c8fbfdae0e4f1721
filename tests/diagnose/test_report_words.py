"""Sentences and tables of a report: what was found, compared with what, and what a number is called."""

from __future__ import annotations

import re
from typing import Any

import msgspec
import pytest
from diagnose.examples import EXAMPLES, HELDOUT, TRAIN, consistent, coulomb, unknown
from diagnose.reports import Page, printed, squeezed

from hoopd.diagnose.record import (
    Candidate,
    EffectFinding,
    ErrorWindow,
    Fit,
    FreeRunChoice,
    FreeRunEffect,
    Placebo,
    Quantity,
    Refused,
    Visible,
)
from hoopd.diagnose.report import headline, plain_words, sentences as words, table_notes, tables
from hoopd.diagnose.report.page import page
from hoopd.diagnose.report_curves import Shown
from hoopd.plots.diagnosis import draw_candidates
from hoopd.plots.number_format import chance, interval_text, short_names, value_text

pytestmark = pytest.mark.usefixtures("drawn_where_it_is_looked_at")


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
    ("probability", "said"),
    [
        (0.11, "something at the hoop whose law is open (hoop.imbalance: 47 % likely; hoop.coulomb_friction: 11 % lik"),
        (0.3, "hoop.coulomb_friction (Fc = 5.10 mN m; 30 % likely; hoop.imbalance: 47 % likely)"),
        (0.48, "hoop.coulomb_friction (Fc = 5.10 mN m; 48 % likely)"),
    ],
)
def test_what_is_likelier_than_a_finding_in_its_place_stands_in_the_first_line(probability: float, said: str) -> None:
    """The page named a law with 11 % where another one had 47 %, in a note below a table."""
    diagnosis, _ = coulomb()
    shares = {"hoop.imbalance": 0.47, "camera.latency": 0.9, "none of these": 0.5, "hoop.coulomb_friction": probability}
    tried = [Candidate(name=name, log_likelihood_gain=None, probability=share) for name, share in shares.items()]
    first = msgspec.structs.replace(diagnosis.effects[0], status="confirmed", not_excluded=[], probability=probability)
    told = msgspec.structs.replace(diagnosis, effects=[first], candidates=tried)
    assert said in headline.verdict_sentence(told)
    # of two findings in one place nobody says which of them another law would replace
    two = msgspec.structs.replace(told, effects=[first, msgspec.structs.replace(first, name="hoop.other")])
    assert "imbalance" not in headline.verdict_sentence(two)


def test_a_push_is_told_with_its_size_and_where_it_was() -> None:
    diagnosis, _ = coulomb()

    def s(value: float, ci95: tuple[float, float] | None) -> Quantity:
        return Quantity(value=value, unit="s", ci95=ci95, nominal=0.0)

    there, nowhere = s(9.15, (9.1, 9.2)), s(0.0, None)
    sizes = {
        "t0": there, "t0@a/one.csv": nowhere, "t0@a/two.csv": there,
        "t1": there, "t1@a/one.csv": nowhere, "t1@a/two.csv": there,
        "A": Quantity(value=0.06, unit="N", ci95=(0.05, 0.07), nominal=0.0),
    }  # fmt: skip
    # a file has them by the alphabet
    for own in (sizes, dict(sorted(sizes.items()))):
        push = msgspec.structs.replace(
            diagnosis.effects[0], name="external.disturbance", parameters=own, not_excluded=[], status="untested"
        )
        said = headline.verdict_sentence(msgspec.structs.replace(diagnosis, effects=[push]))
        assert "external.disturbance (A = 60 mN; t0 = 9.150 s in two.csv; held-out data never test it)" in said


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


def test_what_is_not_excluded_is_not_called_invisible() -> None:
    """Beside a finding nothing is left of what does the same; in its place it shows as much."""
    blind = Visible(smallest=None, unit="N m", parameter="Fc")
    found = coulomb()[0].effects[0]
    said = words.invisible_sentence({"frame.tilt": blind, "hoop.imbalance": blind}, [found])
    assert "frame.tilt" in said and "hoop.imbalance" in said
    instead = msgspec.structs.replace(found, not_excluded=["frame.tilt"])
    said = words.invisible_sentence({"frame.tilt": blind, "hoop.imbalance": blind}, [instead])
    assert "frame.tilt" not in said and "hoop.imbalance" in said
