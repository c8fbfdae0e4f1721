"""The one data type of a recorded run, of whatever plant and from whatever file.

Rules of this file: immutable; numpy columns of one length, NaN for missing; angles in radians where the unit says so;
no files, no clock. Row k: an input's value is held from t[k] to t[k+1] (or goes straight to the next one), a channel's
value was sampled at the channel's own time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.recording.tick_columns import CHANNELS, INPUTS, TIMES, UNITS

__all__ = ["HOLDS", "UNITS", "Column", "Recording", "Signal", "from_columns", "from_signals", "with_hold"]

Column = NDArray[np.float64]

# How an input goes on between its rows: at its value, straight to the next one, on a smooth curve through them, or on
# one of which they are means.
HOLDS = ("zero", "linear", "smooth", "mean")

# Usual steps: rows farther apart have others missing between them, and over a pause nobody knows what was there.
MISSED_STEPS, PAUSE_STEPS = 1.5, 5.5


@dataclass(frozen=True, eq=False)
class Signal:
    """An input or a channel: a value and a time for every row.

    Attributes
    ----------
    values : array (n,)
        In `unit`, NaN where missing.
    t : array (n,)
        Run time in s: of a channel when each value was sampled, of an input when each value began to act.
    unit : str
        As a person writes it, empty for a plain number.
    hold : str
        Of an input: "zero", "linear", "smooth" or "mean", how it goes on to the next row; of a channel "mean" where
        each value is one over the time about it.
    """

    values: Column
    t: Column
    unit: str = ""
    hold: str = HOLDS[0]

    @property
    def told_hold(self) -> str:
        """Of a channel, as a file has it: empty where there is nothing to tell."""
        return self.hold if self.hold != HOLDS[0] else ""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Recording:
    """One run: inputs and channels by name, where they came from, and the configuration text they were taken with.

    Every signal's values are an attribute of its name, too (`recording.u`), and its sample times under `NAME_t`; of the
    daemon's own recordings the three readings of the board share `y_t`. `dataclasses.replace` takes these names.
    """

    t: Column  # s, run time of the row
    inputs: Mapping[str, Signal]
    channels: Mapping[str, Signal]
    source: str = ""  # name of the file, without its folder
    config: str = ""  # configuration text (YAML), empty when the source has none
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # other columns of the rows by name
    lost: str = ""  # what a damaged file lost, empty when whole
    rig: bool = False  # recorded by a daemon on the simulated rig

    def __init__(
        self,
        t: ArrayLike,
        inputs: Mapping[str, Signal] | None = None,
        channels: Mapping[str, Signal] | None = None,
        source: str = "",
        config: str = "",
        extra: Mapping[str, ArrayLike] | None = None,
        lost: str = "",
        rig: bool = False,
        **columns: ArrayLike,
    ) -> None:
        """Signals by name, changed in `columns`; without signals those of the daemon's tick.

        ValueError names the column that does not have a number for every row.
        """
        rows = np.asarray(t, dtype=np.float64)
        if inputs is None and channels is None:
            inputs, channels = _tick_signals(rows)
        inputs, channels = _changed(inputs or {}, channels or {}, columns)
        copies = _Copies(rows)
        values: dict[str, Any] = {
            "t": copies.rows,
            "inputs": MappingProxyType({name: copies.signal(name, signal) for name, signal in inputs.items()}),
            "channels": MappingProxyType({name: copies.signal(name, signal) for name, signal in channels.items()}),
            "extra": MappingProxyType({name: copies.extra(name, value) for name, value in (extra or {}).items()}),
            "source": source,
            "config": config,
            "lost": lost,
            "rig": rig,
        }
        _refuse_double([*inputs, *channels])
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Column:
        """Values of a signal, or its sample times, by name."""
        try:
            return self.column(name)
        except KeyError:
            raise AttributeError(f"the recording has no signal {name!r}", name=name, obj=self) from None

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        """Its source, length and measured signals, not its numbers."""
        there = [name for name, signal in self.signals.items() if np.isfinite(signal.values).any()]
        span_s = float(self.t[-1] - self.t[0]) if len(self) else 0.0
        return f"Recording({self.source!r}, {len(self)} rows, {span_s:.6g} s, {', '.join(there) or 'nothing'})"

    @property
    def signals(self) -> Mapping[str, Signal]:
        """Inputs and channels."""
        return {**self.inputs, **self.channels}

    @property
    def is_tick(self) -> bool:
        """Whether the signals are those of the daemon's tick."""
        return _is_tick(self.inputs, self.channels)

    @property
    def sample_time_s(self) -> float:
        """Median step of `t`, NaN below two rows."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")

    def column(self, name: str) -> Column:
        """Values of a signal, its sample times under `NAME_t`, or `t`; KeyError when there is none of that name."""
        if name == "t":
            return np.asarray(self.__dict__["t"])
        signals = self.__dict__.get("inputs", {}), self.__dict__.get("channels", {})
        for group in signals:
            if name in group:
                return np.asarray(group[name].values)
        for signal, times in _times(*signals):
            if times == name:
                return np.asarray(signal.t)
        raise KeyError(name)

    def columns(self) -> dict[str, Column]:
        """Every column by name: t, the signals' values, and their sample times."""
        times = {name: signal.t for signal, name in _times(self.inputs, self.channels)}
        return {"t": self.t, **{name: signal.values for name, signal in self.signals.items()}, **times}

    def replaced(self, **changes: Any) -> Recording:
        """The same with other fields or columns, as `dataclasses.replace` does it."""
        return dataclasses.replace(self, **changes)


def rounded_step_s(recording: Recording) -> float:
    """Median step of the rows to eight digits, whatever its size: 0.02 where times add up to 0.0200000000004."""
    return float(f"{recording.sample_time_s:.8g}")


def with_hold(recording: Recording, hold: str) -> Recording:
    """The recording with inputs that go on in this way, and with readings that are means where all is."""
    inputs = {name: dataclasses.replace(signal, hold=hold) for name, signal in recording.inputs.items()}
    read = hold if hold == "mean" else HOLDS[0]
    channels = {name: dataclasses.replace(signal, hold=read) for name, signal in recording.channels.items()}
    return recording.replaced(inputs=inputs, channels=channels)


def from_columns(
    columns: Mapping[str, Any], source: str = "", config: str = "", lost: str = "", *, rig: bool = False
) -> Recording:
    """A tick's recording from named columns: missing signals become NaN, missing times become t, others `extra`."""
    t = np.asarray(columns["t"], dtype=np.float64)
    known = {name: columns[name] for name in UNITS if name in columns and name != "t"}
    extra = {name: np.asarray(value) for name, value in columns.items() if name not in UNITS}
    return Recording(t, source=source, config=config, extra=extra, lost=lost, rig=rig, **known)


def from_signals(
    t: ArrayLike,
    inputs: Mapping[str, Signal | ArrayLike] | None = None,
    channels: Mapping[str, Signal | ArrayLike] | None = None,
    *,
    source: str = "",
    config: str = "",
    extra: Mapping[str, ArrayLike] | None = None,
    lost: str = "",
) -> Recording:
    """A recording of any plant.

    Parameters
    ----------
    t : array_like (n,)
        Run time of the rows, s.
    inputs, channels : mapping of str to Signal or array_like (n,)
        By name; plain numbers were sampled (or began to act) at `t` and have no unit.
    source, config, extra, lost
        As the attributes of `Recording`.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        When a column has not one number for every row, or a name stands twice.

    Examples
    --------
    >>> import numpy as np
    >>> t = 0.001 * np.arange(3)
    >>> run = from_signals(t, {"F": Signal(np.ones(3), t, "N")}, {"x": [0.0, 1e-6, 4e-6]})
    >>> run.F.tolist(), run.inputs["F"].unit, len(run)
    ([1.0, 1.0, 1.0], 'N', 3)
    """
    rows = np.asarray(t, dtype=np.float64)
    return Recording(
        rows, _as_signals(rows, inputs), _as_signals(rows, channels), source, config, dict(extra or {}), lost
    )


class _Copies:
    """Read-only copies; signals of one source of times share them."""

    def __init__(self, t: Column) -> None:
        self.rows = self._checked("t", t)
        self._of = {id(t): (t, self.rows)}

    def signal(self, name: str, signal: Signal) -> Signal:
        if signal.hold not in HOLDS:
            raise ValueError(f"{name} goes on as {signal.hold!r}; known: {', '.join(HOLDS)}")
        if id(signal.t) not in self._of:
            times = self._checked(f"{name}_t", signal.t)
            self._of[id(signal.t)] = signal.t, self.rows if np.array_equal(times, self.rows) else times
        return Signal(self._checked(name, signal.values), self._of[id(signal.t)][1], signal.unit, signal.hold)

    def _checked(self, name: str, column: ArrayLike) -> Column:
        copy = np.array(column, dtype=np.float64)
        if copy.ndim != 1:
            raise ValueError(f"column {name} has shape {copy.shape}, expected one number a row")
        return self._of_length(name, copy)

    def extra(self, name: str, column: ArrayLike) -> NDArray[Any]:
        return self._of_length(name, np.array(column))

    def _of_length(self, name: str, copy: NDArray[Any]) -> NDArray[Any]:
        if name != "t" and copy.shape[:1] != self.rows.shape:
            raise ValueError(f"column {name} has shape {copy.shape}, t has {self.rows.shape}")
        copy.flags.writeable = False
        return copy


def _as_signals(t: Column, signals: Mapping[str, Signal | ArrayLike] | None) -> dict[str, Signal]:
    return {
        name: item if isinstance(item, Signal) else Signal(np.asarray(item, dtype=np.float64), t)
        for name, item in (signals or {}).items()
    }


def _tick_signals(t: Column) -> tuple[dict[str, Signal], dict[str, Signal]]:
    missing = np.full(t.shape, np.nan)
    inputs, channels = (
        {name: Signal(missing, t, unit) for name, unit in table.items()} for table in (INPUTS, CHANNELS)
    )
    return inputs, channels


def _is_tick(inputs: Mapping[str, Signal], channels: Mapping[str, Signal]) -> bool:
    return inputs.keys() == INPUTS.keys() and channels.keys() == CHANNELS.keys()


def _times(inputs: Mapping[str, Signal], channels: Mapping[str, Signal]) -> Iterator[tuple[Signal, str]]:
    """Signals with the name of their sample times."""
    tick = _is_tick(inputs, channels)
    for name, signal in {**({} if tick else inputs), **channels}.items():
        yield signal, TIMES[name] if tick else f"{name}_t"


def _changed(
    inputs: Mapping[str, Signal], channels: Mapping[str, Signal], columns: Mapping[str, ArrayLike]
) -> tuple[dict[str, Signal], dict[str, Signal]]:
    """The signals with these values or sample times; TypeError for a name that no signal has."""
    if not columns:
        return dict(inputs), dict(channels)
    times = {id(signal): name for signal, name in _times(inputs, channels)}
    if unknown := set(columns) - {*inputs, *channels, *times.values()}:
        raise TypeError(f"a recording has no {sorted(unknown)[0]!r}")
    arrays = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}

    def new(name: str, signal: Signal) -> Signal:
        t = arrays.get(times.get(id(signal), ""), signal.t)
        return dataclasses.replace(signal, values=arrays.get(name, signal.values), t=t)

    ins, outs = ({name: new(name, signal) for name, signal in group.items()} for group in (inputs, channels))
    return ins, outs


def _refuse_double(names: list[str]) -> None:
    """ValueError for a name that two columns would have."""
    taken = ["t", *names, *(f"{name}_t" for name in names)]
    if double := [name for name in taken if taken.count(name) > 1]:
        raise ValueError(f"two columns would be called {double[0]}")
