"""Late readings are asked for beside whatever was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof.late_sensors import late_sentences
from hoopd.diagnose.search.naming import Named, Refusal
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit

PLANT = shipped_plant()
LIBRARY = library(PLANT)
LATE, RUBS = LIBRARY["camera.latency"], LIBRARY["hoop.coulomb_friction"]
SIZES = {f"{RUBS.name}.Fc": 0.01, f"{LATE.name}.d": 0.02}


@pytest.fixture(scope="module")
def named() -> Named:
    """Of a friction and a late camera the friction alone was found."""
    run = stretch_with(PLANT, "train", 1, 12.0, [RUBS], {**PLANT.values, **SIZES})
    psi = run.y[:, -1:]
    train = [replace(run, y=np.hstack([run.y[:, :-1], np.vstack([psi[:1], psi[:-1]])]))]  # a sample late
    base = fit(train, (), PLANT.values)
    return Named(base, base, fit(train, (RUBS,), {**base.values, **SIZES}, like=base, noise=base.noise))


def test_a_late_camera_is_told_beside_a_friction_that_took_the_last_place(named: Named) -> None:
    (told,) = [one for one in late_sentences(named, LIBRARY, 12.0) if "psi" in one]
    assert told.startswith("beside all that was found psi still looks late, by ") and told.endswith("?")
    # 20 ms are hidden; the parameters have taken a part of them
    assert 2.0 < float(told.split(", by ")[1].split(" ms")[0]) < 25.0


def test_what_was_found_or_refused_is_not_told_again(named: Named) -> None:
    train = [track.stretch for track in named.final.tracks]
    both = fit(train, (RUBS, LATE), {**named.final.values, **SIZES}, like=named.final, noise=named.final.noise)
    assert late_sentences(Named(named.nominal, named.base, both), LIBRARY, 12.0) == []
    refused = Named(named.nominal, named.base, named.final, refusals={LATE.name: Refusal(90.0, 30.0)})
    assert not any("psi" in one for one in late_sentences(refused, LIBRARY, 12.0))
