"""The command that designs a control law for a model.

Rules of this file: declare options, call `hoopd.commands`, print; heavy imports are made inside the command.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoopd.commands.cli_options import FigureOption, JsonOption, ModelOption, check_files, finish


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
    from hoopd.commands.design import run
    from hoopd.commands.design_options import poles_from, spec_from, weights_from
    from hoopd.commands.linear_tables import of_design

    check_files([recording, identified, model], out=out, figure=figure, json=json_path)
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
