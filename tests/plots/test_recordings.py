"""Recordings as a picture and as a page: what is in them, gaps, modes, and what cannot be drawn."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from harness.browser import CHROMIUM, opened

from hoopd.commands.options.plot import PlotOptions
from hoopd.commands.plot import run
from hoopd.files.reading import InputError
from hoopd.plots.panels import DIFFERENCE, RecordingPicture, compared_picture, picture
from hoopd.plots.recording_page import recording_page, thinned
from hoopd.plots.recordings import draw_picture
from hoopd.plots.style import rendered
from hoopd.recording import Recording, from_columns, save
from hoopd.recording.pairs import paired
from hoopd.recording.recording import Signal, from_signals

T = 0.02 * np.arange(200)
MODES = np.array(["DISARMED"] * 50 + ["RUNNING"] * 120 + ["FAULT"] * 30)


def device() -> Recording:
    """As the daemon records it: pictures every other tick, one stretch without any, a reference that moves."""
    angle = np.where(np.arange(200) % 2 == 0, np.sin(T), np.nan)
    angle[100:130] = np.nan
    extra = {"mode": MODES, "reference": np.where(T > 2.0, 0.1, 0.0), "x_hat": np.outer(T, [1.0, 2.0, 3.0, 4.0])}
    return from_columns({"t": T, "u": np.sign(np.sin(5 * T)), "dtheta": T, "psi": angle, "psi_t": T - 0.03, **extra})


def tanks() -> Recording:
    return from_signals(T, {"q": Signal(np.ones(200), T, "l/s", "linear")}, {"h</script>": Signal(T**2, T, "m")})


def shown(*recordings: Recording, channels: tuple[str, ...] = (), **options: bool) -> RecordingPicture:
    return picture({f"run {k}": one for k, one in enumerate(recordings)}, channels, **options)


def test_every_measured_channel_has_a_panel_with_words_and_unit() -> None:
    found = shown(device())
    assert [panel.label for panel in found.panels] == [
        "ball angle, psi (rad)", "hoop speed, dtheta (rad/s)", "torque, u (N m)",
    ]  # fmt: skip
    assert [curve.held for panel in found.panels for curve in panel.curves] == [False, False, True]
    assert [panel.label for panel in shown(tanks()).panels] == ["h</script> (m)", "q (l/s)"]
    assert not shown(tanks()).panels[1].curves[0].held


def test_chosen_channels_come_in_their_order_columns_of_the_tick_among_them() -> None:
    found = shown(device(), channels=("x_hat_1", "reference", "u"))
    assert [panel.unit for panel in found.panels] == ["rad/s", "rad", "N m"]
    assert found.panels[0].curves[0].values[-1] == pytest.approx(2.0 * T[-1])


@pytest.mark.parametrize(
    ("channel", "reason"), [("omega", "known: u, theta"), ("current", "every value of it is missing")]
)
def test_what_is_not_there_cannot_be_drawn(channel: str, reason: str) -> None:
    with pytest.raises(InputError, match=f"--channels: {channel}: .*{reason}"):
        shown(device(), channels=(channel,))


def test_samples_lie_at_their_own_times_and_a_gap_is_one() -> None:
    (panel,) = shown(device(), channels=("psi",)).panels
    (curve,) = panel.curves
    assert curve.t[0] == pytest.approx(-0.03)
    assert np.isnan(curve.values).sum() == 1 and len(curve.t) == 85 + 1
    assert panel.wanted is not None and panel.wanted.held and panel.wanted.values.max() == 0.1
    assert shown(tanks()).panels[0].wanted is None


def test_modes_are_told_with_the_recording_of_which_they_are() -> None:
    assert [(span.mode, span.start_s, span.end_s) for span in shown(device()).modes] == [
        ("DISARMED", 0.0, 1.0),
        ("RUNNING", 1.0, pytest.approx(3.4)),
        ("FAULT", pytest.approx(3.4), pytest.approx(3.98)),
    ]
    assert [span.recording for span in shown(device(), tanks(), device()).modes] == [0] * 3 + [2] * 3


def test_recordings_may_begin_together() -> None:
    late = from_columns({**device().columns(), "t": T + 100.0, "y_t": T + 100.0, "psi_t": T + 99.97})
    found = shown(device(), late, channels=("u", "psi"), from_zero=True)
    for panel in found.panels:
        first, second = panel.curves
        np.testing.assert_allclose(first.t, second.t, atol=1e-9)


def test_the_figure_shades_modes_and_repeats_its_bytes() -> None:
    figure = draw_picture(shown(device()))
    words = {text.get_text() for text in figure.axes[0].get_legend().get_texts()}
    assert words == {"wanted", "DISARMED", "FAULT"}
    assert rendered(figure, ".svg") == rendered(draw_picture(shown(device())), ".svg")


def test_thinning_keeps_extremes_ends_and_gaps() -> None:
    t = np.linspace(0.0, 1.0, 100_000)
    values = np.sin(40.0 * t)
    values[12_345], values[70_000], values[50_000:50_100] = 9.0, -9.0, np.nan
    few, kept = thinned(t, values, 3_000)
    assert len(few) <= 3_000 + 2 and (few[0], few[-1]) == (0.0, 1.0)
    assert np.nanmax(kept) == 9.0 and np.nanmin(kept) == -9.0 and np.isnan(kept).any()
    assert np.all(np.diff(few) > 0)


def test_a_page_holds_its_numbers_and_fetches_nothing() -> None:
    page = recording_page(shown(device(), tanks())).decode()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert [panel["label"] for panel in data["panels"]][-1] == "q (l/s)"
    assert "h</script>" not in page and "h\\u003c/script>" in page
    assert "MIT License" in page and "default-src 'none'" in page
    assert not re.findall(r'(?:src|href)="', page)
    assert recording_page(shown(device(), tanks())).decode() == page


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_in_a_browser_the_charts_zoom_together_and_tell_values(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(recording_page(shown(device(), channels=("psi", "u"))))
    with opened(tmp_path, path.as_uri()) as page:
        assert page.ask("charts.length") == 2
        box = page.ask("(() => { const b = charts[0].over.getBoundingClientRect(); return [b.x, b.y, b.width]; })()")
        x, y, width = box
        page.drag([(x + 0.25 * width, y + 40), (x + 0.4 * width, y + 40), (x + 0.5 * width, y + 40)])
        low, high = page.ask("[charts[1].scales.x.min, charts[1].scales.x.max]")
        assert (low, high) == (pytest.approx(0.97, abs=0.05), pytest.approx(1.97, abs=0.05))
        assert page.text(".u-legend .u-value") == "1.480 s"  # of the cursor, where it was let go
        assert float(page.text(".u-series:nth-child(2) .u-value")) == pytest.approx(np.sin(1.48), abs=0.03)
        page.click("button")
        assert page.ask("charts[0].scales.x.max") == pytest.approx(3.98)
        page.size(390, 800)
        page.wait_for("document.documentElement.scrollWidth <= 390")
        assert page.errors == []
        assert [address for address in page.requested if not address.startswith("file:")] == []


def late(recording: Recording, ticks: int, offset: float) -> Recording:
    """The same a little later, by another clock, the ball further out."""
    there = {name: np.roll(getattr(recording, name), ticks) for name in ("u", "dtheta")}
    psi = np.roll(np.sin(T), ticks) + offset
    return from_columns({"t": T + 7.0, **there, "psi": psi, "psi_t": T + 7.0 - 0.03, "mode": np.full(200, "FAULT")})


def chirp() -> Recording:
    return from_columns(
        {"t": T, "u": np.sign(np.sin(3 * T**2)), "dtheta": np.sin(T), "psi": np.sin(T), "psi_t": T - 0.03}
    )


def test_two_are_compared_over_each_other_with_their_difference_and_both_modes(tmp_path: Path) -> None:
    both = {"one": chirp(), "two": late(chirp(), 15, 0.05)}
    found = compared_picture(both, paired(*both.values()), ("psi", "u"))
    assert found.note.startswith("Aligned by the input (correlation 1.00): the second's came 0.3 s later. Shaded are")
    twice = compared_picture({"one": chirp(), "again": chirp()}, paired(chirp(), chirp()))
    assert twice.note == "Both begin at zero, where their inputs agree best (correlation 1.00)."
    assert [panel.words for panel in found.panels] == ["ball angle", DIFFERENCE, "torque", DIFFERENCE]
    (psi,) = (one for one in found.figures if one.channel == "psi")
    assert (psi.mean, psi.rms) == (pytest.approx(0.05, abs=0.01), pytest.approx(0.05, abs=0.01))
    (u,) = (one for one in found.figures if one.channel == "u")
    assert u.rms == 0.0 and u.first_rms == u.second_rms > 0.99
    page = recording_page(found).decode()
    assert "Aligned by the input" in page and '<th scope="row">psi (rad)</th>' in page
    assert rendered(draw_picture(found), ".svg") == rendered(draw_picture(found), ".svg")
    if CHROMIUM is None:
        return
    (tmp_path / "page.html").write_text(page)
    with opened(tmp_path, (tmp_path / "page.html").as_uri(), 390, 800) as browser:
        browser.wait_for("charts.length === 4 && document.documentElement.scrollWidth <= 390")
        assert DIFFERENCE in browser.text("section:nth-of-type(2) h2") and browser.errors == []


@pytest.mark.parametrize("later", [0.0, 0.4])
def test_of_the_periods_of_an_input_the_one_with_most_overlap_is_taken(later: float) -> None:
    """Every period agrees as well, and noise made one of ten seconds off the best."""
    t, noise = np.arange(1000) * 0.02, np.random.default_rng(0)

    def run(shift: float) -> Recording:
        u = np.sign(np.sin(2.0 * np.pi * (t - shift) + 1e-6)) + 1e-3 * noise.standard_normal(len(t))
        return from_columns({"t": t, "u": u, "psi": u})

    pair = paired(run(0.0), run(later))
    assert pair.shift_s == pytest.approx(later, abs=0.011) and pair.correlation > 0.99


def test_a_turn_of_the_ball_is_no_difference_and_another_unit_is_not_subtracted() -> None:
    t = np.arange(400) * 0.02
    u = np.sign(np.sin(t * t * 9.0))
    psi = 3.1 + 0.2 * np.sin(5.0 * t)
    first = from_columns({"t": t, "u": u, "psi": psi, "theta": t})
    wrapped = from_columns({"t": t, "u": u, "psi": np.angle(np.exp(1j * (psi + 0.05))), "theta": t})
    off = paired(first, wrapped).signals["psi"]
    assert off.mean == pytest.approx(0.05, abs=1e-9) and off.largest == pytest.approx(0.05, abs=1e-9)
    metres, millimetres = (from_signals(t, {"F": Signal(u, t, "N")}, {"x": Signal(t, t, unit)}) for unit in ("m", "mm"))
    assert "x" not in paired(metres, millimetres).signals and "x" in paired(metres, metres).signals


def test_inputs_that_are_not_alike_shift_nothing() -> None:
    other = from_columns({"t": T, "u": np.sign(np.sin(11 * T)), "dtheta": T, "psi": T, "psi_t": T})
    pair = paired(chirp(), other)
    assert pair.shift_s == 0.0 and pair.correlation < 0.8
    still = from_columns({"t": T, "u": np.zeros(200), "dtheta": T, "psi": T, "psi_t": T})
    assert np.isnan(paired(still, chirp()).correlation) and paired(still, chirp()).shift_s == 0.0
    with pytest.raises(InputError, match="no signal in common"):
        paired(chirp(), tanks())


def test_a_tick_that_is_a_little_late_is_compared_with_its_own() -> None:
    late_by = np.random.default_rng(1).uniform(-0.004, 0.004, 200)
    other = from_columns({"t": T + late_by, "u": chirp().u, "dtheta": T, "psi": T, "psi_t": T})
    assert paired(chirp(), other).signals["u"].rms == 0.0


def test_nothing_is_subtracted_over_a_gap() -> None:
    gap = late(chirp(), 0, 0.0)
    psi = np.array(gap.psi)
    psi[80:120] = np.nan
    found = paired(chirp(), gap.replaced(psi=psi)).signals["psi"]
    assert len(found.t) in (159, 160) and not ((found.t > 1.56) & (found.t < 2.36)).any()
    assert found.largest < 1e-12


def test_the_command_compares_two_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, one in (("one", chirp()), ("two", late(chirp(), 15, 0.05)), ("three", chirp())):
        save(one, f"{name}.mcap" if name != "two" else "two.csv")
    told = run(PlotOptions(recordings=("one.mcap", "two.csv"), compare=True, out=Path("c.html")))
    assert told["difference"]["psi"]["mean"] == pytest.approx(0.05, abs=0.01) and "unit" in told["difference"]["psi"]
    assert told["notes"][0].startswith("Aligned by the input") and list(told["channels"]) == ["psi", "dtheta", "u"]
    for names, from_zero in ((("one.mcap",), False), (("one.mcap", "two.csv"), True)):
        with pytest.raises(InputError, match="--compare: takes two recordings"):
            run(PlotOptions(recordings=names, compare=True, from_zero=from_zero))


def test_the_command_writes_and_says_what_it_drew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save(device(), "one.mcap")
    save(device(), "two.csv")
    told = run(PlotOptions(recordings=("one.mcap", "two.csv@1:2"), channels=("u",)))
    assert told["picture"] == "one-plot.png" and Path("one-plot.png").read_bytes().startswith(b"\x89PNG")
    assert list(told["recordings"]) == ["one.mcap", "two.csv@1:2"]
    assert told["channels"] == {"u": "torque, N m"}


@pytest.mark.parametrize(
    ("recordings", "out", "told"),
    [
        (("one.mcap",), "picture.gif", "known: .png, .svg, .pdf, .html"),
        (("one.mcap", "one.mcap"), "picture.png", "one.mcap: stands twice"),
        (("one.mcap",), "none/picture.html", "no such folder"),
    ],
)
def test_unusable_input_writes_nothing(
    recordings: tuple[str, ...], out: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save(device(), "one.mcap")
    with pytest.raises(InputError, match=told):
        run(PlotOptions(recordings=recordings, out=Path(out)))
    assert [path.name for path in tmp_path.iterdir()] == ["one.mcap"]


def test_a_bad_file_is_one_line_with_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    command = [sys.executable, "-m", "hoopd", "plot", "bad.mcap"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("hoopd: bad.mcap: ") and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mcap"]
