"""Draw the thesis's figures again, from the real recordings and this model: `make figures`.

Usage: python tools/figures.py [--out FOLDER] [--only NAME] [--list]

The recordings are read from $HOOPD_SHARED/recordings (../shared/recordings without it); where they are missing, it says
how to get them, and recordings of the rig take their place. The folder gets one picture a figure and index.html.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.status import Status
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from thesis import device, fitted, identification, linear, loops  # noqa: E402
from thesis.records import Bench, how_to_get, shared_folder  # noqa: E402
from thesis.results import Drawn, Entry, page  # noqa: E402

from hoopd.files.reading import InputError  # noqa: E402
from hoopd.plots import style  # noqa: E402

PAPER_COLUMNS = 140  # of the table where nobody's terminal limits it


class Wanted(NamedTuple):
    """One figure: the thesis's numbers for it, and what draws it."""

    numbers: str
    draw: Callable[[Bench], Drawn]


FIGURES: dict[str, Wanted] = {
    "fit_first": Wanted("Figures 3.2 to 3.5", partial(identification.fits, key="first")),
    "fit_second": Wanted("Figures 3.6 to 3.9", partial(identification.fits, key="second")),
    "fit_ball": Wanted("", partial(identification.fits, key="ball")),
    "fit_sine": Wanted("", partial(identification.fits, key="sine")),
    "fit_chirp": Wanted("", partial(identification.fits, key="chirp")),
    "solver": Wanted("The question of Figures 3.3 to 3.9", identification.solver_question),
    "poles": Wanted("Figure 4.1", linear.poles),
    "step": Wanted("Figure 4.2", linear.step),
    "bode": Wanted("Figure 4.3", linear.bode),
    "nyquist": Wanted("Figure 4.4", linear.nyquist),
    "linearity": Wanted("Figures 4.5 and 4.6", linear.linearity),
    "gang_of_four": Wanted("Figures 5.3 and 5.4", loops.gang),
    "impulse": Wanted("Figure 5.5", loops.impulse),
    "device": Wanted("Figures 7.1 to 7.3", device.chapter_seven),
    "fitted_loop": Wanted("", fitted.fitted_loop),
}


def draw(names: Sequence[str], folder: Path, console: Console) -> list[Entry]:
    """Draw and save these figures; progress on the console."""
    entries = []
    with tempfile.TemporaryDirectory(prefix="hoopd-figures-") as scratch, console.status("") as status:
        bench = Bench(Path(scratch))
        for count, name in enumerate(names, 1):
            bench.say = partial(_say, status, f"{count}/{len(names)} {name}")
            bench.say("computing")
            drawn = FIGURES[name].draw(bench)
            style.save(drawn.figure, folder / f"{name}.png")
            console.print(f"[{count}/{len(names)}] {folder / name}.png", markup=False, highlight=False)
            entries.append(Entry(f"{name}.png", FIGURES[name].numbers, drawn))
    return entries


def _say(status: Status, where: str, text: str) -> None:
    status.update(f"{where}: {text}")


def summary(entries: Sequence[Entry]) -> Table:
    """Every key number beside the thesis's."""
    table = Table("figure", "number", "here", "thesis", title="Key numbers")
    for entry in entries:
        for index, row in enumerate(entry.drawn.rows):
            name = entry.file.removesuffix(".png") if index == 0 else ""
            table.add_row(name, *row, end_section=index == len(entry.drawn.rows) - 1)
    return table


def main() -> int:
    """Draw what is asked for; 2 on unusable input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "figures", metavar="FOLDER")
    parser.add_argument("--only", action="append", default=[], choices=FIGURES, metavar="NAME", help="repeatable")
    parser.add_argument("--list", action="store_true", help="names of the figures")
    options = parser.parse_args()
    if options.list:
        print("\n".join(FIGURES))
        return 0
    console, errors = Console(width=None if sys.stdout.isatty() else PAPER_COLUMNS), Console(stderr=True)
    missing = Bench(Path()).missing
    notes = [how_to_get(shared_folder(), missing)] if missing else []
    for note in notes:
        errors.print(note, markup=False, highlight=False, soft_wrap=True)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        entries = draw(options.only or list(FIGURES), options.out, console)
        (options.out / "index.html").write_text(page(entries, notes), encoding="utf-8")
    except InputError as error:
        errors.print(f"figures: {error}", markup=False, highlight=False, soft_wrap=True)
        return 2
    except OSError as error:
        errors.print(f"figures: {options.out}: {error.strerror}", markup=False, highlight=False, soft_wrap=True)
        return 2
    console.print(summary(entries))
    console.print(f"{options.out / 'index.html'} shows all of them", markup=False, highlight=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
