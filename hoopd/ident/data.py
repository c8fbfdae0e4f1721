"""Uniformly sampled inputs and outputs of an experiment: the one form that every method of this room takes.

Rules of this file: samples run along rows; NaN in an output is a sample that was not measured, an input has none;
arrays are copies that nobody writes to; every operation gives a new object.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Data:
    """One experiment: y (n, ny), u (n, nu) with nu = 0 where there is no input, x (n, nx) where states are known.

    `dt` in seconds, `t0` the time of the first sample; names by channel.
    """

    y: Array
    u: Array
    dt: float
    t0: float = 0.0
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    x: Array | None = None

    @property
    def n(self) -> int:
        """Samples."""
        return len(self.y)

    @property
    def ny(self) -> int:
        """Outputs."""
        return int(self.y.shape[1])

    @property
    def nu(self) -> int:
        """Inputs."""
        return int(self.u.shape[1])

    @property
    def t(self) -> Array:
        """(n,) seconds."""
        return np.asarray(self.t0 + self.dt * np.arange(self.n), dtype=float)

    @property
    def fs(self) -> float:
        """Samples a second."""
        return 1.0 / self.dt

    @property
    def complete(self) -> bool:
        """Whether every output was measured at every sample."""
        return bool(np.isfinite(self.y).all())

    def __getitem__(self, rows: slice) -> Data:
        """Samples by number; a step makes `dt` so many times as long."""
        if not isinstance(rows, slice):
            raise TypeError("samples are taken as data[first:last:step], channels by data.channels(outputs, inputs)")
        first, _, step = rows.indices(self.n)
        if step < 1:
            raise ValueError("time runs forwards: a step below 1 has no meaning")
        x = None if self.x is None else self.x[rows]
        return replace(self, y=self.y[rows], u=self.u[rows], x=x, dt=self.dt * step, t0=self.t0 + first * self.dt)

    def seconds(self, start: float, end: float) -> Data:
        """Samples with start <= t < end."""
        first, last = np.searchsorted(self.t, [start - 1e-9 * self.dt, end - 1e-9 * self.dt])
        return self[int(first) : int(last)]

    def channels(self, outputs: Sequence[int | str], inputs: Sequence[int | str] | None = None) -> Data:
        """The chosen channels by number or name, in the order given; all inputs when none are."""
        out = [_index(one, self.outputs) for one in outputs]
        own = list(range(self.nu)) if inputs is None else [_index(one, self.inputs) for one in inputs]
        return replace(
            self, y=self.y[:, out], u=self.u[:, own],
            outputs=tuple(self.outputs[i] for i in out), inputs=tuple(self.inputs[i] for i in own),
        )  # fmt: skip


def iddata(
    y: ArrayLike,
    u: ArrayLike | None = None,
    dt: float = 1.0,
    *,
    t0: float = 0.0,
    x: ArrayLike | None = None,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
) -> Data:
    """Data of arrays (n,) or (n, channels).

    ValueError that names the cause: lengths that differ, samples along columns, an input that is not finite, a step
    that is none. An output may hold NaN, and none may be infinite.
    """
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt must be a positive number of seconds, not {dt}")
    outs = _columns(y, "y")
    ins = np.zeros((len(outs), 0)) if u is None else _columns(u, "u")
    states = None if x is None else _columns(x, "x")
    for name, part in (("u", ins), ("x", states)):
        if part is not None and len(part) != len(outs):
            raise ValueError(f"{name} has {len(part)} samples and y has {len(outs)}")
    if not np.isfinite(ins).all():
        raise ValueError(f"u is not finite at sample {int(np.argwhere(~np.isfinite(ins))[0, 0])}")
    if np.isinf(outs).any():
        raise ValueError(f"y is infinite at sample {int(np.argwhere(np.isinf(outs))[0, 0])}")
    return Data(
        outs, ins, float(dt), float(t0), _names(outputs, outs.shape[1], "y"), _names(inputs, ins.shape[1], "u"), states
    )  # fmt: skip


def experiments(data: Data | Sequence[Data]) -> list[Data]:
    """One or several experiments as a list; ValueError when they do not have the same channels and step."""
    each = [data] if isinstance(data, Data) else list(data)
    if not each:
        raise ValueError("no experiment given")
    first = each[0]
    for i, one in enumerate(each[1:], start=1):
        if (one.ny, one.nu) != (first.ny, first.nu):
            raise ValueError(
                f"experiment {i} has {one.ny} outputs and {one.nu} inputs, the first has {first.ny} and {first.nu}"
            )
        if not np.isclose(one.dt, first.dt, rtol=1e-6):
            raise ValueError(f"experiment {i} has a step of {one.dt} s, the first one of {first.dt} s")
    return each


def runs(data: Data) -> Iterator[Data]:
    """Pieces of consecutive samples in which every output was measured, in the order of time."""
    known = np.asarray(np.isfinite(data.y).all(axis=1))
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield data[first:last]


def _columns(values: Any, name: str) -> Array:
    found = np.array(values, dtype=float)
    if found.ndim == 1:
        found = found[:, None]
    if found.ndim != 2:
        raise ValueError(f"{name} must be (n,) or (n, channels), not {found.shape}")
    if found.shape[1] > found.shape[0] > 0:
        raise ValueError(f"{name} has {found.shape[0]} rows and {found.shape[1]} columns: samples run along rows")
    found.setflags(write=False)
    return found


def _names(given: Sequence[str] | None, count: int, letter: str) -> tuple[str, ...]:
    if given is None:
        return tuple(f"{letter}{i + 1}" if count > 1 else letter for i in range(count))
    if len(given) != count or len(set(given)) != count:
        raise ValueError(f"{count} different names wanted, not {list(given)}")
    return tuple(given)


def _index(one: int | str, names: Sequence[str]) -> int:
    if isinstance(one, str):
        if one not in names:
            raise ValueError(f"no channel {one!r}; there are {', '.join(names)}")
        return list(names).index(one)
    return range(len(names))[one]
