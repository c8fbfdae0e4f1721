"""The bench behind the page: what is listed and handed out, the commands as jobs, and what a stranger gets."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dashboard.bench_folder import HOSTILE, lay_out
from dashboard.served import Served, served
from shell.peers import Ticks, controlled, free_endpoint, running, wait_until

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.requests import PROOF
from hoopd.dashboard.work import forms
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.forms import JobOrder
from hoopd.dashboard.work.jobs import KEPT, STARTS, STATE, WAITING_AT_MOST, Jobs
from hoopd.dashboard.work.recordings import GROWS_S, Recordings
from hoopd.files.reading import InputError
from hoopd.recording.formats import save
from hoopd.recording.recording import from_columns

BUSY_S = 100.0  # a job of the idle class, on a machine that has other work
WORK = {"kind": "identify", "recordings": ["first.csv"], "fields": {"orders": "1,1", "outputs": "dtheta"}}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return lay_out(tmp_path / "recordings")


@pytest.fixture
def web(folder: Path, tmp_path: Path) -> Iterator[Served]:
    """Without any daemon: to look at."""
    with served(Feed([free_endpoint()], {}), bench=Bench(folder, tmp_path / "results")) as web:
        yield web


def told(web: Served) -> dict[str, Any]:
    answer: dict[str, Any] = web.ask("/api/work").json
    return answer


def test_recordings_are_listed_with_a_glance_at_each_and_handed_out(web: Served, folder: Path) -> None:
    (folder / "elsewhere.csv").symlink_to("/etc/passwd")
    assert wait_until(lambda: all(one["glance"] for one in told(web)["recordings"]), BUSY_S)
    listed = {one["name"]: one for one in told(web)["recordings"]}
    assert set(listed) == {"first.csv", "second.csv", HOSTILE, "broken.csv"}
    glance = listed["first.csv"]["glance"]
    assert glance["seconds"] == pytest.approx(11.98) and glance["rows"] == 600
    assert {"u", "dtheta", "psi"} <= {*glance["channels"]} and len(glance["curves"]["psi"]) == 120
    assert listed["broken.csv"]["glance"]["wrong"].startswith("broken.csv: ")
    answer = web.ask("/api/work/recording?name=first.csv")
    assert answer.body == (folder / "first.csv").read_bytes()
    assert answer.headers["content-disposition"].startswith("attachment;")


@pytest.mark.parametrize(
    "name", ["../results/notes.json", "/etc/passwd", "..%2Fsecret.csv", "elsewhere.csv", "notes.txt", "", "a\0b.csv"]
)
def test_only_what_is_listed_is_handed_out(web: Served, folder: Path, name: str) -> None:
    (folder.parent / "secret.csv").write_text("t\n0\n", encoding="utf-8")
    (folder / "elsewhere.csv").symlink_to(folder.parent / "secret.csv")
    for route in ("recording", "plot"):
        answer = web.ask(f"/api/work/{route}?name={name.replace(chr(0), '%00')}")
        assert answer.status == 404 and b"no such recording" in answer.body


def test_a_plot_is_a_page_with_the_rights_of_a_stranger(web: Served) -> None:
    page = web.ask("/api/work/plot?name=first.csv&name=second.csv")
    policy = page.headers["content-security-policy"]
    assert page.status == 200 and b"uPlot" in page.body
    assert "sandbox allow-scripts;" in policy and "connect-src" not in policy and "default-src 'none'" in policy
    assert "frame-ancestors 'self'" in policy
    broken = web.ask("/api/work/plot?name=broken.csv")
    assert broken.status == 404 and broken.body.count(b"\n") == 1 and b"broken.csv" in broken.body
    assert web.ask("/api/work/plot").status == 404


@pytest.mark.proof
def test_two_recordings_with_no_signal_in_common_are_drawn_from_zero(folder: Path, tmp_path: Path) -> None:
    t = np.arange(50) * 0.02
    for name, column in (("hoop.csv", "theta"), ("ball.csv", "psi")):
        save(from_columns({"t": t, column: np.sin(t)}), folder / name)
    page = Bench(folder, tmp_path / "results").plots.page(["hoop.csv", "ball.csv"]).read_text()
    assert "hoop.csv" in page and "ball.csv" in page


def test_a_page_is_kept_until_it_would_be_drawn_in_another_way(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = "import sys; open(sys.argv[-2].removeprefix('--out='), 'w').write(sys.argv[-1])"
    monkeypatch.setattr("hoopd.dashboard.work.plots.background", lambda **_: (sys.executable, "-c", drawn))
    plots, pair = Bench(folder, tmp_path / "results").plots, ["first.csv", "second.csv"]
    before = plots.page(pair)
    assert plots.page(pair) == before and before.read_text() == "--compare"
    monkeypatch.setattr("hoopd.dashboard.work.plots._ways", lambda _: [["--from-zero"]])
    assert plots.page(pair).read_text() == "--from-zero"
    monkeypatch.setattr("hoopd.dashboard.work.plots.__version__", "another")
    assert len({before, plots.page(pair), *before.parent.glob("*.html")}) == 3


def test_whoever_is_not_logged_in_changes_nothing(web: Served) -> None:
    for path, content in {
        "ask": WORK, "remark": {"name": "first.csv", "note": "x"}, "again": {"number": 1}, "cancel": {"number": 1},
        "remove": {"number": 1},
    }.items():  # fmt: skip
        assert web.post(f"/api/work/{path}", content, content_type="application/json").status == 401
        assert web.ask(f"/api/work/{path}", "POST", content, content_type="application/json").status == 403
    assert told(web)["jobs"] == []


@pytest.mark.realtime  # in the idle class: beside other tests it gets no processor
def test_a_job_runs_shows_what_it_wrote_and_is_written_down(folder: Path, tmp_path: Path) -> None:
    settings, audit = controlled(tmp_path), tmp_path / "audit.jsonl"
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    bench = Bench(folder, tmp_path / "results")
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate),
        served(Feed([settings.endpoint], {}), operators, Audit(audit), bench) as web,
    ):
        login = web.post("/api/login", {"user": "operator", "password": "turn"}, content_type="application/json")
        who = {
            "cookie": login.headers["set-cookie"].partition(";")[0],
            PROOF: login.json["proof"],
            "content_type": "application/json",
        }
        assert web.post("/api/work/ask", WORK, **who).json["value"] == 1
        assert wait_until(lambda: told(web)["jobs"][0]["state"] not in ("waiting", "running"), BUSY_S)
        job = told(web)["jobs"][0]
        assert (job["state"], job["line"], job["who"]) == ("done", "", "operator")
        assert {"figure.svg", "result.json", "model.yaml", "output.txt"} == {*job["files"]}
        numbers = web.ask("/api/work/file?job=1&name=result.json")
        assert numbers.headers["content-type"] == "application/json" and numbers.json["method"] == "arx"
        assert "sandbox" in web.ask("/api/work/file?job=1&name=figure.svg").headers["content-security-policy"]
        assert "1/model.yaml" in told(web)["models"]
        for wrong in (
            "job=1&name=job.json",
            "job=1&name=../job.json",
            "job=2&name=model.yaml",
            "job=x&name=model.yaml",
        ):
            assert web.ask(f"/api/work/file?{wrong}").status == 404
        refused = web.post("/api/work/ask", {**WORK, "recordings": ["../secret.csv"]}, **who)
        assert not refused.json["ok"] and "no such recording" in refused.json["reason"]
        assert web.post(
            "/api/work/remark", {"name": "first.csv", "tags": ["good", "good "], "note": "<b>"}, **who
        ).json["ok"]
        assert next(one for one in told(web)["recordings"] if one["name"] == "first.csv")["tags"] == ["good"]
        assert web.post("/api/work/remark", {"name": "first.csv", "note": "x" * 30_000}, **who).status == 413
        assert web.post("/api/work/again", {"number": 1}, **who).json["value"] == 2
        assert wait_until(lambda: told(web)["jobs"][0]["state"] == "done", BUSY_S)
        assert web.post("/api/work/remove", {"number": 1}, **who).json["ok"]
        assert [one["number"] for one in told(web)["jobs"]] == [2]
    lines = [json.loads(line) for line in audit.read_text().splitlines()]
    done = [one["command"] for one in lines]
    assert done == ["login", "job identify", "work ask", "remark", "job 1 again", "job removed"]
    assert [one["command"] for one in lines if not one.get("ok", True)] == ["work ask"]
    assert {one["who"] for one in lines} == {"operator"}
    assert Bench(folder, tmp_path / "results").recordings.told()[-1] is not None
    kept = {one["name"]: one["note"] for one in Bench(folder, tmp_path / "results").recordings.told()}
    assert kept["first.csv"] == "<b>"


class Slow:
    """Jobs that do what a line of Python says, in the place of the bench's commands."""

    def __init__(self, folder: Path, line: str) -> None:
        folder.mkdir(exist_ok=True)
        self.jobs = Jobs(folder, lambda: (sys.executable, "-c", line))

    def add(self) -> int:
        return self.jobs.add(JobOrder("identify", ["first.csv"]), ["identify"], "somebody").number

    def state(self, number: int) -> str:
        return next(str(one["state"]) for one in self.jobs.told() if one["number"] == number)


SLEEP = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(60)"


def test_one_job_at_a_time_and_a_cancelled_one_ends(tmp_path: Path) -> None:
    slow = Slow(tmp_path / "jobs", SLEEP)
    first, second, third = (slow.add() for _ in range(3))
    slow.jobs.start()
    pid = slow.jobs.of(first) / "pid"
    assert wait_until(lambda: pid.exists() and pid.read_text() != "")
    assert [slow.state(one) for one in (first, second, third)] == ["running", "waiting", "waiting"]
    with pytest.raises(InputError, match="is not over"):
        slow.jobs.remove(first)
    slow.jobs.cancel(third)
    slow.jobs.cancel(first)
    assert wait_until(lambda: slow.state(first) == "cancelled" and slow.state(second) == "running")
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)
    slow.jobs.close()
    assert slow.state(third) == "cancelled"


def test_a_queue_survives_a_restart_and_what_ran_begins_again(tmp_path: Path) -> None:
    before = Slow(tmp_path / "jobs", SLEEP)
    first, second = before.add(), before.add()
    before.jobs.start()
    assert wait_until((before.jobs.of(first) / "pid").exists)
    before.jobs.close()
    after = Slow(tmp_path / "jobs", "pass")
    assert [after.state(one) for one in (first, second)] == ["waiting", "waiting"]
    after.jobs.start()
    assert wait_until(lambda: after.state(second) == "done")
    assert after.state(first) == "done" and after.add() == second + 1
    after.jobs.close()


def test_what_ends_the_server_itself_is_not_tried_for_ever(tmp_path: Path) -> None:
    first = Slow(tmp_path / "jobs", "pass").add()
    path = tmp_path / "jobs" / f"{first:05}" / STATE
    for starts, state in ((STARTS - 1, "waiting"), (STARTS, "failed")):
        path.write_text(json.dumps({**json.loads(path.read_text()), "state": "running", "starts": starts}))
        assert Slow(tmp_path / "jobs", "pass").state(first) == state


def test_a_job_that_fails_says_why_in_one_line(tmp_path: Path) -> None:
    slow = Slow(
        tmp_path / "jobs",
        "import sys; print('table'); print('hoopd: a.csv: row 3: wrong', file=sys.stderr); sys.exit(2)",
    )
    number = slow.add()
    slow.jobs.start()
    assert wait_until(lambda: slow.state(number) == "failed")
    assert slow.jobs.told()[0]["line"] == "a.csv: row 3: wrong" and slow.jobs.told()[0]["files"] == ["output.txt"]
    slow.jobs.close()


def test_the_queue_is_bounded_and_old_results_go(tmp_path: Path) -> None:
    slow = Slow(tmp_path / "jobs", "pass")
    for _ in range(WAITING_AT_MOST):
        slow.add()
    with pytest.raises(InputError, match="wait already"):
        slow.add()
    for _ in range(KEPT + 5):
        slow.jobs.cancel(number := [one["number"] for one in slow.jobs.told() if one["state"] == "waiting"][-1])
        slow.add()
    assert sum(one["state"] == "cancelled" for one in slow.jobs.told()) <= KEPT
    assert number and not slow.jobs.of(1).exists()


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (JobOrder("rm"), "unknown; known: fit"),
        (JobOrder("fit"), "choose one at least"),
        (JobOrder("fit", ["a.csv"], ["a.csv"]), "cannot judge"),
        (JobOrder("fit", ["a.csv"], fields={"out": "/tmp/x"}), "unknown; known: structure"),
        (JobOrder("fit", ["a.csv"], fields={"structure": "other"}), "unknown; known: entries"),
        (JobOrder("fit", ["a.csv"], fields={"plant": "/etc/passwd"}), "not what is expected"),
        (JobOrder("fit", ["a.csv"], fields={"columns": "a\nb"}), "not what is expected"),
        (JobOrder("fit", ["a.csv"], fields={"model": "/etc/passwd"}), "unknown"),
        (JobOrder("identify", ["a.csv"], fields={"order": "2.5"}), "whole number"),
        (JobOrder("design", fields={"law": "--json=x"}), "unknown; known: lqg"),
        (JobOrder("design", ["a.csv"], fields={"law": "lqg"}), "takes none"),
        (JobOrder("design", fields={"law": "lqg", "mt": "nan"}), "expected a number"),
        (JobOrder("fit", [f"{k}.csv" for k in range(30)]), "at most"),
    ],
)
def test_what_no_form_offers_is_one_line(order: JobOrder, reason: str) -> None:
    def model(name: str) -> str:
        raise InputError("model", name, "unknown")

    with pytest.raises(InputError, match=reason):
        forms.words(order, Path, model)


def test_the_words_of_a_command_are_made_here() -> None:
    order = JobOrder("fit", ["a b.csv"], ["-c.csv"], {"structure": "rolling", "model": "models/hoop.yaml", "plant": ""})
    assert forms.words(order, lambda name: Path("/r") / name, lambda name: name) == [
        "fit", "/r/a b.csv", "--holdout=/r/-c.csv", "--structure=rolling", "--model=models/hoop.yaml",
        "--out=model.yaml", "--figure=figure.svg", "--json=result.json",
    ]  # fmt: skip
    lqg = forms.words(JobOrder("design", fields={"law": "lqg", "delay": "0.05"}), Path, str)
    assert lqg[:3] == ["design", "lqg", "--delay=0.05"]


def test_every_form_is_a_command_with_these_options() -> None:
    from hoopd.commands.options.calibrate import CalibrateOptions
    from hoopd.commands.options.design import DesignOptions
    from hoopd.commands.options.diagnose import DiagnoseOptions
    from hoopd.commands.options.fit import FitOptions
    from hoopd.commands.options.identify import IdentifyOptions

    records = {
        "fit": FitOptions,
        "diagnose": DiagnoseOptions,
        "identify": IdentifyOptions,
        "design": DesignOptions,
        "calibrate": CalibrateOptions,
    }
    assert set(records) == set(forms.FORMS)
    for name, form in forms.FORMS.items():
        known = str([field.metadata for field in records[name].__dataclass_fields__.values()])
        for option in (*form.writes, *(field.option for field in form.fields)):
            assert f"'{option}'" in known, (name, option)


def test_folders_that_there_are_not(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        Bench(tmp_path / "none", tmp_path)
    with pytest.raises(InputError, match="--results"):
        Bench(tmp_path, tmp_path / "none" / "below")


def test_a_command_tells_how_far_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hoopd.commands.options.shared import PROGRESS_FILE, shown_progress

    monkeypatch.setenv(PROGRESS_FILE, str(tmp_path / "progress.json"))
    with shown_progress({"reading": 0.25}) as progress:
        progress("reading")
    assert json.loads((tmp_path / "progress.json").read_text()) == {"share": 0.25, "step": "reading"}


def test_the_servers_end_does_not_wait_for_a_plot(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "hoopd.dashboard.work.plots.background", lambda **_: (sys.executable, "-c", "import time; time.sleep(60)")
    )
    bench = Bench(folder, tmp_path / "results")
    with ThreadPoolExecutor(1) as threads:
        asked = threads.submit(bench.plots.page, ["first.csv"])
        assert wait_until(lambda: bench.plots.busy)
        bench.plots.close()
        with pytest.raises(InputError):
            asked.result(10.0)


def test_a_recording_that_is_being_written_is_looked_at_when_it_is_finished(tmp_path: Path) -> None:
    folder, results = lay_out(tmp_path / "recordings"), tmp_path / "results"
    results.mkdir()
    recordings = Recordings(folder, results)
    (folder / "first.csv").touch()

    def first() -> Any:
        return next(one["glance"] for one in recordings.told() if one["name"] == "first.csv")

    until = time.monotonic() + GROWS_S + 2.0
    while time.monotonic() < until:
        os.utime(folder / "first.csv")
        assert first() is None
        time.sleep(0.2)
    long_ago = time.time() - 60.0
    os.utime(folder / "first.csv", (long_ago, long_ago))

    assert wait_until(lambda: bool(first()), BUSY_S) and "curves" in first()
    recordings.close()


def test_a_doubtful_model_is_written_when_the_page_asks_for_it_and_the_acting_one_is_proposed() -> None:
    offered = {field["option"]: field for field in forms.told()["diagnose"]["fields"]}
    assert offered["--model"]["usual"] == "models/hoop.yaml"
    (choice,) = offered["--yes"]["choices"]
    order = JobOrder("diagnose", ["a.csv"], fields={"yes": choice})
    assert "--yes" in forms.words(order, Path, lambda name: name)
    with pytest.raises(InputError, match="yes"):
        forms.words(JobOrder("diagnose", ["a.csv"], fields={"yes": "no"}), Path, lambda name: name)
