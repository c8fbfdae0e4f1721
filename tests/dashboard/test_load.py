"""From a design to the controller that acts: laid into the daemon's folder, loaded in the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from dashboard.bench_folder import lay_out
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from harness.realrun import Daemon, fifo_granted
from shell.peers import controlled, wait_until

from hoopd.daemon.loading import ControllerLoader
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench
from hoopd.dashboard.work.controllers import Controllers
from hoopd.dashboard.work.forms import JobOrder
from hoopd.files.reading import InputError
from hoopd.shell import config as configuration

BUSY_S = 90.0


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
    Controllers(folder).lay_in("job2", controller, jobs)
    assert (folder / "job2.yaml").read_text() == "law: lqg\nmodel: job2-model.yaml\nend: 1\n"
    assert (folder / "job2-model.yaml").read_text() == "the model\n"
    with pytest.raises(InputError, match="--controllers"):
        Controllers(tmp_path / "none")


@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_it_is_loaded_in_the_page_and_a_trial_that_is_refused_says_why(tmp_path: Path) -> None:
    control = controlled(tmp_path)
    telemetry = {
        "endpoint": control.endpoint,
        "commands": True,
        "control": {"endpoint": control.control_endpoint, "zenoh": dict(control.control_zenoh)},
    }
    operators = Operators({control.endpoint: (control.control_endpoint, control.control_zenoh)})
    bench, folder = designed(tmp_path)
    key = bench.hand_over(1)
    second = folder / "second.yaml"
    second.write_text((folder / "job1.yaml").read_text() + "# another file\n", encoding="utf-8")
    settings = {"telemetry": telemetry, "control": {"folder": str(folder)}, "sim": {"commands": []}}
    bench = Bench(tmp_path / "recordings", tmp_path / "results", folder)
    with (
        Daemon(tmp_path, fifo=fifo_granted(), config=settings),
        served(Feed([control.endpoint], {}), operators, bench=bench) as web,
    ):

        def acting() -> Any:
            devices = [*web.feed.devices.values()]
            return devices[0].status.get("controller", {}) if devices else {}

        with opened(tmp_path, web.origin, 1440, 900) as page:
            page.wait_for("!document.querySelector('#login').hidden", BUSY_S)
            page.click("#login")
            page.type("input[name=user]", "operator")
            page.type("input[name=password]", "turn")
            page.key("Enter")
            page.wait_for("!document.querySelector('#load-controller').disabled")
            page.wait_for("document.querySelectorAll('#load-files option').length === 2")
            page.type("#load-file", key)
            page.ask("document.querySelector('#load-controller').click()")  # the panel may move under a mouse
            assert bench.controllers is not None
            assert wait_until(lambda: acting().get("file") == "job1.yaml", 15.0), page.text("#answer")
            page.ask("void (document.querySelector('#load-file').value = '')")
            page.type("#load-file", next(one.key for one in bench.controllers.listed() if "second" in one.key))
            page.ask("document.querySelector('#load-trial').click()")  # it has nothing to be compared with yet
            page.wait_for("document.querySelector('#answer').innerText.includes('has to act for')")
            assert acting().get("file") == "job1.yaml" and page.errors == []
