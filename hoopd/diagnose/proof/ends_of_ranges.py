"""Which fitted numbers stand at the end of what they may be: the data ask for more than the range allows;
and which lie outside of their usual range.

Rules of this file: a fit in, sentences out; nothing is fitted again.
"""

from __future__ import annotations

from math import inf, isclose, isfinite

from hoopd.plants.effects.base import ON_END
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.priors import ranges
from hoopd.plants.likelihood.recording_parameters import plain


def end_sentences(found: HypothesisFit) -> list[str]:
    """One for each free number on an end of its range that is not where it started (what is declared, or no effect),
    and for each that lies outside of its usual range."""
    bounds, effects = ranges(found.effects, found.tracks), {one.name: one for one in found.effects}
    units = {name: unit for track in found.tracks for name, unit in track.stretch.plant.units.items()}
    declared = {name: value for track in found.tracks for name, value in track.stretch.plant.values.items()}
    usual: dict[str, tuple[float, float]] = {}
    for one in effects.values():
        units |= {one.key(p.name): p.unit for p in one.parameters}
        declared |= {one.key(p.name): p.neutral for p in one.parameters}
        usual |= {one.key(p.name): p.usual for p in one.parameters if p.usual is not None}
    out = []
    for name in found.free:
        key, value = plain(name), found.values[name]
        ends = [end for end in bounds.get(key, ()) if isfinite(end) and isclose(value, end, rel_tol=ON_END)]
        unit = "" if units.get(key, "-") in ("", "-") else f" {units[key]}"
        low, high = usual.get(key, (-inf, inf))
        if ends and value != declared.get(key):
            wider = ", widened already" if key in usual else ""
            told = f"the end of its range{wider}, {value:.3g}{unit}"
            out.append(f"{name} stands at {told}: the recordings ask for more than it allows")
        elif not low <= value <= high:
            usually = f"its usual range of {low:.3g} to {high:.3g}{unit}"
            out.append(f"{name} is {value:.3g}{unit}, outside of {usually}, which was widened")
    return out
