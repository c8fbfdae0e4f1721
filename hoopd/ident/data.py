"""Uniformly sampled inputs and outputs of an experiment: the one form that every method of this room takes.

Rules of this file: samples run along rows once `iddata` has taken them; NaN in an output is a sample that was not
measured, an input has none; arrays are copies that nobody writes to; every operation gives a new object.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.doubts import warn

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Data:
    """One experiment, sampled uniformly: what `iddata` makes and every method of this package takes.

    Attributes
    ----------
    y : ndarray, shape (n, ny)
        Outputs; NaN is a sample that was not measured.
    u : ndarray, shape (n, nu)
        Inputs, all finite; nu = 0 where there is no input.
    dt : float
        Step in s.
    t0 : float
        Time of the first sample in s.
    outputs, inputs : tuple of str
        Names by channel.
    x : ndarray, shape (n, nx), or None
        States, where they are known.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata
    >>> data = iddata(np.arange(6.0), np.ones(6), dt=0.5, t0=1.0)
    >>> data.n, data.ny, data.nu, data.fs
    (6, 1, 1, 2.0)
    >>> data.seconds(2.0, 3.0).t
    array([2. , 2.5])
    >>> data[::2].dt
    1.0
    """

    y: Array
    u: Array
    dt: float
    t0: float = 0.0
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    x: Array | None = None

    def __repr__(self) -> str:
        missing = int((~np.isfinite(self.y)).sum())
        gaps = f", {missing} outputs missing" if missing else ""
        channels = f"outputs {', '.join(self.outputs) or self.ny}; inputs {', '.join(self.inputs) or self.nu or 'none'}"
        return f"Data({self.n} samples, step {self.dt:g} s from {self.t0:g} s; {channels}{gaps})"

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
    time_axis: Literal[0, 1] | None = None,
) -> Data:
    """Make the data of one experiment of arrays, samples along rows or, as python-control has them, along columns.

    Parameters
    ----------
    y : array_like, shape (n,), (n, ny) or (ny, n)
        Outputs. NaN is a sample that was not measured; none may be infinite.
    u : array_like, shape (n,), (n, nu) or (nu, n), optional
        Inputs, all finite; without it there are none.
    dt : float
        Step in s.
    t0 : float
        Time of the first sample in s.
    x : array_like, shape (n, nx) or (nx, n), optional
        States, where they are known.
    outputs, inputs : sequence of str, optional
        Names by channel; without them y1, y2 ... and u1, u2 ...
    time_axis : {0, 1}, optional
        Along which axis of the arrays time runs. Unless given it is the longer one, and arrays that are taken as
        (channels, n) are told by an `IdentificationWarning`.

    Returns
    -------
    Data
        The experiment, as copies that nobody writes to.

    Raises
    ------
    ValueError
        Lengths that differ, an input that is not finite, a step that is none.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata
    >>> data = iddata([0.0, 1.0, np.nan], np.ones((3, 2)), dt=0.01)
    >>> data.y.shape, data.u.shape, data.inputs, data.complete
    ((3, 1), (3, 2), ('u1', 'u2'), False)
    >>> iddata(np.ones((2, 50)), np.ones((1, 50)), dt=0.01, time_axis=1)
    Data(50 samples, step 0.01 s from 0 s; outputs y1, y2; inputs u)
    >>> iddata(np.zeros(3), np.zeros(4))
    Traceback (most recent call last):
        ...
    ValueError: u has 4 samples and y has 3
    """
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt must be a positive number of seconds, not {dt}")
    given = {name: np.array(one, dtype=float) for name, one in (("y", y), ("u", u), ("x", x)) if one is not None}
    found = _by_samples(given, time_axis)
    outs, states = found["y"], found.get("x")
    ins = found.get("u", np.zeros((len(outs), 0)))
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
    """Give one or several experiments as a list, and see to it that they belong together.

    Parameters
    ----------
    data : Data or sequence of Data
        The experiments.

    Returns
    -------
    list of Data
        As they were given.

    Raises
    ------
    TypeError
        What is no `Data`.
    ValueError
        No experiment, or several that do not have the same channels and step.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import experiments, iddata
    >>> len(experiments(iddata(np.zeros(5))))
    1
    >>> experiments([iddata(np.zeros(5), dt=0.1), iddata(np.zeros(5), dt=0.2)])
    Traceback (most recent call last):
        ...
    ValueError: experiment 1 has a step of 0.2 s, the first one of 0.1 s
    """
    each = [data] if isinstance(data, Data) else list(data) if isinstance(data, Sequence) else [data]
    if strange := [type(one).__name__ for one in each if not isinstance(one, Data)]:
        raise TypeError(_no_data(strange[0], [data, *each]))
    if not each:
        raise ValueError("no experiment given")
    first = each[0]
    for i, one in enumerate(each[1:], start=1):
        if (one.ny, one.nu) != (first.ny, first.nu):
            raise ValueError(
                f"experiment {i} has {one.ny} outputs and {one.nu} inputs, the first has {first.ny} and {first.nu}"
            )
        if not np.isclose(one.dt, first.dt, rtol=1e-6, atol=0.0):
            raise ValueError(f"experiment {i} has a step of {one.dt} s, the first one of {first.dt} s")
    return each


def one_experiment(data: Any, what: str) -> Data:
    """The data, if it is one experiment; TypeError that says what it is instead."""
    if not isinstance(data, Data):
        experiments(data)
        raise TypeError(f"{what} takes one experiment: take them one by one")
    return data


def _no_data(called: str, each: Sequence[Any]) -> str:
    told = f"data (iddata) are wanted, not {'an' if called[:1].lower() in 'aeiou' else 'a'} {called}"
    if any(hasattr(one, "filled") for one in each):
        return f"{told}: of what fill_gaps gives take .data"
    if any(hasattr(one, "predict") for one in each):
        return f"{told}: models come first, several of them as a list"
    return told


def runs(data: Data) -> Iterator[Data]:
    """Give the pieces of consecutive samples in which every output was measured, in the order of time.

    Parameters
    ----------
    data : Data
        An experiment, with gaps or without.

    Returns
    -------
    iterator of Data
        The pieces, each with its own `t0`.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, runs
    >>> data = iddata([1.0, 2.0, np.nan, 4.0, 5.0, 6.0], dt=1.0)
    >>> [(piece.t0, piece.n) for piece in runs(data)]
    [(0.0, 2), (3.0, 3)]
    """
    known = np.asarray(np.isfinite(data.y).all(axis=1))
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield data[first:last]


def driving_data(given: Any, ny: int, nu: int, dt: float | None) -> Data:
    """Data as they are, or an input array as data whose outputs are missing, from which nothing but rest follows.

    `dt`: the model's step, None where it has none.
    """
    if isinstance(given, Data):
        return given
    try:
        u = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise TypeError(f"data (iddata) or an input array is wanted, not a {type(given).__name__}") from None
    if dt is None:
        raise ValueError("an array has no step and the model neither: give iddata(y, u, dt)")
    u = input_rows(u, nu)
    return iddata(np.full((len(u), ny), np.nan), u, dt, time_axis=0)


def input_rows(u: Array, nu: int) -> Array:
    """(n, nu) of a model's inputs in either layout, (n, nu) or (nu, n), or (n,) of one; rows where both would do."""
    u = u[:, None] if u.ndim == 1 and nu == 1 else u.T if u.ndim == 2 and u.shape[1] != nu == u.shape[0] else u
    if u.ndim != 2 or u.shape[1] != nu:
        raise ValueError(f"the input of a model of {nu} inputs is (n, {nu}) or ({nu}, n), not {u.shape}")
    return u


def _by_samples(given: Mapping[str, Array], time_axis: int | None) -> dict[str, Array]:
    """Arrays (n, channels) of arrays of either layout, that nobody writes to."""
    for name, one in given.items():
        if one.ndim not in (1, 2):
            raise ValueError(f"{name} must be (n,), (n, channels) or (channels, n), not {one.shape}")
    axis = dict.fromkeys(given, time_axis) if time_axis is not None else _longer_axes(given)
    if time_axis is None and (turned := [f"{name} {given[name].shape}" for name, one in axis.items() if one]):
        warn(f"{' and '.join(turned)} taken as (channels, n); time_axis=1 says so, time_axis=0 takes rows for samples")
    found = {}
    for name, one in given.items():
        found[name] = one[:, None] if one.ndim == 1 else np.ascontiguousarray(one.T) if axis[name] else one
        found[name].setflags(write=False)
    return found


def _longer_axes(given: Mapping[str, Array]) -> dict[str, int]:
    """The axis of each array along which time runs: that of the common length, else the longer one."""
    single = [len(one) for one in given.values() if one.ndim == 1]
    length = single[0] if single else max(max(one.shape) for one in given.values())
    return {
        name: int(one.ndim == 2 and one.shape[0] != length and (one.shape[1] == length or one.shape[1] > one.shape[0]))
        for name, one in given.items()
    }


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


def with_values(data: Data, y: Array, u: Array, x: Array | None) -> Data:
    """The data with other values at the same times, which nobody changes any more."""
    for one in (y, u):
        one.setflags(write=False)
    return replace(data, y=y, u=u, x=x)
