"""The command that identifies linear models.

Rules of this file: declare options, call `hoopd.commands`, print; heavy imports are made inside the command.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoopd.commands.cli_options import ColumnsOption, FigureOption, JsonOption, finish, shown_progress


def identify(
    recordings: Annotated[
        list[str], typer.Argument(help="Recordings: FILE[:EXPERIMENT][@START:END].", metavar="REC...")
    ],
    holdout: Annotated[
        list[str], typer.Option("--holdout", help="Recording that is compared, never fitted; repeatable.")
    ] = [],  # noqa: B006
    method: Annotated[
        str, typer.Option("--method", help="arx, armax, oe, bj (polynomials), subspace or pem (state space).")
    ] = "arx",
    orders: Annotated[str, typer.Option("--orders", help="Polynomials: na,nb or na,nb,nc.", metavar="4,6")] = "4,6",
    order: Annotated[
        int | None, typer.Option("--order", min=1, help="State space: states; without it the data choose.")
    ] = None,
    outputs: Annotated[str, typer.Option("--outputs", help="Of theta, dtheta, psi.", metavar="NAMES")] = "dtheta,psi",
    delay: Annotated[
        float | None,
        typer.Option("--delay", help="Age of a picture in s when a tick uses it, for rows that were taken at once."),
    ] = None,
    detrend: Annotated[bool, typer.Option("--detrend", help="Take the mean off every signal.")] = False,
    columns: ColumnsOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the model here (.yaml), for `hoopd design`.", metavar="FILE")
    ] = None,
    figure: FigureOption = None,
    json_path: JsonOption = None,
) -> None:
    """Identify a linear model from recordings, compare it with data it has not seen (docs/guides/identify.md)."""
    from hoopd.commands.identify import run
    from hoopd.commands.identify_data import Wish
    from hoopd.commands.inputs import whole_numbers

    wish = Wish(
        method=method,
        orders=whole_numbers("--orders", orders),
        order=order,
        outputs=tuple(part.strip() for part in outputs.split(",") if part.strip()),
        delay_s=delay,
        detrend=detrend,
    )
    with shown_progress() as progress:
        result = run(recordings, holdout, wish, columns=columns, out=out, figure=figure, progress=progress)
    finish(result, json_path)
