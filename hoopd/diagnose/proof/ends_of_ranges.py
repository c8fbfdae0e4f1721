"""Which fitted numbers stand at the end of what they may be: the data ask for more than the range allows.

Rules of this file: a fit in, sentences out; nothing is fitted again.
"""

from __future__ import annotations

from math import isclose, isfinite

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.priors import ranges
from hoopd.plants.likelihood.recording_parameters import plain

# As near as this to an end, as a share of its size, is on it.
ON_IT = 1e-9


def end_sentences(found: HypothesisFit) -> list[str]:
    """One for each free number on an end of its range that is not where it started: what is declared, or no effect."""
    bounds, effects = ranges(found.effects, found.tracks), {one.name: one for one in found.effects}
    units = {name: unit for track in found.tracks for name, unit in track.stretch.plant.units.items()}
    declared = {name: value for track in found.tracks for name, value in track.stretch.plant.values.items()}
    for one in effects.values():
        units |= {one.key(p.name): p.unit for p in one.parameters}
        declared |= {one.key(p.name): p.neutral for p in one.parameters}
    out = []
    for name in found.free:
        key, value = plain(name), found.values[name]
        ends = [end for end in bounds.get(key, ()) if isfinite(end) and isclose(value, end, rel_tol=ON_IT)]
        if ends and value != declared.get(key):
            unit = units.get(key, "-")
            told = f"{value:.3g}" + (f" {unit}" if unit not in ("", "-") else "")
            out.append(f"{name} stands at the end of its range, {told}: the recordings ask for more than it allows")
    return out
