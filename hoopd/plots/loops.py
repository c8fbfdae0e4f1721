"""Figures of closed loops: the gang of four, and runs in time, nonlinear against linear.

Rules of this file: data in, `Figure` out; nothing is computed but absolute values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.design.gang_of_four import GangOfFour
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun
from hoopd.plants.hoop.loop.trial import Trial
from hoopd.plots import style

# Of each panel: attribute, title, unit on the axis.
PANELS = (
    ("sensitivity", "Sensitivity S", "|S| (1)"),
    ("load", "Load disturbance to ball angle, PS", "|PS| (rad per N m)"),
    ("noise", "Noise to torque, CS", "|CS| (N m per rad)"),
    ("complementary", "Complementary sensitivity T", "|T| (1)"),
)
UNIT_LINES = ("sensitivity", "complementary")  # panels in which 1 means something
FLOOR = 1e-4  # of a panel's largest value: what lies below says nothing
WIDTH_IN = 9.0


def draw_gang_of_four(gangs: Mapping[str, GangOfFour], title: str = "Gang of four") -> Figure:
    """The four responses of one loop or of several by name."""
    figure = style.figure(WIDTH_IN, 6.0, rows=2, columns=2, title=title, sharex=True)
    _gang(figure.axes, gangs)
    return figure


def draw_responses(runs: Mapping[str, tuple[ClosedLoopRun, ClosedLoopRun]], title: str = "Closed loop") -> Figure:
    """Ball angle, hoop speed and torque of runs by name, each nonlinear (solid) and linear (dashed)."""
    figure = style.figure(WIDTH_IN, 7.0, rows=3, columns=1, title=title, sharex=True)
    for index, (name, pair) in enumerate(runs.items()):
        _pair(figure.axes, name, pair, style.COLOURS[index])
    _name_axes(figure.axes, next(iter(runs.values()), (None,))[0])
    style.legend(figure.axes[0], ncols=2)
    return figure


def draw_runs(runs: Mapping[str, ClosedLoopRun], title: str = "") -> Figure:
    """Ball angle, hoop speed and torque of runs by name."""
    figure = style.figure(WIDTH_IN, 7.0, rows=3, columns=1, title=title, sharex=True)
    for name, run in runs.items():
        _curves(figure.axes, run, {"label": name}, {"linewidth": 0.9})
    _name_axes(figure.axes, next(iter(runs.values()), None))
    style.legend(figure.axes[0], loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=max(1, len(runs)))
    return figure


def draw_design(gang: GangOfFour, runs: Trial, disturbance_rad: float, title: str = "") -> Figure:
    """One law: the gang of four above, released and disturbed runs below."""
    figure = style.figure(WIDTH_IN + 1.0, 10.0, rows=5, columns=2, title=title)
    _gang(figure.axes[:4], {"": gang})
    columns = {
        f"Ball let go at {disturbance_rad:g} rad": (runs.released, runs.released_linear),
        f"One picture {disturbance_rad:g} rad wrong": (runs.disturbed, runs.disturbed_linear),
    }
    for column, (name, pair) in enumerate(columns.items()):
        axes = figure.axes[4 + column :: 2]
        _pair(axes, "", pair, style.BLUE)
        _name_axes(axes, pair[0])
        for one in axes[:-1]:
            one.tick_params(labelbottom=False)
        axes[0].set_title(name, fontsize=style.TITLE_PT)
    style.legend(figure.axes[4], ncols=2)
    for one in figure.axes[:2]:
        one.set_xlabel("")
    return figure


def _gang(axes: list[Axes], gangs: Mapping[str, GangOfFour]) -> None:
    for one, (key, title, label) in zip(axes, PANELS, strict=True):
        sizes = []
        for index, (name, gang) in enumerate(gangs.items()):
            size = np.abs(getattr(gang, key))
            one.loglog(gang.w, size, label=name or None, color=style.COLOURS[index])
            sizes.append(float(size.max()))
        if key in UNIT_LINES:
            one.axhline(1.0, color=style.GREY, linewidth=0.8, linestyle=":")
        low, high = one.get_ylim()
        one.set_ylim(max(low, FLOOR * max(sizes)), max(high, 2.0 * max(sizes)))
        one.set_title(_titled(title, sizes), fontsize=style.TITLE_PT)
        one.set_ylabel(label)
        one.set_xlabel("frequency (rad/s)")
    style.legend(axes[1], loc="lower left")  # |PS| is small where the others are not


def _titled(title: str, sizes: list[float]) -> str:
    """With one loop, its largest value."""
    return f"{title} (largest {sizes[0]:.3g})" if len(sizes) == 1 else title


def _pair(axes: Any, name: str, pair: tuple[ClosedLoopRun, ClosedLoopRun], colour: str) -> None:
    solid, dashed = (f"{name} {kind}".strip() for kind in ("nonlinear", "linear"))
    for run, label, look in zip(pair, (solid, dashed), ("-", "--"), strict=True):
        own = colour if name or look == "-" else style.VERMILION
        options: dict[str, Any] = {"color": own, "linestyle": look}
        _curves(axes, run, {"label": label, **options}, options)


def _curves(axes: Any, run: ClosedLoopRun, first: Mapping[str, Any], rest: Mapping[str, Any]) -> None:
    """The signals of a run below each other, the last one, which is held, in steps."""
    *smooth, held = run.signals.values()
    for index, (one, values) in enumerate(zip(axes, smooth, strict=False)):
        one.plot(run.t, values, **(first if index == 0 else {key: rest[key] for key in rest if key != "linewidth"}))
    axes[-1].step(run.t, held, where="post", **rest)


def _name_axes(axes: Any, run: ClosedLoopRun | None) -> None:
    for one, label in zip(axes, run.signals if run else (), strict=False):
        one.set_ylabel(label)
    for one in axes:
        one.margins(x=0.0)
    axes[-1].set_xlabel("time (s)")
