"""Unknown effects: a force outside the library is called unknown and drawn, a known one is not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from diagnose.examples import bad_data
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.curves.curve import curves
from hoopd.diagnose.curves.curve_fits import fitted_shapes, together
from hoopd.diagnose.curves.location_evidence import locate
from hoopd.diagnose.curves.unknown_effects import Survey, chance_of_lead, judge_unknown, survey
from hoopd.diagnose.findings import refused_of, unknown_finding
from hoopd.diagnose.location import location_of, segments_of
from hoopd.diagnose.proof import unknown_proof as unnamed
from hoopd.diagnose.proof.confirmation import confirmation
from hoopd.diagnose.proof.fit_record import fits_of
from hoopd.diagnose.proof.fit_tables import played
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.hypotheses import heldout_fits
from hoopd.diagnose.proof.unknown_proof import asked_for, missing_instead, proven
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.step_halving import step_nats, step_sentence

PLANT = shipped_plant()
LIBRARY = library(PLANT)
# Rivals of the two cases: screening all of them takes longer and says the same.
RIVALS = [LIBRARY[name] for name in ("hoop.coulomb_friction", "hoop.imbalance", "actuator.cogging", "camera.latency")]
PULL, PLACE = 0.006, 2.0


def magnet_force(theta: object) -> object:
    """A magnet at PLACE, felt near it only; N m."""
    return -ca.sin(theta - PLACE) * ca.exp(4.0 * (ca.cos(theta - PLACE) - 1.0))


MAGNET = Effect(
    "hoop.magnet", (EffectParameter("A", "N m", 0, 0, 1),), force=lambda s, e: {"theta": e.A * magnet_force(s.theta)}
)


@pytest.fixture(scope="module")
def magnetic() -> Survey:
    made = stretch_with(PLANT, "r", 1, 15.0, [MAGNET], {"hoop.magnet.A": PULL})
    return survey(fit([made], (), PLANT.values), RIVALS)


@pytest.fixture(scope="module")
def rubbed() -> tuple[Survey, HypothesisFit]:
    """With Coulomb friction: survey beside the base, and the fit of the named effect."""
    friction = LIBRARY["hoop.coulomb_friction"]
    made = stretch_with(PLANT, "r", 2, 15.0, [friction], {"hoop.coulomb_friction.Fc": 2.5e-3})
    base = fit([made], (), PLANT.values)
    start = {**base.values, "hoop.coulomb_friction.Fc": 1e-3}
    return survey(base, RIVALS), fit([made], [friction], start, like=base, noise=base.noise)


def test_a_force_outside_the_library_is_unknown_where_it_sits(magnetic: Survey) -> None:
    found = judge_unknown(magnetic)
    assert found is not None
    assert (found.name, found.curve.depends_on) == ("unknown.hoop", ("theta",))
    assert "encoder" not in found.not_excluded
    assert found.channels["theta"] > 0.5


def test_its_curve_is_the_force(magnetic: Survey) -> None:
    joint, (curve,) = together([magnetic.curves[0]], magnetic.fit)
    shapes = fitted_shapes(curve, joint, joint.recordings)
    assert joint.criterion < magnetic.fit.criterion - 10.0
    shape = shapes[0]
    true = np.array([PULL * float(magnet_force(float(x))) for x in shape.x])
    # the base's parameters take no constant force here, but hats flatten a narrow law
    assert np.corrcoef(shape.y, true)[0, 1] > 0.85
    inside = (shape.low <= true) & (true <= shape.high)
    assert inside.mean() >= 0.6
    assert any(a <= PLACE + 0.8 and b >= PLACE - 0.8 for a, b in shape.region)


def test_its_place_is_located(magnetic: Survey) -> None:
    evidence = locate(magnetic)
    assert evidence["hoop"] == max(evidence.values())
    assert set(evidence) == set(PLANT.slots)


def test_a_named_effect_is_not_called_unknown(rubbed: tuple[Survey, HypothesisFit]) -> None:
    base, named = rubbed
    assert base.fires
    assert judge_unknown(base, survey(named, RIVALS)) is None
    # nor when the search has not accepted it
    assert judge_unknown(base) is None
    assert chance_of_lead(base, base.named[0], 100, 0) > 0.05


def test_without_its_name_in_the_library_it_is_unknown(rubbed: tuple[Survey, HypothesisFit]) -> None:
    base, _ = rubbed
    others = survey(base.fit, [effect for effect in RIVALS if effect.name != "hoop.coulomb_friction"])
    found = judge_unknown(others)
    assert found is not None
    assert (found.name, found.curve.depends_on) == ("unknown.hoop", ("dtheta",))
    shape = found.shapes[0]
    # a jump against the motion at rest, which no viscous base takes
    assert np.interp(-3.0, shape.x, shape.y) - np.interp(3.0, shape.x, shape.y) > 1e-3


def test_nothing_is_unknown_in_clean_data() -> None:
    made = stretch_with(PLANT, "r", 4, 10.0)
    found = survey(fit([made], (), PLANT.values), RIVALS)
    assert not found.fires
    assert judge_unknown(found) is None
    assert max(locate(found).values()) <= found.threshold


# ---------------------------------------------------------------------------------------------- on data held out


def test_an_unknown_effect_is_proven_on_held_out_data_and_is_the_ceiling(magnetic: Survey) -> None:
    found = judge_unknown(magnetic)
    assert found is not None
    # disturbances hide from a simulation of two seconds what a filter sees: here are few
    quiet = Noise(0.1 * NOISE.force, NOISE.time_s, NOISE.reading)
    held = HeldOut([stretch_with(PLANT, "held", 21, 10.0, [MAGNET], {"hoop.magnet.A": PULL}, noise=quiet)])
    proof = proven(found, held)
    assert proof is not None and proof.joint is not None and proof.heldout is not None and proof.unknown.carries_over
    without = held.of(magnetic.fit)
    assert without is not None and without.criterion - proof.heldout.criterion > 10.0
    assert proof.unknown.gain == pytest.approx(magnetic.fit.criterion - proof.joint.criterion)
    fits = played(heldout_fits(Named(magnetic.fit, magnetic.fit, magnetic.fit), held, magnetic, proof))
    told, row = unknown_finding(proof.unknown, fits).ablation, fits_of(fits)["held"]
    assert told is not None and told.log_likelihood_loss == proof.unknown.gain
    # its ablation is the base; no other slot asks for a curve beside it, so that it is the ceiling itself
    for channel, one in row.items():
        assert told.heldout_without[channel] == pytest.approx(one.base_refit)
        assert told.heldout_with[channel] == one.with_effects == one.ceiling
    assert row["psi"].ceiling > row["psi"].base_refit


def test_a_curve_that_the_held_out_data_deny_is_not_confirmed_with_the_reason(magnetic: Survey) -> None:
    found = judge_unknown(magnetic)
    assert found is not None
    held = HeldOut([stretch_with(PLANT, "held", 22, 10.0)])
    proof = proven(found, held)
    assert proof is not None and proof.joint is None and proof.denial is not None
    assert proof.denial.reason.startswith("the held-out data lose ")
    named = Named(magnetic.fit, magnetic.fit, magnetic.fit)
    fits = played(heldout_fits(named, held, magnetic, proof))
    said = confirmation(named, held, fits, proof, found.threshold)
    told = unknown_finding(proof.unknown, fits, said)
    assert (told.status, told.reason) == ("not_confirmed", proof.denial.reason) and "curve" not in told.statement
    # without evidence beyond chance it is no finding
    weak = replace(proof, unknown=replace(proof.unknown, surprise=1.1 * found.threshold))
    assert proof.is_told and not weak.is_told
    (refused,) = refused_of(named, said, weak)
    assert (refused.name, refused.reason) == ("unknown.hoop", proof.denial.reason)


def test_what_the_held_out_data_ask_for_with_other_values_is_unknown_and_in_no_model(magnetic: Survey) -> None:
    found = judge_unknown(magnetic)
    assert found is not None
    held = HeldOut([stretch_with(PLANT, "held", 23, 20.0, [MAGNET], {"hoop.magnet.A": -PULL})])
    proof = proven(found, held)
    assert proof is not None and not proof.unknown.carries_over
    assert proof.joint is None and proof.heldout is None
    fits = played(heldout_fits(Named(magnetic.fit, magnetic.fit, magnetic.fit), held, magnetic, proof))
    assert fits["final"] is fits["named"] and fits["ceiling"] is fits["base"]
    told = unknown_finding(proof.unknown, fits)
    assert told.ablation is None and told.statement.endswith("by another curve in the held-out recordings")


def test_parameters_that_are_off_do_not_ask_for_a_curve() -> None:
    judge_bent_base("hoop.coulomb_friction", {"Fc": 2.5e-3}, ("dtheta",))


@pytest.mark.proof
def test_parameters_that_drag_or_a_ball_s_friction_bent_do_not_ask_for_a_curve() -> None:
    judge_bent_base("hoop.quadratic_drag", {"c": 2e-5}, ("dtheta",))
    judge_bent_base("ball.coulomb_friction", {"Fc": 3e-4}, ("dtheta-dpsi",))


def judge_bent_base(name: str, values: dict[str, float], depends_on: tuple[str, ...]) -> None:
    """What is there in the training data alone bends the base, and a bent base is no curve of the held-out data."""
    hidden = {f"{name}.{key}": value for key, value in values.items()}
    base = fit([stretch_with(PLANT, "r", 3, 15.0, [LIBRARY[name]], hidden)], (), PLANT.values)
    place = (LIBRARY[name].slot, "force", *depends_on)
    curve = next(one for one in curves(base) if one.place == place)
    clean = HeldOut([stretch_with(PLANT, "held", 4, 15.0)]).of(base)
    again = HeldOut([stretch_with(PLANT, "held", 5, 15.0, [LIBRARY[name]], hidden)]).of(base)
    assert clean is not None and not asked_for(curve, clean)
    assert again is not None and asked_for(curve, again)


def test_names_stay_where_the_held_out_data_refuse_the_curve_that_was_to_stand_alone(
    magnetic: Survey, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = judge_unknown(magnetic)
    assert found is not None and not found.beside_names
    held = HeldOut([stretch_with(PLANT, "held", 23, 20.0, [MAGNET], {"hoop.magnet.A": -PULL})])
    named = Named(magnetic.fit, magnetic.fit, magnetic.fit)
    named.accepted.append(object())  # type: ignore[arg-type]
    monkeypatch.setattr(unnamed, "survey", lambda *_, **__: magnetic)
    monkeypatch.setattr(unnamed, "judge_unknown", lambda *_, **__: found)
    told = unnamed.missing_of(named, held, (), 0)
    assert told.unknown is not None and told.joint is None and named.accepted


def test_a_name_that_a_scan_or_a_refit_found_is_not_called_unknown(rubbed: tuple[Survey, HypothesisFit]) -> None:
    base, _ = rubbed
    friction = next(one for one in base.named if one.member.effect.name == "hoop.coulomb_friction")
    # the library's own screen has no word for it
    others = [effect for effect in RIVALS if effect.name != "hoop.coulomb_friction"]
    assert judge_unknown(survey(base.fit, others)) is not None
    assert judge_unknown(survey(base.fit, others, also=[friction])) is None
    assert judge_unknown(survey(base.fit, others, fitted=[friction])) is None


def test_a_name_that_a_joint_fit_refuted_does_not_stand_for_a_curve(rubbed: tuple[Survey, HypothesisFit]) -> None:
    """Its screen is linear: what it hoped for counts no longer."""
    base, _ = rubbed
    friction = next(one for one in base.named if one.member.effect.name == "hoop.coulomb_friction")
    assert judge_unknown(survey(base.fit, RIVALS)) is None
    found = judge_unknown(survey(base.fit, RIVALS, fitted=[replace(friction, gain=1.0)]))
    assert found is not None and found.curve.slot == "hoop"


# ---------------------------------------------------------------------------------------------- where and when


def test_a_change_of_a_few_seconds_has_its_segment_and_one_of_all_the_time_has_none(magnetic: Survey) -> None:
    track = magnetic.fit.tracks[0]
    each = np.zeros((len(track.stretch.t), len(magnetic.fit.rows[0]) // len(track.stretch.t)))
    each[(track.stretch.t > 4.0) & (track.stretch.t < 5.5)] = 1.0
    found = segments_of(each.ravel(), magnetic)
    assert found is not None and len(found) == 1
    assert found[0] == pytest.approx((4.0, 5.5), abs=0.5)
    assert segments_of(np.ones(each.size), magnetic) is None


def test_where_parameters_are_the_answer_a_channel_is_told_and_no_slot(magnetic: Survey) -> None:
    base = magnetic.fit
    nominal = SimpleNamespace(values={**base.values, "K2": 0.8 * base.values["K2"]})
    named = Named(nominal, base, base)  # type: ignore[arg-type]
    place = location_of(named, magnetic, None, "parameters")
    assert (place.slot, place.channel) == (None, "psi")
    assert place.evidence["hoop"] == max(place.evidence.values())
    assert location_of(named, magnetic, None, "consistent").channel is None


def test_a_fault_of_the_camera_has_a_place_too(magnetic: Survey) -> None:
    base = magnetic.fit
    named = Named(base, base, base)  # type: ignore[arg-type]
    (late,) = bad_data()[0].effects
    place = location_of(named, magnetic, None, "missing_physics", [late])
    assert (place.slot, place.channel, place.segments) == ("camera", "psi", None)


def test_the_place_is_that_of_what_has_no_name_when_it_carries_most(magnetic: Survey) -> None:
    base, unknown = magnetic.fit, judge_unknown(magnetic)
    assert unknown is not None
    named = Named(base, base, base)  # type: ignore[arg-type]
    place = location_of(named, magnetic, unknown, "unknown_physics", [unknown_finding(unknown, {})])
    assert (place.slot, place.depends_on) == (unknown.curve.slot, list(unknown.curve.depends_on))


def test_half_the_step_changes_little_and_a_long_step_is_told(magnetic: Survey) -> None:
    assert step_nats(magnetic.fit) < 0.1
    assert "0.1 nats" in step_sentence(0.1) and "may be the solver's" in step_sentence(2.0)


def test_a_curve_is_asked_for_where_held_out_data_have_refused_all_names(
    rubbed: tuple[Survey, HypothesisFit],
) -> None:
    """Its own name could be it, and stays untold; what the held-out data gain by the curve is proof enough."""
    base, friction = rubbed[0].fit, LIBRARY["hoop.coulomb_friction"]
    named = Named(base, base, base)
    again = HeldOut([stretch_with(PLANT, "held", 23, 10.0, [friction], {"hoop.coulomb_friction.Fc": 2.5e-3})])
    told = missing_instead(named, again, RIVALS, ["camera.latency"], 0)
    assert told is not None and told.unknown is not None and told.unknown.name == "unknown.hoop"
    assert "hoop.coulomb_friction could be it" in told.unknown.reason
    nothing = HeldOut([stretch_with(PLANT, "held", 24, 10.0)])
    assert missing_instead(named, nothing, RIVALS, ["camera.latency"], 0) is None
    assert missing_instead(named, HeldOut([]), RIVALS, ["camera.latency"], 0) is None
