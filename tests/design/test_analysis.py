"""The linear model: the thesis's figures, and each result derived a second way."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings, strategies as st

from hoopd.design.analysis import channel, linear_model, minimal
from hoopd.design.delay import held
from hoopd.design.margins import closed_loop_poles, is_stable, margins
from hoopd.design.response import response
from hoopd.design.speed import bandwidth, sampling_advice, step_info
from hoopd.design.visibility import controllability, detectability, in_words, observability
from hoopd.ident.transfer_functions import numerator_and_denominator, transfer_function, zeros
from hoopd.plants.hoop.loop.operating_points import NoEquilibriumError, operating_point
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
THESIS = plant_of(load_model(CONFIG / "models" / "thesis.yaml"))
HOOP = plant_of(load_model(CONFIG / "models" / "hoop.yaml"))
PLANTS = pytest.mark.parametrize("plant", [THESIS, HOOP], ids=["thesis", "rolling"])
P = linear_model(THESIS)

# The thesis's printed PID, Kp (1 + 1/(Ti s) + Td s/(1 + s Td/15)), and it at 20 ms
KP, TI, TD = 0.16425557639727875, 0.03906614150888865, 0.3930283441920987
S = control.tf("s")
PID = control.tf2ss(KP * (1 + 1 / (TI * S) + TD * S / (1 + S * TD / 15)))
PID_50_HZ = control.sample_system(PID, 0.02, "tustin")


def by_size(values: np.ndarray) -> np.ndarray:
    return np.array(sorted(map(complex, values), key=lambda v: (round(abs(v), 9), v.imag)))


# ---------------------------------------------------------------------------------------------- the thesis's figures


def test_poles_and_zeros_are_the_printed_ones() -> None:
    pair = -0.167663694405211 + 8.579375019784992j
    np.testing.assert_allclose(by_size(P.poles()), [0, -0.4816611437370447, pair.conjugate(), pair], atol=1e-12)
    np.testing.assert_allclose(by_size(zeros(P)), [0, -0.4727679267190814], atol=1e-12)


def test_transfer_function_is_the_printed_one_without_a_spurious_leading_coefficient() -> None:
    found = transfer_function(P)
    np.testing.assert_allclose(found.num[0][0], [210.12, 99.338, 0.0], atol=5e-4)
    np.testing.assert_allclose(found.den[0][0], [1.0, 0.81699, 73.795, 35.467, 0.0], atol=5e-4)
    assert found.num[0][0][-1] == found.den[0][0][-1] == 0.0


def test_phase_margin_is_exact_and_the_printed_one_is_a_grid_point_beside_it() -> None:
    found = margins(P)
    assert math.degrees(found.phase_rad) == pytest.approx(1.5704866373, abs=1e-9)
    assert found.phase_rad_s == pytest.approx(16.8426461038, abs=1e-9)
    assert abs(response(P, found.phase_rad_s)) == pytest.approx(1.0, abs=1e-12)
    printed = complex(response(P, 16.845711769073052))
    assert math.degrees(np.angle(printed)) + 180.0 == pytest.approx(1.570004618148971, abs=1e-10)
    assert abs(printed) == pytest.approx(0.99951, abs=1e-5)  # so it is no crossover
    assert found.gain_up == math.inf and found.gain_down == 0.0
    assert found.delay_s == pytest.approx(found.phase_rad / found.phase_rad_s)


def test_both_bandwidths() -> None:
    found = bandwidth(P)
    assert found.absolute_rad_s == pytest.approx(19.254, abs=5e-4)
    assert found.below_dc_rad_s == pytest.approx(13.403, abs=5e-4)
    assert found.dc_gain == pytest.approx(2.8009, abs=1e-4)
    # python-control's is at 3.000 dB instead of 3.010
    assert control.bandwidth(minimal(P).system) == pytest.approx(13.398, abs=5e-4)


def test_controllable_and_not_observable_from_the_ball_angle() -> None:
    assert controllability(P).full
    seen = observability(P)
    assert not seen.full and seen.rank == 3 and seen.lost == ("theta",) and seen.weak == ("dtheta",)
    np.testing.assert_allclose(seen.singular_values, [86.8, 62.5, 4.9e-5, 0.0], rtol=0.01)
    text = " ".join(in_words(P))
    assert "hoop angle (theta) is not seen from psi" in text and "not detectable" in text


@pytest.mark.parametrize(
    ("delay", "phase_deg", "gain", "peak", "stable"),
    [(0, 41.9, 6.16, 1.59, True), (1, 24.3, 2.18, 2.70, True), (2, 6.6, 1.23, 9.76, True), (3, -11.0, 0, 0, False)],
)
def test_margins_of_the_printed_pid_at_50_hz(
    delay: int, phase_deg: float, gain: float, peak: float, stable: bool
) -> None:
    found = margins(held(P, 0.02, 0.02 * delay) * PID_50_HZ)
    assert found.stable is stable
    assert math.degrees(found.phase_rad) == pytest.approx(phase_deg, abs=0.05)
    if stable:
        assert found.gain_up == pytest.approx(gain, abs=0.005)
        assert found.peak_sensitivity == pytest.approx(peak, abs=0.005)
        assert int(found.delay_s / 0.02) == 2 - delay  # the third sample is too much


def test_margins_of_the_printed_pid_in_continuous_time() -> None:
    found = margins(P * PID)
    assert math.degrees(found.phase_rad) == pytest.approx(50.6, abs=0.05)
    assert found.phase_rad_s == pytest.approx(15.33, abs=0.005)
    assert found.delay_s == pytest.approx(57.6e-3, abs=5e-5)


# ---------------------------------------------------------------------------------------------- second derivations


@PLANTS
def test_matrices_are_the_derivative_of_the_plant(plant: HoopPlant) -> None:
    point = operating_point(plant, psi_rad=0.7)
    model = linear_model(plant, point.x, point.u, ("theta", "dpsi"))
    step = 1e-6
    columns = [
        (plant.derivative(point.x + step * e, point.u) - plant.derivative(point.x - step * e, point.u)) / (2 * step)
        for e in np.eye(4)
    ]
    torque = (plant.derivative(point.x, point.u + step) - plant.derivative(point.x, point.u - step)) / (2 * step)
    np.testing.assert_allclose(model.A, np.array(columns).T, atol=1e-6 * np.abs(model.A).max())
    np.testing.assert_allclose(model.B[:, 0], torque, rtol=1e-6)
    np.testing.assert_array_equal(model.C, np.eye(4)[[0, 3]])
    assert model.state_labels == ["theta", "dtheta", "psi", "dpsi"]
    assert (model.input_labels, model.output_labels) == (["torque"], ["theta", "dpsi"])


def test_unknown_outputs_are_refused() -> None:
    for outputs in ((), ("phi",), ("psi", "psi")):
        with pytest.raises(ValueError, match="outputs must be different ones"):
            linear_model(THESIS, outputs=outputs)


def random_stable(seed: int, n: int) -> control.StateSpace:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a -= (np.linalg.eigvals(a).real.max() + rng.uniform(0.05, 1.0)) * np.eye(n)
    return control.ss(a, rng.normal(size=(n, 1)), rng.normal(size=(1, n)), 0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6))
def test_transfer_function_zeros_and_response_agree_with_scipy(seed: int, n: int) -> None:
    system = random_stable(seed, n)
    num, den = numerator_and_denominator(system)
    arrays = (system.A, system.B, system.C, system.D)
    np.testing.assert_allclose(den, np.poly(system.A), rtol=1e-7, atol=1e-9)
    w = np.geomspace(0.01, 100, 30)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", scipy.signal.BadCoefficients)
        expected = scipy.signal.freqresp(scipy.signal.StateSpace(*arrays), w)[1]
    np.testing.assert_allclose(response(system, w), expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(np.polyval(num, 1j * w) / np.polyval(den, 1j * w), expected, rtol=1e-6, atol=1e-9)
    own, theirs = by_size(zeros(system)), by_size(system.zeros())
    if len(own) == len(theirs):  # python-control lists zeros at infinity as very large ones
        np.testing.assert_allclose(own, theirs, rtol=1e-4, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 5))
def test_peaks_are_not_below_any_grid_and_gain_margin_is_where_stability_ends(seed: int, n: int) -> None:
    loop = random_stable(seed, n)
    found = margins(loop)
    peak = found.peak_sensitivity_rad_s
    # a peak may be narrower than a grid's step
    near = peak * np.linspace(0.9, 1.1, 4001) if np.isfinite(peak) else np.zeros(0)
    w = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 4000), near])
    num, den = numerator_and_denominator(loop)
    dense = 1.0 / np.abs(1.0 + np.polyval(num, 1j * w) / np.polyval(den, 1j * w))
    assert found.peak_sensitivity >= dense.max() * (1.0 - 1e-9)
    assert found.peak_sensitivity == pytest.approx(dense.max(), rel=0.02)
    if not found.stable:
        return
    for factor, inside in ((found.gain_up, 0.999), (found.gain_down, 1.001)):
        if math.isfinite(factor) and factor > 0.0:
            assert is_stable(closed_loop_poles(inside * factor * loop), sampled=False)
            assert not is_stable(closed_loop_poles(factor / inside * loop), sampled=False)


def test_delay_margin_is_where_a_delay_ends_stability() -> None:
    loop = P * PID
    bare = margins(loop)
    for share, stable in ((0.98, True), (1.02, False)):
        num, den = control.pade(share * bare.delay_s, 8)
        late = minimal(loop).system * control.tf2ss(control.tf(num, den))
        assert is_stable(closed_loop_poles(late), sampled=False) is stable
        assert margins(loop, share * bare.delay_s).stable is stable
    half = margins(loop, bare.delay_s / 2)
    assert half.delay_s == pytest.approx(bare.delay_s / 2, rel=1e-9)
    assert half.phase_rad == pytest.approx(bare.phase_rad - bare.phase_rad_s * bare.delay_s / 2, rel=1e-9)
    num, den = control.pade(bare.delay_s / 2, 8)
    assert margins(loop * control.tf2ss(control.tf(num, den))).peak_sensitivity == pytest.approx(
        half.peak_sensitivity, rel=1e-5
    )


def test_a_resonance_that_just_reaches_one_is_not_missed() -> None:
    s = control.tf("s")
    narrow = control.tf2ss(1e-4 / (s**2 + 2e-4 * s + 1) + 0.49 / (s + 1))  # 0.5 at its top, 2e-4 wide
    top = margins(2.0000001 * narrow)
    assert margins(narrow).gain_crossovers == ()
    peak = np.abs(response(narrow, 1.0 + np.linspace(-3e-4, 3e-4, 6001))).max()
    barely = margins((1.0 + 1e-7) / peak * narrow)
    assert len(barely.gain_crossovers) == 2
    assert top.stable


@pytest.mark.parametrize("output", ["theta", "dtheta", "dpsi"])
def test_an_undamped_pole_stops_no_root_finder(output: str) -> None:
    free = linear_model(HOOP.with_parameters(bb=0.0, bh=0.0), outputs=(output,))
    assert margins(free).gain_crossovers and bandwidth(free).absolute_rad_s > 0.0


def test_a_plant_without_friction_has_no_phase_to_spare() -> None:
    free = linear_model(HOOP.with_parameters(bb=0.0, bh=0.0))
    found = margins(free)
    assert found.phase_rad == pytest.approx(0.0, abs=1e-6)
    assert not found.stable and math.isnan(found.delay_s)
    assert step_info(free) is None


# ---------------------------------------------------------------------------------------------- what cancels


def test_minimal_names_what_the_output_does_not_see() -> None:
    less = minimal(P)
    assert less.unseen == ("theta",) and less.unmoved == ()
    assert less.system.state_labels == ["dtheta", "psi", "dpsi"]
    np.testing.assert_allclose(by_size(zeros(less.system)), [-0.4727679267190814], atol=1e-12)
    w = np.geomspace(0.01, 100, 20)
    np.testing.assert_allclose(response(less.system, w), response(P, w), rtol=1e-10)
    np.testing.assert_allclose(response(transfer_function(P), w), response(P, w), rtol=1e-9)


def test_nothing_is_dropped_when_the_hoop_angle_is_measured_and_more_when_nothing_couples() -> None:
    both = linear_model(THESIS, outputs=("theta", "psi"))
    assert minimal(both).unseen == ()
    assert observability(both).full and detectability(both).detectable
    assert minimal(linear_model(THESIS.with_parameters(J21=0.0))).unseen == ("theta", "dtheta")
    assert minimal(linear_model(THESIS.with_parameters(L2=0.0, J21=0.0))).unmoved == ("psi", "dpsi")


def test_only_the_hoop_angle_stops_a_filter() -> None:
    found = detectability(P)
    assert not found.detectable and found.states == ("theta",) and found.hidden == (0j,)
    less = minimal(P).system
    assert detectability(less).detectable
    gain, _, poles = control.lqe(less.A, np.eye(3), less.C, np.eye(3), np.eye(1))  # which stops on P
    assert gain.shape == (3, 1) and (np.real(poles) < 0).all()


def test_the_hoop_angle_at_z_1_does_not_make_a_loop_unstable() -> None:
    loop = held(P, 0.02, 0.02) * PID_50_HZ
    closed = np.linalg.eigvals(loop.A - loop.B @ loop.C)  # D = 0
    assert np.abs(closed - 1.0).min() < 1e-9
    assert is_stable(closed_loop_poles(loop), sampled=True)
    assert np.abs(closed_loop_poles(loop)).max() == pytest.approx(0.99060, abs=5e-6)


# ---------------------------------------------------------------------------------------------- sampled


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_delay_of_samples_is_a_power_of_z(delay: int) -> None:
    prompt, late = held(P, 0.02), held(P, 0.02, 0.02 * delay)
    w = np.geomspace(0.1, 150, 50)
    expected = response(prompt, w) * np.exp(-1j * w * 0.02 * delay)
    np.testing.assert_allclose(response(late, w), expected, rtol=1e-9)
    np.testing.assert_allclose(response(prompt, w, 0.02 * delay), expected, rtol=1e-9)
    assert late.state_labels[4:] == [f"torque_{k}" for k in range(delay, 0, -1)]
    ad, bd = THESIS.discretize(0.02)
    np.testing.assert_allclose(prompt.A, ad, atol=1e-12)
    np.testing.assert_allclose(prompt.B, bd, atol=1e-12)


def test_a_delayed_run_is_the_run_later() -> None:
    rng = np.random.default_rng(3)
    u, time = rng.normal(size=100), 0.02 * np.arange(100)
    _, prompt = control.forced_response(held(P, 0.02), time, u)
    _, late = control.forced_response(held(P, 0.02, 0.04), time, u)
    np.testing.assert_allclose(late[2:], prompt[:-2], atol=1e-9)


def test_a_resonance_behind_the_first_fall_parts_the_two_bandwidths() -> None:
    """1/(s + 1) falls at 1 rad/s, a resonance of gain 5 at 10 rad/s lifts it again: below for good only behind that."""
    found = bandwidth(control.ss(control.tf([1.0], [1.0, 1.0]) * control.tf([100.0], [1.0, 0.2, 100.0])))
    assert found.below_dc_rad_s == pytest.approx(1.0, abs=0.03) and 10.0 < found.absolute_rad_s < 12.0


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("stiffness", [0.5, 50.0, 500.0])
def test_a_free_drive_of_two_masses_integrates_however_stiff_its_shaft(stiffness: float, sampled: bool) -> None:
    j1, j2, k, d = 1e-4, 3e-4, stiffness, 1e-2
    a = [[0, 0, 1, 0], [0, 0, 0, 1], [-k / j1, k / j1, -d / j1, d / j1], [k / j2, -k / j2, d / j2, -d / j2]]
    drive = control.ss(a, [[0], [0], [1 / j1], [0]], [[1, 0, 0, 0]], 0)
    found = bandwidth(held(drive, 0.001) if sampled else drive)
    assert math.isnan(found.below_dc_rad_s) and math.isinf(found.dc_gain)
    if sampled:
        return
    # S = den/(den + num) of L = (j2 s^2 + d s + k) / (j1 j2 s^4 + (j1 + j2) s^2 (d s + k))
    den, num = np.array([j1 * j2, (j1 + j2) * d, (j1 + j2) * k, 0.0, 0.0]), np.array([j2, d, k])
    closed = np.polyadd(den, num)
    w = 1j * np.concatenate([np.geomspace(0.1, 1e5, 100_000), np.abs(np.roots(closed).imag)])
    largest = np.abs(np.polyval(den, w) / np.polyval(closed, w)).max()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert margins(drive).peak_sensitivity == pytest.approx(largest, rel=1e-3)


@pytest.mark.parametrize("step_s", [None, 0.001])
def test_what_is_slow_beside_the_rest_does_not_integrate(step_s: float | None) -> None:
    slow = control.ss([[-1e-4, 1.0, 0.0], [0.0, -2e-4, 1.0], [0.0, 0.0, -1e3]], [[0], [0], [1e3]], [[2e-8, 0, 0]], 0)
    found = bandwidth(slow if step_s is None else held(slow, step_s))
    assert found.dc_gain == pytest.approx(1.0, rel=1e-5)
    assert step_s or found.below_dc_rad_s == pytest.approx(8.4e-5, rel=0.01)


def test_sampling_advice_is_ten_to_thirty_times_the_bandwidth() -> None:
    found = sampling_advice(19.254)
    assert found.slowest_hz == pytest.approx(30.64, abs=0.01) and found.fastest_hz == pytest.approx(91.93, abs=0.01)
    assert found.slowest_hz < 50.0 < found.fastest_hz


# ---------------------------------------------------------------------------------------------- step


def test_step_figures_of_a_known_second_order_system() -> None:
    z, w = 0.3, 5.0
    found = step_info(control.tf2ss(control.tf([w**2], [1, 2 * z * w, w**2])))
    assert found is not None
    assert found["Overshoot"] == pytest.approx(100 * math.exp(-math.pi * z / math.sqrt(1 - z * z)), rel=1e-4)
    assert found["PeakTime"] == pytest.approx(math.pi / (w * math.sqrt(1 - z * z)), abs=1e-3)
    assert found["SteadyStateValue"] == pytest.approx(1.0)


def test_step_of_the_plant_against_its_own_simulation() -> None:
    found = step_info(P)
    assert found is not None
    assert found["SteadyStateValue"] == pytest.approx(2.8008938, abs=1e-6)
    x, peak = np.zeros(4), (0.0, 0.0)
    small = 1e-5  # N m: linear
    for k in range(1, 600):
        x = THESIS.advance(x, small, 1e-3)
        peak = max(peak, (x[2] / small, k * 1e-3))
    assert found["Peak"] == pytest.approx(peak[0], rel=1e-4)
    assert found["PeakTime"] == pytest.approx(peak[1], abs=2e-3)
    assert step_info(channel(linear_model(THESIS, outputs=("theta",)), "theta")) is None  # integrates


def test_step_of_a_speed_ends_at_zero_and_has_nothing_relative_to_it() -> None:
    found = step_info(linear_model(THESIS, outputs=("dpsi",)))
    assert found is not None and found["SteadyStateValue"] == 0.0
    assert math.isnan(found["SettlingTime"]) and math.isnan(found["Overshoot"]) and found["Peak"] > 20.0


def test_step_of_a_very_slow_sampled_system_is_not_followed_for_ever() -> None:
    slow = control.ss([[1.0 - 1e-9]], [[1.0]], [[1.0]], 0, 0.02)
    assert step_info(slow) is None


# ---------------------------------------------------------------------------------------------- operating points


@PLANTS
@pytest.mark.parametrize("psi", [0.0, 0.01, -0.3, 1.2, math.pi])
def test_an_operating_point_by_angle_stays(plant: HoopPlant, psi: float) -> None:
    point = operating_point(plant, psi_rad=psi)
    rate = plant.derivative(point.x, point.u)
    np.testing.assert_allclose(rate, [point.x[1], 0, 0, 0], atol=1e-9 * (1 + abs(point.x[1])))
    assert point.x[2] == psi
    still = psi in (0.0, math.pi)
    assert bool(point.x[1] == 0.0 and point.u == 0.0) is still


@PLANTS
@pytest.mark.parametrize("speed", [-60.0, 5.0, 150.0])
def test_an_operating_point_by_speed_stays_and_is_that_of_its_angle(plant: HoopPlant, speed: float) -> None:
    point = operating_point(plant, dtheta_rad_s=speed)
    np.testing.assert_allclose(plant.derivative(point.x, point.u), [speed, 0, 0, 0], atol=1e-9 * abs(speed))
    assert abs(point.x[2]) < math.pi / 2
    again = operating_point(plant, psi_rad=float(point.x[2]))
    assert again.x[1] == pytest.approx(speed, rel=1e-9) and again.u == pytest.approx(point.u, rel=1e-9)


def test_hoop_speed_per_degree_and_what_carries_the_ball() -> None:
    point = operating_point(THESIS, psi_rad=math.radians(1.0))
    assert point.x[1] == pytest.approx(7.4, abs=0.01) and point.u == pytest.approx(6.23e-3, abs=1e-5)
    p = HOOP.parameters
    point = operating_point(HOOP, psi_rad=0.4)
    friction = (p["Ro"] / p["Rb"]) ** 2 * p["bb"] * point.x[1]
    assert friction == pytest.approx(p["mb"] * p["g"] * (p["Ro"] - p["Rb"]) * math.sin(0.4), rel=1e-9)
    assert point.u == pytest.approx(friction + p["bh"] * point.x[1], rel=1e-9)
    assert "all the time" in point.notes[0]


def test_points_that_do_not_exist_are_refused_and_impossible_ones_named() -> None:
    with pytest.raises(NoEquilibriumError, match=r"no equilibrium at 1000 rad/s: .* holds 423\.8 rad/s"):
        operating_point(THESIS, dtheta_rad_s=1000.0)
    with pytest.raises(NoEquilibriumError, match="rolling friction alone carries it, and the model has none"):
        operating_point(HOOP.with_parameters(bb=0.0), psi_rad=0.3)
    with pytest.raises(NoEquilibriumError, match="not both"):
        operating_point(HOOP, psi_rad=0.1, dtheta_rad_s=1.0)
    assert "leaves the outer hoop" in operating_point(HOOP, psi_rad=math.pi).notes[0]
    assert "cannot be held" in operating_point(HOOP, psi_rad=1.0, torque_limit_nm=0.1).notes[-1]


def test_the_top_is_unstable() -> None:
    point = operating_point(HOOP, psi_rad=math.pi)
    assert linear_model(HOOP, point.x, point.u).poles().real.max() > 5.0
