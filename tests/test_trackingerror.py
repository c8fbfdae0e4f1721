"""What the summary calls the ball's error: measured angles against the reference of their time, and the rig's truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import nan, tau

import numpy as np
import pytest

from hoopd.core.records import TickRecord
from hoopd.daemon.tracking_error import RELEASE_S, SETTLED_S, TRUTH_AGE_S, TrackingError, Truth

PERIOD_S = 0.02
LATE_S = 0.05  # a picture's age


@dataclass
class Run:
    """Ticks made by hand; `psi` over time in s is what the camera sees, NaN a missing picture."""

    psi: Callable[[float], float]
    modes: str = "R" * 200  # a letter a tenth of a second: R controlled, else not
    reference: Callable[[float], float] = lambda t: 0.0
    estimate: float = 0.0

    def ticks(self) -> Iterator[TickRecord]:
        for k in range(5 * len(self.modes)):
            t, mode = PERIOD_S * k, "RUNNING" if self.modes[k // 5] == "R" else "READY"
            x = (0.0, 0.0, self.estimate, 0.0)
            yield TickRecord(
                t, k, mode, 0, 0, 0, nan, self.psi(t - LATE_S), t, t - LATE_S, x, self.reference(t), 0, 0, 0, 0
            )

    def judged(self, truth: Truth | None = None) -> TrackingError:
        error = TrackingError(truth)
        for record in self.ticks():
            error.put(record)
        return error


def test_the_filters_own_estimate_has_no_say() -> None:
    """A filter that believes in a model without the friction sees the ball at rest where the camera does not."""
    told = Run(psi=lambda t: 0.0097, estimate=0.0).judged().summary()["measured"]
    assert told["rms_rad"] == pytest.approx(0.0097) and told["mean_rad"] == pytest.approx(0.0097)


def test_a_late_picture_is_judged_by_the_reference_of_its_time() -> None:
    """The ball follows at once: there is no error, though every picture arrives two ticks and a half later."""

    def wanted(t: float) -> float:
        return 0.3 if t >= 17.0 else 0.0

    told = Run(psi=wanted, reference=wanted).judged().summary()["measured"]
    assert told["rms_rad"] == 0.0


def test_missing_pictures_are_left_out_and_counted_by_their_absence() -> None:
    def every_other(t: float) -> float:
        return nan if int(t / PERIOD_S + 0.25) % 2 else 0.01

    told = Run(psi=every_other).judged().summary()["measured"]
    assert told["rms_rad"] == pytest.approx(0.01) and 120 <= told["samples"] <= 130


def test_the_release_is_left_out_and_a_pause_is_another_one() -> None:
    seen = Run(psi=lambda t: 0.01, modes="-" * 10 + "R" * 40).judged().measured
    assert seen[0].t == pytest.approx(1.0 + RELEASE_S, abs=2 * PERIOD_S) and seen[-1].t == pytest.approx(4.93, abs=0.02)
    assert not Run(psi=lambda t: 0.01, modes="-" * 10 + "R" * 20).judged().measured
    again = Run(psi=lambda t: 0.01, modes="R" * 60 + "-" * 5 + "R" * 40).judged().measured
    assert not any(6.0 < sample.t < 6.5 + RELEASE_S - PERIOD_S for sample in again)


def test_it_is_the_error_of_the_last_seconds() -> None:
    told = Run(psi=lambda t: 0.01).judged().summary()["measured"]
    first, last = told["over_s"]
    assert last - first == pytest.approx(SETTLED_S, abs=2 * PERIOD_S) and last == pytest.approx(19.93, abs=0.02)


def test_whole_turns_are_no_error() -> None:
    assert Run(psi=lambda t: tau + 0.01).judged().summary()["measured"]["rms_rad"] == pytest.approx(0.01)


@pytest.mark.parametrize("sigma", [0.001, 0.004])
def test_the_noise_of_the_pictures_is_told_from_the_motion(sigma: float) -> None:
    rng = np.random.default_rng(1)
    told = Run(psi=lambda t: 0.05 * np.sin(8.6 * t) + sigma * rng.normal()).judged().summary()["measured"]
    assert told["noise_rad"] == pytest.approx(sigma, rel=0.3) and told["rms_rad"] > 0.03


def test_too_few_pictures_have_no_noise_to_tell() -> None:
    told = Run(psi=lambda t: 0.01 if t > 19.9 else nan).judged().summary()["measured"]
    assert told["samples"] < 4 and np.isnan(told["noise_rad"])


def test_the_truth_is_asked_for_its_own_time_and_what_is_unknown_is_left_out() -> None:
    asked: list[float] = []

    def truth(t: float) -> float | None:
        asked.append(t)
        return None if len(asked) % 2 else 0.003

    told = Run(psi=lambda t: nan).judged(truth).summary()
    assert told["measured"] is None and told["true"]["rms_rad"] == pytest.approx(0.003)
    assert told["true"]["samples"] == pytest.approx(SETTLED_S / PERIOD_S / 2, abs=2)
    assert min(asked) >= RELEASE_S and max(asked) == pytest.approx(19.98 - TRUTH_AGE_S)
