"""Power: the smallest size of every effect that these recordings would have shown.

An effect of which a size s0 changes the whitened readings by v is expected to gain (s/s0)^2 |v|^2 / 2 nats at size s:
it is seen (every second time) where that is what its threshold asks for. Of an effect that is not proportional the grid
says where the gain crosses the threshold.

Rules of this file: where an effect has a shape or phases that nobody knows, the size is one that would be seen at every
shape of its grid (of a long grid: of some spread over it), at an average phase.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.record import Visible
from hoopd.diagnose.search.candidates import columns_of, needed_of
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.scan_score import Scanned
from hoopd.diagnose.search.screen import Column, Member, Screen, members_of, touched_grids
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Of a push nobody knows when: half a second in the middle of the longest stretch stands for all.
PUSH_S = 0.5
# Places that a scan looks at where none was made.
PLACES = 1000.0
# Of a long grid (harmonics of a turn) so many stand for all.
MOST_SHAPES = 9


def visible(named: Named, library: Mapping[str, Effect], threshold: float = THRESHOLD) -> dict[str, Visible]:
    """Of every effect of a library about the final fit, in the library's order; of those named, by what they gain."""
    known = named.screens.get(id(named.final))
    screen = Screen(named.final, ()) if known is None else known
    slots = {slot for track in named.final.tracks for slot in track.stretch.plant.slots}
    scans = {s.member.effect.name: s for s in named.scores if isinstance(s, Scanned)}
    stretches = [track.stretch for track in named.final.tracks]
    # what is the same as an effect of the fit has nothing left to show
    taken = {name for one in named.final.effects for name in (one.name, *one.same_as)}
    found = {}
    for name, effect in library.items():
        if name in named.losses:
            found[name] = _of_named(effect, named, threshold)
        elif name not in taken and effect.found_by in ("screen", "scan") and effect.slot in slots:
            inner = [p.name for one in effect.contains if one in library for p in library[one].parameters]
            needed = needed_of(scans[name], threshold, stretches) if name in scans else None
            found[name] = of_effect(screen, effect, threshold, needed, inner)
    return found


def of_effect(
    screen: Screen,
    effect: Effect,
    threshold: float = THRESHOLD,
    needed: float | None = None,
    inner: Sequence[str] = (),
) -> Visible:
    """Of an effect that the fit does not have; `inner`: parameters that a simpler effect has too, and speaks for.

    `needed`: the gain that a scan of it asks for.
    """
    if needed is None:
        columns, choices = columns_of(effect, [track.stretch for track in screen.fit.tracks])
        needed = needed_gain(threshold, columns, PLACES if effect.found_by == "scan" else choices)
    members = _members(screen, effect)
    z = screen.whitened([(effect, column) for member in members for column in member.columns])
    ends = np.cumsum([len(member.columns) for member in members])[:-1]
    nats = [np.sum(part**2, axis=0) / 2.0 for part in np.split(z, ends, axis=1)]
    amplitudes = [p for p in effect.parameters if p.role == "amplitude"]
    if not amplitudes:
        return _of_shape(effect, members, [float(one[0]) for one in nats], needed)
    phased = any(p.role == "phase" for p in effect.parameters)
    # an average phase: half of what the two quarters show together
    rows = np.min([np.array([float(one.sum()) / 2.0]) if phased else one for one in nats], axis=0)
    told = [i for i, a in enumerate(amplitudes) if a.name not in inner] or [0]
    return _of_amplitudes([amplitudes[i] for i in told], rows[told], needed)


# ---------------------------------------------------------------------------------------------- inside


def _members(screen: Screen, effect: Effect) -> list[Member]:
    shapes = {p.name: p.unit for p in effect.parameters if p.role == "shape"}
    if shapes != {"t0": "s", "t1": "s"}:
        every = members_of(effect, screen.recordings, touched_grids(effect, screen.fit))
        few = np.unique(np.linspace(0, len(every) - 1, min(len(every), MOST_SHAPES)).round().astype(int))
        return [every[k] for k in few]
    longest = max((track.stretch for track in screen.fit.tracks), key=lambda s: float(s.t[-1] - s.t[0]))
    middle = float(longest.t[0] + longest.t[-1]) / 2.0
    a = next(p for p in effect.parameters if p.role == "amplitude")
    half = PUSH_S * motion_scale(longest.plant) / 2.0
    shape = {"t0": middle - half, "t1": middle + half}
    values = (*shape.items(), (a.name, a.neutral + a.size))
    return [Member(effect, shape, (Column(values, longest.recording),))]


def _of_amplitudes(amplitudes: Sequence[EffectParameter], nats: Array, needed: float) -> Visible:
    """The amplitude that is seen worst, against its range."""
    sizes = [a.size * sqrt(needed / max(n, 1e-12)) for a, n in zip(amplitudes, nats, strict=True)]
    shares = [size / (a.high - a.neutral) for a, size in zip(amplitudes, sizes, strict=True)]
    worst = int(np.argmax(shares))
    a = amplitudes[worst]
    smallest = a.neutral + sizes[worst] if shares[worst] <= 1.0 else None
    return Visible(parameter=a.name, unit=a.unit, smallest=smallest, largest=a.high)


def _of_shape(effect: Effect, members: Sequence[Member], nats: Sequence[float], needed: float) -> Visible:
    p = next(p for p in effect.parameters if p.role == "shape")
    at = np.array([member.shape[p.name] for member in members])
    if not _is_limit(p):
        size = _crossing(np.abs(at - p.neutral), np.array(nats), needed, p.high - p.neutral)
        return Visible(
            parameter=p.name, unit=p.unit, smallest=None if size is None else p.neutral + size, largest=p.high
        )
    size = _crossing(1.0 / at, np.array(nats), needed, 1.0 / p.low)
    limit = None if size is None else float(1.0 / max(size, 1.0 / at.max()))
    return Visible(parameter=p.name, unit=p.unit, smallest=limit)


def _is_limit(p: EffectParameter) -> bool:
    """The lower it is, the larger the effect: it vanishes beyond the end of its range."""
    return p.neutral > p.high


def _crossing(sizes: Array, nats: Array, needed: float, most: float) -> float | None:
    """Size at which the gain crosses what is needed, between two of the grid in logarithms, beyond them as a square."""
    order = np.argsort(sizes)
    x, y = np.log(sizes[order]), np.log(np.maximum(np.maximum.accumulate(nats[order]), 1e-12))
    if y[0] >= log(needed):
        return float(np.exp(x[0] + (log(needed) - y[0]) / 2.0))
    if y[-1] < log(needed):
        size = float(np.exp(x[-1] + (log(needed) - y[-1]) / 2.0))
        return size if size <= most else None
    k = int(np.argmax(y >= log(needed)))
    share = (log(needed) - y[k - 1]) / (y[k] - y[k - 1])
    return float(np.exp(x[k - 1] + share * (x[k] - x[k - 1])))


def _of_named(effect: Effect, named: Named, threshold: float) -> Visible:
    """By what it gained at the size it has."""
    p = next((p for p in effect.parameters if p.role == "amplitude"), effect.parameters[0])
    score = next(one.score for one in named.accepted if one.effect.name == effect.name)
    needed = needed_of(score, threshold, [track.stretch for track in named.final.tracks])
    value = named.final.values.get(effect.key(p.name), p.neutral)
    if _is_limit(p):
        return Visible(parameter=p.name, unit=p.unit, smallest=value)
    size = (value - p.neutral) * sqrt(needed / max(named.losses[effect.name], 1e-12))
    return Visible(parameter=p.name, unit=p.unit, smallest=p.neutral + abs(size), largest=p.high)
