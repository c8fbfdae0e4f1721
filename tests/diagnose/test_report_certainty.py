"""What a report says of how sure it is, what each finding was tested by, and what to do next."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from diagnose.examples import EXAMPLES, TRAIN, consistent, coulomb, unknown
from diagnose.reports import Page, made, printed, squeezed

from hoopd.diagnose.proof.not_excluded import one_body_notes
from hoopd.diagnose.record import (
    Candidate,
    EffectFinding,
    Evidence,
    Fit,
    NextExperiment,
    Placebo,
    Quantity,
    RecordingQuality,
)
from hoopd.diagnose.report import headline, plain_words, sentences as words, table_notes, tables
from hoopd.diagnose.report.page import page
from hoopd.diagnose.report.terminal import WIDTH, report_console
from hoopd.diagnose.report_curves import Shown

pytestmark = pytest.mark.usefixtures("drawn_where_it_is_looked_at")


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
