"""How late the readings of a device are in all, from the names of a model file.

    hoop's angle: drive's delay + encoder's,    ball's angle: drive's delay + camera's

No recording tells a late drive from sensors that are all late by the same time, so that only the sums can be compared.

Rules of this file: estimates in, sums out; intervals are added as if the parts were independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot

from realdata.intervals import Estimate

SUMS = {
    "hoop late by": ("actuator.delay.d", "encoder.latency.d"),
    "ball late by": ("actuator.delay.d", "camera.latency.d"),
}


def sums(estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """By what is late; nothing where no part was named."""
    found = {}
    for name, parts in SUMS.items():
        known = [estimates[part] for part in parts if part in estimates]
        if known:
            found[name] = _sum(known)
    return found


def _sum(parts: list[Estimate]) -> Estimate:
    value, halves = sum(one.value for one in parts), [_half(one) for one in parts]
    width = hypot(*(half for half in halves if half is not None))
    return Estimate(value, None if None in halves else (value - width, value + width))


def _half(one: Estimate) -> float | None:
    return None if one.interval is None else (one.interval[1] - one.interval[0]) / 2.0
