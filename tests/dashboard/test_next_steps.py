"""From a job to the next one by a click: a diagnosis to a design with its model, a design to the comparison."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from dashboard.bench_folder import lay_out
from dashboard.driven import log_in
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from shell.peers import Ticks, controlled, running

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.jobs import Jobs
from hoopd.files.shipped import defaults_folder

SUMMARY = "Something is certainly missing at the hoop; that it is hoop.coulomb_friction is 59 % likely."
PLANNED = {"signal": "steps", "command": "hoopd experiment steps --duration 12 --amplitude 0.05 --sim", "reason": "why"}
DOUBTED = "model.yaml: is not written without --yes: the ball's mass is negative"
LQG = (defaults_folder() / "controllers" / "lqg.yaml").read_text()


def laid(results: Path, number: int, kind: str, files: dict[str, str], **of: Any) -> None:
    """A job that is over, as an earlier server left it."""
    folder = results / "jobs" / f"{number:05}"
    folder.mkdir(parents=True)
    order = {"kind": kind, "recordings": [] if kind == "design" else ["first.csv"], "fields": {}}
    told = {"number": number, "order": order, "words": [], "who": "ann", "asked": 1.0, "state": "done", **of}
    (folder / "job.json").write_text(json.dumps(told))
    for name, text in files.items():
        (folder / name).write_text(text)


def jobs_of_a_walk(results: Path) -> None:
    result = json.dumps({"summary": SUMMARY, "next_experiment": PLANNED})
    laid(results, 1, "diagnose", {"report.html": "<p>report</p>", "result.json": result, "model.yaml": "a: 1\n"})
    doubted = {"report.html": "", "result.json": json.dumps({"summary": 7, "next_experiment": PLANNED})}
    laid(results, 2, "diagnose", doubted, state="failed", line=DOUBTED)
    laid(results, 3, "design", {"result.json": "[1, 2]", "controller.yaml": LQG})
    laid(results, 4, "identify", {"model.yaml": "a: 1\n"})
    of_an_axis = {"kind": "fit", "recordings": ["first.csv"], "fields": {"plant": "axis"}}
    laid(results, 5, "fit", {"model.yaml": "a: 1\n"}, order=of_an_axis)


def test_a_result_tells_its_summary_and_what_is_none_tells_nothing(tmp_path: Path) -> None:
    jobs_of_a_walk(tmp_path)
    told = Jobs(tmp_path / "jobs").told()
    assert {one["number"]: one["summary"] for one in told} == {1: SUMMARY, 2: "", 3: "", 4: "", 5: ""}


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_a_click_leads_from_a_diagnosis_to_a_design_and_from_there_to_the_comparison(tmp_path: Path) -> None:
    folder, settings = lay_out(tmp_path / "recordings"), controlled(tmp_path)
    (tmp_path / "controllers").mkdir()
    jobs_of_a_walk(tmp_path / "results")
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    bench = Bench(folder, tmp_path / "results", tmp_path / "controllers")

    def button(job: int, words: str) -> str:
        return f"[...document.querySelectorAll('[data-row=\"{job}\"] button')].find(one => one.innerText === '{words}')"

    def value(name: str) -> str:
        return f"document.querySelector('#job-form [name={name}]').value"

    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate),
        served(Feed([settings.endpoint], {}), operators, bench=bench) as web,
        opened(tmp_path, f"{web.origin}/#work", 1440, 1000) as page,
    ):
        page.wait_for("document.querySelectorAll('#jobs > li').length === 5")
        assert SUMMARY in page.text("[data-row='1']") and "--yes" not in page.text("#jobs")
        assert page.ask(f"{button(3, 'Compare')}.disabled") is True  # nobody is logged in
        assert "Design with this model" not in page.text("[data-row='5']")  # of another plant
        page.ask(f"{button(2, 'Report')}.click()")
        above = "document.querySelector('#viewer-steps button:last-of-type')"  # the report that is open
        page.wait_for(f"{above}?.innerText === 'Again, and write the model' && {above}.disabled")
        page.wait_for("new Promise(done => { const y = scrollY; setTimeout(() => done(y && y === scrollY), 300); })")
        log_in(page)  # by clicks at a place, once nothing moves any more
        page.wait_for(f"!{button(3, 'Compare')}.disabled && !{above}.disabled")
        page.ask(f"{button(1, 'Design with this model')}.click()")
        assert page.ask(value("model")) == "1/model.yaml" and page.ask(value("law")) == "lqg"
        assert page.ask("document.querySelector('#job-form select').value") == "design"
        page.ask(f"{button(4, 'Design with this model')}.click()")
        assert page.ask(value("identified")) == "4/model.yaml" and page.ask(value("law")) == "identified"
        page.ask(f"{button(1, 'Report')}.click()")
        page.wait_for("document.querySelector('#viewer-steps').innerText.includes('is a click here')")
        page.ask(f"{above}.click()")
        page.wait_for(f"{value('model')} === '1/model.yaml'")
        page.ask(f"{button(2, 'Again, and write the model')}.click()")
        page.wait_for("document.querySelectorAll('#jobs > li').length === 6")
        assert bench.jobs.told()[0]["order"]["fields"] == {"yes": "write it, too"}
        page.ask(f"{button(1, 'Report')}.click()")
        bench.jobs.remove(4)
        design = "page.work.jobs.design({number: 4, order: {kind: 'identify', fields: {}}})"
        page.wait_for("!document.querySelector('[data-row=\"4\"]')")
        page.ask(f"void {design}")
        assert "the model of job 4 is not there any more" in page.text("#answer")
        assert page.ask(value("model")) == "1/model.yaml" and page.text("#viewer-steps")
        bench.jobs.remove(1)
        page.wait_for("document.querySelector('#viewer-steps').innerText === ''")
        page.ask(f"{button(3, 'Compare')}.click()")
        page.wait_for("document.querySelector('#candidate').value.startsWith('job3.yaml@')")
        assert page.ask("page.views.shown") == "try"
        page.ask("void (location.hash = '#work')")
        page.ask(f"{button(2, 'Next experiment')}.click()")
        page.wait_for("document.querySelector('[data-signal=duration]').value === '12'")
        assert page.text("#signal-state") == "As the diagnosis proposes: why." and page.errors == []
