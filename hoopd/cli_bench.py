"""The offline commands of the command line.

Rules of this file: declare options, call `hoopd.bench`, print; heavy imports are made inside the commands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result to this file.", metavar="FILE")]
FigureOption = Annotated[
    Path | None, typer.Option("--figure", help="Draw into this file (.png, .svg or .pdf).", metavar="FILE")
]
ModelOption = Annotated[
    Path,
    typer.Option(
        "--model",
        help="Model file of `hoopd fit`, or a shipped one: models/hoop.yaml, models/thesis.yaml.",
        metavar="MODEL",
    ),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="What a file's columns hold, e.g. u,theta,dtheta,current.", metavar="NAMES"),
]
AgeOption = Annotated[
    str,
    typer.Option(
        "--age",
        help="Seconds by which samples are older than their row: the ball's angle, the board's readings.",
        metavar="psi=0.03,y=0.02",
    ),
]


def register(app: typer.Typer) -> None:
    """Add every offline command to the program."""
    for command in (convert, fit, simulate, linearize, design, diagnose):
        app.command()(command)


def convert(
    source: Annotated[
        Path, typer.Argument(help="Recording: .mcap, .mat, .h5 (also FILE.h5:Exp2) or .csv.", metavar="IN")
    ],
    target: Annotated[Path, typer.Argument(help="Where it goes; the extension says the format.", metavar="OUT")],
    columns: ColumnsOption = None,
    experiment: Annotated[str | None, typer.Option("--experiment", help="Group of an .h5 file, e.g. Exp2.")] = None,
    start: Annotated[float | None, typer.Option("--from", help="First second to keep.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last second to keep.")] = None,
    step: Annotated[float | None, typer.Option("--step", help="Resample to this step in seconds.")] = None,
    json_path: JsonOption = None,
) -> None:
    """Convert a recording between formats; cut and resample on the way."""
    from hoopd.bench.convert import run

    _check_files([source], target=target, json=json_path)
    finish(run(source, target, columns=columns, experiment=experiment, start=start, end=end, step=step), json_path)


def fit(
    recordings: Annotated[
        list[str], typer.Argument(help="Recordings to fit: FILE[:EXPERIMENT][@START:END].", metavar="REC...")
    ],
    holdout: Annotated[
        list[str],
        typer.Option("--holdout", help="Recording that judges the model, never fitted; repeatable.", metavar="REC"),
    ] = [],  # noqa: B006
    structure: Annotated[
        str,
        typer.Option(
            "--structure", help="entries: eight coefficients; rolling, published: masses, radii, inertias, frictions."
        ),
    ] = "entries",
    method: Annotated[
        str,
        typer.Option(
            "--method", help="output: free runs; prediction: a Kalman filter's innovations, with noise levels."
        ),
    ] = "output",
    model: Annotated[
        Path | None, typer.Option("--model", help="What it starts from; a shipped one by default.", metavar="MODEL")
    ] = None,
    fix: Annotated[
        list[str],
        typer.Option(
            "--fix",
            help="Not fitted, e.g. mb=0.0608 (kg); NAME alone: at its start; repeatable.",
            metavar="NAME[=VALUE]",
        ),
    ] = [],  # noqa: B006
    prior: Annotated[
        list[str],
        typer.Option(
            "--prior",
            help="Known beforehand, e.g. Rb=0.0104:0.02: SIGMA relative (of J, K, L2: absolute); repeatable.",
            metavar="NAME=VALUE:SIGMA",
        ),
    ] = [],  # noqa: B006
    free: Annotated[
        str, typer.Option("--free", help="Only these are fitted, separated by commas.", metavar="NAMES")
    ] = "",
    channels: Annotated[
        str,
        typer.Option(
            "--channels",
            help="What is compared: theta, theta_rate, dtheta, psi; chosen by itself else.",
            metavar="NAMES",
        ),
    ] = "",
    window: Annotated[
        float | None, typer.Option("--window", help="Runs of so many seconds, each with its own start.")
    ] = None,
    loss: Annotated[str, typer.Option("--loss", help="linear, huber, soft_l1 or cauchy.")] = "linear",
    columns: ColumnsOption = None,
    age: AgeOption = "",
    kinematics: Annotated[
        bool, typer.Option("--kinematics", help="Which kinematics the recordings support (several fits).")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Write the model here.", metavar="MODEL")] = None,
    figure: FigureOption = None,
    json_path: JsonOption = None,
) -> None:
    """Fit the plant's parameters to recordings, with 95 % intervals (docs/fit.md)."""
    from hoopd.bench.fit import run
    from hoopd.bench.fit_options import Wish
    from hoopd.bench.fit_shown import for_terminal

    _check_files([*recordings, *holdout, model], out=out, figure=figure, json=json_path)
    wish = Wish(
        structure=structure,
        model=model,
        columns=columns,
        age=age,
        free=free,
        fix=fix,
        priors=prior,
        channels=channels,
        window_s=window,
        loss=loss,
        method=method,
        kinematics=kinematics,
    )
    with shown_progress() as progress:
        result = run(recordings, holdout, wish, out=out, figure=figure, progress=progress)
    finish(result, json_path, for_terminal(result))


def simulate(
    model: ModelOption,
    recording: Annotated[
        str,
        typer.Option(
            "--input", help="Recording whose torque is applied: FILE[:EXPERIMENT][@START:END].", metavar="REC"
        ),
    ],
    figure: FigureOption = None,
    columns: ColumnsOption = None,
    age: AgeOption = "",
    x0: Annotated[
        str | None,
        typer.Option(
            "--x0", help="Start (rad, rad/s) instead of an estimated one, the rest 0.", metavar="psi=0.4,dtheta=0"
        ),
    ] = None,
    step: Annotated[float, typer.Option("--step", help="Longest integration step in seconds.")] = 0.01,
    moving: Annotated[
        str, typer.Option("--moving", help="What moves: both, hoop, ball, or auto: as the recording shows.")
    ] = "auto",
    without_effects: Annotated[bool, typer.Option("--without-effects", help="Leave the model's effects out.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Write the simulated run (.csv, .mcap, .mat or .h5).", metavar="FILE"),
    ] = None,
    json_path: JsonOption = None,
) -> None:
    """Run a model freely with the torque of a recording, and compare with what was measured."""
    from hoopd.bench.simulate import run

    _check_files([recording, model], out=out, figure=figure, json=json_path)
    result = run(
        model,
        recording,
        columns=columns,
        age=age,
        x0=x0,
        step_s=step,
        moving=moving,
        without_effects=without_effects,
        out=out,
        figure=figure,
    )
    finish(result, json_path)


def linearize(
    model: ModelOption,
    output: Annotated[
        list[str], typer.Option("--output", help="Measured: psi, theta, dtheta or dpsi; repeatable.", metavar="NAME")
    ] = ["psi"],  # noqa: B006
    psi: Annotated[float | None, typer.Option("--psi", help="Ball held at this angle (rad), hoop turning.")] = None,
    hoop_speed: Annotated[
        float | None, typer.Option("--hoop-speed", help="Hoop turning at this speed (rad/s), ball held up its side.")
    ] = None,
    top: Annotated[bool, typer.Option("--top", help="Ball at rest at the top.")] = False,
    sample_time: Annotated[
        float | None, typer.Option("--sample-time", help="Hold the torque over this time (s): the sampled plant.")
    ] = None,
    delay: Annotated[int, typer.Option("--delay", help="Samples of delay in the sampled plant.")] = 0,
    figure: FigureOption = None,
    plot: Annotated[
        str | None, typer.Option("--plot", help="What --figure shows: overview, bode, nyquist, poles or step.")
    ] = None,
    json_path: JsonOption = None,
) -> None:
    """Linear model around an operating point (the bottom at rest), and what it says (docs/linear.md)."""
    from hoopd.bench.forterminal import of_linearize
    from hoopd.bench.linearize import run

    _check_files([model], figure=figure, json=json_path)
    result = run(
        model,
        outputs=output,
        psi_rad=psi,
        dtheta_rad_s=hoop_speed,
        top=top,
        sample_time_s=sample_time,
        delay_samples=delay,
        figure=figure,
        plot=plot,
    )
    finish(result, json_path, of_linearize(result))


def design(
    law: Annotated[
        str, typer.Argument(help="lqg, lqr, placement, pid, pi, lead, lag, arx or identified.", metavar="LAW")
    ],
    model: ModelOption,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the controller file here.", metavar="CONTROLLER")
    ] = None,
    recording: Annotated[
        str | None, typer.Option("--recording", help="arx: the run that the model is fitted to.", metavar="REC")
    ] = None,
    identified: Annotated[
        Path | None, typer.Option("--identified", help="identified: model file of `hoopd identify`.", metavar="FILE")
    ] = None,
    omega: Annotated[
        float | None, typer.Option("--omega", "--bandwidth", help="rad/s: where the loop is shaped, the link acts.")
    ] = None,
    mt: Annotated[float | None, typer.Option("--mt", help="pid: largest |T| wanted, e.g. 1.25.")] = None,
    phase: Annotated[
        float | None, typer.Option("--phase", help="Degrees; pid: angle of the touching point; pi: phase margin.")
    ] = None,
    zeta: Annotated[float | None, typer.Option("--zeta", help="pi: damping, poles placed instead.")] = None,
    filter_ratio: Annotated[float, typer.Option("--filter", help="pid: N of the derivative's filter Td/N.")] = 15.0,
    lead: Annotated[
        tuple[float, float] | None, typer.Option("--lead", help="pid: lead link in series, rad/s and N.")
    ] = None,
    ratio: Annotated[float, typer.Option("--ratio", help="lead: N; lag: M.")] = 5.0,
    gain: Annotated[float, typer.Option("--gain", help="lead, lag: N m/rad.")] = 1.0,
    poles: Annotated[
        str, typer.Option("--poles", help="placement: three poles in rad/s, for hoop speed and ball.")
    ] = "-5+7j,-5-7j,-4",
    weights: Annotated[
        list[str],
        typer.Option(
            "--weights", help="lqg, arx: deviations that cost the same, e.g. psi=0.2,torque=0.05; also dtheta, dpsi."
        ),
    ] = [],  # noqa: B006
    delay: Annotated[
        float,
        typer.Option("--delay", help="Age of a picture in s when a tick uses it: the camera's delay and half a tick."),
    ] = 0.05,
    sample_time: Annotated[float, typer.Option("--sample-time", help="Tick in s.")] = 0.02,
    disturbance: Annotated[
        float, typer.Option("--disturbance", help="Angle in rad of the trial's release and of its one wrong picture.")
    ] = 0.4,
    figure: FigureOption = None,
    json_path: JsonOption = None,
) -> None:
    """Design a control law for a model and write the file that the daemon loads."""
    from hoopd.bench.design import run
    from hoopd.bench.design_options import poles_from, spec_from, weights_from
    from hoopd.bench.forterminal import of_design

    _check_files([recording, identified, model], out=out, figure=figure, json=json_path)
    spec = spec_from(
        omega_rad_s=omega,
        mt=mt,
        phase_deg=phase,
        zeta=zeta,
        filter_ratio=filter_ratio,
        lead=lead,
        ratio=ratio,
        gain=gain,
        poles=poles_from(poles),
        weights=weights_from(weights),
        delay_s=delay,
        sample_time_s=sample_time,
    )
    result = run(
        law,
        model,
        spec,
        recording=recording,
        identified=identified,
        out=out,
        figure=figure,
        disturbance_rad=disturbance,
    )
    finish(result, json_path, of_design(result, out))


@contextmanager
def shown_progress() -> Iterator[Callable[[str], None]]:
    """What a long command is doing and since when, on a line of standard error; nothing where no one looks."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        task = shown.add_task("")
        yield lambda text: shown.update(task, description=text)


def diagnose(
    recordings: Annotated[
        list[str],
        typer.Argument(help="Recordings, or folders of them: FILE[:EXPERIMENT][@START:END].", metavar="REC..."),
    ],
    holdout: Annotated[
        list[str],
        typer.Option("--holdout", help="Recording that proves the gain, never fitted; repeatable.", metavar="REC"),
    ] = [],  # noqa: B006
    model: Annotated[
        Path | None,
        typer.Option("--model", help="Model that is judged; without one the thesis's entries.", metavar="MODEL"),
    ] = None,
    effects: Annotated[
        Path | None, typer.Option("--effects", help="Effects of your own beside the library.", metavar="FILE.py")
    ] = None,
    without: Annotated[
        list[str],
        typer.Option("--without", help="Effect that is not to be looked for; repeatable.", metavar="NAME[,NAME]"),
    ] = [],  # noqa: B006
    columns: ColumnsOption = None,
    age: AgeOption = "",
    report: Annotated[
        Path | None, typer.Option("--report", help="Write the whole report as one page.", metavar="FILE.html")
    ] = None,
    write: Annotated[
        Path | None, typer.Option("--write", help="Write a model with what was found.", metavar="MODEL")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random in the search.")] = 0,
    free_run: Annotated[
        bool, typer.Option("--free-run/--no-free-run", help="Also refine and compare one run over whole recordings.")
    ] = True,
    free_run_choice: Annotated[
        bool, typer.Option("--free-run-choice", help="Look, too, for effects that make that run better (minutes).")
    ] = False,
    json_path: JsonOption = None,
) -> None:
    """Say where recordings and model differ, name the physics that was left out, prove it (docs/diagnose.md)."""
    from rich.console import Console

    from hoopd.bench.diagnose import run
    from hoopd.diagnose.report.terminal import report_text

    with shown_progress() as progress:
        found = run(
            recordings,
            holdout,
            model=model,
            effects=effects,
            without=[name for text in without for name in text.split(",")],
            json_path=json_path,
            report=report,
            write=write,
            columns=columns,
            age=age,
            seed=seed,
            free_run=free_run,
            free_run_choice=free_run_choice,
            progress=progress,
        )
    report_text(found, Console())


def _check_files(inputs: Sequence[Path | str | None], **outputs: Path | None) -> None:
    """Said before the work, and before another file is written."""
    from hoopd.bench.targets import check_targets

    check_targets([one for one in inputs if one is not None], {f"--{name}": path for name, path in outputs.items()})


def finish(result: dict[str, Any], json_path: Path | None, shown: dict[str, Any] | None = None) -> None:
    """Print a result (or what a person shall see of it), and write it where it is wanted."""
    from hoopd.output import print_result, write_json

    write_json(json_path, result)
    print_result(shown or result)
