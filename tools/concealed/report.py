"""A scored run as a person reads it: Markdown with the tables, and the power curve.

Rules of this file: nothing is computed; a rate is shown as percent with its interval and its counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.plots import style

TITLES: Mapping[str, str] = {
    "false_alarms": "false alarms, nulls and decoys",
    "false_alarms_null": "false alarms, nulls",
    "false_alarms_decoy": "false alarms, decoys",
    "gain_is_parameters": "torque gain taken for parameters",
    "detected": "effect detected (singles)",
    "first_name": "right name first (singles)",
    "first_class": "right class first (singles)",
    "confounded_class": "right class first (confounded)",
    "unknown_declared": "unknown effects declared unknown",
    "known_declared_unknown": "known effects declared unknown",
    "pair_both": "pairs: both names",
    "pair_one": "pairs: at least one name",
    "compound_all": "compounds: all names",
    "location_slot": "slot right",
    "failed": "no diagnosis",
}


def percent(found: Mapping[str, Any]) -> str:
    """`93 % (28/30, 78-99)`, or a dash."""
    if found["rate"] is None:
        return "-"
    low, high = found["interval"]
    return f"{100 * found['rate']:.0f} % ({found['k']}/{found['n']}, {100 * low:.0f}-{100 * high:.0f})"


def markdown(result: Mapping[str, Any], head: str) -> str:
    """The whole report."""
    parts = [head, _rates(result), _others(result), _power(result), _effects(result["by_effect"], "Effects")]
    if result["by_unknown"]:
        parts.append(_effects(result["by_unknown"], "Effects outside the library"))
    return "\n\n".join(parts) + "\n"


def _table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _rates(result: Mapping[str, Any]) -> str:
    rivals = result["baselines"]
    rows = [
        [title, percent(result["rates"][key]), *(percent(rivals[name][key]) for name in rivals)]
        for key, title in TITLES.items()
        if result["rates"][key]["n"]
    ]
    return _table(["", "hoopd diagnose", *rivals], rows)


def _number(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _others(result: Mapping[str, Any]) -> str:
    share, seconds = result["oracle_share"], result["seconds"]
    told = f"{_number(share['median'])} (n = {share['n']})" if share["n"] else "not measured: no oracle"
    rows = [
        ["95 % intervals of effects hold the truth", percent(result["coverage"]["effects"])],
        ["95 % intervals of the base hold the truth", percent(result["coverage"]["base"])],
        ["share of the oracle's held-out gain, median", told],
        ["seconds a case, median and largest", f"{_number(seconds['median'])}, {_number(seconds['largest'])}"],
    ]
    return _table(["", ""], rows)


def _power(result: Mapping[str, Any]) -> str:
    rows = [[row["nats"], percent(row["detected"]), percent(row["first_name"])] for row in result["power"]]
    return _table(["nats", "detected", "right name first"], rows)


def _effects(rows: list[dict[str, Any]], title: str) -> str:
    header = [title, "n", "named", "class", "unknown", "nothing", "median nats", "median error", "mostly instead"]
    return _table(
        header,
        [
            [row["effect"], *(str(row[key]) for key in ("n", "named", "class", "unknown", "nothing")),
             _number(row["median_nats"]), _number(row["median_relative_error"], 2), row["instead"] or ""]
            for row in rows
        ],
    )  # fmt: skip


def calibration_markdown(found: Mapping[str, Any], head: str) -> str:
    """Thresholds, and how often nulls and effects are beyond them."""
    rows = [[f"{row['threshold']:g}", percent(row["alarms"]), percent(row["seen"])] for row in found["by_threshold"]]
    table = _table(["surprise, nats", "nulls and decoys beyond it", "single effects beyond it"], rows)
    wanted = f"{_number(found['recommended'])} nats" if found["recommended"] is not None else "too few nulls to say"
    said = f"{100 * found['aim']:g} % of the nulls exceed, by the tail of {found['nulls']} of them: {wanted}."
    return f"{head}\n\n{table}\n\n{said} Alarms without a name: {percent(found['other_alarms'])}.\n"


def draw_power(result: Mapping[str, Any], path: Path) -> None:
    """Power against nats, with Clopper-Pearson bars."""
    figure = style.figure(6.0, 3.6, title="What is found, against how visible it is")
    (axes,) = figure.axes
    at = range(len(result["power"]))
    for key, colour, shift, label in (
        ("detected", style.BLUE, -0.06, "detected"),
        ("first_name", style.VERMILION, 0.06, "right name first"),
    ):
        found = [row[key] for row in result["power"]]
        middle = [100 * one["rate"] for one in found]
        bars = [
            [m - 100 * one["interval"][0] for m, one in zip(middle, found, strict=True)],
            [100 * one["interval"][1] - m for m, one in zip(middle, found, strict=True)],
        ]
        axes.errorbar([x + shift for x in at], middle, yerr=bars, fmt="o-", color=colour, label=label, capsize=3)
    axes.set_xticks(list(at), [row["nats"] for row in result["power"]])
    style.labelled(axes, "expected gain in log-likelihood, nats", "cases, %")
    axes.set_ylim(0, 103)
    style.legend(axes, loc="lower right")
    style.save(figure, path)
