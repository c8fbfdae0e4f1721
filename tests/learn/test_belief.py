"""When it is settled, and what is recorded while it is not."""

from __future__ import annotations

import msgspec
import pytest
from harness.told_diagnosis import proposal, said

from hoopd.diagnose.record import Alternative, Candidate, Diagnosis, Quantity, Remains, Unexplained
from hoopd.learn.belief import belief_of
from hoopd.learn.choice import MENU, first, next_choice


def test_a_law_is_as_sure_as_it_is_among_the_laws_that_are_known() -> None:
    belief = belief_of(said(0.90, none=0.07), 0.95, kinds=1)
    assert belief.probability == pytest.approx(0.90 / 0.93) and belief.unknown == 0.07
    assert belief.settled and belief.explanation == "hoop.coulomb_friction"


@pytest.mark.parametrize(
    ("diagnosis", "why"),
    [
        (said(0.80), "hoop.coulomb_friction is 86% sure, 95% are asked for"),
        (said(0.92, "weak"), "hoop.coulomb_friction is weak"),
        (said(0.92, "not_confirmed"), "hoop.coulomb_friction is not confirmed"),
        (
            said(0.92, unexplained=Unexplained(fires=True, slot="ball", curve=None)),
            "something without a name acts at ball",
        ),
        (
            said(0.92, remains=Remains(slot="ball", follows="psi", log_likelihood_gain=20.0, by_chance=4.0)),
            "what remains at ball follows psi",
        ),
    ],
)
def test_what_is_open_is_said(diagnosis: object, why: str) -> None:
    assert belief_of(diagnosis, 0.95, kinds=2).open == (why,)  # type: ignore[arg-type]


def test_that_one_law_is_denied_makes_the_other_no_surer() -> None:
    alone = said(0.6)
    denied = msgspec.structs.replace(
        alone.effects[0], name="ball.slip", slot="ball", probability=0.45, status="not_confirmed"
    )
    none = Candidate(name="none of these", log_likelihood_gain=None, probability=0.54)
    both = msgspec.structs.replace(alone, effects=[*alone.effects, denied], candidates=[none])
    assert belief_of(both, 0.95, kinds=2).unsure[0] == "hoop.coulomb_friction"
    assert "hoop.coulomb_friction is 70% sure, 95% are asked for" in belief_of(both, 0.95, kinds=2).open


def test_that_nothing_is_missing_takes_three_kinds_of_signal() -> None:
    assert not belief_of(said(), 0.95, kinds=2).settled
    belief = belief_of(said(), 0.95, kinds=3)
    assert belief.settled and belief.laws == ()


def test_what_is_nearly_seen_is_looked_for() -> None:
    nearly = [*said().candidates, Candidate(name="ball.slip", log_likelihood_gain=7.0, probability=0.01, surprise=5.0)]
    belief = belief_of(said(candidates=nearly), 0.95, kinds=3)
    assert belief.open == ("ball.slip may be there (5.0 nats)",)


def test_a_curve_without_a_law_is_never_settled() -> None:
    diagnosis = said(0.99)
    unknown = msgspec.structs.replace(diagnosis.effects[0], name="unknown.hoop")
    diagnosis = msgspec.structs.replace(diagnosis, effects=[unknown], verdict="unknown_physics")
    assert belief_of(diagnosis, 0.95, kinds=3).open == ("unknown.hoop has no law yet",)


@pytest.mark.parametrize(
    ("intervals", "settled"),
    [
        ({"s": (-0.053, 0.077)}, False),
        ({"s": (0.010, 0.014)}, True),
        ({"x": (-0.1, 0.3), "y": (0.2, 0.4)}, True),  # a place has two numbers, and one may well be zero
        ({"x": (-0.1, 0.3), "y": (-0.2, 0.4)}, False),
        ({"s": None}, True),
        ({"A": (-0.3, 0.5), "w": (9.0, 11.0), "phi": (1.2, 2.0)}, False),  # how fast, but not how much
        ({"A": (0.1, 0.5), "phi": (-1.2, 2.0)}, True),
        ({"T": (0.001, 0.003)}, True),
        ({"T": (-0.001, 0.003)}, False),
        ({"s": (-0.3, None)}, False),
    ],
)
def test_a_law_whose_size_nobody_knows_is_open(
    intervals: dict[str, tuple[float, float | None] | None], settled: bool
) -> None:
    told = said(0.92)
    parameters = {name: Quantity(value=0.012, unit="N m", ci95=ends, nominal=None) for name, ends in intervals.items()}
    drive = msgspec.structs.replace(told.effects[0], name="actuator.saturation", parameters=parameters)
    belief = belief_of(msgspec.structs.replace(told, effects=[drive]), 0.95, kinds=1)
    assert belief.settled == settled
    assert settled or belief.open[0].startswith("actuator.saturation is there and nobody knows how much: ")
    assert not belief.lacks_proof_alone and not belief.lacks_probability_alone


def late(behind_nats: float, other: str = "actuator.lag") -> Diagnosis:
    """A late torque that is 60 % sure, and another law that is 33 % likely."""
    told = said(0.6)
    delay = msgspec.structs.replace(
        told.effects[0], name="actuator.delay", slot="actuator",
        alternatives=[Alternative(name=other, behind_nats=behind_nats)],
    )  # fmt: skip
    shares = {"actuator.delay": 0.6, other: 0.33, "none of these": 0.07}
    candidates = [Candidate(name=name, log_likelihood_gain=None, probability=one) for name, one in shares.items()]
    return msgspec.structs.replace(told, effects=[delay], candidates=candidates)


def test_a_lag_and_a_delay_count_together_where_nobody_tells_them_apart() -> None:
    belief = belief_of(late(0.4), 0.95, kinds=2)
    assert belief.probability == pytest.approx(1.0) and belief.settled and belief.alike == ("actuator.lag",)
    assert belief.explanation == "actuator.delay (or actuator.lag: the same delay to filter and law)"
    # where they are told apart, and of laws that make another controller, the name has to be sure
    for told in (late(1.4), late(0.4, "encoder.latency")):
        assert belief_of(told, 0.95, kinds=2).open == ("actuator.delay is 65% sure, 95% are asked for",)


def worth(nats: float, status: str = "untested") -> Diagnosis:
    """A law with so many nats, of which 10 name it."""
    told = said(0.92, status)
    evidence = msgspec.structs.replace(told.effects[0].evidence, log_likelihood_gain=nats)
    return msgspec.structs.replace(told, effects=[msgspec.structs.replace(told.effects[0], evidence=evidence)])


def test_a_law_that_no_simulation_tests_is_proven_by_later_recordings_that_show_it_again() -> None:
    """Fresh recordings that show it alone, as clearly as it takes to name a law; less, or its own, do not."""
    assert belief_of(worth(28.0), 0.95, 2, [said(), worth(17.0), worth(18.5)]).settled
    short = belief_of(worth(26.0), 0.95, 2, [worth(17.0)])
    assert short.open == ("hoop.coulomb_friction is untested",) and short.lacks_proof_alone
    assert not belief_of(worth(80.0), 0.95, 2, [said()]).settled
    assert not belief_of(worth(80.0), 0.95, 2).settled
    for refuted in ("weak", "not_confirmed"):
        assert not belief_of(worth(80.0, refuted), 0.95, 2, [worth(17.0)]).settled
        assert not belief_of(worth(80.0), 0.95, 3, [worth(17.0), worth(16.0, refuted)]).settled


def test_evidence_is_compared_beside_the_same_laws_alone() -> None:
    """A law's nats rise or fall with what is named beside it, without that a recording says so."""

    def with_another(told: Diagnosis) -> Diagnosis:
        other = msgspec.structs.replace(told.effects[0], name="camera.latency", status="confirmed")
        return msgspec.structs.replace(told, effects=[*told.effects, other])

    both = with_another(worth(40.0))
    assert not belief_of(worth(80.0), 0.95, 2, [both]).settled
    assert not belief_of(with_another(worth(80.0)), 0.95, 2, [worth(17.0)]).settled
    assert belief_of(with_another(worth(80.0)), 0.95, 3, [worth(17.0), both]).settled


def test_a_proposal_that_brings_enough_comes_first_and_without_its_place() -> None:
    diagnosis = said(0.6, next_experiment=proposal(40.0))
    choice = next_choice(diagnosis, belief_of(diagnosis, 0.95, 1), [MENU[0]])
    assert choice is not None and choice.words == ("multisine", "--low", "0.05") and choice.expected_nats == 40.0


def test_a_proposal_that_did_not_bring_what_it_promised_twice_makes_place_for_the_menu() -> None:
    diagnosis, words = said(0.6, next_experiment=proposal(40.0)), ("multisine", "--low", "0.05")
    belief = belief_of(diagnosis, 0.95, 2)
    again = next_choice(diagnosis, belief, [MENU[0], words])
    other = next_choice(diagnosis, belief, [MENU[0], words, words])
    assert again is not None and again.words == words
    assert other is not None and other.words == MENU[1]
    # where all have been played it ends, whatever is still promised
    assert next_choice(diagnosis, belief, [*MENU, words, words]) is None


def test_a_proposal_that_brings_nothing_leaves_it_to_the_menu_and_then_it_ends() -> None:
    diagnosis = said(0.6, "weak", next_experiment=proposal(0.5))
    belief = belief_of(diagnosis, 0.95, 1)
    played = [first().words]
    for _ in MENU[1:]:
        choice = next_choice(diagnosis, belief, played)
        assert choice is not None and choice.words in MENU and choice.words not in played
        played.append(choice.words)
    words = ("multisine", "--low", "0.05")
    last = next_choice(diagnosis, belief, played)
    assert last is not None and last.words == words
    assert next_choice(diagnosis, belief, [*played, words, words]) is None


def test_laws_that_no_signal_tells_apart_end_it_once_three_kinds_have_shown_nothing_else() -> None:
    diagnosis = said(0.6, next_experiment=proposal(0.03))
    belief = belief_of(diagnosis, 0.95, 3)
    assert belief.lacks_probability_alone and belief.unsure == ("hoop.coulomb_friction",)
    assert next_choice(diagnosis, belief, MENU[:2]) is not None
    assert next_choice(diagnosis, belief, (MENU[0], *MENU[:2])) is not None
    assert next_choice(diagnosis, belief, MENU[:3]) is None
    # what remains, or a proof that is lacking, is another question
    refuted = said(0.6, "weak", next_experiment=proposal(0.03))
    assert next_choice(refuted, belief_of(refuted, 0.95, 3), MENU[:3]) is not None
    rest = said(0.6, next_experiment=proposal(0.03), unexplained=Unexplained(fires=True, slot="ball", curve=None))
    assert next_choice(rest, belief_of(rest, 0.95, 3), MENU[:3]) is not None


def test_where_the_careful_first_run_shows_nothing_it_is_made_again_with_more_torque() -> None:
    quiet = said()
    again = next_choice(quiet, belief_of(quiet, 0.95, 1), [first().words])
    assert again is not None and again.words == first().words and "careful" in again.reason
    third = next_choice(quiet, belief_of(quiet, 0.95, 1), [first().words, first().words])
    assert third is not None and third.words == MENU[1]


def test_a_law_that_lacks_proof_alone_is_shown_again_by_what_has_shown_it() -> None:
    diagnosis = said(0.92, "untested", next_experiment=proposal(0.1))
    belief, prbs = belief_of(diagnosis, 0.95, 1), ("prbs", "--clock", "4")
    choice = next_choice(diagnosis, belief, [prbs], {"hoop.coulomb_friction": prbs})
    assert choice is not None and choice.words == prbs and "not confirmed" in choice.reason
    # what tells rivals apart comes first, what is not sure yet is another question, and in the end the menu goes on
    better = said(0.92, "untested", next_experiment=proposal(40.0))
    assert next_choice(better, belief, [prbs], {"hoop.coulomb_friction": prbs}).words[0] == "multisine"  # type: ignore[union-attr]
    doubtful = said(0.6, "untested")
    found = next_choice(doubtful, belief_of(doubtful, 0.95, 1), [prbs], {"hoop.coulomb_friction": prbs})
    assert found is not None and found.words == MENU[0]
    last = next_choice(diagnosis, belief, [prbs, prbs, prbs], {"hoop.coulomb_friction": prbs})
    assert last is not None and last.words == MENU[0]
