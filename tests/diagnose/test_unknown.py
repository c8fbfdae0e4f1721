"""Unknown effects: a force outside the library is called unknown and drawn, a known one is not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.curves.locate import locate
from hoopd.diagnose.curves.unknown import Survey, chance_of_lead, judge_unknown, refitted, survey
from hoopd.diagnose.engine.fitting import Fit, fit
from hoopd.physics.effects.base import Effect, EffectParameter
from hoopd.physics.effects.catalogue import library

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
def rubbed() -> tuple[Survey, Fit]:
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
    joint, shapes = refitted(magnetic.curves[0], magnetic.fit)
    assert joint.criterion < magnetic.fit.criterion - 10.0
    shape = shapes[0]
    true = np.array([PULL * float(magnet_force(float(x))) for x in shape.x])
    # the base's parameters take no constant force here, but hats flatten a narrow law
    assert np.corrcoef(shape.y, true)[0, 1] > 0.85
    inside = (shape.low <= true) & (true <= shape.high)
    assert inside.mean() >= 0.6
    assert any(a <= PLACE + 0.8 and b >= PLACE - 0.8 for a, b in shape.region)


def test_its_place_is_located(magnetic: Survey) -> None:
    found = locate(magnetic)
    assert (found.slot, found.channel, found.depends_on) == ("hoop", "theta", ("theta",))
    assert found.evidence["hoop"] == max(found.evidence.values())
    assert set(found.evidence) == set(PLANT.slots)


def test_a_named_effect_is_not_called_unknown(rubbed: tuple[Survey, Fit]) -> None:
    base, named = rubbed
    assert base.fires
    assert judge_unknown(base, survey(named, RIVALS)) is None
    # nor when the search has not accepted it
    assert judge_unknown(base) is None
    assert chance_of_lead(base, base.named[0], 100, 0) > 0.05


def test_without_its_name_in_the_library_it_is_unknown(rubbed: tuple[Survey, Fit]) -> None:
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
    assert locate(found).slot is None
