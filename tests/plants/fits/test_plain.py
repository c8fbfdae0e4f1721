"""Judgements as JSON."""

from __future__ import annotations

import json
from math import inf

import numpy as np
from freeruns import DEVICE

from hoopd.plants.fits.plain_numbers import plain
from hoopd.plants.fits.undetermined import Direction
from hoopd.plants.hoop.entries import entries_of
from hoopd.plants.hoop.fitting.physical_parameters import Known, physical_from_entries


def test_judgements_become_json_without_infinities():
    assert plain(Direction({"a": np.float64(1.0)}, inf)) == {"changes": {"a": 1.0}, "relative_sd": None}
    assert plain((Known("mb", 0.06, 0.01), np.array([1, 2]), True)) == [
        {"name": "mb", "value": 0.06, "relative_sd": 0.01},
        [1, 2],
        True,
    ]
    found = physical_from_entries("rolling", entries_of("rolling", DEVICE), DEVICE, starts=2)
    again = json.loads(json.dumps(plain(found), allow_nan=False))
    assert again["directions"][0]["relative_sd"] is None
    assert again["parameters"].keys() == DEVICE.keys()
