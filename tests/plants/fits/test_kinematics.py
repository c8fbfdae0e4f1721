"""Which kinematics recordings support: right on simulated truth, silent where nothing can be said."""

from __future__ import annotations

import numpy as np
import pytest
from freeruns import DEVICE, runs_of
from samples import sampled
from shared import shared_path

from hoopd.plants.fits.uncertainty import uncertainty
from hoopd.plants.hoop.entries import entries_of, equivalent
from hoopd.plants.hoop.fitting.separating_measurement import DECISIVE, separating
from hoopd.plants.hoop.kinematics import MEASURED, compare_kinematics, entries_covariance, fit_entries, known_from
from hoopd.plants.hoop.recordings.fit_data import prepare
from hoopd.recording import load

KINDS = ("rolling", "published")
# A torque that the recording does not know makes the residuals as coloured as those of a device.
UNKNOWN_NM = 0.001


@pytest.mark.parametrize("kind", sampled(KINDS, ["rolling"]))
def test_known_geometry_tells_the_kinematics(kind):
    found = compare_kinematics(runs_of(kind, DEVICE, 1), DEVICE)
    assert found.supported == kind
    assert not found.contradicted
    assert abs(found.evidence) > 2 * DECISIVE
    ratio, sd = found.ratio[kind]
    assert abs(ratio - DEVICE["Ro"] / DEVICE["Rb"]) < 3 * sd
    assert f"support the {kind} kinematics" in found.words[0]
    by = {(fit.structure, fit.geometry): fit for fit in found.fits}
    # geometry free: the same likelihood to rounding, whatever the kinematics
    assert abs(by["rolling", "free"].deviance - by["published", "free"].deviance) < 0.5
    other = "published" if kind == "rolling" else "rolling"
    assert by[other, "known"].bic > by[kind, "known"].bic + DECISIVE
    assert by[kind, "known"].bic < by["entries", "-"].bic


def test_exactly_known_geometry_decides_beyond_doubt():
    known = known_from(DEVICE, dict.fromkeys(MEASURED, 1e-3))
    found = compare_kinematics(runs_of("rolling", DEVICE, 2), DEVICE, known=known, direct=False)
    assert found.supported == "rolling"
    assert found.evidence > 1000


@pytest.mark.parametrize("kind", sampled(KINDS, ["published"]))
def test_no_false_verdict_with_coloured_residuals_and_a_geometry_measured_with_error(kind):
    said = []
    for seed in range(3):
        random = np.random.default_rng(1000 + seed)
        measured = {**DEVICE, **{n: DEVICE[n] * np.exp(sd * random.normal()) for n, sd in MEASURED.items()}}
        found = compare_kinematics(runs_of(kind, DEVICE, seed, unknown_nm=UNKNOWN_NM), measured, direct=False)
        assert found.growth > 5.0
        said.append(found.supported)
    assert set(said) <= {kind, None}
    assert kind in said


def test_a_start_under_the_wrong_kinematics_does_not_end_elsewhere():
    # this free run has a second minimum for entries that start from those of the other kinematics
    found = fit_entries(runs_of("published", DEVICE, 16), DEVICE)
    assert found.sigma["psi"] < 0.004


def test_nothing_known_nothing_said():
    found = compare_kinematics(runs_of("rolling", DEVICE, 3), DEVICE, known=(), direct=False)
    assert found.supported is None
    assert found.evidence == pytest.approx(0.0, abs=1e-2)
    assert found.words[0] == "Geometry and kinematics cannot be separated on these recordings."
    assert "Ro/Rb must be among it" in found.words[-1]


def test_a_wrong_geometry_is_contradicted_instead_of_believed():
    wrong = {**DEVICE, "mb": 0.032, "Rb": 0.008, "Ib": 1.3e-6}
    found = compare_kinematics(runs_of("rolling", DEVICE, 4), wrong, direct=False)
    assert found.contradicted
    assert found.supported is None
    assert "contradict" in found.words[1]


def test_only_sets_with_the_ratio_of_the_radii_separate():
    runs = runs_of("rolling", DEVICE, 5)
    solution = fit_entries(runs, DEVICE)
    expected = separating(entries_covariance(solution, uncertainty(solution)), DEVICE)
    without = [value for name, value in expected.items() if "Ro/Rb" not in name]
    assert max(without) < 1e-2
    assert expected["Ro/Rb"] < 1e-2
    assert expected["Ro/Rb and the ball's spin"] > DECISIVE
    assert expected["Ro/Rb and the ball's mass and diameter (mb, Ib)"] > DECISIVE
    # why: the twin of the device under the papers' kinematics has another ratio and nothing else that can be weighed
    assert entries_of("published", equivalent("rolling", DEVICE)) == pytest.approx(entries_of("rolling", DEVICE))


def test_recordings_without_a_rolling_ball_are_refused():
    with pytest.raises(ValueError, match="both hoop and ball move"):
        compare_kinematics([], DEVICE)


def test_the_real_recordings_do_not_separate_geometry_and_kinematics():
    path = shared_path("recordings/meas_hoopAndBall2_01.mat")
    found = compare_kinematics(prepare([load(path)]), DEVICE, known=())
    assert found.supported is None
    assert "cannot be separated" in found.words[0]
    assert abs(found.evidence) < 0.1
    by = {(fit.structure, fit.geometry): fit for fit in found.fits}
    assert abs(by["rolling", "free"].deviance - by["published", "free"].deviance) < 2.0
    assert found.effective_samples < 200
    # the difference would show: it is hidden by the geometry alone
    assert found.predicted["K2"].difference_in_errors > 10.0
    assert max(found.separating.values()) > DECISIVE
