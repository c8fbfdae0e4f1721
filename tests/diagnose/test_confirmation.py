"""What held-out data say about a name: which are kept, which lower a channel, and which are never tested."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnose.confirming import FRICTION, LIMIT, PLANT, TILT, confirmed, named_with, recorded
from diagnose.madeup import stretch_with

from hoopd.diagnose.findings import heldout_nats, is_any_told, refused_of
from hoopd.diagnose.proof import confirmation as confirmation_module, denial as denials, worse_channels
from hoopd.diagnose.proof.confirmation import HARDLY, Confirmation, confirmation, less_sure, of_all, reach, status_of
from hoopd.diagnose.proof.denial import Denial, denial
from hoopd.diagnose.proof.error_windows import error_windows, window_of_the_loss
from hoopd.diagnose.proof.fit_tables import played
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.training_windows import is_wave, reason_of
from hoopd.diagnose.proof.worse_channels import lowered
from hoopd.diagnose.record import Placebo
from hoopd.diagnose.search.candidates import Tried
from hoopd.diagnose.search.naming import Named, Refusal
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit


def test_what_is_there_is_confirmed_and_kept(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    named = named_with(*fits)
    found, shown = confirmed(named, recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "confirmed"}
    assert found.kept is named.final and found.final is named.final and not found.denials and not found.refused
    assert lowered(shown["named"], shown["base"])  # the other way round something is lost


def test_what_is_hardly_the_law_in_its_place_is_weak_whatever_held_out_data_gain(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named = named_with(*fits)
    said, _ = confirmed(named, recorded("held", 2, friction=True))
    assert less_sure(said, {FRICTION.name: 0.02}).statuses == said.statuses
    found = less_sure(said, {FRICTION.name: 0.005})
    assert found.statuses == {FRICTION.name: "weak"} and found.reason(FRICTION.name) == HARDLY
    assert found.written is said.written and found.kept is said.kept  # held-out windows are surely better with it
    monkeypatch.setattr(confirmation_module, "lowered", lambda *_: {})
    assert FRICTION.name in less_sure(said, {FRICTION.name: 0.005}).written.names  # nothing is farther from the law
    said = replace(said, barely=frozenset([FRICTION.name]))
    assert FRICTION.name not in less_sure(said, {FRICTION.name: 0.005}).written.names
    # nor is one written that held-out data never test, because a rest of another law asked for it
    untested = less_sure(replace(said, statuses={FRICTION.name: "untested"}), {FRICTION.name: 0.005})
    assert untested.statuses == {FRICTION.name: "untested"} and untested.reason(FRICTION.name) == HARDLY
    assert FRICTION.name not in untested.written.names
    # what is denied stays denied, with its own reason
    denied = replace(said, statuses={FRICTION.name: "not_confirmed"})
    assert less_sure(denied, {FRICTION.name: 0.005}).statuses == {FRICTION.name: "not_confirmed"}


def test_what_held_out_data_refuse_is_not_confirmed_and_in_no_model(wrong: tuple[HypothesisFit, HypothesisFit]) -> None:
    named = named_with(*wrong)
    found, _ = confirmed(named, recorded("held", 2, friction=False))
    assert found.statuses == {FRICTION.name: "not_confirmed"}
    assert found.kept is named.base and found.final is named.base
    assert max(found.denials[FRICTION.name].points.values()) > 1.0 and found.denials[FRICTION.name].is_refuted
    assert found.fits["final"].fit is found.fits["base"].fit
    assert found.refused == {FRICTION.name} and not is_any_told(named, found)
    (told,) = refused_of(named, found)
    assert told.name == FRICTION.name and "held-out data is worse: " in told.reason and " nats with it" in told.reason


def test_a_name_without_a_worse_simulation_is_refuted_by_the_likelihood_that_held_out_data_lose(
    fits: tuple[HypothesisFit, HypothesisFit],
) -> None:
    held = HeldOut([recorded("held", 2, friction=True)])
    without, with_it = (held.played_of(one) for one in fits)
    assert without is not None and with_it is not None
    assert denial(without, with_it, 50.0) is None
    # the same runs, and likelihood that falls
    why = denial(replace(with_it, fit=with_it.fit), replace(with_it, fit=without.fit), 50.0)
    assert why is not None and why.is_refuted and not why.points and why.nats < -denials.UNSEEN_LOSS
    assert why.reason.startswith("the held-out data lose ") and not why.leaves_evidence(1000.0, 12.0)
    # what a simulation is surely better with is not refuted by a filter
    assert denial(replace(without, fit=with_it.fit), replace(with_it, fit=without.fit), 50.0) is None
    # nor by levels of noise that a search missed
    off = replace(with_it.fit, criterion=without.fit.criterion + 50.0)
    assert denial(with_it, replace(with_it, fit=off), 50.0) is None


def test_what_is_certain_of_the_training_data_stays_a_finding_though_held_out_data_refuse_its_law() -> None:
    """A drive's gain that is as before in the held-out recording: something happened, and the law does not hold."""
    undone = Denial({}, nats=-15.9, is_refuted=True)
    assert undone.leaves_evidence(149.0, 19.0) and not undone.leaves_evidence(75.0, 19.0)
    assert not Denial({}, nats=-100.0, is_refuted=True).leaves_evidence(149.0, 19.0)


def test_strong_evidence_stays_a_finding_whatever_a_simulation_makes_of_it() -> None:
    """Something is there; the name is not confirmed, and in no model."""
    worse = Denial({"psi": 0.7}, nats=0.5)
    assert worse.leaves_evidence(24.0, 12.0) and not worse.leaves_evidence(23.9, 12.0)
    assert Denial({"psi": 0.7}, nats=3.0).leaves_evidence(12.5, 12.0)  # held-out readings say so, too
    assert worse.reason == "with it the simulation of the held-out data is worse: psi by 0.7 points"


def test_a_finding_that_is_denied_and_leaves_evidence_is_told_and_not_kept(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(denials, "lowered", lambda *_: {"psi": 0.7})
    named = named_with(*fits)
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "not_confirmed"} and found.kept is named.base
    assert not found.refused and is_any_told(named, found) and refused_of(named, found) == []


def test_the_chance_of_a_worse_channel_is_shared_by_names_and_channels(
    fits: tuple[HypothesisFit, HypothesisFit],
) -> None:
    """A loss that one look in fifty gives is none where it was looked ten times."""
    held = HeldOut([recorded("held", 2, friction=True)])
    one = held.played_of(fits[1])
    assert one is not None
    for share in (0.01, 0.02, 0.03, 0.05, 0.08, 0.12):
        runs = [replace(run, y=run.y + share * np.nanstd(run.y, axis=0) * _signs(run.y.shape)) for run in one.runs]
        alone, among = lowered(one, replace(one, runs=runs)), lowered(one, replace(one, runs=runs), 0, 1000)
        assert among.keys() <= alone.keys()
        if among != alone:
            return
    pytest.fail("however often it was looked, the same was lowered")


def test_every_look_at_a_channel_and_every_name_has_its_share_of_the_chance(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = HeldOut([recorded("held", 2, friction=True)]).played_of(fits[1])
    assert one is not None
    asked: list[float] = []

    def lost(pairs: Any, chance: float, random: Any) -> tuple[float, float]:
        asked.append(chance)
        return 0.0, 0.0

    monkeypatch.setattr(worse_channels, "_loss", lost)
    lowered(one, one)
    channels = len(asked)
    assert channels > 1 and asked == pytest.approx([worse_channels.CHANCE / channels] * channels)
    asked.clear()
    assert denial(one, one, 50.0, names=4) is None
    assert asked == pytest.approx([worse_channels.CHANCE / (4 * channels)] * 2 * channels)


def test_the_window_that_carries_the_error_and_that_of_the_loss_are_told(
    fits: tuple[HypothesisFit, HypothesisFit],
) -> None:
    held = HeldOut([recorded("held", 2, friction=True)])
    one = held.played_of(fits[1])
    assert one is not None
    assert window_of_the_loss(one, one, "psi") is None
    runs = [replace(run, y=run.y.copy()) for run in one.runs]
    runs[0].y[:, -1, 3] += 5.0 * np.nanstd(one.runs[0].y[:, -1])  # the fourth of windows of some 2 s
    worse = replace(one, runs=runs)
    where = error_windows(worse)["held"]["psi"]
    assert where.windows == 8 and where.share is not None and where.share > 0.9
    assert (where.t0, where.t1) == pytest.approx((6.0, 8.0), abs=0.05)
    assert window_of_the_loss(one, worse, "psi") == ("held", where.t0, where.t1)
    assert window_of_the_loss(one, worse, "theta_rate") is None
    why = denial(one, worse, 50.0)
    assert why is not None and why.reason.endswith(" points (most of it at 6.0 to 8.0 s of held)")


def _signs(shape: tuple[int, ...]) -> Any:
    return np.random.default_rng(5).choice([-1.0, 1.0], (1, *shape[1:]))


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


def test_what_held_out_data_are_no_likelier_with_is_weak(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named = named_with(*fits)
    _, shown = confirmed(named, recorded("held", 2, friction=True))
    assert heldout_nats(shown, FRICTION.name) > 3.0
    assert confirmation_module._status(named, named.accepted[0], shown, 12.0) == "confirmed"
    other = {**shown, "named": shown[f"without {FRICTION.name}"]}
    monkeypatch.setattr(confirmation_module, "reach", lambda *_: 100.0)
    assert heldout_nats(other, FRICTION.name) == 0.0
    assert confirmation_module._status(named, named.accepted[0], other, 12.0) == "weak"


def test_a_wave_without_which_held_out_data_are_simulated_better_is_weak(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    """However likely it makes the readings one after the other; of a law that does not come again nothing is asked."""
    named = named_with(*fits)
    _, shown = confirmed(named, recorded("held", 2, friction=True))
    without, with_it = shown[f"without {FRICTION.name}"], shown["named"]
    other = {
        **shown,
        "named": replace(with_it, runs=without.runs),
        f"without {FRICTION.name}": replace(without, runs=with_it.runs),
    }
    assert confirmation_module._status(named, named.accepted[0], other, 12.0) == "confirmed"
    monkeypatch.setattr(confirmation_module, "is_wave", lambda effect: True)
    assert confirmation_module._status(named, named.accepted[0], other, 12.0) == "weak"
    assert confirmation_module._status(named, named.accepted[0], shown, 12.0) == "confirmed"


def test_laws_with_a_phase_are_waves() -> None:
    known = library(PLANT)
    assert is_wave(known["actuator.cogging"]) and is_wave(known["hoop.imbalance"])
    assert not is_wave(FRICTION) and not is_wave(known["camera.latency"])


def test_what_is_weak_is_a_finding_and_in_no_model_that_is_written(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named = named_with(*fits)
    monkeypatch.setattr(confirmation_module, "_status", lambda *_: "weak")
    # unless it is simulated better with it
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.written is found.kept is named.final and not found.denials
    monkeypatch.setattr(confirmation_module, "_simulates_better", lambda *_: False)
    # nor where the training data are far beyond chance
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.written is found.kept is named.final
    monkeypatch.setattr(confirmation_module, "surprise_in", lambda *_: 23.9)
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.kept is named.final and not found.denials
    assert found.written.names == () and found.written.criterion > found.kept.criterion


def test_a_name_whose_shuffles_gain_is_weak_and_in_no_model_that_is_written(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named = named_with(*fits)
    _, shown = confirmed(named, recorded("held", 2, friction=True))
    monkeypatch.setattr(confirmation_module, "surprise_in", lambda *_: 23.9)
    monkeypatch.setattr(confirmation_module, "_simulates_better", lambda *_: False)
    held = HeldOut([recorded("held", 2, friction=True)])
    for most, status, written in ((3.0, "confirmed", named.final.names), (3000.0, "weak", ())):
        gains = Placebo(log_likelihood_gain=1.0, held=most < 4.0, shuffles=8, most=most, limit=4.0)
        found = confirmation(named, held, shown, None, 12.0, shuffled={FRICTION.name: gains})
        assert found.statuses == {FRICTION.name: status} and found.written.names == written


def test_a_channel_that_is_worse_is_outweighed_by_one_that_is_better_by_more(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    held = HeldOut([recorded("held", 2, friction=True)])
    without, with_it = (held.played_of(one) for one in fits)
    assert without is not None and with_it is not None
    for better, is_denied in (({"theta_rate": 56.0}, False), ({"theta_rate": 4.0}, True), ({}, True)):
        monkeypatch.setattr(
            denials, "lowered", lambda one, _, *more, better=better: {"psi": 5.0} if one is without else better
        )
        assert (denial(without, with_it, 50.0) is not None) is is_denied


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
    told = refused_of(named, Confirmation(fits[1], fits[1], fits[1], {}, {FRICTION.name: "confirmed"}))
    assert [(one.name, one.log_likelihood_gain) for one in told] == [("actuator.cogging", 33.0)]
    assert "7.2 nats" in told[0].reason


def test_of_several_reasons_that_is_told_which_makes_a_name_weak(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    own, unlikely = {FRICTION.name: "weak"}, frozenset({FRICTION.name})
    for lost, told in (({}, HARDLY), ({"psi": 2.0}, reason_of({"psi": 2.0}))):
        said = Confirmation(fits[1], fits[1], fits[1], {}, own, harmful={FRICTION.name: lost}, unlikely=unlikely)  # type: ignore[arg-type]
        assert said.reason(FRICTION.name) == told


def test_names_are_proven_beside_those_that_are_kept(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    """One that is refused beside them lowers and raises what the others gain."""
    base, right = fits
    train = [track.stretch for track in base.tracks]
    off = {**right.values, f"{TILT.name}.d": 0.3}
    both = fit(train, (FRICTION, TILT), off, like=right, noise=right.noise, move=False)
    tilted = fit(train, (TILT,), off, like=base, noise=base.noise, move=False)
    scores: list[Any] = [SimpleNamespace(member=SimpleNamespace(effect=one)) for one in (FRICTION, TILT)]
    tried = [Tried(s.member.effect, both, 500.0, 500.0, s) for s in scores]
    named = Named(base, base, both, tried, tried, {FRICTION.name: 500.0, TILT.name: 20.0},
                  {FRICTION.name: tilted, TILT.name: right})  # fmt: skip
    found, all_of_them = confirmed(named, recorded("held", 2, friction=True))
    assert [*found.denials] == [TILT.name] and found.statuses[FRICTION.name] == "confirmed"
    assert found.fits["named"].fit.names == (FRICTION.name,) and all_of_them["named"].fit.names != (FRICTION.name,)
    assert found.fits[f"without {FRICTION.name}"].fit.names == ()
    assert found.fits[f"with {TILT.name}"].fit.names == (FRICTION.name, TILT.name)
    assert found.fits[f"without {TILT.name}"] is found.fits["named"]


def test_what_is_simulated_worse_than_by_the_users_own_model_is_confirmed_by_nothing(
    wrong: tuple[HypothesisFit, HypothesisFit],
) -> None:
    base, final = wrong
    held = HeldOut([recorded("held", 2, friction=False)])
    yours, named = held.played_of(base), held.played_of(final)
    assert yours is not None and named is not None
    assert "points worse than by your own model" in of_all({"nominal": yours}, named, 0)
    assert of_all({"nominal": yours}, yours, 0) == "" and of_all({"nominal": yours}, None, 0) == ""
