"""What becomes of denied names: neighbours in their place, names that are worse together, curves, written models."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from diagnose.confirming import FRICTION, PLANT, named_with, recorded
from diagnose.examples import consistent, coulomb

from hoopd.commands.diagnosed_model import flipped, left_out, outside
from hoopd.diagnose.proof import confirmation as confirmation_module, replacement
from hoopd.diagnose.proof.denial import Denial
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.replacement import replace_denied
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.search import neighbours
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit


def test_a_neighbour_of_the_same_slot_takes_the_place_of_a_denied_name() -> None:
    """A friction that was called a drag; a drag that is denied and has no neighbour stays."""
    drag = library(PLANT)["hoop.quadratic_drag"]
    train, held = [recorded("train", 1, friction=True)], HeldOut([recorded("held", 2, friction=True)])
    base = fit(train, (), PLANT.values)
    size = {f"{drag.name}.c": 2.0 * next(p.size for p in drag.parameters if p.name == "c")}
    named = named_with(
        base, fit(train, (drag,), {**base.values, **size}, like=base, noise=base.noise, move=False), drag
    )
    named.losses[drag.name] = 15.0
    near = {one.name: one for one in (drag, library(PLANT)["ball.quadratic_drag"])}
    replace_denied(named, held, Judge(train, near, Settings()))
    assert named.final.names == (drag.name,)
    judge = Judge(train, {**near, FRICTION.name: FRICTION}, Settings())
    replace_denied(named, held, judge)  # what barely passed is not worth a neighbour
    assert named.final.names == (drag.name,)
    named.losses[drag.name] = 30.0
    replace_denied(named, held, judge)
    assert named.final.names == (FRICTION.name,) and [one.effect.name for one in named.accepted] == [FRICTION.name]
    assert named.losses.keys() == named.without.keys() == {FRICTION.name} and named.losses[FRICTION.name] > 20.0
    assert named.rivals[FRICTION.name][0][0] == drag.name


def test_neighbours_are_effects_of_the_same_slot(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def judge(train: Any, near: Any, settings: Any) -> Any:
        asked.append([*near])
        return SimpleNamespace(proposals=lambda *_: [])

    monkeypatch.setattr(neighbours, "Judge", judge)
    named = named_with(*fits)
    neighbours.neighbours(named, Judge([], library(PLANT), Settings()), named.accepted[0])
    assert "hoop.quadratic_drag" in asked[0] and FRICTION.name not in asked[0]
    assert {name.split(".")[0] for name in asked[0]} == {"hoop"}


@pytest.mark.parametrize("lost", [None, 5.0])
def test_a_neighbour_that_folds_refuse_takes_no_place(lost: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    name, other = FRICTION.name, SimpleNamespace(surprise=40.0, fit=SimpleNamespace(criterion=0.0))
    named: Any = SimpleNamespace(
        final=SimpleNamespace(criterion=1.0), without={name: SimpleNamespace(criterion=50.0)}, accepted=[1]
    )
    judge: Any = SimpleNamespace(settings=Settings(), fold_loss=lambda *_: lost)
    held: Any = SimpleNamespace(played_of=lambda _: object())
    one: Any = SimpleNamespace(effect=FRICTION)
    monkeypatch.setattr(replacement, "neighbours", lambda *_: [other])
    monkeypatch.setattr(replacement, "surprise_in", lambda *_: 30.0)
    monkeypatch.setattr(replacement, "denial", lambda *_: None)
    assert replacement._neighbour(named, held, judge, one, 0) is (other if lost is None else None)


def test_a_name_that_is_not_denied_is_not_exchanged(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    named = named_with(*fits)
    stribeck = library(PLANT)["hoop.stribeck_friction"]
    judge = Judge([track.stretch for track in fits[1].tracks], {stribeck.name: stribeck}, Settings())
    replace_denied(named, HeldOut([recorded("held", 2, friction=True)]), judge)
    assert named.final is fits[1]
    replace_denied(named, HeldOut([]), judge)
    assert named.final is fits[1]


def two_names(both: tuple[str, str], accepted: str) -> tuple[Any, Any, Any, Any]:
    """Fits with none, one and both of two names, these played on held-out data, both as named, and what plays them."""
    made: Any = {
        names: SimpleNamespace(names=names, effects=tuple(_effect(n) for n in names), values={})
        for names in ((), ("a",), ("b",), both)
    }
    shown: Any = {names: SimpleNamespace(fit=one) for names, one in made.items()}
    named: Any = SimpleNamespace(
        base=made[()], final=made[both], accepted=[SimpleNamespace(effect=_effect(name)) for name in accepted],
        losses={"a": 40.0, "b": 15.0}, without={"a": made["b",], "b": made["a",]}, others=[],
    )  # fmt: skip
    return made, shown, named, SimpleNamespace(played_of=lambda found: shown[found.names])


def test_names_that_together_are_worse_than_none_are_taken_up_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taken out again neither of two is denied; the one with less evidence is, beside the other."""
    made, shown, named, held = two_names(("a", "b"), accepted="ba")
    asked = []

    def denied(before: Any, after: Any, *_: Any) -> Denial | None:
        asked.append((before.fit.names, after.fit.names))
        return (
            Denial({"x": 2.0})
            if (before.fit.names, after.fit.names) == (("a",), ("a", "b")) and len(asked) > 2
            else None
        )

    monkeypatch.setattr(confirmation_module, "denial", denied)
    monkeypatch.setattr(confirmation_module, "lowered", lambda *_: {"x": 1.5})
    fits = {"base": shown[()], "named": shown["a", "b"], "without a": shown["b",], "without b": shown["a",]}
    found = confirmation_module._of_names(named, held, fits, 0)
    assert asked[2:] == [((), ("a",)), (("a",), ("a", "b"))]  # most evidence first
    assert found.kept is made["a",] and found.heldout is shown["a",] and [*found.denials] == ["b"]


def test_of_two_denied_names_that_stand_in_for_each_other_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is denied beside the other; without both, held-out data are worse than with both."""
    made, shown, named, held = two_names(("a", "b"), accepted="ba")
    monkeypatch.setattr(
        confirmation_module, "denial", lambda before, *_: Denial({"x": 2.0}) if before.fit.names else None
    )
    monkeypatch.setattr(
        confirmation_module, "lowered", lambda before, after, *_: {"x": 9.0} if before.fit.names else {}
    )
    fits = {"base": shown[()], "named": shown["a", "b"], "without a": shown["b",], "without b": shown["a",]}
    found = confirmation_module._of_names(named, held, fits, 0)
    assert found.kept is made["a",] and [*found.denials] == ["b"]


def test_a_name_that_costs_something_alone_is_asked_again_beside_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first is denied alone and not beside the second; nothing is asked twice of the same."""
    made, shown, named, held = two_names(("b", "a"), accepted="ab")
    asked = []

    def denied(before: Any, after: Any, *_: Any) -> Denial | None:
        asked.append((before.fit.names, after.fit.names))
        return Denial({"x": 2.0}) if asked[-1] == ((), ("a",)) else None

    monkeypatch.setattr(confirmation_module, "denial", denied)
    found = confirmation_module._taken_up(named, held, {"base": shown[()]}, 0)
    assert asked == [((), ("a",)), ((), ("b",)), (("b",), ("b", "a"))]
    assert found.kept is made["b", "a"] and not found.denials


def _effect(name: str) -> Any:
    return SimpleNamespace(name=name)


@pytest.mark.parametrize(
    ("lost", "carries_over", "status"),
    [({}, True, "confirmed"), ({}, False, "not_confirmed"), ({"x": 2.0}, True, "not_confirmed")],
)
def test_a_curve_is_denied_by_its_values_or_by_its_simulation(
    lost: dict[str, float], carries_over: bool, status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(confirmation_module, "lowered", lambda *_: lost)
    unknown = SimpleNamespace(name="unknown.hoop", carries_over=carries_over, surprise=30.0, threshold=12.0)
    proof: Any = SimpleNamespace(unknown=unknown, denial=None)
    fits: Any = {"without unknown.hoop": object(), "final": object()}
    told, why = confirmation_module._of_curve(proof, fits, 0)
    assert told == status and (why is not None) is bool(lost)
    assert confirmation_module._of_curve(proof, {}, 0)[0] == ("untested" if carries_over else "not_confirmed")


def made_up(size: float, worse: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """Ten windows with errors of `size` of the motion, and the same with each window's worse by a factor."""
    monkeypatch.setattr("hoopd.diagnose.proof.worse_channels.series", lambda windows: {"x": windows})
    t, random = np.arange(100.0), np.random.default_rng(2)
    y = np.sin(0.3 * t)
    errors = [size * random.normal(size=100) for _ in worse]
    each = [[(t, y, y + by * one) for by, one in zip(factors, errors, strict=True)] for factors in (worse**0, worse)]
    before, after = (SimpleNamespace(by_recording=lambda windows=windows: {"r": windows}) for windows in each)
    return before, after


def test_a_loss_of_part_of_a_point_counts_where_all_windows_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same loss that some windows make and others take back is left open by the draws."""
    found = lowered(*made_up(0.1, np.full(10, 1.03), monkeypatch))
    assert 0.3 < found["x"] < 0.6
    before, after = made_up(0.1, np.tile([1.35, 0.5], 5), monkeypatch)
    assert lowered(before, after) == {}
    assert "x" in lowered(*made_up(0.1, np.tile([1.6, 0.8], 5), monkeypatch))  # beyond a point, sure or not


def test_what_a_written_model_is_without_is_told_with_the_reason() -> None:
    first = coulomb()[0].effects[0]
    each = [
        msgspec.structs.replace(first, name=name, status=status, reason=reason, in_model=False)
        for name, status, reason in (
            ("a.denied", "not_confirmed", "psi is worse"),
            ("a.harmful", "weak", "blocks are worse"),
            ("a.faint", "weak", ""),
            ("a.own", "confirmed", "a model file holds no effects of your own"),
            ("unknown.hoop", "confirmed", ""),
        )
    ]
    kept = msgspec.structs.replace(first, name="a.kept", status="confirmed", in_model=True)
    told = left_out(SimpleNamespace(diagnosis=SimpleNamespace(effects=[*each, kept])))  # type: ignore[arg-type]
    assert told == [
        "a.denied is not in the model: held-out data do not confirm it",
        "a.harmful is not in the model: blocks are worse",
        "a.faint is not in the model: its evidence is weak",
        "a.own is not in the model: a model file holds no effects of your own",
    ]


def test_a_parameter_that_changed_its_sign_is_told() -> None:
    diagnosis, _ = consistent()
    (name, one), *_ = diagnosis.base.parameters.items()
    other = msgspec.structs.replace(one, value=-2.5, nominal=1.5)
    base = msgspec.structs.replace(diagnosis.base, parameters={**diagnosis.base.parameters, name: other})
    assert flipped(diagnosis.base) == []
    (told,) = flipped(base)
    assert told.startswith(f"{name} has the other sign: -2.5 ") and told.endswith("1.5 before")


def test_what_is_beyond_its_bounds_is_told_of_plant_and_effects_and_a_phase_is_not() -> None:
    plant = replace(PLANT, bounds={"J11": (0.0, np.inf)})
    wave = library(PLANT)["hoop.imbalance"]
    values = {
        **PLANT.values,
        "J11": -0.1,
        f"{FRICTION.name}.Fc": -1e-3,
        f"{wave.name}.A": 1e-3,
        f"{wave.name}.phi": 9.0,
    }
    kept = SimpleNamespace(
        tracks=[SimpleNamespace(stretch=SimpleNamespace(plant=plant))], effects=(FRICTION, wave), values=values
    )
    found: Any = SimpleNamespace(written=SimpleNamespace(fit=kept))
    first, second = outside(found)
    assert first.startswith("J11 is -0.1, beyond the 0 to inf ") and second.startswith(
        f"{FRICTION.name}.Fc is -0.001, "
    )
    kept.values = {**values, "J11": 0.1, f"{FRICTION.name}.Fc": 1e-3}
    assert outside(found) == []
