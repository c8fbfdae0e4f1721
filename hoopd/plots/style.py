"""The one look of every figure, and how a figure becomes a file.

Rules of this file: matplotlib's objects only (`Figure` on the Agg canvas), never pyplot, and no global setting is
changed; the same figure gives the same bytes, so no date, version or random identifier goes into a file; a file that
cannot be written is one `InputError`.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target, replace_file

# Okabe and Ito's palette, told apart by colour-blind people; its yellow is left out, it cannot be read on white.
BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#000000",
)
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, BLACK)
GREY = "#666666"  # marks, limits and whatever is not data

DPI = 150
LINE_WIDTH_PT = 1.4
HEAD_PT, TITLE_PT, LABEL_PT, TICK_PT, NOTE_PT = 12, 10.5, 10, 9, 8.5

# What matplotlib would write about day and version, by extension; None leaves an entry out.
_METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": "hoopd"},
    ".pdf": {"CreationDate": None, "Creator": "hoopd", "Producer": "hoopd"},
}
EXTENSIONS = tuple(_METADATA)
# Identifiers inside an .svg come from this salt instead of a random one; text stays text in .svg and .pdf.
_FILE_SETTINGS: Any = {"svg.hashsalt": "hoopd", "svg.fonttype": "none", "pdf.fonttype": 42, "savefig.bbox": None}


class _Steady(ConstrainedLayoutEngine):
    """Matplotlib's layout to 1e-6 of the figure: its solver rounds by the order of addresses in memory."""

    def execute(self, fig: Figure) -> Any:
        """As the layout does, then rounded."""
        found = super().execute(fig)
        for axes in fig.axes:
            x, y, width, height = (round(float(one), 6) for one in axes.get_position(original=True).bounds)
            axes.set_position((x, y, width, height))
            # a position that was set is otherwise left out of the next layout
            axes.set_in_layout(True)
        return found


class ShownFigure(Figure):
    """A figure that a notebook shows by itself."""

    def _repr_png_(self) -> bytes:
        return rendered(self, ".png")


def figure(
    width_in: float = 7.0,
    height_in: float = 4.5,
    *,
    rows: int = 1,
    columns: int = 1,
    mosaic: Sequence[Sequence[str]] | None = None,
    title: str = "",
    **grid: Any,
) -> Figure:
    """A figure with `rows` x `columns` styled axes (`.axes`, row by row), or a `mosaic` of named ones (`named`);
    `grid` goes to `Figure.subplots` or `Figure.subplot_mosaic`."""
    made = ShownFigure(figsize=(width_in, height_in), dpi=DPI, layout=_Steady(), facecolor="white")
    FigureCanvasAgg(made)
    if mosaic is None:
        made.subplots(rows, columns, **grid)
    else:
        made.subplot_mosaic([list(row) for row in mosaic], **grid)
    for axes in made.axes:
        styled(axes)
    if title:
        made.suptitle(title, fontsize=HEAD_PT, fontweight="bold")
    return made


def named(figure: Figure) -> dict[str, Axes]:
    """Axes of a mosaic by their names."""
    return {str(axes.get_label()): axes for axes in figure.axes}


def styled(axes: Axes) -> Axes:
    """The look on axes: colours in their order, thin grid behind the data, no frame on top and right."""
    axes.set_prop_cycle(cycler(color=COLOURS) * cycler(linewidth=[LINE_WIDTH_PT]))
    axes.set_axisbelow(True)
    axes.grid(True, which="major", color="#D9D9D9", linewidth=0.6)
    axes.tick_params(which="both", labelsize=TICK_PT, color=GREY, direction="out")
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_fontsize(LABEL_PT)
    return axes


def labelled(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Axis labels and a title (`set_title` alone would take matplotlib's own size)."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=TITLE_PT)


def legend(axes: Axes, **options: Any) -> None:
    """A legend in the style; nothing when no artist has a label."""
    if axes.get_legend_handles_labels()[0]:
        look = {"fontsize": NOTE_PT, "framealpha": 0.9, "edgecolor": "none", "loc": "best"}
        axes.legend(**{**look, **options})


def check_path(path: Path) -> None:
    """InputError when no figure can go there: said before the work, not after it."""
    if path.suffix.lower() not in _METADATA:
        raise InputError(path, "--figure", f"unknown extension {path.suffix!r}; known: {', '.join(EXTENSIONS)}")
    check_target(path, "--figure")


def rendered(figure: Figure, extension: str) -> bytes:
    """The figure as the bytes of a file of this kind (".png", ".svg", ".pdf")."""
    buffer = io.BytesIO()
    with mpl.rc_context(_FILE_SETTINGS):
        figure.savefig(buffer, format=extension[1:], metadata=_METADATA[extension])
    return buffer.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write the figure, whole or not at all; InputError on an unknown extension or a path that cannot be written."""
    check_path(path)
    data = rendered(figure, path.suffix.lower())
    replace_file(path, data)
