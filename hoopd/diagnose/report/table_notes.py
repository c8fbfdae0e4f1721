"""What the columns of a diagnosis's tables are, in sentences below them.

Rules of this file: nothing is judged here, only said; a sentence about a table that is not there is empty.
"""

from __future__ import annotations

from collections.abc import Sequence

from hoopd.diagnose.record import Diagnosis, EffectFinding, FitTable
from hoopd.diagnose.report.sentences import each_fit
from hoopd.plots.number_format import listed, nats


def checks_sentence(diagnosis: Diagnosis) -> str:
    """What the columns of the table of tests are; empty where nothing was tested."""
    tested = [one for one in diagnosis.effects if one.ablation is not None or one.placebo is not None]
    if not tested:
        return ""
    return (
        "Fit: points of NRMSE that simulations of held-out data gain by the finding; readings: nats that the same data "
        "gain, reading by reading; taken out: nats that the data fitted to lose without it; shuffled: a placebo, the "
        f"effect with its cause in another order{_shuffles(tested)}."
    )


def _shuffles(tested: Sequence[EffectFinding]) -> str:
    """What the best shuffle of each gains, beside what chance may give it, and what the effect then needs."""
    told = []
    for one in tested:
        most, limit = (None, None) if one.placebo is None else (one.placebo.most, one.placebo.limit)
        if most is not None and limit is not None and one.placebo is not None:
            needed = one.evidence.threshold
            more = "" if one.placebo.held or needed is None else f", so that it needs {nats(needed * most / limit)}"
            told.append(f"{nats(most)} nats for {one.name}, by chance up to {nats(limit)}{more}")
    return f" (the best of several gains {listed(told)})" if told else ""


def columns_sentence(fit: FitTable) -> str:
    """Which model each column of the tables of fits is; empty without a table."""
    if not fit.heldout:
        return ""
    rows = [one for *_, one in each_fit(fit.heldout)]
    curves = any(one.ceiling is not None for one in rows)
    saved = any(one.written is not None for one in rows)
    return (
        "Nominal: your model as it is; re-fitted: with its parameters estimated again; + effects: with the findings, "
        "too; "
        + ("saved model: with those of them that --write puts into a model; " if saved else "")
        + "noise floor: what a perfect model would reach"
        + (
            "; free curves: what a free curve over one variable reaches in place of laws, which is no bound."
            if curves
            else "."
        )
    )
