"""Feedback in the data and outputs that drift: what the history of a record says before any model is chosen.

Rules of this file: pure statistics of complete stretches; the thresholds are levels of significance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import SINGULAR, check_channels, warn
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.modelchecks import drifting, integrator

Array = NDArray[np.float64]

# Lags of its own past that an input is foretold by, and the samples that the test of feedback needs.
FEEDBACK_LAGS = 10
FEEDBACK_SAMPLES = 100
# Lags at which it may answer an error, with the upper 1e-4 points of chi-square of so many degrees of freedom: three
# false alarms in 10,000 inputs.
FEEDBACK_LEVELS = ((1, 15.14), (3, 21.11), (10, 35.56))
# An input that its own past tells to this share (a sine, a constant) answers nobody.
FORETOLD = 1e-6
# Lags of the long model of each output, and the equations that each of its coefficients has at least.
LONG = 10
SHARE = 8
# Innovations below this share of the output's power are the rounding of the Gram matrix: they tell of no loop.
RESOLVED = 1e-10


def check_record(data: Data | Sequence[Data], *, drift: bool = True) -> None:
    """Warn of feedback and (`drift`) of outputs that integrate, for methods whose own errors or poles do not tell.

    A long ARX model of each output gives the innovations that an input must not follow, and poles that tell an
    integrator (Said & Dickey, Biometrika 71, 1984). Missing outputs: stretches without gaps are used.
    ValueError: channels that are constant, missing or not finite.
    """
    each = experiments(data)
    check_channels(each)
    parts = [_channels(part) for one in each for part in runs(one) if part.n > 2 * LONG]
    if not parts:
        return
    long = _long_models(parts, each[0].ny)
    if long:
        for said in (*_drifting(long, each[0].outputs if drift else ()), *_looped(long, parts, each[0].inputs)):
            warn(said)


def check_feedback(errors: Array, u: Array, names: Sequence[str] = ()) -> None:
    """Warn when inputs u (n, nu) answer earlier prediction errors of a model, (n,) or (n, ny): a loop was closed."""
    each = errors.reshape(len(errors), -1).T
    for i in range(u.shape[1]):
        if any(answers(e, u[:, i]) for e in each):
            warn(_loop(names[i] if names else f"u{i + 1}"))


def answers(errors: Array, u: Array) -> bool:
    """Whether an input (n,) follows earlier errors (n,) beyond chance, at 1, 1 to 3 or 1 to 10 samples.

    How much the errors before add to what the input's own past says of it: n ln(S_0/S_1) is chi-square (Granger,
    Econometrica 37, 1969), whatever an error still holds of earlier inputs. NaN errors count nothing.
    """
    n, m = len(u), FEEDBACK_LAGS
    if n < FEEDBACK_SAMPLES:
        return False
    signals = [np.ascontiguousarray(u), np.nan_to_num(errors)]
    gram = lagged_gram(signals, [range(m + 1), range(1, m + 1)], m)
    left = _left(gram)
    alone = left[m]
    if alone <= FORETOLD:
        return False
    floor = FORETOLD * alone
    return any((n - m) * np.log(alone / max(left[m + lags], floor)) > level for lags, level in FEEDBACK_LEVELS)


def _left(gram: Array) -> Array:
    """Share of the first column's square that the next 0, 1, 2, ... columns leave; by one Cholesky factor."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    relative = gram / np.outer(scale, scale)
    low = np.linalg.cholesky(relative[1:, 1:] + SINGULAR * len(gram) * np.eye(len(gram) - 1))
    z = np.linalg.solve(low, relative[1:, 0])
    return 1.0 - np.concatenate([[0.0], np.cumsum(z**2)])


# ------------------------------------------------------------------------------------------------- a long model


@dataclass(frozen=True)
class _Long:
    """Model of one output on the past of itself, of the inputs and a constant: A in q^-1, one B an input, equations."""

    a: Array
    b: list[Array]
    constant: float
    rows: int


def _long_models(parts: Sequence[list[Array]], ny: int) -> list[_Long]:
    """One model an output, all from one Gram matrix of the channels; none where the data are too few."""
    count = len(parts[0])
    rows = sum(len(part[0]) for part in parts)
    lags = min(LONG, rows // (SHARE * (2 + count - ny)))
    if lags < 1:
        return []
    usable = [part for part in parts if len(part[0]) > 2 * lags]
    spans = [range(lags + 1)] * ny + [range(1, lags + 1)] * (count - ny) + [range(1)]
    gram = np.sum([lagged_gram([*part, np.ones(len(part[0]))], spans, lags) for part in usable], axis=0)
    offsets = np.concatenate([[0], np.cumsum([len(span) for span in spans])])
    out = []
    for i in range(ny):
        own = np.arange(offsets[i] + 1, offsets[i + 1])
        at = np.concatenate([own, np.arange(offsets[ny], offsets[-1])])
        x = _least(gram[np.ix_(at, at)], gram[at, offsets[i]])
        a = np.concatenate([[1.0], -x[:lags]])
        b = [np.concatenate([[0.0], one]) for one in x[lags:-1].reshape(-1, lags)]
        out.append(_Long(a, b, float(x[-1]), sum(len(part[0]) - lags for part in usable)))
    return out


def _least(gram: Array, right: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    found = np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=SINGULAR)[0]
    return np.asarray(found / scale)


def _drifting(long: Sequence[_Long], outputs: Sequence[str]) -> Iterator[str]:
    for one, name in zip(long, outputs, strict=False):
        for pole in drifting(np.roots(one.a).astype(complex), one.rows)[:1]:
            yield integrator(pole, one.rows, f" in output {name}")


def _looped(long: Sequence[_Long], parts: Sequence[list[Array]], inputs: Sequence[str]) -> Iterator[str]:
    """By the longest stretch."""
    best = max(parts, key=lambda part: len(part[0]))
    ny = len(long)
    late = [_innovations(one, best[i], best[ny:]) for i, one in enumerate(long)]
    for name, u in zip(inputs, best[ny:], strict=True):
        if any(answers(e, u) for e, y in zip(late, best, strict=False) if e @ e > RESOLVED * (y @ y)):
            yield _loop(name)


def _innovations(model: _Long, y: Array, u: Sequence[Array]) -> Array:
    """A y - B u less the constant (n,), zero where the lags reach before the data."""
    out = np.convolve(y, model.a)[: len(y)] - model.constant
    for b, one in zip(model.b, u, strict=True):
        out -= np.convolve(one, b)[: len(y)]
    out[: len(model.a) - 1] = 0.0
    return out


def _loop(name: str) -> str:
    return (
        f"feedback suspected: input {name} follows earlier disturbances of the output; direct methods with a full "
        "noise model (armax, bj, pem) stay right in a loop, output-error, correlation and subspace methods do not"
    )


def _channels(part: Data) -> list[Array]:
    """Outputs, then inputs."""
    return [np.ascontiguousarray(one) for one in (*part.y.T, *part.u.T)]
