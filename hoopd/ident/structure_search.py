"""Which structure describes data best: every family and order fitted on one part, judged on another, told in words.

The training data are split in time: candidates are fitted to the first part and scored on the rest, one step ahead, ten
steps ahead and in simulation. The best by the mean of the three is fitted again to all of the data. Of candidates that
are as good to within `EQUAL` points the one with the fewest parameters is taken, and never one whose simulation grows
without bound while another's does not.

Rules of this file: no threshold looks at anything but scores; a candidate that cannot be fitted is left out and told.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.information_criteria import parameters_of
from hoopd.ident.measures import fit_percent
from hoopd.ident.polynomial.arx import arx, varx
from hoopd.ident.polynomial.delay import delay
from hoopd.ident.polynomial.pem import armax, bj, oe
from hoopd.ident.prediction import predict
from hoopd.ident.stacked_models import stack
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.subspace import subspaceid

Array = NDArray[np.float64]
Fit = Callable[[list[Data]], IdentifiedModel]

HORIZONS = {"1 step": 1.0, "10 steps": 10.0, "simulation": math.inf}
# Of the training data, for the choice.
HELD_SHARE = 0.3
# Points within which two fits are alike.
EQUAL = 0.5
# Fits below this count as this: worse than the mean by so much is as useless as any.
WORST = -100.0
FAMILIES = ("arx", "armax", "oe", "bj", "subspace", "pem")
# Orders that are tried by family: cheap ones densely.
ORDERS = {"arx": (1, 2, 3, 4, 6, 8, 10), "subspace": (1, 2, 3, 4, 5, 6, 8, 10), "pem": (), "other": (1, 2, 3, 4)}
# A dead time is looked for up to so many samples, by a model of the first input of each output.
LONGEST_DELAY = 20


@dataclass(frozen=True)
class StructureCandidate:
    """A structure by name, its fit percent (mean over the outputs) by horizon on held-back data, its parameters.

    `stable`: whether its simulation stays finite; `model`: as fitted to the first part of the data.
    """

    name: str
    family: str
    fit: Mapping[str, float]
    parameters: int
    stable: bool
    model: IdentifiedModel

    @property
    def score(self) -> float:
        """Mean of the fits at the three horizons, each at least -100."""
        return float(np.mean([max(one, WORST) for one in self.fit.values()]))


@dataclass(frozen=True, repr=False)
class StructureSearch:
    """All candidates, the best first; the `model` of the best, fitted to all data; what cannot be fitted, and why."""

    candidates: tuple[StructureCandidate, ...]
    model: IdentifiedModel
    failed: Mapping[str, str]
    delays: Mapping[str, int]

    @property
    def best(self) -> StructureCandidate:
        """The one that is recommended."""
        return self.candidates[0]

    @property
    def recommendation(self) -> str:
        """What was chosen and why, in sentences."""
        return " ".join(_sentences(self))

    def table(self, most: int = 12) -> str:
        """The best candidates as text."""
        head = ("structure", "parameters", *HORIZONS, "mean")
        rows = [
            (one.name, str(one.parameters), *(_percent(one.fit[name]) for name in HORIZONS), _percent(one.score))
            for one in self.candidates[:most]
        ]
        width = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
        return "\n".join(
            "  ".join(
                cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, width, strict=True))
            )
            for row in (head, *rows)
        )

    def __repr__(self) -> str:
        return f"{self.table()}\n{self.recommendation}"


def identify(
    data: Data | Sequence[Data], *, families: Sequence[str] = FAMILIES, most_order: int = 10, direct: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> StructureSearch:  # fmt: skip
    """Find the structure and order that describe data best, by data held back inside them.

    ARX, ARMAX, output error, Box-Jenkins and state space of several orders are fitted to the first 70 % and scored on
    the rest one step ahead, ten steps ahead and in simulation; the best by the mean is fitted again to all.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments with an input; of several each is split.
    families : sequence of {"arx", "armax", "oe", "bj", "subspace", "pem"}
        Which are tried.
    most_order : int
        Largest order.
    direct : bool
        Whether models are tried, too, that answer in the sample in which an input acts; no control law can use them.
    progress : callable
        Told what is being fitted.

    Returns
    -------
    StructureSearch
        The `candidates`, the best first, its `model`, a `table()` and a `recommendation` in words; it prints as both.

    Raises
    ------
    ValueError
        No input, a family that is none, or data that no structure can be fitted to.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import identify, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 600))
    >>> y = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.5 * e  # white noise on the output: output error
    >>> found = identify(iddata(y, u, 0.1), families=["arx", "oe"], most_order=3)
    >>> found.best.name
    'oe 2,2'
    """
    each = experiments(data)
    _check(each, families)
    first = [one[: round(one.n * (1.0 - HELD_SHARE))] for one in each]
    held = [one[round(one.n * (1.0 - HELD_SHARE)) :] for one in each]
    delays = _delays(first)
    late = {*delays.values(), 1} | ({0} if direct else set())
    found, failed = _candidates(_fits(families, most_order, late), first, held, progress)
    if "pem" in families:
        more, why = _candidates(_refined(found, most_order), first, held, progress)
        found, failed = [*found, *more], failed | why
    if not found:
        raise ValueError(f"no structure can be fitted: {next(iter(failed.values()), 'no order asked for')}")
    ranked = _ranked(found)
    fits = dict(_fits(families, most_order, late)) | dict(_refined(found, most_order))
    for one in ranked:
        progress(f"fitting {one.name} to all data")
        try:
            return StructureSearch(
                (one, *(other for other in ranked if other is not one)), fits[one.name](each), failed, delays
            )
        except (ValueError, ArithmeticError) as error:
            failed[one.name] = str(error)
    raise ValueError("no structure can be fitted to all of the data")


# ------------------------------------------------------------------------------------------------- candidates


def _check(each: Sequence[Data], families: Sequence[str]) -> None:
    if unknown := [one for one in families if one not in FAMILIES]:
        raise ValueError(f"families are {', '.join(FAMILIES)}, not {unknown[0]!r}")
    if each[0].nu == 0:
        raise ValueError("no input: there is nothing to find the response to (ar, arma tell a signal without one)")


def _fits(families: Sequence[str], most: int, late: set[int]) -> Iterator[tuple[str, Fit]]:
    """Names and fits of what is tried; `late`: delays in samples, 0 a direct term."""
    for family in families:
        for order in ORDERS.get(family, ORDERS["other"]):
            if order <= most:
                for k in sorted(late & {0, 1} if family == "subspace" else late):
                    yield _fit_of(family, order, k)
    if "subspace" in families:
        yield "subspace, order by the data", subspaceid


def _fit_of(family: str, n: int, k: int) -> tuple[str, Fit]:
    words = f", delay {k}" if k > 1 else ", direct" if k == 0 else ""
    if family == "arx":
        return f"arx {n},{n}{words}", lambda data: _arx(data, n, k)
    if family == "armax":
        return f"armax {n},{n},{n}{words}", lambda data: _by_output(data, lambda one: armax(one, n, n, n, k))
    if family == "oe":
        return f"oe {n},{n}{words}", lambda data: _by_output(data, lambda one: oe(one, n, n, k))
    if family == "bj":
        return f"bj {n},{n},{n}{words}", lambda data: _by_output(data, lambda one: bj(one, n, n, n, n, k))
    return f"subspace, order {n}{words}", lambda data: subspaceid(data, n, direct=k == 0)


def _refined(found: Sequence[StructureCandidate], most: int) -> Iterator[tuple[str, Fit]]:
    """Prediction errors of the two best orders of the subspace models."""
    own = sorted((one for one in found if one.family == "subspace"), key=lambda one: -one.score)
    forms = [one.model.state_space for one in own]
    for order, direct in list(dict.fromkeys((form.nx, bool(form.d.any())) for form in forms))[:2]:
        yield _pem_of(order, direct)


def _pem_of(order: int, direct: bool) -> tuple[str, Fit]:
    return f"pem, order {order}{', direct' if direct else ''}", lambda data: pem(data, order, direct=direct)


def _arx(each: list[Data], n: int, k: int) -> IdentifiedModel:
    return arx(each, n, n, k) if each[0].ny == 1 else varx(each, n, n, k)


def _by_output(each: list[Data], fit: Callable[[list[Data]], Any]) -> IdentifiedModel:
    if each[0].ny == 1:
        return fit(each)  # type: ignore[no-any-return]
    return stack([fit([one.channels([i]) for one in each]) for i in range(each[0].ny)])


def _delays(each: Sequence[Data]) -> dict[str, int]:
    """Dead times in samples from the first input to each output, those beyond one."""
    found = {}
    for name in each[0].outputs:
        part = [one.channels([name]) for one in each]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", IdentificationWarning)
                told = delay(part, longest=min(LONGEST_DELAY, each[0].n // 20))
        except (ValueError, ArithmeticError):
            continue
        if told.interval[0] > 1:
            found[name] = int(told.samples)
    return found


def _candidates(
    fits: Iterator[tuple[str, Fit]], first: list[Data], held: Sequence[Data], progress: Callable[[str], None]
) -> tuple[list[StructureCandidate], dict[str, str]]:
    found, failed = [], {}
    for name, fit in fits:
        progress(f"fitting {name}")
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                found.append(_candidate(name, fit(first), held))
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            failed[name] = str(error)
    return found, failed


def _candidate(name: str, model: IdentifiedModel, held: Sequence[Data]) -> StructureCandidate:
    y = np.concatenate([one.y for one in held])
    fit = {}
    for words, horizon in HORIZONS.items():
        said = np.concatenate([predict(model, one, horizon) for one in held])
        percent = fit_percent(y, np.nan_to_num(said, nan=np.inf, posinf=np.inf, neginf=-np.inf))
        fit[words] = float(np.mean(np.maximum(np.nan_to_num(percent, nan=-np.inf), 10.0 * WORST)))
    stable = bool((np.abs(np.linalg.eigvals(model.state_space.a)) < 1.0 + 1e-9).all())
    family = name.replace(",", " ").split()[0]
    return StructureCandidate(name, family, fit, parameters_of(model), stable, model)


def _ranked(found: Sequence[StructureCandidate]) -> list[StructureCandidate]:
    """The best first: stable ones before others, the simplest of those that are alike, then by score."""
    stable = [one for one in found if one.stable] or list(found)
    top = max(one.score for one in stable)
    alike = [one for one in stable if one.score >= top - EQUAL]
    best = min(alike, key=lambda one: (one.parameters, -one.score))
    return [best, *sorted((one for one in found if one is not best), key=lambda one: (not one.stable, -one.score))]


# ------------------------------------------------------------------------------------------------- in words


def _sentences(found: StructureSearch) -> Iterator[str]:
    best = found.best
    fits = ", ".join(f"{_percent(best.fit[name])} % {_ahead(name)}" for name in HORIZONS)
    yield f"Take {best.name}: on data held back from its fit it tells {fits}, with {best.parameters} parameters."
    top = max(found.candidates, key=lambda one: (one.stable, one.score))
    if top is not best:
        better = top.score - best.score
        yield f"{top.name} is {better:.1f} points better in the mean and has {top.parameters} parameters."
    simulating = max(
        (one for one in found.candidates if one.stable), key=lambda one: one.fit["simulation"], default=best
    )
    if simulating.fit["simulation"] > best.fit["simulation"] + EQUAL:
        yield f"Only to simulate, {simulating.name} is better ({_percent(simulating.fit['simulation'])} %)."
    predicting = max(found.candidates, key=lambda one: one.fit["1 step"])
    if predicting.fit["1 step"] > best.fit["1 step"] + EQUAL:
        yield f"Only to predict one step, {predicting.name} is better ({_percent(predicting.fit['1 step'])} %)."
    if not best.stable:
        yield "No structure that was tried is stable: its simulation grows without bound."
    if best.fit["1 step"] - best.fit["simulation"] > 30.0:
        yield "It predicts much better than it simulates: disturbances that no input tells of drive the output."
    if best.name.endswith("direct"):
        yield (
            "It answers in the sample in which its input acts: a law needs a model that does not (direct=False, "
            "--no-direct)."
        )
    for output, samples in found.delays.items():
        yield f"{output} answers {samples} samples after its input."


def _ahead(name: str) -> str:
    return "in simulation" if name == "simulation" else f"{name} ahead"


def _percent(value: float) -> str:
    return f"{value:.1f}" if value > WORST else "diverges" if value <= 10.0 * WORST else f"{value:.0f}"
