"""The page of a campaign: what was believed after each run, why the next one came, what it cost, what was gained.

Rules of this file: order and words only; no wall time, no host and no path outside the campaign's folder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hoopd.diagnose.report.headline import verdict_sentence
from hoopd.diagnose.report.markup import document, drawing, paragraph, section, table, text
from hoopd.diagnose.report.tables import Table
from hoopd.learn.campaign import DiagnosedRun, RunFiles
from hoopd.plots.comparison import draw_comparison
from hoopd.plots.learning import draw_beliefs


def story(runs: Sequence[DiagnosedRun], result: Mapping[str, Any], comparison: Mapping[str, Any] | None) -> bytes:
    """The whole page as UTF-8."""
    title = _title(result)
    header = (
        f'<header>\n<p class="kicker">hoopd learn</p>\n<h1>{text(title)}</h1>\n'
        f"{paragraph(_explained(result), 'verdict')}{paragraph(result['ended_because'])}"
        f"{paragraph(_kept(result))}</header>\n"
    )
    parts = [
        section("beliefs", "What was believed", _beliefs(runs)),
        section("runs", "Run after run", *(_run(number, one) for number, one in enumerate(runs, 1))),
        section("trial", "Old against new", _trial(comparison)),
        section("words", "Words", paragraph(WORDS)),
    ]
    return document(f"Campaign: {title}", f"<main>\n{header}{''.join(parts)}</main>\n")


WORDS = (
    "Sure: the probability of the least sure law among all laws that are known; a share for laws that nobody knows "
    "stays beside it, whatever is recorded. Settled: everything that is named is as sure as was asked for, "
    "confirmed by data that were not fitted or shown again by later recordings, and nothing follows a law that has "
    "no name. Nats: how much more "
    "probable the recordings are with a law than without, as a logarithm."
)


def _title(result: Mapping[str, Any]) -> str:
    if not result["settled"]:
        return "Not settled"
    return "Learned" if result["laws"] else "Nothing is missing"


def _explained(result: Mapping[str, Any]) -> str:
    runs, seconds = result["runs"], result["recorded_s"]
    sure = "" if result["probability"] is None else f", {result['probability']:.0%} sure"
    return (
        f"After {runs} run{'s' if runs != 1 else ''} and {seconds:.0f} s of recording: {result['explanation']}{sure}."
    )


def _kept(result: Mapping[str, Any]) -> str:
    return str(result["kept_because"])


def _beliefs(runs: Sequence[DiagnosedRun]) -> str:
    bars = [(f"run {number}", one.belief.shares) for number, one in enumerate(runs, 1)]
    said = "; ".join(f"run {number}: {one.belief.explanation}" for number, one in enumerate(runs, 1))
    caption = "Probabilities of the laws that were thought likely; grey: a law that is in no vocabulary."
    rows = [_row(number, one) for number, one in enumerate(runs, 1)]
    head = ("run", "signal", "s", "believed after it", "sure")
    listed = table(Table("Runs", head, "llrlr", rows))
    return drawing(draw_beliefs(bars), "bars", said, caption) + listed


def _row(number: int, run: DiagnosedRun) -> tuple[str, ...]:
    signal, seconds = " ".join(run.choice.played), f"{run.seconds:.0f}"
    return str(number), signal, seconds, run.belief.explanation, f"{run.belief.probability:.0%}"


def _run(number: int, run: DiagnosedRun) -> str:
    expected = run.choice.expected_nats
    nats = "" if expected is None else f" ({expected:.1f} nats expected)"
    still = "Settled." if run.belief.settled else f"Still open: {'; '.join(run.belief.open)}."
    return (
        f"<h3>Run {number}: {text(' '.join(run.choice.played))}, {run.seconds:.0f} s</h3>\n"
        f"{paragraph(f'Why: {run.choice.reason}{nats}.')}{paragraph(verdict_sentence(run.diagnosis))}"
        f"{paragraph(still)}{_links(run.files)}"
    )


def _links(files: RunFiles) -> str:
    """To what is there: what was recorded by hand lies somewhere else."""
    every = {"report": files.report, "diagnosis": files.diagnosis, "recording": files.recording, "model": files.model}
    there = [f'<a href="{files.folder.name}/{one.name}">{name}</a>' for name, one in every.items() if one.exists()]
    return f"<p>{' · '.join(there)}</p>\n"


def _trial(comparison: Mapping[str, Any] | None) -> str:
    if comparison is None:
        return ""
    title = f"The candidate is {comparison['verdict']}: {comparison['reason']}"
    caption = "Both took turns in one run, in random order; the interval holds whenever one stops to look."
    return paragraph(f"{title}.") + drawing(draw_comparison(comparison), "comparison", title, caption)
