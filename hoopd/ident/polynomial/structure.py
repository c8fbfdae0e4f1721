"""Orders of a polynomial model and the order of its coefficients in a vector.

Rules of this file: nb counts coefficients, `delay` is the power of q^-1 of the first (1: no direct term); the vector is
a, b of input 1, b of input 2, ..., c, d, f of input 1, ...
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import index

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import Orders
from hoopd.ident.data import Data
from hoopd.ident.modelchecks import coefficient
from hoopd.ident.models import ONE, Polynomials

Array = NDArray[np.float64]
Counts = int | Sequence[int]


@dataclass(frozen=True)
class Structure:
    """How many coefficients each polynomial has: na, nc, nd without the leading one; nb, nf, delay by input."""

    na: int = 0
    nb: tuple[int, ...] = ()
    nc: int = 0
    nd: int = 0
    nf: tuple[int, ...] = ()
    delay: tuple[int, ...] = ()

    @property
    def nu(self) -> int:
        """Inputs."""
        return len(self.nb)

    @property
    def size(self) -> int:
        """Coefficients."""
        return self.na + sum(self.nb) + self.nc + self.nd + sum(self.nf)

    @property
    def states(self) -> int:
        """Size of the innovation form over the common denominator, and so of its initial state."""
        own, noise = sum(self.nf), self.nd
        reach = [d + n - 1 + noise + own - f for d, n, f in zip(self.delay, self.nb, self.nf, strict=True) if n]
        return max([self.na + noise + own, self.nc + own, *reach])

    @property
    def lags(self) -> tuple[range, ...]:
        """Powers of q^-1 in B, by input."""
        return tuple(range(d, d + n) for d, n in zip(self.delay, self.nb, strict=True))

    @property
    def lost(self) -> int:
        """Samples before the first equation A y - B u."""
        return max([self.na, *(lag[-1] for lag in self.lags if lag)])

    @property
    def asked(self) -> Orders:
        """What the structure asks of data."""
        # B of n and a denominator of m coefficients want order n + m (Ljung, 1999, 13.2)
        lags = max([n + f + self.na for n, f in zip(self.nb, self.nf, strict=True) if n], default=0)
        return Orders(self.size, lags, self.lost)

    def parts(self) -> Iterator[tuple[str, int, range]]:
        """Letter, input and powers of q^-1 of each polynomial, in the order of the vector."""
        yield "a", 0, range(1, self.na + 1)
        for i, lag in enumerate(self.lags):
            yield "b", i, lag
        yield "c", 0, range(1, self.nc + 1)
        yield "d", 0, range(1, self.nd + 1)
        for i, n in enumerate(self.nf):
            yield "f", i, range(1, n + 1)

    @property
    def names(self) -> tuple[str, ...]:
        """a1, b1, ...; b1(2) with several inputs."""
        return tuple(coefficient(one, k, i, self.nu) for one, i, powers in self.parts() for k in powers)

    def model(self, values: Array, data: Data, variance: float = 0.0, covariance: Array | None = None) -> Polynomials:
        """The model with these coefficients; step and names of channels from the data."""
        found = dict(zip(((one, i) for one, i, _ in self.parts()), self.split(values), strict=True))
        return Polynomials(
            data.dt, found["a", 0], tuple(found["b", i] for i in range(self.nu)), found["c", 0], found["d", 0],
            tuple(found["f", i] for i in range(self.nu)) if any(self.nf) else (), float(variance), self.names,
            np.array(values, dtype=float), covariance, data.inputs, data.outputs[0],
        )  # fmt: skip

    def split(self, values: Array) -> Iterator[Array]:
        """Full polynomials in q^-1, in the order of `parts`."""
        start = 0
        for one, _, powers in self.parts():
            full = np.zeros(max(powers.stop, 1))
            if one != "b":
                full[0] = 1.0
            full[powers.start : powers.stop] = values[start : start + len(powers)]
            start += len(powers)
            yield full

    def values(self, model: Polynomials) -> Array:
        """The vector of a model that has at most these orders."""
        found: list[Array] = []
        for one, i, powers in self.parts():
            full = getattr(model, one)
            if one in "bf":
                full = full[i] if full else ONE
            own = np.zeros(powers.stop)
            own[: len(full)] = full[: powers.stop]
            found.append(own[powers.start :])
        return np.concatenate(found)


def structure(
    nu: int, na: int = 0, nb: Counts = (), nc: int = 0, nd: int = 0, nf: Counts = 0, delay: Counts = 1
) -> Structure:
    """Orders with one number for all inputs or one for each; ValueError where the counts do not fit."""
    if not isinstance(na, int | np.integer):
        raise TypeError(f"orders stand one by one, arx(data, 2, 2, 3), not as {na!r}")
    out = Structure(int(na), _each(nb, nu, "nb"), index(nc), index(nd), _each(nf, nu, "nf"), _each(delay, nu, "delay"))
    if min([na, nc, nd, *out.nb, *out.nf, *out.delay], default=0) < 0:
        raise ValueError("orders and delays are not negative")
    if out.size == 0:
        raise ValueError("a model without coefficients: give at least one order")
    return out


def single(data: Sequence[Data]) -> None:
    """ValueError when the data have more than one output."""
    if data[0].ny != 1:
        raise ValueError(
            f"one output wanted, there are {data[0].ny}: take one with data.channels, or a method for several (varx)"
        )


def _each(given: Counts, nu: int, name: str) -> tuple[int, ...]:
    counts = (int(given),) * nu if isinstance(given, int | np.integer) else tuple(int(one) for one in given)
    if len(counts) != nu:
        raise ValueError(f"{name} has {len(counts)} numbers and the data have {nu} inputs")
    return counts
