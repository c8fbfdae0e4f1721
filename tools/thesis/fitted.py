"""From a recording to a controller: LQG on a fitted model against LQG on the thesis's entries, on the same rig.

Rules of this file: recording, fit and design as the three commands make them; measures in `tools/harness/rivals.py`.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

from harness.rivals import SCENARIOS, SEEDS, Judged, judged, race

from hoopd.commands import design, fit
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.daemon import experiment
from hoopd.daemon.app import Options
from hoopd.daemon.recording_target import Where
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.plots import style
from hoopd.plots.device import DeviceRun, draw_device
from thesis.records import Bench
from thesis.results import Drawn, Row

NAMES = {
    "thesis": "designed on the thesis's entries",
    "fitted": "designed on the fitted model",
    "truth": "designed on the rig's own model",
}
DRAWN = ("thesis", "fitted")  # the third cannot be told from the second
COLOURS = (style.VERMILION, style.BLUE)


def controllers(folder: Path) -> dict[str, Path]:
    """The controller files, the fitted one from a recording of the rig."""
    recording, model = folder / "rec.mcap", folder / "mine.yaml"
    options = Options(sim=True, sets=("log.level=error",), speed="max", direct=True)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        experiment.run(Plan("prbs"), options, Where(file=recording))
    fit.run(FitOptions(recordings=(str(recording),), out=model))
    files = {name: folder / f"{name}.yaml" for name in NAMES}
    models = {"thesis": Path("models/thesis.yaml"), "fitted": model, "truth": Path("models/hoop.yaml")}
    for name, file in files.items():
        design.run(DesignOptions(law="lqg", model=models[name], out=file))
    return files


def fitted_loop(bench: Bench) -> Drawn:
    """References and a release, several seeds; the first seed's references are drawn."""
    folder = bench.scratch / "fitted"
    folder.mkdir()
    bench.say("experiment, fit, design")
    files = controllers(folder)
    rows, shown = [], {}
    for scenario, asked in SCENARIOS.items():
        for name, file in files.items():
            bench.say(f"rig: {scenario}, {NAMES[name]}")
            runs = race(folder / scenario, file, asked)
            rows += _rows(f"{scenario}, {NAMES[name]}", [judged(run) for run in runs])
            if scenario == "references" and name in DRAWN:
                shown[NAMES[name]] = DeviceRun(runs[0].t, runs[0].psi, runs[0].dtheta, runs[0].u, runs[0].reference)
    caption = (
        "The rig's ball told to be at 0.1, -0.1, 0.05 and 0 rad, by LQG designed on the thesis's entries and by LQG "
        "from the three commands experiment, fit, design. To hold the ball away from the bottom the hoop must turn, "
        "and how fast is a matter of friction: the wrong model turns it too fast, up to the limit of 30 rad/s, and "
        "misses the angle. Bringing the ball back to the bottom needs no such knowledge: after a release both are "
        "alike, and the thesis's design is even 2 % cheaper (a linear-quadratic gain is not optimal behind a filter "
        "with late pictures)."
    )
    return Drawn(draw_device(shown, "From a recording to a controller", colours=COLOURS), caption, tuple(rows))


def _rows(words: str, found: list[Judged]) -> list[Row]:
    off, _, cost = zip(*found, strict=True)
    return [Row(f"{words}: RMS of ψ - reference", _range(off, "rad")), Row("cost a tick", _range(cost, ""))]


def _range(values: tuple[float, ...], unit: str) -> str:
    return f"{min(values):.4g} to {max(values):.4g} {unit}".strip() + f" ({len(SEEDS)} seeds)"
