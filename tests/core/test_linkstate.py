"""AnswerFilter: only the expected echo is a measurement."""

from __future__ import annotations

import math

import pytest

from hoopd.core.frames import THETA_WRAP_RAD, Answer, LinkFault
from hoopd.core.linkstate import AnswerFilter
from hoopd.core.records import LinkCounts

ANSWER = Answer(7, 1, 0, 0.5, -2.0, 0.25, 1234)


def test_the_expected_echo_is_taken_once_with_its_time() -> None:
    judge = AnswerFilter()
    judge.expect(256 + 7, 1.5)
    judge.take([ANSWER, ANSWER])
    sample, counts = judge.collect()
    assert sample is not None
    assert (sample.t, sample.seq, sample.theta, sample.board_ms) == (1.5, 7, 0.5, 1234)
    assert counts == LinkCounts(good=1, unexpected_seq=1)
    assert judge.collect(lost=True) == (None, LinkCounts(lost=True))


def test_late_and_unasked_answers_are_not_measurements() -> None:
    judge = AnswerFilter()
    judge.take([ANSWER])
    judge.expect(7, 0.0)
    judge.expect(8, 0.02)
    judge.take([ANSWER])
    assert judge.collect() == (None, LinkCounts(unexpected_seq=2))


@pytest.mark.parametrize("change", [{"theta": math.nan}, {"dtheta": 1e4}, {"current": -math.inf}])
def test_implausible_values_are_counted(change: dict[str, float]) -> None:
    judge = AnswerFilter()
    judge.expect(7, 0.0)
    judge.take([ANSWER._replace(**change), LinkFault("implausible", 1, "dtheta")])
    assert judge.collect() == (None, LinkCounts(implausible=2))


def test_faults_are_counted_by_kind() -> None:
    judge = AnswerFilter()
    judge.take([LinkFault("bad_crc", 1), LinkFault("garbage", 12), LinkFault("garbage", 3)])
    assert judge.collect()[1] == LinkCounts(bad_crc=1, garbage_bytes=15)


def test_theta_is_unwrapped_over_several_turns_of_the_wrap() -> None:
    judge = AnswerFilter()
    for k in range(40):
        true = 400.0 * k
        wrapped = (true + THETA_WRAP_RAD) % (2 * THETA_WRAP_RAD) - THETA_WRAP_RAD
        judge.expect(k, 0.02 * k)
        judge.take([ANSWER._replace(seq=k, theta=wrapped)])
        sample, _ = judge.collect()
        assert sample is not None
        assert sample.theta == pytest.approx(true)


def test_a_layout_without_echo_takes_the_first_answer() -> None:
    judge = AnswerFilter(has_seq=False)
    judge.expect(7, 0.0)
    judge.take([ANSWER._replace(seq=-1)])
    assert judge.collect()[1].good == 1
