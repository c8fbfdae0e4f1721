"""The report: sentences and numbers a person reads, 80 columns, one page that stands alone and is always the same."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from diagnose.examples import EXAMPLES, HELDOUT, TRAIN, bad_data, consistent, coulomb, renamed
from diagnose.reports import Page, made, printed, squeezed

from hoopd.diagnose.record import DataQuality, FitTable, Quantity, RecordingQuality
from hoopd.diagnose.report import headline, plain_words, sentences as words, tables
from hoopd.diagnose.report.page import page
from hoopd.diagnose.report_curves import Comparison, MissingForce, Regressor, Shown, Strip, Trace
from hoopd.plots.number_format import percent

pytestmark = pytest.mark.usefixtures("drawn_where_it_is_looked_at")


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
