"""The campaign's tables: a row a kind, over all its trials; the lies that nothing tells stand apart.

Rules of this file: prints and judges nothing; what a kind's trials say is their worst, and the message of the first.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import isnan, nan
from statistics import median

from .judging import Verdict
from .trials import Way

HEAD = (
    f"{'kind':<24} {'rule':<8} {'passed':>7} {'from':>7} {'deadline':>8} {'zero at':>9} {'worst':>9} {'max N m':>8}"
    f" {'rad/s':>6} {'replay':>7}  message, what is wrong"
)
HEAD_UNTOLD = f"{'lies that nothing tells':<24} {'trials':>7} {'N m then':>9} {'rad/s':>6} {'ball off':>9}  ended by"


def show(verdicts: list[Verdict], took_s: float, way: Way) -> None:
    """Both tables and the sum."""
    by_kind: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        by_kind.setdefault(verdict.kind, []).append(verdict)
    judged = {name: rows for name, rows in by_kind.items() if rows[0].outcome != "untold"}
    print(HEAD)
    for name, rows in judged.items():
        print(_judged(name, rows))
    if len(judged) < len(by_kind):
        print(f"\n{HEAD_UNTOLD}")
        for name in (name for name in by_kind if name not in judged):
            print(_untold(name, by_kind[name]))
    failed = sum(bool(verdict.wrong) for verdict in verdicts)
    again = sum(verdict.attempts - 1 for verdict in verdicts)
    repeated = f", {again} repeated for the machine's sake" if again else ""
    print(f"\n{len(by_kind)} kinds, {len(verdicts)} trials, {failed} failed{repeated}, {took_s:.0f} s, {way}")


def _judged(name: str, rows: list[Verdict]) -> str:
    first, wrong = rows[0], [row for row in rows if row.wrong]
    on = first.outcome == "goes on"
    zeros = [row.zero_s for row in rows]
    cells = (
        f"{name:<24} {first.outcome:<8} {len(rows) - len(wrong):>3}/{len(rows):<3} {first.began_s:>5.2f} s"
        f" {'-' if on else f'{first.deadline_s:.3f} s':>8} {'went on' if on else f'{median(zeros):.3f} s':>9}"
        f" {'-' if on else f'{max(zeros):.3f} s':>9} {_most(row.max_torque_nm for row in rows):>8.3f}"
        f" {_most(row.max_speed_rad_s for row in rows):>6.1f} {'equal' if all(row.opens for row in rows) else 'NO':>7}"
    )
    told = [f"FAILED (trial {row.trial}): {'; '.join(row.wrong)}" for row in wrong[:3]]
    return "  ".join((cells, first.message, *told))


def _untold(name: str, rows: list[Verdict]) -> str:
    ended = [row for row in rows if row.message]
    by = f"{len(ended)} times, first: {ended[0].message}" if ended else "nothing"
    wrong = [f"FAILED (trial {row.trial}): {'; '.join(row.wrong)}" for row in rows if row.wrong]
    cells = (
        f"{name:<24} {len(rows):>7} {_most(row.late_torque_nm for row in rows):>9.3f}"
        f" {_most(row.max_speed_rad_s for row in rows):>6.1f} {_most(row.ball_off_rad for row in rows):>9.3f}"
    )
    return "  ".join((cells, by, *wrong[:3]))


def _most(values: Iterable[float]) -> float:
    """The largest; NaN when there is none."""
    return max((value for value in values if not isnan(value)), default=nan)
