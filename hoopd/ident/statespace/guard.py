"""Checks of data that every state-space method makes first, and of what subspace methods give.

Rules of this file: a ValueError says what is void and where; a warning what is doubtful and why.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import DICKEY_FULLER, IdentificationWarning, answers
from hoopd.ident.data import Data

Array = NDArray[np.float64]


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
    """Warn when an input u (n, nu) follows earlier one-step errors (n, ny) beyond chance, as `answers` tells it."""
    for i, name in enumerate(inputs):
        output = next((one for e, one in zip(errors.T, outputs, strict=True) if answers(e, u[:, i])), None)
        if output is not None:
            _warn(
                f"feedback suspected: input {name} follows earlier disturbances of {output}; subspace estimates"
                " are biased in a loop, pem with a free gain is not"
            )


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


def _warn(text: str) -> None:
    warnings.warn(text, IdentificationWarning, stacklevel=6)
