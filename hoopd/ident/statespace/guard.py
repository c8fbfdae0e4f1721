"""Checks of data that every state-space method makes first, and of what subspace methods give.

Rules of this file: a ValueError says what is void and where; a warning what is doubtful and why.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data

Array = NDArray[np.float64]

FEEDBACK_LAGS = 10
# Upper 1e-5 point of chi-square with 10 degrees of freedom: one false alarm in 100,000 channels.
FEEDBACK_LEVEL = 41.30
# An input that its own past tells to this share (a sine, a constant) answers nobody.
FORETOLD = 1e-6
# N (1 - pole) of an integrator that was estimated stays below this in 95 of 100 (Dickey & Fuller, JASA 74, 1979).
DICKEY_FULLER = 8.0


def check_channels(each: Sequence[Data]) -> None:
    """ValueError on a channel that never moves or was never measured, or on infinite samples."""
    for name, values, labels in (
        ("output", [one.y for one in each], each[0].outputs),
        ("input", [one.u for one in each], each[0].inputs),
    ):
        whole = np.concatenate(values)
        for i, label in enumerate(labels):
            column = whole[:, i]
            if np.isinf(column).any() or (name == "input" and np.isnan(column).any()):
                raise ValueError(f"{name} {label} is not finite")
            seen = column[np.isfinite(column)]
            if not len(seen):
                raise ValueError(f"{name} {label} was never measured")
            if np.ptp(seen) == 0.0:
                raise ValueError(f"{name} {label} is constant ({seen[0]:g}): it tells nothing")


def check_feedback(errors: Array, u: Array, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Warn when an input u (n, nu) follows earlier one-step errors (n, ny) beyond chance.

    Both are whitened by their own past; n times the sum of squared correlations at 1 to 10 samples is then chi-square
    (Granger, Econometrica 37, 1969).
    """
    if len(u) < 10 * FEEDBACK_LAGS:
        return
    late = [_whitened(errors[:, j]) for j in range(errors.shape[1])]
    for i, name in enumerate(inputs):
        fresh = _whitened(u[:, i])
        if fresh @ fresh <= FORETOLD * (u[:, i] @ u[:, i]):
            continue
        for e, output in zip(late, outputs, strict=True):
            size = (e @ e) * (fresh @ fresh) / len(e)
            together = np.array([fresh[k:] @ e[:-k] for k in range(1, FEEDBACK_LAGS + 1)])
            if size > 0.0 and together @ together > FEEDBACK_LEVEL * size:
                _warn(
                    f"feedback suspected: input {name} follows earlier disturbances of {output}; subspace estimates"
                    " are biased in a loop, pem with a free gain is not"
                )
                break


def check_poles(a: Array, n: int) -> None:
    """Warn of an integrator: a pole that n samples cannot tell from one."""
    poles = np.linalg.eigvals(a)
    if (np.abs(poles - 1.0) * n < DICKEY_FULLER).any():
        _warn(f"an integrator: a pole cannot be told from 1 by {n} samples; simulations drift")


def check_determined(gram: Array, names: Sequence[str]) -> None:
    """A warning that names the parameters of a combination which the errors do not feel."""
    values, vectors = np.linalg.eigh(gram)
    if len(values) and values[0] < 1e-10 * values[-1]:
        part = np.abs(vectors[: len(names), 0])
        loose = [
            name for name, share in zip(names, part, strict=True) if share > 0.1 * max(part.max(initial=0.0), 1e-3)
        ]
        warnings.warn(
            f"the data do not determine a combination of {', '.join(loose) or 'the initial states'}: their covariance"
            " leaves it out",
            IdentificationWarning, stacklevel=5,
        )  # fmt: skip


def _whitened(signal: Array) -> Array:
    """What the samples before do not tell of a signal (n - lags,)."""
    m = FEEDBACK_LAGS
    past = np.stack([signal[m - k : len(signal) - k] for k in range(1, m + 1)], axis=1)
    gram = past.T @ past
    own = np.linalg.lstsq(gram, past.T @ signal[m:], rcond=1e-11)[0]
    return np.asarray(signal[m:] - past @ own)


def _warn(text: str) -> None:
    warnings.warn(text, IdentificationWarning, stacklevel=6)
