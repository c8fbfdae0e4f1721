"""Options of `hoopd identify`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, names_of, option
from hoopd.commands.options.shared import (
    SLICE,
    columns_option,
    figure_option,
    hold_option,
    holdout_option,
    json_option,
    plant_option,
)
from hoopd.files.reading import InputError


def whole_numbers(text: str) -> tuple[int, ...]:
    """Numbers of "4,6"; InputError for what is none."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError("--orders", "", f"whole numbers between commas, not {text!r}") from None


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions:
    """Identify a linear model from recordings or from columns of any file, compare it with data it has not seen."""

    recordings: tuple[str, ...] = argument(f"Recordings: {SLICE}.", metavar="REC...")
    holdout: tuple[str, ...] = holdout_option("Recording that is compared, never fitted; repeatable.")
    method: str = option(
        "--method",
        text="arx, armax, oe, bj (polynomials), subspace, pem (state space), or auto: all of them, the best by data "
        "held back. Of the hoop arx unless told, of columns auto.",
        default="",
    )
    orders: tuple[int, ...] = option(
        "--orders", text="Polynomials: na,nb or na,nb,nc.", metavar="4,6", default="4,6", read=whole_numbers
    )
    input_delay: int = option(
        "--input-delay",
        text="Polynomials: samples by which inputs act later than on the next one.",
        metavar="SAMPLES",
        default=0,
    )
    order: int | None = option("--order", min=1, text="State space: states; without it the data choose.")
    outputs: tuple[str, ...] = option(
        "--outputs",
        "--output",
        text="Columns of any file, as --input; or of theta, dtheta, psi (dtheta,psi unless told), or channels of "
        "another plant (all of them).",
        metavar="NAMES",
        default="",
        read=names_of,
    )
    inputs: tuple[str, ...] = option(
        "--inputs",
        "--input",
        text="Columns of any file that drive the outputs, COLUMN[:UNIT],... or NAME=COLUMN[:UNIT],...; of another "
        "plant those that its outputs answer to (all of them).",
        metavar="NAMES",
        default="",
        read=names_of,
    )
    time: str = option(
        "--time", text="Column of the time, where it is not called so.", metavar="COLUMN[:UNIT]", default=""
    )
    step_s: float | None = option(
        "--sample-time", text="Seconds from row to row where a file has no time; else rows are brought to this step."
    )
    keep_means: bool = option("--keep-means", text="Leave the means in: zero is the operating point.", default=False)
    no_direct: bool = option("--no-direct", text="auto: only models on which a law can be designed.", default=False)
    delay_s: float | None = option(
        "--delay", text="Age of a picture in s when a tick uses it, for rows that were taken at once."
    )
    detrend: bool = option("--detrend", text="Take the mean off every signal.", default=False)
    plant: str | None = plant_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    out: Path | None = option(
        "--out", text="Write the model here (.yaml), for `hoopd design` and `simulate`.", metavar="FILE"
    )
    figure: Path | None = figure_option()
    json_path: Path | None = json_option()
