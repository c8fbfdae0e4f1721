"""The offline commands of the command line.

Rules of this file: declare options, call `hoopd.commands`, print; heavy imports are made inside the commands.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoopd.commands.cli_design import design
from hoopd.commands.cli_diagnose import diagnose
from hoopd.commands.cli_identify import identify
from hoopd.commands.cli_options import (
    AgeOption,
    ColumnsOption,
    FigureOption,
    JsonOption,
    ModelOption,
    check_files,
    finish,
    shown_progress,
)


def register(app: typer.Typer) -> None:
    """Add every offline command to the program."""
    for command in (convert, fit, simulate, linearize, design, diagnose, identify):
        app.command(rich_help_panel="Files: recordings, models, controllers")(command)


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
    from hoopd.commands.convert import run

    check_files([source], target=target, json=json_path)
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
    """Fit the plant's parameters to recordings, with 95 % intervals (docs/guides/fit.md)."""
    from hoopd.commands.fit import run
    from hoopd.commands.fit_options import Wish
    from hoopd.commands.fit_tables import for_terminal

    check_files([*recordings, *holdout, model], out=out, figure=figure, json=json_path)
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
    from hoopd.commands.simulate import run

    check_files([recording, model], out=out, figure=figure, json=json_path)
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
    """Linear model around an operating point (the bottom at rest), and what it says (docs/explanations/linear.md)."""
    from hoopd.commands.linear_tables import of_linearize
    from hoopd.commands.linearize import run

    check_files([model], figure=figure, json=json_path)
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
