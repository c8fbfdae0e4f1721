"""The empirical transfer function estimate: outputs over inputs at each frequency, as many experiments as inputs.

Rules of this file: no frequency is smoothed with its neighbours (`spectral.tfest` does that); where an input has no
power the answer is rounding, and a warning says so.
"""

from __future__ import annotations

from collections.abc import Sequence

import control as ct
import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import BROAD, SINGULAR, Orders, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.doubts import warn
from hoopd.ident.frequencydata import FrequencyData, fft
from hoopd.ident.loopchecks import check_record

Complex = NDArray[np.complex128]


def etfe(data: FrequencyData | Data | Sequence[Data]) -> ct.FRD:
    """Give the empirical transfer function estimate, outputs over inputs at each frequency.

    H = Y U^-1 over the experiments at each frequency (least squares if there are more than inputs). No frequency is
    smoothed with its neighbours: `tfest` does that.

    Parameters
    ----------
    data : FrequencyData, Data or sequence of Data
        As many experiments of one length as inputs, at least.

    Returns
    -------
    control.FRD
        The response (ny, nu, nw).

    Raises
    ------
    ValueError
        Fewer experiments than inputs, or of different lengths.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 6.3.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import etfe, iddata
    >>> u = np.random.default_rng(0).standard_normal(200)
    >>> found = etfe(iddata(2.0 * u, u, 0.1))  # a gain of 2
    >>> np.allclose(found.frdata, 2.0)
    True
    """
    if not isinstance(data, FrequencyData):
        check(data, orders=Orders(0, BROAD))
        check_record(data)
    each = [data] if isinstance(data, FrequencyData) else [fft(one) for one in experiments(data)]
    if len(each) < each[0].nu or not each[0].nu:
        raise ValueError(f"{each[0].nu} inputs want at least so many experiments, not {len(each)}: see tfest")
    if any(one.n != each[0].n for one in each):
        raise ValueError("experiments of different lengths do not share their frequencies: see tfest")
    y, u = (np.stack([getattr(one, name) for one in each], axis=2) for name in ("y", "u"))
    _check_lines(u, y)
    return ct.FRD(np.moveaxis(y @ np.linalg.pinv(u), 0, 2), each[0].w, each[0].dt)


def _check_lines(u: Complex, y: Complex) -> None:
    """ValueError for channels (nw, channels, experiments) without power, a warning where inputs have none."""
    for kind, values in (("input", u), ("output", y)):
        power = np.square(np.abs(values)).sum(axis=2)
        idle = np.flatnonzero(power[1:].max(axis=0, initial=0.0) <= SINGULAR * power.max(axis=0, initial=0.0))
        if len(idle):
            raise ValueError(f"{kind} {idle[0] + 1} is constant or zero: it tells nothing at any frequency")
        silent = int((power <= SINGULAR * power.max(axis=0)).any(axis=1).sum())
        if silent and kind == "input":
            warn(
                f"not persistently exciting: an input has no power at {silent} of {len(power)} frequencies; the "
                "response there is rounding"
            )
