"""A second population of errors is told from heavy tails; shares of several recordings are put together."""

from __future__ import annotations

import numpy as np
import pytest
import spoiled
from diagnose.madeup import assess
from freeruns import PSI_SIGMA_RAD

from hoopd.diagnose.camera_faults import camera_faults, pooled
from hoopd.diagnose.quality.population import COLUMNS, LOOKED_AT, second_population
from hoopd.diagnose.quality.sensor_samples import Share
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain, surprise

ROWS = 1500


@pytest.mark.parametrize("freedom", [1.5, 2.5, 4.0, 10.0])
def test_heavy_tails_alone_are_no_second_population(freedom):
    rng = np.random.default_rng(int(10 * freedom))
    gains = [second_population(rng.standard_t(freedom, ROWS), np.ones(ROWS)).gain for _ in range(5)]
    assert max(surprise(gain, COLUMNS, LOOKED_AT) for gain in gains) < THRESHOLD


@pytest.mark.parametrize("freedom", [3.0, 1e9])
@pytest.mark.parametrize("share", [0.03, 0.2])
def test_far_errors_are_found_beside_either_core(freedom, share):
    rng = np.random.default_rng(3)
    errors, false = rng.standard_t(freedom, ROWS), rng.random(ROWS) < share
    errors[false] = rng.uniform(-300.0, 300.0, false.sum())
    found = second_population(errors, np.ones(ROWS))
    assert surprise(found.gain, COLUMNS, LOOKED_AT) > 5 * THRESHOLD
    assert abs(found.share - false.mean()) < 3 * found.error < 0.5 * share + 0.02


def heavy(recording, seed):
    tails = np.random.default_rng(seed).standard_t(2.5, len(recording)) / np.sqrt(5.0)
    return spoiled.changed(recording, "psi", slice(None), recording.extra["exact"] + PSI_SIGMA_RAD * tails)


def test_a_camera_with_heavy_tails_has_no_outliers_and_one_with_both_has():
    recordings = [heavy(spoiled.clean(seed), seed) for seed in (1, 2)]
    assert camera_faults([assess(one) for one in recordings]) == []
    rows = [spoiled.chosen(one, 0.05, seed) for seed, one in enumerate(recordings)]
    bad = [spoiled.false(one, which, None) for one, which in zip(recordings, rows, strict=True)]
    (fault,) = camera_faults([assess(one) for one in bad])
    assert fault.name == "camera.outliers"
    assert fault.ci95[0] < np.mean(rows) < fault.ci95[1]
    assert fault.gain > fault.needed
    assert fault.surprise > THRESHOLD


def test_a_fault_of_one_recording_in_three_is_none_of_the_camera():
    one = spoiled.clean(1)
    bad = spoiled.false(one, spoiled.chosen(one, 0.1, 1), None)
    assert camera_faults([assess(bad), assess(one), assess(spoiled.clean(2))]) == []


def test_pooled_shares_count_by_samples_and_their_errors_add_as_squares():
    share, error = pooled([Share(0.10, 0.01, 50.0, 3000, 0.1), Share(0.10, 0.02, 20.0, 1000, 0.1)])
    assert share == pytest.approx(0.10)
    assert error == pytest.approx(np.hypot(0.75 * 0.01, 0.25 * 0.02))
    apart, wider = pooled([Share(0.05, 0.01, 50.0, 1000, 0.1), Share(0.15, 0.01, 50.0, 1000, 0.1)])
    assert apart == pytest.approx(0.10)
    assert wider == pytest.approx(0.05)  # half of what lies between them


def test_a_needed_gain_is_the_one_with_that_surprise():
    for columns, looked_at in ((1, 1), (4, 35), (24, 2)):
        assert surprise(needed_gain(12.0, columns, looked_at), columns, looked_at) == pytest.approx(12.0, abs=1e-6)
