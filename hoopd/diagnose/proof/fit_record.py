"""How well each hypothesis repeats every recording, as records of the diagnosis.

Rules of this file: from free runs to records; what is compared is decided elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hoopd.diagnose.proof.fit_tables import Played, noise_floor, nrmse
from hoopd.diagnose.record import Fit as Percent, Fits

# Hypotheses that a table of fits has a column for.
SHOWN = ("nominal", "base", "final", "ceiling", "written")


def fits_of(fits: Mapping[str, Played]) -> Fits:
    """NRMSE of nominal, base, final, and ceiling and what is written where they are given, by recording and channel."""
    figures = {name: _by_recording(one) for name, one in fits.items() if name in SHOWN}
    floors = _floors(fits["final"])
    return {
        recording: {
            channel: Percent(
                nominal=figures["nominal"][recording].get(channel), base_refit=value,
                with_effects=figures["final"][recording].get(channel),
                noise_floor=floors.get(recording, {}).get(channel),
                ceiling=figures.get("ceiling", {}).get(recording, {}).get(channel),
                written=figures.get("written", {}).get(recording, {}).get(channel),
            )
            for channel, value in channels.items()
        }
        for recording, channels in figures["base"].items()
    }  # fmt: skip


def _by_recording(one: Played) -> dict[str, dict[str, float]]:
    return {name: nrmse(runs) for name, runs in one.by_recording().items()}


def _floors(one: Played) -> dict[str, dict[str, float]]:
    return {name: noise_floor(runs, one.fit.noise) for name, runs in one.by_recording().items()}


def mean_nrmse(one: Played) -> dict[str, float]:
    """By channel, over recordings."""
    each = _by_recording(one).values()
    channels = dict.fromkeys(channel for part in each for channel in part)
    return {channel: float(np.nanmean([part.get(channel, np.nan) for part in each])) for channel in channels}
