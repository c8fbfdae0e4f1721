"""A fit with effects beside the base: the base is found beside them, and is wrong without them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.files.reading import InputError
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.fitting.fit import FitSettings, fit, model_file
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import effects_of, load_model, parse_model
from hoopd.recording.recording import Recording, from_columns

FILE = load_model(Path(__file__).resolve().parents[3] / "config" / "models" / "hoop.yaml")
ENTRIES = (FoundEffect("hoop.coulomb_friction", {"Fc": 0.01}), FoundEffect("camera.latency", {"d": 0.03}))
FOUND = FoundEffects(FILE.structure, FILE.values(), ENTRIES)


def recorded() -> Recording:
    rng, t = np.random.default_rng(3), 0.02 * np.arange(600)
    u = 0.06 * np.repeat(rng.choice((-1.0, 1.0), 60), 10)
    x = HoopModel.with_effects(FOUND).run((), np.array([0.0, 0.0, 0.2, 0.0]), t, u[:-1])
    theta = np.floor(x[:, 0] * 4096 / (2 * np.pi)) * 2 * np.pi / 4096
    psi = x[:, 2] + 0.002 * rng.normal(size=len(t))
    return from_columns({"t": t, "u": u, "theta": theta, "dtheta": x[:, 1], "psi": psi}, "made")


def test_the_base_is_found_beside_its_effects() -> None:
    fixed = {name: FILE.values()[name] for name in ("mb", "Ro", "Rb", "g", "bb")}
    settings = FitSettings(structure="rolling", fixed=fixed, window_s=3.0)
    start = {**FILE.values(), "Ih": 1.8e-3}
    off = {}
    for label, effects in (("with", FOUND), ("without", None)):
        found = fit([recorded()], start, replace(settings, effects=effects))
        off[label] = abs(found.values["Ih"] / FILE.values()["Ih"] - 1.0)
        if effects is not None:
            parameters = {"Fc": Parameter(value=0.01, unit="N m")}
            base = msgspec.structs.replace(
                FILE, effects=[EffectEntry(name="hoop.coulomb_friction", parameters=parameters)]
            )
            written = parse_model(model_text(model_file(found, base, "m")), "m")
            assert effects_of(written).names == ("hoop.coulomb_friction",)
    assert off["with"] < 0.005 < 0.03 < off["without"]


def test_a_filter_that_knows_no_effects_is_not_asked() -> None:
    settings = FitSettings(structure="rolling", method="prediction", effects=FOUND)
    with pytest.raises(InputError, match=r"hoop\.coulomb_friction"):
        fit([recorded()], FILE.values(), settings)
