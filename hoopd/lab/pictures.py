"""Figures of the lab: shown by a notebook, saved by name.

Rules of this file: what is drawn comes from `hoopd.plots`; nothing is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from hoopd.plots import style
from hoopd.plots.curves import draw_curves, draw_recordings
from hoopd.plots.experiment import ExperimentLimits, draw_experiment
from hoopd.plots.loops import draw_runs
from hoopd.recording.recording import Recording

NO_LIMITS = ExperimentLimits(float("inf"), float("inf"), float("inf"))


class Picture:
    """A figure that a notebook shows by itself; `.figure` is matplotlib's."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def save(self, path: Path | str) -> Path:
        """Write a .png, .svg or .pdf; InputError when it cannot be written."""
        style.save(self.figure, Path(path))
        return Path(path)

    def _repr_png_(self) -> bytes:
        """What a notebook draws."""
        return style.rendered(self.figure, ".png")


def plot(what: Any, title: str = "", x: str = "time (s)", y: str = "") -> Picture:
    """Draw a recording or anything of the lab, or several side by side.

    Parameters
    ----------
    what : object or mapping of str to object
        A recording or what has a `plot()`; or recordings, closed-loop runs or curves (x, y) by name.
    title : str
        Stands above.
    x, y : str
        Labels of the axes of curves, with their units.

    Returns
    -------
    Picture
        What a notebook shows by itself; `save` writes it.

    Raises
    ------
    ValueError
        What cannot be drawn.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.plot({"line": ([0.0, 1.0], [2.0, 3.0])}, y="ball angle (rad)").figure.axes[0].get_ylabel()
    'ball angle (rad)'
    """
    if hasattr(what, "plot"):
        made: Picture = what.plot()
        return made
    if isinstance(what, Recording):
        return Picture(draw_experiment(what, title or what.source, NO_LIMITS))
    if not isinstance(what, Mapping) or not what:
        raise ValueError("plot takes a recording, or several, runs or curves by name: {'pid': run, 'lqg': other}")
    if all(isinstance(one, Recording) for one in what.values()):
        return Picture(draw_recordings(what, title))
    if all(hasattr(one, "run") for one in what.values()):
        return Picture(draw_runs({name: one.run for name, one in what.items()}, title))
    return Picture(draw_curves(what, x, y, title))
