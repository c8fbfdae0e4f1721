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
    "first_name_known": "right name first (singles that it knows by name)",
    "first_three": "right name among the first three named or not excluded (singles)",
    "abstained": "no name given (singles)",
    "right_if_answered": "right name first, where a name is given (singles)",
    "first_class": "right class first (singles)",
    "first_wide_class": "right class first, near partners on any input (singles)",
    "confounded_class": "right class first (confounded)",
    "confounded_wide_class": "right class first, near partners on any input (confounded)",
    "unknown_declared": "unknown effects declared unknown",
    "unknown_named": "unknown effects: an effect of the library named",
    "known_declared_unknown": "known effects declared unknown",
    "spurious": "effects named that are not there, of all that are named",
    "spurious_cases": "cases with an effect named that is not there",
    "pair_both": "pairs: both names",
    "pair_one": "pairs: at least one name",
    "compound_all": "compounds: all names",
    "location_slot": "slot right",
    "left_out_declared": "left out of the library: declared unknown",
    "left_out_alone": "left out of the library: declared unknown, nothing else named",
    "left_out_slot": "left out of the library: slot right",
    "failed": "no diagnosis",
}

# Physics outside the library.
OUTSIDE: Mapping[str, str] = {
    "found": "declared unknown or given a formula, at the right slot",
    "found_tellable": "the same, where the nearest name of the library leaves 10 nats or more",
    "found_memory": "the same, mechanisms with memory",
    "found_anywhere": "declared unknown or given a formula, at any slot",
    "formula": "given a formula, at the right slot",
    "kept": "80 % of the oracle's held-out gain kept, where it gains over 1 point",
    "kept_little": "the same, where it gains over 0.1 points",
    "sure_wrong": "a name of the library said with more than 50 %, or without a probability",
    "sure_wrong_tellable": "the same, where the nearest name of the library leaves 10 nats or more",
    "named": "a name of the library said at all",
    "silent": "called consistent, or parameters",
    "worse": "worse on held-out data than the re-fitted base, where something was named",
    "without_probability": "findings without a probability",
    "failed": "no diagnosis",
}


def percent(found: Mapping[str, Any]) -> str:
    """`93 % (28/30, 78-99)`, or a dash."""
    if found["rate"] is None:
        return "-"
    low, high = found["interval"]
    cases = f" in {found['cases']} cases" if "cases" in found else ""
    return f"{100 * found['rate']:.0f} % ({found['k']}/{found['n']}{cases}, {100 * low:.0f}-{100 * high:.0f})"


def average(found: Mapping[str, Any]) -> str:
    """`0.93 (30, 0.88-0.97)`, or a dash."""
    if found["mean"] is None:
        return "-"
    low, high = found["interval"]
    return f"{found['mean']:.2f} ({found['n']}, {low:.2f}-{high:.2f})"


def markdown(result: Mapping[str, Any], head: str) -> str:
    """The whole report."""
    parts = [head, _rates(result), _others(result), _power(result), _effects(result["by_effect"], "Effects")]
    if result["by_unknown"]:
        parts.append(_effects(result["by_unknown"], "Effects outside the library"))
    if result["by_left_out"]:
        parts.append(_effects(result["by_left_out"], "Effects left out of the library"))
    if result["outside"]["n"]:
        parts += _outside(result["outside"])
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
    seconds, f1 = result["seconds"], result["set_f1"]
    rows = [
        ["F1 of the set of names, singles and compounds", average(f1["single+compound"])],
        ["F1 of the set of names, singles", average(f1["single"])],
        ["F1 of the set of names, compounds", average(f1["compound"])],
        ["95 % intervals of effects hold the truth, where the name is right", percent(result["coverage"]["effects"])],
        ["95 % intervals of the base hold the truth, where the name is right", percent(result["coverage"]["base"])],
        ["share of the oracle's held-out gain, median", _share(result["oracle_share"])],
        ["seconds a case, median and largest", f"{_number(seconds['median'])}, {_number(seconds['largest'])}"],
    ]
    return _table(["", ""], rows)


def _share(found: Mapping[str, Any]) -> str:
    if not found["asked"]:
        return "not measured: no oracle"
    counts = f"n = {found['n']}; {found['too_little']} gain too little, {found['errors']} oracles failed"
    return f"{_number(found['median'])} ({counts})"


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


def _outside(found: Mapping[str, Any]) -> list[str]:
    """Tables of the family outside the library."""
    rows = [[title, percent(found["rates"][key])] for key, title in OUTSIDE.items() if found["rates"][key]["n"]]
    rows.append(
        ["share of the oracle's held-out gain, median where it gains over 1 point", _number(found["share"]["median"])]
    )
    nats = [
        [row["nats"], *(percent(row[key]) for key in ("found", "sure_wrong", "silent"))] for row in found["by_nats"]
    ]
    header = ["Outside the library", "slot", "memory", "n", "found", "formula", "sure and wrong", "silent",
              "median nats", "left by the nearest name", "oracle gains", "gained", "said"]  # fmt: skip
    kinds = [
        [row["kind"].removeprefix("outside."), row["slot"], "yes" if row["memory"] else "",
         *(str(row[key]) for key in ("n", "found", "formula", "sure_wrong", "silent")),
         *(_number(row[key]) for key in ("median_nats", "median_left", "median_oracle_gain", "median_gain")),
         ", ".join(row["said"])]
        for row in found["by_kind"]
    ]  # fmt: skip
    return [
        _table(["Outside the library", "hoopd diagnose"], rows),
        _table(["nats", "found at its slot", "sure and wrong", "silent"], nats),
        _table(header, kinds),
    ]


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
