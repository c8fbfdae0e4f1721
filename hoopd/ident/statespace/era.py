"""State space from Markov parameters (ERA: Juang & Pappa, J. Guidance 8, 1985; Ho & Kalman, 1966).

H0 = [Y_1 Y_2 ..; Y_2 Y_3 ..; ..] = U S V', A = S^-1/2 U' H1 V S^-1/2, B and C the first blocks of S^1/2 V' and U S^1/2.

Rules of this file: no sample time is put into the Markov parameters; they are the response to a unit pulse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import estimated
from hoopd.ident.modelchecks import check_predictor
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.okid import okid
from hoopd.ident.statespace.ordering import check_states

Array = NDArray[np.float64]


@estimated("realisation (ERA)")
def era(
    markov: Array, order: int | None = None, *, dt: float = 1.0, rows: int | None = None, columns: int | None = None
) -> Innovations:
    """Realise Markov parameters in balanced state space.

    H0 = [Y_1 Y_2 ..; Y_2 Y_3 ..; ..] = U S V', A = S^-1/2 U' H1 V S^-1/2, B and C the first blocks of S^1/2 V' and U
    S^1/2.

    Parameters
    ----------
    markov : ndarray, shape (count + 1, ny, nu)
        D, C B, C A B, ...: the response to a unit pulse.
    order : int, optional
        States; without it the singular values above sqrt(largest * least).
    dt : float
        Step in s that the model bears.
    rows, columns : int, optional
        Blocks of the Hankel matrix; half of what there is each, unless given.

    Returns
    -------
    Innovations
        The model, k = 0, with its `singular_values`.

    Raises
    ------
    ValueError
        Too few parameters, or an order that they do not give.

    Notes
    -----
    Sources: Juang & Pappa, J. Guidance 8, 1985; Ho & Kalman, 1966.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import era
    >>> pulse = lfilter([0.0, 1.0], [1.0, -1.5, 0.7], np.eye(30)[0])
    >>> np.poly(era(pulse[:, None, None], order=2, dt=0.1).a).round(6)
    array([ 1. , -1.5,  0.7])
    """
    values = np.asarray(markov, dtype=float)
    if values.ndim != 3 or not np.isfinite(values).all():
        raise ValueError("Markov parameters are finite and (count, outputs, inputs)")
    count, ny, nu = len(values) - 1, values.shape[1], values.shape[2]
    high = rows or count // 2
    wide = columns or count - high
    if high + wide > count or min(high, wide) < 1:
        raise ValueError(f"{high} rows and {wide} columns need {high + wide} Markov parameters besides D, not {count}")
    if order is not None and order < 1:
        raise ValueError(f"order is a whole number from 1 on, not {order}")
    if not values[1:].any():
        raise ValueError("all Markov parameters are zero: there are no dynamics")
    u, s, vt = np.linalg.svd(_hankel(values[1:], high, wide), full_matrices=False)
    nx = order or max(int((s > np.sqrt(s[0] * max(s[-1], 1e-16 * s[0]))).sum()), 1)
    if nx > len(s):
        raise ValueError(f"order {nx} is more than the {len(s)} singular values")
    if s[nx - 1] < 1e-12 * s[0]:
        warn(f"order too high: singular value {nx} is rounding")
    root = np.sqrt(np.maximum(s[:nx], 1e-300))
    left, right = u[:, :nx], vt[:nx]
    a = (left.T @ _hankel(values[2:], high, wide) @ right.T) / np.outer(root, root)
    b, c = (root[:, None] * right)[:, :nu], (left * root)[:ny]
    found = Innovations(a, b, c, values[0], np.zeros((nx, ny)), dt, singular_values=s)
    check_predictor(found)
    return found


@estimated("realisation (ERA)")
def era_of_data(
    data: Data | Sequence[Data], order: int, *, lags: int | None = None, drop: int | None = None,
    rows: int | None = None, columns: int | None = None, ridge: float = 0.0, curvature: float = 0.0,
) -> Innovations:  # fmt: skip
    """Realise the Markov parameters of data: `era` of what `okid` gives, averaged over the experiments.

    The impulse responses are averaged, so each experiment weighs alike.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments.
    order : int
        States.
    lags : int, optional
        Of the observer; 5 order unless given.
    drop : int, optional
        As in `okid`.
    rows, columns : int, optional
        As in `era`.
    ridge, curvature : float
        As in `okid`.

    Returns
    -------
    Innovations
        The model, k = 0.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import era_of_data, iddata
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 1.0], [1.0, -1.5, 0.7], u) + 0.01 * e
    >>> np.poly(era_of_data(iddata(y, u, 0.1), order=2).a).round(2)
    array([ 1. , -1.5,  0.7])
    """
    each = experiments(data)
    if order < 1:
        raise ValueError(f"order is a whole number from 1 on, not {order}")
    check_states(each, order)
    own = lags or 5 * order
    need = max(own, (rows or 0) + (columns or 0))
    found = [okid(one, own, count=need, drop=drop, ridge=ridge, curvature=curvature) for one in each]
    return era(np.mean(found, axis=0), order, dt=each[0].dt, rows=rows, columns=columns)


def _hankel(blocks: Array, rows: int, columns: int) -> Array:
    """(rows ny, columns nu); a block beyond the last is zero."""
    _, ny, nu = blocks.shape
    padded = np.concatenate([blocks, np.zeros((max(rows + columns - 1 - len(blocks), 0), ny, nu))])
    index = np.add.outer(np.arange(rows), np.arange(columns))
    return np.asarray(padded[index].transpose(0, 2, 1, 3).reshape(rows * ny, columns * nu))
