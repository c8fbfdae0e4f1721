"""A result in a table that can be read, and the same as plain data: estimates, standard errors, poles, fit, warnings.

Rules of this file: plain numbers and words; what a model does not know is left out, never made up; data of the fit are
predicted when a summary is asked for, not before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hoopd.ident.data import Data, experiments
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.model_forms import root_form

# Estimates and poles that are printed; the data hold all of them.
MOST_ROWS = 40
HORIZONS = {"1 step": 1.0, "10 steps": 10.0, "simulation": math.inf}
# Entries of matrices are a choice of basis: the data hold them, the table shows what they mean.
MATRIX_ENTRY = "a[0,0]"
# Samples of each experiment on which a fit is taken: more change it by less than it tells.
MOST_SAMPLES = 20_000


class Summary(dict[str, Any]):
    """Plain data by name (`summary["estimates"]["a1"]["value"]`); as text, a table."""

    def __str__(self) -> str:
        return "\n".join(_lines(self))

    __repr__ = __str__


def summary(model: Any, data: Data | Sequence[Data] | None = None) -> Summary:
    """Sum a result up: what was estimated how, how well it is known, how well it fits, what to beware of.

    Parameters
    ----------
    model : any model
        A result of this package.
    data : Data or sequence of Data, optional
        Other data, on which the fit is told too.

    Returns
    -------
    Summary
        A dictionary that prints as a table: `method`, `samples`, `estimates` by name with `value` and
        `standard_error`, `poles`, `stable`, `noise_covariance`, `fit_percent`, `choices`, `warnings`.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arx, iddata, summary
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.1 * e)
    >>> summary(arx(iddata(y, u, dt=0.1), na=1, nb=1))
    ARX from 1000 samples: y by u, step 0.1 s
      estimate   value  standard error
      a1        -0.800           0.001
      b1         2.003           0.003
      pole       |z|  standard error
      +0.7998  0.800           0.001
    stable; standard deviation of the innovations: y 0.102
    fit on the data of the estimation, 1 step: y 96.9 %; 10 steps: y 94.9 %; simulation: y 94.8 %
    """
    report = getattr(model, "report", None)
    system = _system(model)
    found = Summary(model=type(model).__name__)
    if report is not None:
        found["method"] = report.method
        found["samples"] = sum(one.n for one in report.data if hasattr(one, "n"))
    found |= _channels(model, system)
    found["estimates"] = estimates(model)
    if system is not None:
        found |= _poles(model)
    if (r := _noise(model)) is not None:
        found["noise_covariance"] = r
    fits = {"estimation": [] if report is None else [one for one in report.data if isinstance(one, Data)]}
    if data is not None:
        fits["validation"] = experiments(data)
    found["fit_percent"] = {name: _fit(model, each) for name, each in fits.items() if each}
    found["choices"] = [] if report is None else list(report.choices)
    found["warnings"] = [] if report is None else list(report.warnings)
    return found


def estimates(model: Any) -> dict[str, dict[str, float | None]]:
    """Values and standard errors by name; a result that was not estimated has none."""
    if hasattr(model, "rows"):
        return {
            f"{name} ({output})": one
            for output, row in zip(model.outputs, model.rows, strict=True)
            for name, one in estimates(row).items()
        }
    parameters = getattr(model, "parameters", None)
    names, values = getattr(model, "names", ()), getattr(model, "values", ())
    own = dict(parameters) if parameters is not None else dict(zip(names, np.asarray(values).tolist(), strict=False))
    errors = model.deviations() if hasattr(model, "deviations") else {}
    return {
        name: {"value": float(value), "standard_error": _number(errors.get(name))} for name, value in own.items()
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------- what is told


def _system(model: Any) -> Any:
    """The linear form, where there is one."""
    if isinstance(model, FreeModel):
        return None
    try:
        return model.state_space
    except ValueError:
        return None


def _channels(model: Any, system: Any) -> dict[str, Any]:
    own = model if system is None else system
    outputs, inputs = getattr(own, "outputs", ()), getattr(own, "inputs", ())
    found: dict[str, Any] = {"outputs": list(outputs), "inputs": list(inputs)}
    if system is not None:
        found |= {"step_s": system.dt, "states": system.nx}
    return found


def _poles(model: Any) -> dict[str, Any]:
    from hoopd.ident.confidence import pole_spread

    own = root_form(model)
    if own.dt > 0.0 and not np.triu(own.a).any():
        return {"poles": [], "stable": True}  # all at zero: a finite impulse response
    spread = pole_spread(model)
    roots = np.linalg.eigvals(own.a) if spread is None else spread.roots
    order = np.argsort(-np.abs(roots), kind="stable")
    poles = []
    for i in order:
        z = complex(roots[i])
        sd = None if spread is None else math.sqrt(max(float(np.trace(spread.covariances[i])), 0.0))
        poles.append({"re": z.real, "im": z.imag, "modulus": abs(z), "standard_error": _number(sd)})
    stable = bool((roots.real < 0.0).all() if own.dt == 0.0 else (np.abs(roots) < 1.0).all())
    return {"poles": poles, "stable": stable, "plane": "s" if own.dt == 0.0 else "z"}


def _noise(model: Any) -> list[list[float]] | None:
    if hasattr(model, "variance") and np.ndim(model.variance) == 0:
        return [[float(model.variance)]] if model.variance > 0.0 else None
    r = getattr(model, "r", None)
    return None if r is None else np.asarray(r).tolist()


def _fit(model: Any, each: Sequence[Data]) -> dict[str, dict[str, float]]:
    from hoopd.ident.measures import fit_percent
    from hoopd.ident.prediction import predict

    part = [one[:MOST_SAMPLES] for one in each]
    y, found = np.concatenate([one.y for one in part]), {}
    for name, horizon in HORIZONS.items():
        with np.errstate(all="ignore"):
            said = np.concatenate([predict(model, one, horizon) for one in part])
            percent = fit_percent(y, said)
        found[name] = {output: float(p) for output, p in zip(each[0].outputs, percent, strict=True) if np.isfinite(p)}
    return found


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


# ------------------------------------------------------------------------------------------------- as text


def _lines(said: Mapping[str, Any]) -> Iterator[str]:
    step = f", step {said['step_s']:g} s" if said.get("step_s") else ""
    by = f" by {', '.join(said['inputs'])}" if said["inputs"] else ""
    of = f" from {said['samples']} samples" if said.get("samples") else ""
    yield f"{said.get('method', said['model'])}{of}: {', '.join(said['outputs']) or 'outputs'}{by}{step}"
    rows = [(name, one["value"], one["standard_error"]) for name, one in said["estimates"].items()]
    if rows and rows[0][0] != MATRIX_ENTRY:
        yield from _table("estimate", "value", [(name, *_pair(value, sd)) for name, value, sd in rows])
    poles = said.get("poles", [])
    if poles:
        size = "|s|" if said["plane"] == "s" else "|z|"
        yield from _table(
            "pole", size, [(_complex(one), *_pair(one["modulus"], one["standard_error"])) for one in poles]
        )  # fmt: skip
    yield from _judgement(said)
    for where, fits in said["fit_percent"].items():
        on = "the data of the estimation" if where == "estimation" else "validation data"
        yield f"fit on {on}, " + "; ".join(f"{name}: {_percents(one)}" for name, one in fits.items())
    yield from said["choices"]
    yield from (f"warning: {one}" for one in said["warnings"])


def _judgement(said: Mapping[str, Any]) -> Iterator[str]:
    words = []
    if "stable" in said:
        words.append("stable" if said["stable"] else "UNSTABLE: a simulation grows without bound")
    if "noise_covariance" in said:
        sd = np.sqrt(np.maximum(np.diag(said["noise_covariance"]), 0.0))
        names = said["outputs"] or [f"y{i + 1}" for i in range(len(sd))]
        each = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, sd, strict=False))
        words.append(f"standard deviation of the innovations: {each}")
    if words:
        yield "; ".join(words)


def _table(head: str, value: str, rows: Sequence[tuple[str, str, str]]) -> Iterator[str]:
    kept = list(rows[:MOST_ROWS])
    lines = [(head, value, "standard error" if any(sd for *_, sd in kept) else ""), *kept]
    first, second, third = (max(len(row[i]) for row in lines) for i in range(3))
    for name, number, sd in lines:
        yield f"  {name.ljust(first)}  {number.rjust(second)}  {sd.rjust(third)}".rstrip()
    if len(rows) > len(kept):
        yield f"  ... and {len(rows) - len(kept)} more"


def _pair(value: float, sd: float | None) -> tuple[str, str]:
    """A value to the digit of its standard error's first one."""
    if sd is None or sd <= 0.0 or not math.isfinite(value):
        return f"{value:.4g}", "" if not sd else f"{sd:.1g}"
    digits = -math.floor(math.log10(float(f"{sd:.1g}")))
    if abs(value) < 1e-4 or abs(value) >= 1e6 or digits > 9:
        return f"{value:.4g}", f"{sd:.1g}"
    digits = max(digits, 0)
    return f"{value:.{digits}f}", f"{sd:.{digits}f}"


def _complex(pole: Mapping[str, float]) -> str:
    re, im = pole["re"], pole["im"]
    return f"{re:+.4g}" if im == 0.0 else f"{re:+.4g}{im:+.4g}j"


def _percents(by_output: Mapping[str, float]) -> str:
    if not by_output:
        return "diverges"
    return ", ".join(f"{name} {percent:.1f} %" for name, percent in by_output.items())
