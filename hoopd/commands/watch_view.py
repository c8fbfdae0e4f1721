"""How a watched daemon looks in a terminal of 80 columns: a headline, three tables, or one line.

Rules of this file: from a `WatchedDaemon` to text; what comes over the network is shown as text, never as markup.
"""

from __future__ import annotations

import math
import textwrap
from typing import Final, NamedTuple

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from hoopd.commands.watched import WatchedDaemon
from hoopd.plots.number_format import safe

WIDTH: Final = 80
STYLES: Final = {"RUNNING": "bold green", "FAULT": "bold red", "STOPPING": "bold yellow", "READY": "bold cyan"}
NOTHING: Final = "-"


class ShownQuantity(NamedTuple):
    """One line of the first table: channel as measured, place in the estimate (-1: none), digits."""

    words: str
    unit: str
    measured: str
    estimate: int
    digits: int


QUANTITIES: Final = (
    ShownQuantity("ball angle", "rad", "psi", 2, 4),
    ShownQuantity("wanted ball angle", "rad", "reference", -1, 4),
    ShownQuantity("ball speed", "rad/s", "", 3, 3),
    ShownQuantity("hoop angle", "rad", "theta", 0, 3),
    ShownQuantity("hoop speed", "rad/s", "dtheta", 1, 3),
    ShownQuantity("torque", "N m", "u", -1, 4),
    ShownQuantity("motor current", "A", "current", -1, 3),
)


def fixed(value: float, digits: int) -> str:
    """A number with so many digits behind its point."""
    return f"{value:.{digits}f}" if math.isfinite(value) else NOTHING


def milliseconds(value_s: float) -> str:
    """A time in ms with its unit."""
    return f"{1e3 * value_s:.1f} ms" if math.isfinite(value_s) else NOTHING


def view(daemon: WatchedDaemon, endpoint: str, news: str) -> RenderableType:
    """Everything; `news` says what became of the daemon itself."""
    parts: list[RenderableType] = [_headline(daemon, endpoint)]
    if news:
        parts.append(Text(news, style="" if daemon.there else "bold red"))
    if daemon.name:
        parts += [_quantities(daemon), _loop(daemon), _faults(daemon)]
    return Group(*parts)


def _headline(daemon: WatchedDaemon, endpoint: str) -> Text:
    text = Text(f"{safe(daemon.name)}  " if daemon.name else "")
    if daemon.name:
        there = daemon.there
        text.append(safe(daemon.mode) if there else f"{safe(daemon.mode)}?", style=STYLES.get(daemon.mode, "bold"))
        text.append(f"  {fixed(daemon.number('t'), 1)} s of this run")
    text.append(f"  {endpoint}", style="dim")
    return text


def _quantities(daemon: WatchedDaemon) -> Table:
    table = _table("", "unit", "measured", "estimated", "standard deviation", left=2)
    for row in QUANTITIES:
        measured = fixed(daemon.number(row.measured), row.digits) if row.measured else NOTHING
        estimated = fixed(daemon.number(f"x_hat_{row.estimate}"), row.digits) if row.estimate >= 0 else ""
        deviation = fixed(daemon.deviation(row.estimate), row.digits) if row.estimate >= 0 else ""
        table.add_row(row.words, row.unit, measured, estimated, deviation)
    return table


def _loop(daemon: WatchedDaemon) -> Table:
    """What the loop, the camera and the writers do; what the daemon does not tell has no row."""
    status, pictures = daemon.status, daemon.pictures_per_s
    table = _table("", "last second", "whole run", left=1)
    missed = status.get("missed_ticks")
    table.add_row("ticks", _rate(daemon.number("tick_rate_hz")), "" if missed is None else f"{safe(missed)} missed")
    for name in ("lateness", "execution"):
        worst, usual = (daemon.number(f"{name}_{kind}_s") for kind in ("worst", "p99"))
        table.add_row(name, f"{milliseconds(worst)} at worst", f"99 % below {milliseconds(usual)}")
    if math.isfinite(pictures):
        table.add_row("pictures", _rate(pictures), "")
    if math.isfinite(daemon.picture_age_s):
        table.add_row("age of the newest picture", milliseconds(daemon.picture_age_s), "")
    for name in ("telemetry", "recorder"):
        counts = status.get(name)
        if isinstance(counts, dict) and "dropped" in counts:
            table.add_row(f"{name}, lost rows", "", safe(counts["dropped"]))
    return table


def _rate(value: float) -> str:
    return f"{fixed(value, 1)} a second"


def _faults(daemon: WatchedDaemon) -> RenderableType:
    lines = Text(safe(daemon.arming))
    if not daemon.faults:
        return Group(Text("no faults"), lines) if lines else Text("no faults")
    table = Table(title="faults", title_justify="left", width=WIDTH)
    table.add_column("name", no_wrap=True, style="bold red")
    table.add_column("what it means")
    table.add_column("what clears it")
    for row in daemon.faults:
        table.add_row(*(Text(safe(part)) for part in row))
    return Group(table, lines)


def _table(*head: str, left: int) -> Table:
    """A table whose first columns are words and the others numbers."""
    table = Table()
    for place, name in enumerate(head):
        table.add_column(name, justify="left" if place < left else "right", no_wrap=True)
    return table


def line(daemon: WatchedDaemon) -> str:
    """All that matters in one line of at most 80 characters."""
    mode = safe(daemon.mode)
    angle, speed = fixed(daemon.number("psi"), 3), fixed(daemon.number("dtheta"), 2)
    torque, late = fixed(daemon.number("u"), 3), milliseconds(daemon.number("lateness_worst_s"))
    text = f"{fixed(daemon.number('t'), 1):>8} s {mode:<9} ball {angle:>6} rad  hoop {speed:>6} rad/s  {torque:>6} N m"
    return f"{text}  {late:>7}"


def fault_lines(daemon: WatchedDaemon) -> list[str]:
    """Active faults as sentences, broken between words."""
    told = [
        f"{name}: {meaning}; {clears}" if clears else f"{name}: {meaning}" for name, meaning, clears in daemon.faults
    ]
    indent = " " * 11
    return [
        row
        for text in told
        for row in textwrap.wrap(safe(text), WIDTH, initial_indent=indent, subsequent_indent=f"{indent}  ")
    ]
