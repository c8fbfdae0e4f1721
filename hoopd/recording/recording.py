"""The one data type of a recorded run, whatever file it came from.

Rules of this file: immutable; numpy columns of one length, NaN for missing; units in the names' comments and in
`UNITS`; angles in radians; no files, no clock. Row k: `u` is held from t[k] to t[k+1], the other columns carry
times of their own (`y_t`, `psi_t`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "t": "s",
        "u": "N m",
        "theta": "rad",
        "dtheta": "rad/s",
        "current": "A",
        "psi": "rad",
        "y_t": "s",
        "psi_t": "s",
    }
)


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One run: signals by row, where they came from, and the configuration text they were taken with."""

    t: Column  # s, run time of the tick
    u: Column  # N m, held from t[k] to t[k+1]
    theta: Column  # rad, unwrapped
    dtheta: Column  # rad/s
    current: Column  # A
    psi: Column  # rad, 0 at the bottom, unwrapped
    y_t: Column  # s, when theta, dtheta and current were sampled
    psi_t: Column  # s, middle of the exposure
    source: str = ""  # name of the file, without its folder
    config: str = ""  # configuration text (YAML), empty when the source has none
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # other columns of the tick by name
    lost: str = ""  # what a damaged file lost, empty when whole

    def __post_init__(self) -> None:
        """Float columns of one length, made read-only; ValueError names the one that does not fit."""
        for name in UNITS:
            object.__setattr__(self, name, _read_only(np.array(getattr(self, name), dtype=np.float64)))
        object.__setattr__(self, "extra", MappingProxyType({k: _read_only(np.array(v)) for k, v in self.extra.items()}))
        for name, column in (*((n, getattr(self, n)) for n in UNITS), *self.extra.items()):
            if column.shape[:1] != self.t.shape or (name in UNITS and column.ndim != 1):
                raise ValueError(f"column {name} has shape {column.shape}, t has {self.t.shape}")

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        """Its source, length and measured signals, not its numbers."""
        signals = [
            name for name in ("u", "theta", "dtheta", "current", "psi") if np.isfinite(getattr(self, name)).any()
        ]
        span_s = float(self.t[-1] - self.t[0]) if len(self) else 0.0
        return f"Recording({self.source!r}, {len(self)} rows, {span_s:.6g} s, {', '.join(signals) or 'nothing'})"

    @property
    def sample_time_s(self) -> float:
        """Median step of `t`, NaN below two rows."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")


def _read_only(column: NDArray[Any]) -> NDArray[Any]:
    column.flags.writeable = False
    return column


def from_columns(columns: Mapping[str, object], source: str = "", config: str = "", lost: str = "") -> Recording:
    """Recording from named columns: missing signals become NaN, missing times become t, the rest goes to `extra`."""
    t = np.asarray(columns["t"], dtype=np.float64)
    missing = {"y_t": t, "psi_t": t}
    signals = {name: columns.get(name, missing.get(name, np.full(t.shape, np.nan))) for name in UNITS}
    extra = {name: np.asarray(value) for name, value in columns.items() if name not in UNITS}
    return Recording(**signals, source=source, config=config, extra=extra, lost=lost)  # type: ignore[arg-type]


SIGNALS = tuple(item.name for item in fields(Recording) if item.name in UNITS)
