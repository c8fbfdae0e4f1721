"""What held-out data say about a name: which are kept, which lower a channel, and which are never tested."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from diagnose.examples import consistent
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.commands.diagnosed_model import flipped
from hoopd.diagnose.findings import is_any_left, refused_of
from hoopd.diagnose.proof.confirmation import Confirmation, confirmation, reach, status_of
from hoopd.diagnose.proof.fit_tables import Played, played
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.lowered import lowered
from hoopd.diagnose.search.candidates import Tried
from hoopd.diagnose.search.naming import Named, Refusal
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
FRICTION = library(PLANT)["hoop.coulomb_friction"]
LIMIT = library(PLANT)["actuator.saturation"]
SIZE = {f"{FRICTION.name}.Fc": 0.03}


def recorded(name: str, seed: int, friction: bool, seconds: float = 16.0) -> Stretch:
    effects, values = ([FRICTION], {**PLANT.values, **SIZE}) if friction else ([], PLANT.values)
    return stretch_with(PLANT, name, seed, seconds, effects, values)


@pytest.fixture(scope="module")
def fits() -> tuple[HypothesisFit, HypothesisFit]:
    """Without and with a friction, fitted to data that have it."""
    train = [recorded("train", 1, friction=True)]
    base = fit(train, (), PLANT.values)
    return base, fit(train, (FRICTION,), {**base.values, **SIZE}, like=base, noise=base.noise)


def named_with(base: HypothesisFit, final: HypothesisFit, effect: Effect = FRICTION) -> Named:
    score: Any = SimpleNamespace(member=SimpleNamespace(effect=effect))
    gain = base.criterion - final.criterion
    one = Tried(effect, final, gain, gain, score)
    return Named(base, base, final, [one], [one], {effect.name: gain}, {effect.name: base})


def confirmed(named: Named, stretch: Stretch) -> tuple[Confirmation, dict[str, Played]]:
    held = HeldOut([stretch])
    wanted = {"base": named.base, "named": named.final}
    wanted |= {f"without {name}": one for name, one in named.without.items()}
    shown = played({name: run for name, one in wanted.items() if (run := held.of(one)) is not None})
    shown["final"] = shown["named"]
    return confirmation(named, held, shown, None, 12.0), shown


def test_what_is_there_is_confirmed_and_kept(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    named = named_with(*fits)
    found, shown = confirmed(named, recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "confirmed"}
    assert found.kept is named.final and found.final is named.final and not found.lost
    assert lowered(shown["named"], shown["base"])  # the other way round something is lost


def test_what_lowers_the_held_out_simulation_is_not_confirmed_and_in_no_model() -> None:
    """A friction that is not there, as if it had been."""
    train = [recorded("train", 1, friction=False)]
    base = fit(train, (), PLANT.values)
    wrong = fit(train, (FRICTION,), {**base.values, **SIZE}, like=base, noise=base.noise, move=False)
    named = named_with(base, wrong)
    found, _ = confirmed(named, recorded("held", 2, friction=False))
    assert found.statuses == {FRICTION.name: "not_confirmed"}
    assert found.kept is named.base and found.final is named.base and found.denied == [FRICTION.name]
    assert max(found.lost[FRICTION.name].values()) > 1.0
    assert found.fits["final"].fit is found.fits["base"].fit
    assert not is_any_left(named, found)
    (told,) = refused_of(named, found)
    assert told.name == FRICTION.name and "held-out data is worse: " in told.reason


def test_a_limit_that_held_out_data_never_reach_is_untested(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    values = {**PLANT.values, f"{LIMIT.name}.s": 0.12}
    train = [stretch_with(PLANT, "train", 1, 16.0, [LIMIT], values, torque=0.15)]
    base = fit(train, (), PLANT.values)
    final = fit(train, (LIMIT,), values, like=base, noise=base.noise)
    named = named_with(base, final, LIMIT)
    assert confirmed(named, stretch_with(PLANT, "held", 2, 10.0, torque=0.05))[0].statuses == {LIMIT.name: "untested"}
    reached = stretch_with(PLANT, "held", 2, 10.0, [LIMIT], values, torque=0.15)
    assert confirmed(named, reached)[0].statuses == {LIMIT.name: "confirmed"}


def test_without_held_out_data_nothing_is_tested(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    found = confirmation(named_with(*fits), HeldOut([]), {}, None, 12.0)
    assert found.statuses == {FRICTION.name: "untested"} and found.kept is fits[1]


def test_what_barely_passes_is_weak() -> None:
    assert [status_of(one, 12.0) for one in (12.0, 14.9, 15.0)] == ["weak", "weak", "confirmed"]


def test_the_reach_of_an_effect_grows_with_its_size(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    base, final = fits
    twice = replace(final, values={**final.values, f"{FRICTION.name}.Fc": 2.0 * final.values[f"{FRICTION.name}.Fc"]})
    assert reach(FRICTION, base, twice) > 2.0 * reach(FRICTION, base, final) > 20.0


def test_equal_simulations_lower_nothing_and_noise_is_no_loss(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    held = HeldOut([recorded("held", 2, friction=True)])
    base, final = held.of(fits[0]), held.of(fits[1])
    assert base is not None and final is not None
    one = played({"base": base})["base"]
    assert lowered(one, one) == {}
    noisy = [replace(run, y=run.y + 1e-6 * np.random.default_rng(3).normal(size=run.y.shape)) for run in one.runs]
    assert lowered(one, replace(one, runs=noisy)) == {}
    assert lowered(played({"final": final})["final"], one)
    # one window that carries a loss of more than a point leaves the draws undecided: a gain is not proven either
    runs = [replace(run, y=run.y.copy()) for run in one.runs]
    runs[0].y[:, -1, 0] += 0.5 * np.nanstd(one.runs[0].y[:, -1])
    worse = lowered(one, replace(one, runs=runs))
    assert worse and max(worse.values()) > 1.0


def test_what_folds_refused_is_told_with_the_reason(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    named = replace(named_with(*fits), refusals={"actuator.cogging": Refusal(33.0, 7.2)})
    told = refused_of(named, Confirmation(fits[1], fits[1], {}, {FRICTION.name: "confirmed"}))
    assert [(one.name, one.log_likelihood_gain) for one in told] == [("actuator.cogging", 33.0)]
    assert "7.2 nats" in told[0].reason


def test_a_parameter_that_changed_its_sign_is_told() -> None:
    diagnosis, _ = consistent()
    (name, one), *_ = diagnosis.base.parameters.items()
    other = msgspec.structs.replace(one, value=-2.5, nominal=1.5)
    base = msgspec.structs.replace(diagnosis.base, parameters={**diagnosis.base.parameters, name: other})
    assert flipped(diagnosis) == []
    (told,) = flipped(msgspec.structs.replace(diagnosis, base=base))
    assert told.startswith(f"{name} is written with the other sign: -2.5 ") and told.endswith("1.5 before")
