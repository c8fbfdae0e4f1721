"""The scored run: make cases, have every one diagnosed, judge what was said.

Rules of this file: work runs on dask workers, each case a task; every result is stored before the next is asked for;
a run that was broken off goes on where it was. A diagnosis that failed is an answer: it is kept and counted.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster, as_completed
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from concealed import baselines, report, worker
from concealed.calibrate import calibration
from concealed.cases import OUTSIDE, make
from concealed.judged import Judged
from concealed.metrics import summary
from concealed.oracle import NoOracleError, oracle
from concealed.outside.oracle import oracle as told_the_truth
from concealed.runfolder import RunFolder
from concealed.seeds import is_tuning
from concealed.version import version
from concealed.whole import put

ROOT = Path(__file__).resolve().parents[2]
DIAGNOSES, ORACLES = "diagnoses", "oracles"
SEED = 1  # of `hoopd diagnose`


@contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Client]:
    """Workers: this machine's, each one thread, on loopback; or a laboratory's, which get this package sent."""
    if scheduler:
        with Client(scheduler) as client, tempfile.TemporaryDirectory() as scratch:
            client.upload_file(str(_package(Path(scratch))))
            yield client
        return
    paths = [str(ROOT), str(ROOT / "tools"), os.environ.get("PYTHONPATH", "")]
    environment = {
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    os.environ.update(environment)  # the workers are started from here
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as local,
        Client(local) as client,
    ):
        yield client


def _package(scratch: Path) -> Path:
    """This package as a .zip that a worker can import."""
    out = scratch / "concealed.zip"
    with zipfile.ZipFile(out, "w") as archive:
        own = Path(__file__).parent
        for path in sorted(own.rglob("*.py")):
            archive.write(path, path.relative_to(own.parent).as_posix())
    return out


def run(folder: RunFolder, client: Client, console: Console, *, rivals: bool = True, retry: bool = False) -> None:
    """Everything that is not there yet; without rivals and oracle only what `hoopd diagnose` says; `retry`: diagnoses
    that failed once more."""
    asked = folder.asked()
    kind = "tuning" if is_tuning(asked.seed) else "score"
    console.print(f"{kind} seed {asked.seed}, {len(asked.wishes())} cases, folder {folder.path}")
    with _progress(console) as progress:
        made: list[Job] = [(make, (wishes, asked.seed), first) for first, wishes in folder.chunks()]
        _each(client, progress, "cases made", made, folder.keep)
        for kind, call in _speakers(rivals).items():
            jobs: list[Job] = [
                (call, (folder.files(name), *_told(folder, kind, name)), name)
                for name in folder.identifiers()
                if not _done(folder, kind, name, retry) and _concerned(folder, kind, name)
            ]
            if kind == DIAGNOSES and jobs:
                folder.speaks(version())
            _each(client, progress, kind, jobs, partial(folder.say, kind))
    _tell_failures(folder, console)
    if mixed := _mixed(folder):
        console.print(f"[yellow]{mixed}[/]")
    if rivals:
        _ask_oracle(folder, client, console)


def _mixed(folder: RunFolder) -> str:
    """A sentence when more than one version of the code has spoken."""
    versions = folder.versions()
    return f"answers of {len(versions)} versions of the code are mixed: {', '.join(versions)}" if versions[1:] else ""


def _speakers(rivals: bool) -> dict[str, Callable[..., Any]]:
    """Who says something of the cases."""
    return {DIAGNOSES: worker.diagnose, **(baselines.RIVALS if rivals else {})}


def _told(folder: RunFolder, kind: str, name: str) -> tuple[Any, ...]:
    """What is given beside the files: to `hoopd diagnose` its seed, which entries its library shall lack, and whether
    it has names alone."""
    if kind != DIAGNOSES:
        return ()
    return SEED, tuple(folder.answer(name).get("left_out", ())), folder.asked().library_only


def _concerned(folder: RunFolder, kind: str, name: str) -> bool:
    """Is this one asked about the case? Rivals have no library to take an entry out of, and none to be outside of."""
    answer = folder.answer(name)
    return kind == DIAGNOSES or not (answer.get("left_out") or answer.get("family") == OUTSIDE)


def _done(folder: RunFolder, kind: str, name: str, retry: bool) -> bool:
    """Has it been said? A failure, too; with `retry` a diagnosis that failed has not."""
    said = folder.said(kind, name)
    failed = said is not None and kind == DIAGNOSES and said["diagnosis"] is None
    return said is not None and not (retry and failed)


def _tell_failures(folder: RunFolder, console: Console) -> None:
    """How many diagnoses failed, and the last words of one."""
    told = [folder.said(DIAGNOSES, name) for name in folder.identifiers()]
    failed = [said for said in told if said and said["diagnosis"] is None]
    if failed:
        console.print(f"[red]{len(failed)} diagnoses failed[/]; one said:")
        console.print(failed[0]["error"].strip(), markup=False)


Job = tuple[Callable[..., Any], tuple[Any, ...], Any]


def _each(
    client: Client, progress: Progress, title: str, jobs: Sequence[Job], keep: Callable[[Any, Any], None]
) -> None:
    """Runs the jobs and keeps each result under its key as soon as it is there."""
    bar = progress.add_task(title, total=len(jobs))
    waiting = {client.submit(call, *arguments, pure=False): key for call, arguments, key in jobs}
    for future in as_completed(list(waiting)):
        keep(waiting[future], future.result())
        future.release()
        progress.advance(bar)


def _ask_oracle(folder: RunFolder, client: Client, console: Console) -> None:
    """The oracles' fits of singles, compounds and what is outside the library; says so when this hoopd has none."""
    jobs: list[Job] = []
    for name in folder.identifiers():
        answer = folder.answer(name)
        if answer["family"] in ("single", "compound") and not folder.has(ORACLES, name):
            jobs.append((oracle, (folder.files(name), [effect["name"] for effect in answer["effects"]]), name))
        if answer["family"] == OUTSIDE and not folder.has(ORACLES, name):
            jobs.append((told_the_truth, (folder.files(name), folder.signals(name), answer), name))
    try:
        with _progress(console) as progress:
            _each(client, progress, "oracle", jobs, partial(folder.say, ORACLES))
    except NoOracleError as error:
        console.print(f"[yellow]no oracle in this hoopd ({error}): its metric is left out[/]")


def publish_calibration(folder: RunFolder, console: Console) -> dict[str, Any]:
    """Writes calibration.json and calibration.md into the folder, and prints the table."""
    told = [(folder.answer(name), folder.said(DIAGNOSES, name)) for name in folder.identifiers()]
    found = calibration([Judged(answer, said["diagnosis"], said["seconds"]) for answer, said in told if said])
    text = json.dumps(found, indent=1, sort_keys=True, allow_nan=False)
    put(folder.path / "calibration.json", (text + "\n").encode())
    shown = report.calibration_markdown(found, f"tuning seed {folder.asked().seed}")
    put(folder.path / "calibration.md", shown.encode())
    console.print(shown, markup=False, highlight=False, soft_wrap=True)
    return found


def judged(folder: RunFolder) -> dict[str, Any]:
    """All figures of what is there so far."""
    cases, rivals = [], {name: [] for name in baselines.RIVALS}
    for name in folder.identifiers():
        answer, said = folder.answer(name), folder.said(DIAGNOSES, name)
        if said is not None:
            cases.append(Judged(answer, said["diagnosis"], said["seconds"], folder.said(ORACLES, name)))
        for rival, found in rivals.items():
            if (told := folder.said(rival, name)) is not None:
                found.append(Judged(answer, told))
    asked = folder.asked()
    told = {"seed": asked.seed, "tuning": is_tuning(asked.seed), "versions": folder.versions()}
    return {**told, **summary(cases, rivals, baselines.KNOWN)}


def publish(folder: RunFolder, console: Console) -> dict[str, Any]:
    """Writes report.json, report.md and power.png into the run's folder, and prints the tables."""
    result = judged(folder)
    text = json.dumps(result, indent=1, sort_keys=True, allow_nan=False)
    put(folder.path / "report.json", (text + "\n").encode())
    kind = "tuning" if result["tuning"] else "score"
    by = f", code {', '.join(result['versions'])}" if result["versions"] else ""
    shown = report.markdown(result, f"{result['cases']} cases, {kind} seed {result['seed']}{by}")
    put(folder.path / "report.md", shown.encode())
    if result["power"]:
        report.draw_power(result, folder.path / "power.png")
    console.print(shown, markup=False, highlight=False, soft_wrap=True)
    return result


def _progress(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description:>14}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console)
