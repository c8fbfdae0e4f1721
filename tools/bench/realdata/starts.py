"""Where a fit starts and where it ends, by its own criterion.

Rules of this file: a criterion is a negative log-likelihood in nats, the lower the better; noise levels are fitted at
the start as they are at the end.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import log
from typing import Any, NamedTuple

from hoopd.commands.inputs import read_recording
from hoopd.diagnose.case import last_third, stretches_of
from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.search.bounded_disturbance import likeliest
from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.fitting import fit

# Less than this is the end of a search, no loss.
SAME_NATS = 0.5


class Start(NamedTuple):
    """A fit, at its start and at its end; percent of fit by channel there where the fit has them."""

    start_nats: float
    end_nats: float
    percent: dict[str, tuple[float, float]]

    @property
    def is_worse(self) -> bool:
        """The end is clearly less likely than the start, or there is none."""
        return not self.end_nats <= self.start_nats + SAME_NATS


def of_output(result: Mapping[str, Any]) -> Start:
    """Of a record of `hoopd fit` (free runs): sum of n log(error), the likelihood of unknown noise in each channel."""
    start = end = 0.0
    percent = {}
    compared = result.get("channels")
    for channels in result["fit"]["train"].values():
        for name, one in channels.items():
            if one["nominal"] is None or one["fitted"] is None or (compared and name not in compared):
                continue
            start += one["samples"] * log(100.0 - one["nominal"])
            end += one["samples"] * log(100.0 - one["fitted"])
            percent[name] = (one["nominal"], one["fitted"])
    return Start(start, end, percent)


def of_base(path: str, plant: Plant, values: Mapping[str, float], columns: str | None) -> Start:
    """Of the base of a diagnosis of the first two thirds, from `values`."""
    own = replace(plant, values={**plant.values, **values})
    train, _ = last_third([source_of(path, read_recording(path, columns, plant=own), own)])
    stretches = stretches_of(train)
    start = fit(stretches, (), values, move=False)
    end = likeliest(fit(stretches, (), values, like=start, noise=start.noise))
    return Start(start.criterion, end.criterion, {})
