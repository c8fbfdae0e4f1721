"""From a design to the controller that acts: laid into the daemon's folder, loaded in the page."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from dashboard.bench_folder import lay_out
from dashboard.driven import BUSY_S, arm, driven, log_in
from harness.browser import CHROMIUM, Page
from shell.peers import wait_until

from hoopd.daemon.loading import ControllerLoader
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.controllers import Controllers
from hoopd.dashboard.work.forms import JobOrder
from hoopd.files.reading import InputError
from hoopd.shell import config as configuration


def designed(tmp_path: Path) -> tuple[Bench, Path]:
    """A bench whose first job designed a controller, and the daemon's folder."""
    folder = tmp_path / "controllers"
    folder.mkdir()
    bench = Bench(lay_out(tmp_path / "recordings"), tmp_path / "results", folder)
    bench.ask(JobOrder("design", fields={"law": "lqg", "model": "models/hoop.yaml"}), "somebody")
    bench.start()
    wait_until(lambda: bench.jobs.told()[0]["state"] not in ("waiting", "running"), BUSY_S)
    bench.close()
    assert bench.jobs.told()[0]["state"] == "done", bench.jobs.told()[0]["line"]
    return bench, folder


@pytest.mark.proof
@pytest.mark.realtime  # a job of the idle class: beside other tests it gets no processor
def test_a_jobs_controller_is_one_that_the_daemon_loads(tmp_path: Path) -> None:
    bench, folder = designed(tmp_path)
    key = bench.hand_over(1)
    assert key == bench.hand_over(1)  # the same once more is nothing new
    assert [one.key for one in bench.controllers.listed()] == [key] if bench.controllers else False
    config = configuration.load(None, sim=True, overrides=[f"control.folder={folder}"])
    assert key.partition("@")[2] in ControllerLoader(config, None).load(key, "somebody")
    (folder / "job1.yaml").write_text("mine\n", encoding="utf-8")
    with pytest.raises(InputError, match="another file of that name"):
        bench.hand_over(1)
    assert (folder / "job1.yaml").read_text() == "mine\n"


def test_a_model_of_a_job_goes_with_its_controller(tmp_path: Path) -> None:
    jobs, folder = tmp_path / "jobs", tmp_path / "folder"
    for number in ("00001", "00002"):
        (jobs / number).mkdir(parents=True)
    folder.mkdir()
    (jobs / "00001" / "model.yaml").write_text("the model\n", encoding="utf-8")
    controller = jobs / "00002" / "controller.yaml"
    controller.write_text(f"law: lqg\nmodel: {jobs}/00001/model.yaml\nend: 1\n", encoding="utf-8")
    listed = Controllers(folder)
    listed.lay_in("job2", controller, jobs)
    (folder / "other-model.yaml").write_text("# a model\nschema: hoopd.model/1\nname: x\n", encoding="utf-8")
    assert not any(one.key.startswith("other-model.yaml") for one in listed.listed())
    assert (folder / "job2.yaml").read_text() == "law: lqg\nmodel: job2-model.yaml\nend: 1\n"
    assert (folder / "job2-model.yaml").read_text() == "the model\n"
    with pytest.raises(InputError, match="--controllers"):
        Controllers(tmp_path / "none")


def pressed(button: str) -> str:
    """A click wherever the button is now: the panel moves while the daemon tells more."""
    return f"document.querySelector('#{button}').click()"


def choose(page: Page, key: str) -> None:
    """The controller to load."""
    page.ask("void (document.querySelector('#load-file').value = '')")
    page.type("#load-file", key)


@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_a_controller_is_loaded_and_another_tried_under_the_pages_eyes(tmp_path: Path) -> None:
    bench, folder = designed(tmp_path)
    first = bench.hand_over(1)
    (folder / "second.yaml").write_text((folder / "job1.yaml").read_text() + "# another file\n", encoding="utf-8")
    bench = Bench(tmp_path / "recordings", tmp_path / "results", folder)
    assert bench.controllers is not None
    second = next(one.key for one in bench.controllers.listed() if one.key != first)
    with driven(tmp_path, bench, control={"folder": str(folder)}, sim={"commands": []}) as rig:
        page = rig.page

        def acting() -> Any:
            return rig.status.get("controller", {})

        def on_trial() -> bool:
            return bool(acting().get("trial") and acting()["file"] == "second.yaml")

        def tried() -> str:
            arm(page)
            time.sleep(4.0)  # the accepted law has to act for 3 s first
            return rig.answered(pressed("load-trial"))

        log_in(page)
        page.wait_for("document.querySelectorAll('#load-files option').length === 2")
        assert page.wait_for("!document.querySelector('#load-file').disabled")
        assert rig.answered(pressed("load-controller")).endswith("as NAME.yaml@HASH: nothing was sent")
        choose(page, first)
        rig.until(
            lambda: wait_until(lambda: acting().get("file") == "job1.yaml"),
            lambda: rig.answered(pressed("load-controller")),
            "not loaded",
        )
        choose(page, second)
        assert "trial: refused" in rig.answered(pressed("load-trial")).replace(f" {second} null", "")
        assert acting()["file"] == "job1.yaml"

        def lasts() -> bool:  # longer than the 5 s for which the supervisor may be silent
            return wait_until(on_trial) and not wait_until(lambda: not on_trial(), 8.0)

        rig.until(lasts, tried, "no trial lasts under the page's supervision")
        page.wait_for("document.querySelector('#controller-state').innerText.includes('on trial against job1.yaml')")
        page.ask("void (window.page.controller.watched = '')")  # as a page that was closed
        assert wait_until(lambda: acting()["file"] == "job1.yaml" and not acting()["trial"], 10.0)
        rig.until(lasts, tried, "no second trial lasts")
        rig.answered(pressed("accept"))
        assert wait_until(lambda: acting()["accepted"] == acting()["file"] == "second.yaml" and not acting()["trial"])
        assert page.errors == []
    sent = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    assert {one["command"] for one in sent} >= {"controller", "trial", "accept"}
    reasons = [one.get("reason", "") for one in rig.daemon.log() if one.get("event") == "trial_returned"]
    assert any("supervisor was silent" in reason for reason in reasons), reasons
