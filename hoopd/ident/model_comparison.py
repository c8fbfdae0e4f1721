"""Models side by side: fit in percent on validation data by horizon, criteria on the data of each one's own fit.

Rules of this file: nothing is fitted; a model that cannot tell a figure has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.information_criteria import Criteria, criteria, parameters_of
from hoopd.ident.measures import fit_percent
from hoopd.ident.model_forms import named_models
from hoopd.ident.prediction import Start, predict, prediction_error

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compared:
    """A model's fit percent (ny,) on validation data by horizon, its criteria on the data that it was fitted to.

    Infinity is simulation. `criteria`: None without the data of the fit: a penalty for fitted parameters has no meaning
    on data that nothing was fitted to.
    """

    name: str
    percent: Mapping[float, Array]
    criteria: Criteria | None


class ModelComparison(list[Compared]):
    """Models side by side; as text, a table."""

    def __str__(self) -> str:
        return table(self)

    __repr__ = __str__


def compare(
    models: Any,
    validation: Data | Sequence[Data],
    horizons: float | Sequence[float] = (1, 10, np.inf),
    x0: Start = "estimate",
    *,
    estimation: Data | Sequence[Data] | None = None,
) -> ModelComparison:
    """Compare models by their fit on data that none of them was fitted to, and by criteria on the data of the fit.

    Parameters
    ----------
    models : mapping of str to any model, sequence of models, or a model
        Results of this package, python-control systems or FRDs; without names they are called as their estimators.
    validation : Data or sequence of Data
        Data that nothing was fitted to.
    horizons : int or inf, or sequence of them
        Samples ahead; infinity is simulation.
    x0 : {"estimate", "zero"} or array_like, shape (nx,)
        The initial state.
    estimation : Data or sequence of Data, optional
        The data of the fit, for the criteria: a penalty for fitted parameters has no meaning elsewhere. Without it
        they are those that the result itself was made from; a model that knows none has no criteria.

    Returns
    -------
    ModelComparison
        A list of `Compared`, by model its `name`, its fit `percent` (ny,) by horizon and its `criteria`; it prints as
        a table.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, compare, iddata, simulate
    >>> good, bad = (Polynomials(0.1, np.array([1.0, -a]), (np.array([0.0, 1.0]),), variance=0.1) for a in (0.8, 0.6))
    >>> u = np.random.default_rng(0).standard_normal(500)
    >>> data = iddata(simulate(good, iddata(u, u, 0.1), "zero", seed=1), u, 0.1)
    >>> first, second = compare({"good": good, "bad": bad}, data, horizons=[1, np.inf])
    >>> bool(first.percent[1] > second.percent[1]), bool(first.percent[np.inf] > second.percent[np.inf])
    (True, True)
    """
    held = experiments(validation)
    fitted = [] if estimation is None else experiments(estimation)
    y = np.concatenate([one.y for one in held])
    found, ahead = ModelComparison(), [horizons] if isinstance(horizons, int | float | np.number) else [*horizons]
    for name, model in named_models(models).items():
        with np.errstate(over="ignore", invalid="ignore"):
            said = {h: np.concatenate([predict(model, one, h, x0) for one in held]) for h in ahead}
            percent = {h: fit_percent(y, one) for h, one in said.items()}
        found.append(Compared(name, percent, _criteria(model, fitted or _own_data(model), x0)))
    return found


def table(compared: Sequence[Compared]) -> str:
    """Write compared models as text, a row a model; the columns say what they were taken on.

    Parameters
    ----------
    compared : sequence of Compared
        What `compare` gives.

    Returns
    -------
    str
        Lines of columns.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, compare, iddata, simulate, table
    >>> model = Polynomials(0.1, np.array([1.0, -0.8]), (np.array([0.0, 1.0]),))
    >>> u = np.random.default_rng(0).standard_normal(200)
    >>> data = iddata(simulate(model, iddata(u, u, 0.1), "zero"), u, 0.1)
    >>> print(table(compare({"true": model}, data, horizons=[np.inf])))
    model  fit %, simulated (validation)  AICc (estimation)  BIC (estimation)  FPE (estimation)
    true   100.0                          -                  -                 -
    """
    horizons = list(dict.fromkeys(h for one in compared for h in one.percent))
    head = ["model", *(_column(h) for h in horizons), *(f"{name} (estimation)" for name in ("AICc", "BIC", "FPE"))]
    rows = [[one.name, *(_percents(one.percent.get(h)) for h in horizons), *_numbers(one.criteria)] for one in compared]
    width = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    return "\n".join(
        "  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip() for row in (head, *rows)
    )


def _own_data(model: Any) -> list[Data]:
    report = getattr(model, "report", None)
    return [] if report is None else [one for one in report.data if isinstance(one, Data)]


def _criteria(model: Any, fitted: Sequence[Data], x0: Start) -> Criteria | None:
    if not fitted:
        return None
    e = np.concatenate([prediction_error(model, one, 1, x0) for one in fitted])
    d = parameters_of(model)
    return criteria(e, d) if int(np.isfinite(e).all(axis=1).sum()) > d + 1 else None


def _column(horizon: float) -> str:
    return f"fit %, {'simulated' if horizon == np.inf else f'{horizon:g} ahead'} (validation)"


def _percents(values: Array | None) -> str:
    return "-" if values is None else " ".join(f"{one:.1f}" for one in values)


def _numbers(found: Criteria | None) -> list[str]:
    return ["-"] * 3 if found is None else [f"{found.aicc:.1f}", f"{found.bic:.1f}", f"{found.fpe:.4g}"]
