"""Feedback in the data and outputs that drift: what the history of a record says before any model is chosen.

Rules of this file: pure statistics of complete stretches; the thresholds are levels of significance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from hoopd.ident.checks import SINGULAR, check_channels
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.doubts import warn
from hoopd.ident.lagged import lagged_gram
from hoopd.ident.modelchecks import drifting, integrator

Array = NDArray[np.float64]

# Lags of its own past that an input is foretold by, and the samples that the test of feedback needs.
FEEDBACK_LAGS = 10
FEEDBACK_SAMPLES = 100
# Lags at which it may answer an error, with the upper 1e-4 points of chi-square of so many degrees of freedom: three
# false alarms in 10,000 pairs of an input and an error.
FEEDBACK_LEVELS = ((1, 15.14), (3, 21.11), (10, 35.56))
# An input that its own past tells to this share (a sine, a constant) answers nobody.
FORETOLD = 1e-6
# Lags of the long model of each output, and the equations that each of its coefficients has at least.
LONG = 10
SHARE = 8
# Innovations below this share of the output's power are the rounding of the Gram matrix: they tell of no loop.
RESOLVED = 1e-10
# Reciprocal condition above which no singular value of a hundred columns is below SINGULAR.
REGULAR = 100.0 * SINGULAR


def check_record(data: Data | Sequence[Data], *, drift: bool = True) -> bool:
    """Warn of feedback and (`drift`) of outputs that integrate, for methods whose own errors or poles do not tell.

    Gives whether feedback is suspected.

    A long ARX model of each output gives the innovations that an input must not follow, and poles that tell an
    integrator (Said & Dickey, Biometrika 71, 1984). Missing outputs: stretches without gaps are used.
    ValueError: channels that are constant, missing or not finite.
    """
    each = experiments(data)
    check_channels(each)
    parts = [_channels(part) for one in each for part in runs(one) if part.n > 2 * LONG]
    long = _long_models(parts, each[0].ny) if parts else []
    if not long:
        return False
    looped = list(_looped(long, parts, each[0].inputs))
    for said in (*_drifting(long, each[0].outputs if drift else ()), *looped):
        warn(said)
    return bool(looped)


def check_feedback(errors: Array, u: Array, names: Sequence[str] = ()) -> None:
    """Warn when inputs u (n, nu) answer earlier prediction errors of a model, (n,) or (n, ny): a loop was closed."""
    looped = _answering(errors.reshape(len(errors), -1).T, u.T)
    for i in range(u.shape[1]):
        if looped[i]:
            warn(_loop(names[i] if names else f"u{i + 1}"))


def answers(errors: Array, u: Array) -> bool:
    """Whether an input (n,) follows earlier errors (n,) beyond chance, at 1, 1 to 3 or 1 to 10 samples.

    How much the errors before add to what the input's own past says of it: n ln(S_0/S_1) is chi-square (Granger,
    Econometrica 37, 1969), whatever an error still holds of earlier inputs. NaN errors count nothing.
    """
    return bool(_answering(errors[None], u[None])[0])


def _answering(errors: Array, u: Array) -> NDArray[np.bool_]:
    """Which of the inputs (nu, n) answer any of the errors (ne, n), (nu,); one Gram matrix serves all."""
    (nu, n), ne, m = u.shape, len(errors), FEEDBACK_LAGS
    if n < FEEDBACK_SAMPLES or not nu * ne:
        return np.zeros(nu, dtype=bool)
    # without their means, which any lag would stand in for
    signals = [_centred(one) for one in (*u, *errors)]
    gram = lagged_gram(signals, [range(m + 1)] * nu + [range(1, m + 1)] * ne, m)
    own = (m + 1) * np.arange(nu)[:, None] + np.arange(m + 1)
    past = (m + 1) * nu + m * np.arange(ne)[:, None] + np.arange(m)
    # (ne, nu, 2 m + 1): what the input was, the errors before, the input now
    at = np.array([[[*now[1:], *late, now[0]] for now in own] for late in past])
    left = _left(gram[at[..., :, None], at[..., None, :]])
    alone = left[..., m]
    after = np.stack([left[..., m + lags] for lags, _ in FEEDBACK_LEVELS])
    own_only = np.maximum(alone, FORETOLD)
    gain = (n - m) * np.log(own_only / np.maximum(after, FORETOLD * own_only))
    levels = np.array([level for _, level in FEEDBACK_LEVELS])[:, None, None]
    return np.asarray(((alone > FORETOLD) & (gain > levels)).any(axis=(0, 1)))


def _centred(x: Array) -> Array:
    """Less the mean of what is known, zero elsewhere."""
    known = np.isfinite(x)
    return np.where(known, x - (x[known].mean() if known.any() else 0.0), 0.0)


def _left(gram: Array) -> Array:
    """Share of the last column's square that the first 0, 1, 2, ... columns leave, of Gram matrices (..., p, p)."""
    scale = np.sqrt(np.maximum(np.diagonal(gram, axis1=-2, axis2=-1), 1e-300))
    relative = gram / (scale[..., :, None] * scale[..., None, :])
    # L z = r stands in the last row of the whole matrix's factor; twice the last square, so that there always is one
    count = gram.shape[-1]
    relative[..., range(count), range(count)] = [1.0 + SINGULAR * count] * (count - 1) + [2.0]
    z = np.linalg.cholesky(relative)[..., -1, :-1]
    return 1.0 - np.concatenate([np.zeros((*z.shape[:-1], 1)), np.cumsum(z**2, axis=-1)], axis=-1)


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
    """The smallest x of least |gram x - right|; by Cholesky's factor where no direction is near to rounding."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    relative = gram / np.outer(scale, scale)
    low, failed = lapack.dpotrf(relative, lower=1)
    if not failed and lapack.dpocon(low, np.abs(relative).sum(axis=0).max(), uplo="L")[0] > REGULAR:
        return np.asarray(lapack.dpotrs(low, right / scale, lower=1)[0] / scale)
    return np.asarray(np.linalg.lstsq(relative, right / scale, rcond=SINGULAR)[0] / scale)


def _drifting(long: Sequence[_Long], outputs: Sequence[str]) -> Iterator[str]:
    for one, name in zip(long, outputs, strict=False):
        for pole in drifting(np.roots(one.a).astype(complex), one.rows)[:1]:
            yield integrator(pole, one.rows, f" in output {name}")


def _looped(long: Sequence[_Long], parts: Sequence[list[Array]], inputs: Sequence[str]) -> Iterator[str]:
    """By the longest stretch."""
    best = max(parts, key=lambda part: len(part[0]))
    ny = len(long)
    late = [_innovations(one, best[i], best[ny:]) for i, one in enumerate(long)]
    told = [e for e, y in zip(late, best, strict=False) if e @ e > RESOLVED * (y @ y)]
    if told and inputs:
        looped = _answering(np.array(told), np.array(best[ny:]))
        yield from (_loop(name) for name, one in zip(inputs, looped, strict=True) if one)


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
