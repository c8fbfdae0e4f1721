"""The bench behind the page: recordings, plots of them, jobs.

Rules of this file: what the page may use of this machine, and where it is written; nothing is written elsewhere.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.dashboard.work import forms
from hoopd.dashboard.work.controllers import Controllers
from hoopd.dashboard.work.forms import CONTROLLER, MODEL, JobOrder
from hoopd.dashboard.work.jobs import Job, Jobs
from hoopd.dashboard.work.plots import Plots
from hoopd.dashboard.work.recordings import Recordings
from hoopd.files.reading import InputError

SHIPPED = ("models/hoop.yaml", "models/thesis.yaml")


class Bench:
    """One folder of recordings, one of results."""

    def __init__(self, recordings: Path, results: Path, controllers: Path | None = None) -> None:
        """InputError for a folder that there is not, or in which nothing can be written."""
        if not recordings.is_dir():
            raise InputError(recordings, "--recordings", "no such folder")
        jobs, plots = results / "jobs", results / "plots"
        self.comparisons = results / "comparisons"
        for folder in (results, jobs, plots, self.comparisons):
            try:
                folder.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(folder, "--results", (error.strerror or str(error)).lower()) from None
        self.recordings = Recordings(recordings.resolve(), results)
        self.plots = Plots(self.recordings, plots)
        self.jobs = Jobs(jobs)
        self.controllers = None if controllers is None else Controllers(controllers)

    def start(self) -> None:
        """Work from now on."""
        self.jobs.start()

    def close(self) -> None:
        """End what runs."""
        self.recordings.close()
        self.plots.close()
        self.jobs.close()

    def told(self) -> dict[str, Any]:
        """All of it, for the page; where the folder lies is nobody's business."""
        here = f"{self.recordings.folder}/"
        jobs = [{**one, "line": one["line"].replace(here, "")} for one in self.jobs.told()]
        return {
            "offered": True,
            "recordings": self.recordings.told(),
            "jobs": jobs,
            "models": self.models(),
            "forms": forms.told(),
            "hands_over": self.controllers is not None,
        }

    def hand_over(self, number: int) -> str:
        """Lay a job's controller into the daemon's folder; its NAME.yaml@SHA256. It acts only when it is loaded."""
        if self.controllers is None:
            raise InputError("controllers", "", "this server was started without --controllers")
        return self.controllers.lay_in(f"job{number}", self.jobs.file(number, CONTROLLER), self.jobs.folder)

    def ask(self, order: JobOrder, who: str) -> Job:
        """Put a job in the queue; InputError for what no form offers."""
        return self.jobs.add(order, forms.words(order, self.recordings.path, self._model), who)

    def again(self, number: int, who: str) -> Job:
        """The same job once more."""
        told = next((one for one in self.jobs.told() if one["number"] == number), None)
        if told is None:
            raise InputError("job", str(number), "no such job")
        return self.ask(JobOrder(**told["order"]), who)

    def models(self) -> list[str]:
        """What a job may start from: models that are shipped, and those of earlier jobs."""
        made = [f"{one['number']}/{MODEL}" for one in self.jobs.told() if MODEL in one["files"]]
        return [*SHIPPED, *made]

    def _model(self, name: str) -> str:
        if name in SHIPPED:
            return name
        number, _, file = name.partition("/")
        if file != MODEL or not number.isascii() or not number.isdigit() or len(number) > 9:
            raise InputError("model", name[:60], f"unknown; known: {', '.join(self.models())}"[:300])
        return str(self.jobs.file(int(number), MODEL).resolve())
