"""Effects whose shape needs a search of its own: a frequency, or two times.

An effect of `found_by="scan"` is tried at thousands of values of its shape parameters: its score at each is an inner
product with the adjoint (`adjoint`), its level comes from what white noise would make of the same products. The best
few are then whitened exactly and scored as every other effect is, and refined. What is searched is read from the
parameters: a shape in rad/s with a phase is a frequency; two shapes in s called t0, t1 are a pulse in one recording;
any other scan goes through its grid.

Rules of this file: a gain says how many places were looked at; a scan proposes, a fit decides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hoopd.diagnose.search.pushes import pushes
from hoopd.diagnose.search.scan_score import Scanned, scanned
from hoopd.diagnose.search.screen import Screen, members_of, score_of
from hoopd.diagnose.search.tones import tones
from hoopd.plants.effects.base import Effect


def scan(screen: Screen, effect: Effect) -> Scanned | None:
    """The best of an effect's places; None where no recording can show it."""
    return next(iter(places(screen, effect)), None)


def places(screen: Screen, effect: Effect) -> list[Scanned]:
    """The best few of an effect's places, exactly scored, best first; none for an effect that the fit has already."""
    if effect.name in screen.fit.names:
        return []
    found = _search_of(effect)(screen, effect)
    return sorted((one for one in found if one.gain > 0.0), key=lambda one: -one.gain)


def _search_of(effect: Effect) -> Callable[[Screen, Effect], list[Scanned]]:
    shapes = {p.name: p.unit for p in effect.parameters if p.role == "shape"}
    phased = any(p.role == "phase" for p in effect.parameters)
    if effect.force is not None and phased and list(shapes.values()) == ["rad/s"]:
        return tones
    if effect.force is not None and shapes == {"t0": "s", "t1": "s"}:
        return pushes
    return _grid


def _grid(screen: Screen, effect: Effect) -> list[Scanned]:
    members = members_of(effect, screen.recordings)
    z = screen.whitened([(effect, column) for member in members for column in member.columns])
    ends = np.cumsum([len(member.columns) for member in members])[:-1]
    scores = [score_of(m, part, screen.residual) for m, part in zip(members, np.split(z, ends, axis=1), strict=True)]
    return [
        scanned(one, len(one.member.columns), len(members))
        for one in scores if np.any(one.vector)
    ]  # fmt: skip
