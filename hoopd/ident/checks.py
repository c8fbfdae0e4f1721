"""What may be wrong with data, said by name: no method of this room gives a bad model silently.

An error where there is nothing to identify, an `IdentificationWarning` where the answer is doubtful. Here is what can
be told from the channels alone; `loopchecks` knows feedback and drift, `modelchecks` what is wrong with a result.

Rules of this file: one function a cause; a threshold is a level of significance or of the arithmetic, and stands with
its reason; nothing is corrected here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import IdentificationWarning, warn  # noqa: F401
from hoopd.ident.lagged import lagged_gram

Array = NDArray[np.float64]

# Eigenvalue of a Gram matrix below so much of the largest: nothing but rounding is left of that direction.
SINGULAR = 1e-11
# The same of the singular values of a matrix itself, which rounding leaves smaller.
DEPENDENT = 1e-12
# Rounding of a constant that went through other units.
CONSTANT = 1e-12
# Eigenvalue of the Gram matrix of derivatives of unit length below which the errors do not feel a direction.
UNFELT = 1e-10
LOOSE_SHARE = 0.1  # of a direction of unit length that a parameter takes part in
# A response at all frequencies, or over any number of lags, is asked for an input of this order: ten lines.
BROAD = 20


@dataclass(frozen=True)
class Orders:
    """What a method asks of data: free `parameters` of one output, `lags` of the inputs to tell apart, samples `lost`.

    `lost`: samples at the start of an experiment that give no equation.
    """

    parameters: int
    lags: int = 0
    lost: int = 0


def check(data: Data | Sequence[Data], *, orders: Orders) -> None:
    """Stop at data that cannot give a model of these orders, warn of data that hardly can.

    ValueError: a channel that is constant, missing or not finite; too few samples. IdentificationWarning: inputs that
    do not excite so many lags.
    """
    each = experiments(data)
    check_channels(each)
    _samples(each, orders)
    for said in _excitation(each, orders.lags):
        warn(said)


def check_channels(each: Sequence[Data]) -> None:
    """ValueError on a channel that is constant or was never measured, on infinite samples, on gaps in an input."""
    first = each[0]
    for kind, names in (("output", first.outputs), ("input", first.inputs)):
        parts = [one.y if kind == "output" else one.u for one in each]
        for i, name in enumerate(names):
            trouble = _trouble([part[:, i] for part in parts], gaps=kind == "output")
            if trouble:
                raise ValueError(f"{kind} {name} {trouble}")


def check_regressors(columns: Array, names: Sequence[str]) -> None:
    """Warn when columns (m, p) of a regression, or its triangular factor (p, p), depend on each other."""
    weak = dependent(columns)
    if len(weak):
        said = ", ".join(names[i] for i in weak)
        warn(
            f"the regressors of {said} depend on each other, so the smallest coefficients that fit are taken: the "
            "order is too high for data so free of noise, or the input excites too little"
        )  # fmt: skip


def check_determined(gram: Array, names: Sequence[str]) -> None:
    """Warn of the parameters of a combination that the errors do not feel; `gram` is J'J of columns of unit length.

    `names`: of the first columns; the rest belong to initial states, which are no finding where they alone are loose.
    """
    values, vectors = np.linalg.eigh(gram)
    if len(values) and values[0] < UNFELT * values[-1]:
        part = np.abs(vectors[: len(names), 0])
        if float(np.linalg.norm(part)) < LOOSE_SHARE:
            return
        largest = float(part.max())
        loose = [name for name, share in zip(names, part, strict=True) if share > LOOSE_SHARE * largest]
        warn(
            f"the data do not determine a combination of {', '.join(loose)}: too many "
            "parameters or an input that excites too little; their covariance leaves it out"
        )  # fmt: skip


def unsettled(steps: int) -> None:
    """Warn that a search ended by its number of steps."""
    warn(
        f"the search has not settled after {steps} steps: the result is no minimum; allow more, start nearer, or take a"
        " lower order"
    )


# ------------------------------------------------------------------------------------------------- statistics


def dependent(columns: Array) -> NDArray[np.intp]:
    """Columns of a matrix (m, p) that take part in its null directions; none when its rank is full."""
    scale = np.sqrt((columns**2).sum(axis=0))
    dead = np.flatnonzero(scale <= 0.0)
    if len(dead):
        return dead
    values, vectors = np.linalg.svd(columns / scale, full_matrices=False)[1:]
    null = np.abs(vectors[values < DEPENDENT * values[0]])
    return np.flatnonzero((null > 0.1 * null.max(axis=1, initial=0.0, keepdims=True)).any(axis=0))


def excitation(u: Array | Sequence[Array], lags: int) -> int:
    """How many of `lags` consecutive values of each of the inputs (n, nu) are independent, nu * lags when all are.

    Several experiments count together. Source: rank of the sample covariance of the lagged input (Ljung, System
    Identification, 1999, definition 13.1).
    """
    parts = [one for one in ([u] if isinstance(u, np.ndarray) else u) if len(one) > lags]
    if lags < 1 or not parts or parts[0].shape[1] == 0:
        return 0
    size = np.sqrt(np.sum([np.square(one).sum(axis=0) for one in parts], axis=0))
    scale, spans = np.where(size > 0.0, size, 1.0), [range(lags)] * len(size)
    grams = [
        lagged_gram([np.ascontiguousarray(column) for column in (one / scale).T], spans, lags - 1) for one in parts
    ]
    values = np.linalg.eigvalsh(np.sum(grams, axis=0))
    return int((values > SINGULAR * values[-1]).sum())


# ------------------------------------------------------------------------------------------------- the data


def _trouble(parts: Sequence[Array], *, gaps: bool) -> str:
    """What is wrong with a channel of all experiments; empty when nothing is. `gaps`: NaN is a missing sample."""
    known = [part if not gaps or np.isfinite(part).all() else part[~np.isnan(part)] for part in parts]
    if not any(len(part) for part in known):
        return "is missing: it holds no number"
    if not all(np.isfinite(part).all() for part in known):
        return "is not finite"
    spread = max(float(part.max() - part.min()) for part in known if len(part))
    largest = max(float(np.abs(part[0])) for part in known if len(part))
    return "is constant: it tells nothing, leave it out" if spread <= CONSTANT * largest else ""


def _samples(each: Sequence[Data], orders: Orders) -> None:
    rows = sum(max(one.n - orders.lost, 0) for one in each)
    if rows <= orders.parameters:
        raise ValueError(
            f"too few samples: {sum(one.n for one in each)} give {rows} equations for {orders.parameters} parameters"
        )


def _excitation(each: Sequence[Data], lags: int) -> Iterator[str]:
    longest = max(each, key=lambda one: one.n)
    wanted = lags * longest.nu
    if not wanted or longest.n <= 2 * lags:
        return
    found = excitation([one.u for one in each], lags)
    if found < wanted:
        names = ", ".join(longest.inputs)
        yield (
            f"not persistently exciting: {names} excite order {found} and {wanted} is wanted; use a richer input "
            "(noise, PRBS, more sines) or a lower order"
        )
