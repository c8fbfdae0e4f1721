"""Which parameters a fit moves, on which scale, and what is believed of them before any data.

Rules of this file: tables and scales; no data here. A positive parameter is fitted as its logarithm, so that no step
of a search leaves its range; an entry is fitted in units of its nominal size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Prior(NamedTuple):
    """A normal belief on the fitted scale (logarithm of a positive parameter)."""

    value: float  # on the parameter's own scale
    sigma: float  # of the logarithm, or absolute where the parameter may be negative


@dataclass(frozen=True)
class Scale:
    """From the search's coordinates z (m,) to parameters (m,) and back."""

    names: tuple[str, ...]
    nominal: Array  # (m,)
    positive: NDArray[np.bool_]  # (m,)
    bounds: tuple[Array, Array] | None = None  # least and largest (m,), where there are some

    def parameters(self, z: Array) -> Array:
        """p = p0 exp(z) for positive ones, p = p0 + |p0| z else, within the bounds."""
        # the bound keeps a wild step of the search finite: e^30 is 1e13
        grown = self.nominal * np.exp(np.clip(z, -30.0, 30.0))
        p = np.where(self.positive, grown, self.nominal + self.size * z)
        return p if self.bounds is None else np.clip(p, *self.bounds)

    def derivative(self, z: Array) -> Array:
        """dp/dz (m,)."""
        return np.where(self.positive, self.parameters(z), self.size)

    def coordinates(self, p: Array) -> Array:
        """z of parameters."""
        ratio = np.log(np.divide(p, self.nominal, out=np.ones_like(self.nominal), where=self.positive))
        return np.where(self.positive, ratio, (p - self.nominal) / self.size)

    @property
    def size(self) -> Array:
        """Unit (m,) of the coordinates of parameters that may be negative."""
        return np.where(self.nominal == 0.0, 1.0, np.abs(self.nominal))


def scale_within(names: Sequence[str], values: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]) -> Scale:
    """Scale of a declared plant's parameters around their values: what cannot be negative goes by its logarithm.

    Examples
    --------
    >>> scale = scale_within(("M", "offset"), {"M": 100.0, "offset": 0.0}, {"M": (1.0, 1000.0)})
    >>> scale.parameters(np.array([np.log(2.0), 3.0])).round(9).tolist()
    [200.0, 3.0]
    """
    ends = [bounds.get(name, (-np.inf, np.inf)) for name in names]
    nominal = np.array([values[name] for name in names], dtype=float)
    low, high = (np.array([end[side] for end in ends], dtype=float) for side in (0, 1))
    return Scale(tuple(names), nominal, (low >= 0.0) & (nominal > 0.0), (low, high))
