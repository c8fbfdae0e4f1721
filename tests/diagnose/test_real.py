"""The laboratory's recordings: what the steps of a diagnosis find in them by themselves, and the fits that are reached.

Figures are one free run, NRMSE in percent of theta's slope and of psi. The search itself takes minutes on these files
and is not run here, nor is the choice by free runs: the sets are written down as docs/explanations/diagnose_real.md
tells who found them (`by the tool`: `--free-run-choice`, with the last third held out).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hoopd.commands.inputs import read_recording
from hoopd.diagnose.inputs import Source, source_of
from hoopd.diagnose.proof.fit_tables import nrmse
from hoopd.diagnose.proof.free_run_refinement import Refined, refine
from hoopd.diagnose.quality.excluded_stretches import set_aside
from hoopd.diagnose.search.bounded_disturbance import deflated, far_beyond, stiffened
from hoopd.diagnose.search.screen import Screen
from hoopd.files.shipped import or_shipped
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.model_file import load_model
from tests.shared import shared_path

BALL, BOTH, SINE = "meas_ballOnly01.mat", "meas_hoopAndBall2_01.mat", "meas_hoop01_f05_a01.mat"
PRBS = "meas_hoop01_prbs.mat"


@cache
def source(name: str) -> Source:
    base = load_model(or_shipped(Path("models/thesis.yaml")))
    path = str(shared_path(f"recordings/{name}"))
    return source_of(name, read_recording(path, None, ""), hoop_plant(base.structure, base.values()))


@cache
def base_fit(name: str) -> HypothesisFit:
    return fit(source(name).stretches, (), source(name).stretches[0].plant.values)


def refined(stretches: Sequence[Stretch], names: Sequence[str], start: Mapping[str, float]) -> Refined:
    effects = [library(stretches[0].plant)[name] for name in names]
    plain = [(e.key(p.name), p) for e in effects for p in e.parameters if not p.discrete]
    free = (*stretches[0].plant.free, *(key for key, _ in plain))
    values = {**stretches[0].plant.values, **{key: p.neutral for key, p in plain}, **start}
    return refine(stretches, [Track(one).z for one in stretches], effects, values, free)


def held_out(found: Refined, stretch: Stretch, names: Sequence[str]) -> Refined:
    effects = [library(stretch.plant)[name] for name in names]
    return refine([stretch], [Track(stretch).z], effects, found.values, ())


def test_a_rate_that_is_none_is_left_out_and_a_resting_ball_kept() -> None:
    stretch = source(BOTH).stretches[0]
    columns = list(stretch.plant.channels)
    assert not np.isfinite(stretch.y[:, columns.index("dtheta")]).any()
    seen = np.isfinite(stretch.y[:, columns.index("psi")])
    assert seen[:60].sum() >= 2 and not seen[-3:].any()  # at rest before the torque; frozen at the very end
    assert stretch.scatter[:, columns.index("theta")].max() > 2.0


def test_the_late_camera_is_proposed_though_the_likeliest_base_hides_it() -> None:
    base = base_fit(BOTH)
    assert far_beyond(base)
    held = stiffened(base)
    effects = [library(source(BOTH).stretches[0].plant)[n] for n in ("camera.latency", "frame.tilt", "hoop.imbalance")]
    gains = {s.member.effect.name: s.gain for s in deflated(Screen(held, effects).scores(), held)}
    assert max(gains, key=lambda name: gains[name]) == "camera.latency"
    plain = {s.member.effect.name: s.gain for s in Screen(base, effects).scores()}
    assert gains["camera.latency"] > 50.0 > plain["camera.latency"]


def test_the_uneven_scale_of_the_encoder() -> None:
    stretches = [source(SINE).stretches[0].seconds(0.0, 25.0)]
    base = fit(stretches, (), stretches[0].plant.values)
    effects = [library(stretches[0].plant)[n] for n in ("encoder.harmonic", "actuator.cogging", "hoop.imbalance")]
    best = max(Screen(base, effects).scores(), key=lambda s: s.gain)
    assert best.member.effect.name == "encoder.harmonic" and best.member.shape["n"] == 2.0
    found = fit(stretches, [best.member.effect], {**base.values, **best.start}, like=base, noise=base.noise)
    assert base.criterion - found.criterion > 300.0
    assert found.values["encoder.harmonic.a"] == pytest.approx(0.014, abs=0.002)


def test_the_hand_is_set_aside_and_both_decays_repeat() -> None:
    stretches = source(BALL).stretches
    values = stretches[0].plant.values
    kept, aside, *_ = set_aside(stretches, lambda some: fit(some, (), values))
    assert any(one.t0 < 15.0 and one.t1 > 16.5 for one in aside)
    decays = [one for one in kept if one.t[-1] - one.t[0] > 9.0]
    assert len(decays) == 2
    names = ("camera.center_offset", "ball.rolling_resistance")
    found = refined(decays[:1], names, {"ball.rolling_resistance.r": 5e-5})
    base = refined(decays[:1], (), {})
    assert nrmse(found.runs)["psi"] > 95.2 > nrmse(base.runs)["psi"]
    assert nrmse(held_out(found, decays[1], names).runs)["psi"] > 95.0  # the second decay, parameters of the first
    assert nrmse(refined(decays[1:], names, {"ball.rolling_resistance.r": 5e-5}).runs)["psi"] > 97.2


def test_one_free_run_of_hoop_and_ball() -> None:
    stretch = source(BOTH).stretches[0]
    names = ("camera.latency", "hoop.coulomb_friction")
    start = {"camera.latency.d": 0.02, "hoop.coulomb_friction.Fc": 0.004}
    found, base = refined([stretch], names, start), refined([stretch], (), {})
    figures, before = nrmse(found.runs), nrmse(base.runs)
    assert figures["theta_rate"] > 92.0 and figures["psi"] > 90.8
    assert before["theta_rate"] < 82.0 and before["psi"] < 82.0
    assert found.values["camera.latency.d"] == pytest.approx(0.033, abs=0.004)


@pytest.mark.proof
def test_a_bias_gains_a_little_more_and_half_of_a_run_tells_the_other_half() -> None:
    stretch = source(BOTH).stretches[0]
    names = ("camera.latency", "hoop.coulomb_friction")
    start = {"camera.latency.d": 0.02, "hoop.coulomb_friction.Fc": 0.004}
    found = refined([stretch], names, start)
    more = nrmse(refined([stretch], (*names, "actuator.torque_bias"), found.values).runs)
    assert more["theta_rate"] > 92.8 and more["psi"] > 91.0
    half = refined([stretch.seconds(0.0, 10.0)], names, start)
    assert nrmse(held_out(half, stretch.seconds(10.0, 20.0), names).runs)["psi"] > 85.0


@pytest.mark.proof
def test_by_the_tool_the_long_run_of_hoop_and_ball() -> None:
    stretch = source(PRBS).stretches[0]
    names = ("camera.latency", "hoop.coulomb_friction")
    start = {"camera.latency.d": 0.03, "hoop.coulomb_friction.Fc": 0.004}
    cut = stretch.t[-1] * 2.0 / 3.0
    first, last = stretch.seconds(0.0, cut), stretch.seconds(cut, 60.0)
    found, base = refined([first], names, start), refined([first], (), {})
    assert nrmse(found.runs)["theta_rate"] > 89.2 > nrmse(base.runs)["theta_rate"]
    assert nrmse(found.runs)["psi"] > 90.0 > nrmse(base.runs)["psi"]
    better, worse = held_out(found, last, names), held_out(base, last, ())
    # smooth samples of theta that are the hardest to follow count, too: none of them is false
    assert better.cost < 0.55 * worse.cost


def test_by_the_tool_the_ball_alone() -> None:
    stretches = source(BALL).stretches
    values = stretches[0].plant.values
    kept, *_ = set_aside(stretches, lambda some: fit(some, (), values))
    decays = [one for one in kept if one.t[-1] - one.t[0] > 9.0]
    names = ("ball.rolling_resistance", "camera.center_offset", "ball.quadratic_drag")
    found = refined(decays[:1], names, {"ball.rolling_resistance.r": 5e-5})
    assert nrmse(found.runs)["psi"] > 97.0
    assert nrmse(held_out(found, decays[1], names).runs)["psi"] > 97.0


def test_one_free_run_of_the_hoop_alone() -> None:
    stretches = source(SINE).stretches
    found = refined(stretches, ("hoop.coulomb_friction",), {"hoop.coulomb_friction.Fc": 0.003})
    assert nrmse(found.runs)["theta_rate"] > 96.1
    assert nrmse(refined(stretches, (), {}).runs)["theta_rate"] < 95.6
