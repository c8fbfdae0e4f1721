"""Loop shaping, PID forms, links and sampling: the thesis's numbers, and what they do and do not meet."""

from __future__ import annotations

from math import atan2, degrees, inf
from pathlib import Path

import control
import numpy as np
import pytest

from hoopd.design.analysis import linear_model, minimal
from hoopd.design.delay import held, sample_delay
from hoopd.design.links import lag_link, lead_link, lead_link_at, lead_phase_deg, lead_ratio
from hoopd.design.loop_shaping import loopshaping_pi, loopshaping_pid, peak_complementary, response_and_slope
from hoopd.design.margins import margins, response as frequency_response
from hoopd.design.pid import Parallel, Series, Standard, pid, pid_two_degrees, to_parallel, to_series, to_standard
from hoopd.ident.discretization import c2d, d2c
from hoopd.ident.transfer_functions import transfer_function
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
H = 0.02
PRINTED = Standard(0.16425557639727875, 0.03906614150888865, 0.3930283441920987)
SPECIFIED = Parallel(0.1966658517043, 2.8154612922536, 0.0473455704091)


# Torque to psi of the thesis's model, without theta.
P = minimal(linear_model(plant_of(load_model(CONFIG / "models" / "thesis.yaml")))).system


def filtered(gains: Parallel | Standard) -> control.TransferFunction:
    """With the thesis's derivative filter Td/15."""
    return pid(gains, to_standard(gains).td / 15)


def coefficients(c: control.TransferFunction) -> list[float]:
    return [*c.num[0][0], *c.den[0][0]]


# ------------------------------------------------------------------------------------------ loop shaping


@pytest.mark.parametrize("plant", [P, transfer_function(P)], ids=["state space", "rational"])
def test_pid_of_the_thesis_specification(plant: control.StateSpace) -> None:
    gains = loopshaping_pid(plant, 10, 1.25, 50)
    np.testing.assert_allclose(gains, (0.1966659, 2.8154613, 0.0473456), atol=5e-8)
    np.testing.assert_allclose(gains, SPECIFIED, rtol=1e-11)
    peak = peak_complementary(plant, pid(gains))
    assert peak.value == pytest.approx(1.25, abs=1e-12)
    assert peak.w == pytest.approx(10.0, abs=1e-6)


def test_pid_touches_its_circle_at_the_wanted_angle() -> None:
    c = pid(loopshaping_pid(P, 10, 1.25, 50))
    l0 = P(10j) * c(10j)
    ray = l0 + 1.25**2 / (1.25**2 - 1)
    assert abs(l0 / (1 + l0)) == pytest.approx(1.25, abs=1e-13)
    assert degrees(atan2(-ray.imag, ray.real)) == pytest.approx(50, abs=1e-11)
    ahead, behind = (P(1j * w) * c(1j * w) for w in (10 + 1e-5, 10 - 1e-5))
    assert ((ahead - behind) * ray.conjugate()).real / abs(ahead - behind) / abs(ray) == pytest.approx(0, abs=1e-6)


def test_the_printed_pid_does_not_meet_its_specification() -> None:
    """Nor does any reading of its three numbers: without its filter too low a peak, with it too high a one."""
    bare, whole = peak_complementary(P, pid(PRINTED)), peak_complementary(P, filtered(PRINTED))
    assert (bare.value, bare.w) == (pytest.approx(1.1592, abs=1e-4), pytest.approx(9.581, abs=1e-3))
    assert (whole.value, whole.w) == (pytest.approx(1.4072, abs=1e-4), pytest.approx(11.24, abs=5e-3))
    as_parallel = peak_complementary(P, pid(Parallel(*PRINTED)))
    assert as_parallel.value == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("delay_s", [0.03, 0.06])
def test_pid_is_shaped_against_a_delay(delay_s: float) -> None:
    gains = loopshaping_pid(P, 10, 2.0, 60, delay_s=delay_s)
    peak = peak_complementary(P, pid(gains), delay_s)
    assert (peak.value, peak.w) == (pytest.approx(2.0, abs=1e-9), pytest.approx(10.0, abs=1e-6))


def test_pi_puts_the_loop_where_it_is_wanted() -> None:
    """The example of ControlSystems.jl, (s + 1)^-4 at 0.8 rad/s with 60 degrees; its numbers."""
    plant = control.tf([1.0], [1.0, 4.0, 6.0, 4.0, 1.0])
    gains = loopshaping_pi(plant, 0.8, 60)
    np.testing.assert_allclose(gains, (0.82274734724854, -0.45472580052281375, 0), rtol=1e-12)
    loop = plant(0.8j) * pid(gains)(0.8j)
    assert abs(loop) == pytest.approx(abs(plant(0.8j)), rel=1e-12)
    assert degrees(np.angle(loop)) == pytest.approx(-120)
    crossing = loopshaping_pi(plant, 0.4, 60, gain=1.0, delay_s=0.1)
    assert np.abs(plant(0.4j) * pid(crossing)(0.4j)) == pytest.approx(1.0)


def test_slope_of_a_response_is_exact() -> None:
    for w in (0.1, 8.6, 40.0):
        ahead, behind = (response_and_slope(P, w + d, 0.05).value for d in (1e-6, -1e-6))
        assert response_and_slope(P, w, 0.05).slope == pytest.approx((ahead - behind) / 2e-6 / 1j, rel=1e-6)
        rational = response_and_slope(transfer_function(P), w)
        assert response_and_slope(P, w).slope == pytest.approx(rational.slope, rel=1e-9)


def test_loop_shaping_refuses_what_it_cannot_do() -> None:
    with pytest.raises(ValueError, match="continuous"):
        loopshaping_pid(c2d(P, H, "zoh"), 10, 1.25, 50)
    with pytest.raises(ValueError, match="above 1"):
        loopshaping_pid(P, 10, 1.0, 50)


# ------------------------------------------------------------------------------------------ PID forms


def test_the_printed_controller_is_the_standard_form_with_its_filter() -> None:
    printed = [0.0026901298082487772, 0.010720638072209578, 0.16425557639727875]
    below = [0.0010236067274141814, 0.03906614150888865, 0.0]
    made = filtered(PRINTED)
    np.testing.assert_allclose(np.array(coefficients(made)) * PRINTED.ti, [*printed, *below], rtol=1e-12)
    discrete = [1.9895532268941687, -3.781042887492248, 1.837946360416423, 1.0, -1.4475426500133597, 0.4475426500133597]
    np.testing.assert_allclose(coefficients(c2d(made, H)), discrete, rtol=1e-12)


def test_forms_are_the_same_controller() -> None:
    """Numbers of the tests of ControlSystems.jl, and every way there and back."""
    assert to_standard(Parallel(2, 3, 4)) == Standard(2, 2 / 3, 2)
    assert to_parallel(Series(2, 3, 4)) == pytest.approx((14 / 3, 2 / 3, 8))
    assert to_series(Standard(2, 4, 1)) == Series(1, 2, 2)
    for gains in (Parallel(1.0, 2.0, 0.1), Standard(1.0, 0.5, 0.1), Series(2.0, 3.0, 0.4), Standard(3.0, inf, 0.2)):
        for convert in (to_parallel, to_standard, to_series):
            assert pid(convert(gains))(2j) == pytest.approx(pid(gains)(2j))
    with pytest.raises(ValueError, match="complex zeros"):
        to_series(PRINTED)
    with pytest.raises(ValueError, match="proportional"):
        to_standard(Parallel(0.0, 1.0))


def test_filters_of_both_orders() -> None:
    gains, s = Parallel(1.0, 2.0, 0.1), 3j
    assert pid(gains, 0.01)(s) == pytest.approx(1 + 2 / s + 0.1 * s / (1 + 0.01 * s))
    assert pid(gains, 0.01, 2)(s) == pytest.approx((1 + 2 / s + 0.1 * s) / (1 + 0.01 * s + (0.01 * s) ** 2 / 2))
    assert pid(Parallel(1.0, 0.0, 0.1), 0.01, 2).poles().real.max() < -1
    reference, feedback = pid_two_degrees(gains, 0.5, 0.0, 0.01)
    assert reference(s) == pytest.approx(0.5 + 2 / s)
    assert feedback(s) == pytest.approx(pid(gains, 0.01)(s))


# ------------------------------------------------------------------------------------------ links


def test_lead_of_the_thesis() -> None:
    lead = lead_link_at(80, 5)
    np.testing.assert_allclose(
        coefficients(lead), np.array([0.02795084971874737, 1.0, 0.005590169943749474, 1.0]), rtol=1e-14
    )
    made = c2d(lead, H)
    np.testing.assert_allclose(
        coefficients(made), [2.4342806945451483, -1.1514210418177229, 1.0, 0.28285965272742575], rtol=1e-14
    )


def test_links_do_what_their_names_say() -> None:
    lead, lag = lead_link(2.0, 9.0, 3.0), lag_link(0.5, 4.0, 2.0)
    assert (lead(0).real, abs(lead(1e9j))) == (pytest.approx(3), pytest.approx(27))
    assert (lag(0).real, abs(lag(1e9j))) == (pytest.approx(8), pytest.approx(2))
    assert lead(1j) == pytest.approx(3 * 9 * (1j + 2) / (1j + 18))
    assert lag(1j) == pytest.approx(2 * (1j + 0.5) / (1j + 0.125))
    assert degrees(np.angle(lead_link_at(80, 5)(80j))) == pytest.approx(41.8, abs=0.02)
    assert lead_phase_deg(5) == pytest.approx(degrees(np.angle(lead_link_at(80, 5)(80j))))
    assert lead_ratio(lead_phase_deg(5)) == pytest.approx(5)
    assert degrees(np.angle(lag(5j))) > -6
    with pytest.raises(ValueError, match="above zero"):
        lead_link(0.0, 5.0)


# ------------------------------------------------------------------------------------------ sampled time


@pytest.mark.parametrize("method", ["tustin", "zoh"])
def test_the_way_back_from_samples(method: str) -> None:
    for system in (P, filtered(PRINTED), transfer_function(P)):
        back = d2c(c2d(system, H, method), method)
        assert type(back) is type(system)
        for w in (0.3, 8.0, 40.0):
            assert back(1j * w) == pytest.approx(system(1j * w), rel=1e-6)


def test_prewarping_is_exact_at_its_frequency() -> None:
    lead = lead_link_at(80, 5)
    warped = c2d(lead, H, "tustin", prewarp_w=60.0)
    assert warped(np.exp(60j * H)) == pytest.approx(lead(60j))
    assert d2c(warped, "tustin", prewarp_w=60.0)(11j) == pytest.approx(lead(11j))


def test_what_has_no_way_back_is_refused() -> None:
    with pytest.raises(ValueError, match="left of 0"):
        d2c(c2d(lead_link_at(80, 5), H), "zoh")
    with pytest.raises(ValueError, match="sample time"):
        d2c(P)
    with pytest.raises(ValueError, match="derivative"):
        c2d(pid(PRINTED), H)


def test_held_plant_with_a_late_input() -> None:
    exact = c2d(P, H, "zoh")
    for samples in (0, 1, 3):
        late = held(P, H, samples * H)
        z = np.exp(9j * H)
        assert late(z) == pytest.approx(exact(z) * sample_delay(samples, H)(z))
    # between the samples: twice the rate, one of its samples late
    half = held(P, H / 2, H / 2)
    t = np.arange(0, 1.0, H / 2)
    u = np.sin(7 * np.repeat(np.arange(0, 1.0, H), 2))
    fine = control.forced_response(half, t, u).outputs
    coarse = control.forced_response(held(P, H, H / 2), t[::2], u[::2]).outputs
    np.testing.assert_allclose(coarse, fine[::2], atol=1e-12)


# Sampled at 50 Hz, the plant held: phase margin, crossover, gain margin, Ms, recomputed from the printed controller.
LOOPS = {
    "printed": (PRINTED, 1.0, [(41.9, 15.4, 6.16, 1.59), (24.3, 15.4, 2.18, 2.70), (6.6, 15.4, 1.23, 9.76)], -11.0),
    "with lead": (
        PRINTED,
        lead_link_at(80, 5),
        [(61.1, 16.4, 6.42, 1.25), (42.3, 16.4, 2.78, 1.76), (23.6, 16.4, 1.70, 3.07), (4.8, 16.4, 1.12, 14.7)],
        -14.0,
    ),
    "specified": (
        SPECIFIED,
        1.0,
        [(45.7, 13.6, 8.65, 1.36), (30.1, 13.6, 3.19, 2.01), (14.6, 13.6, 1.82, 4.10)],
        -1.0,
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_margins_of_the_loops_at_50_hz(name: str) -> None:
    gains, link, rows, lost = LOOPS[name]
    c = control.ss(c2d(filtered(gains) * link, H))
    for delay, (phase, crossover, gain, ms) in enumerate(rows):
        loop = held(P, H, delay * H) * c
        found = margins(loop)
        assert degrees(found.phase_rad) == pytest.approx(phase, abs=0.05)
        assert found.phase_rad_s == pytest.approx(crossover, abs=0.05)
        assert found.gain_up == pytest.approx(gain, abs=0.005)
        assert found.peak_sensitivity == pytest.approx(ms, rel=5e-3)
        assert np.abs(control.feedback(loop, 1).poles()).max() == pytest.approx(0.9906, abs=1e-4)
    loop = held(P, H, len(rows) * H) * c
    assert degrees(margins(loop).phase_rad) == pytest.approx(lost, abs=0.05)
    assert np.abs(control.feedback(loop, 1).poles()).max() > 1.0


@pytest.mark.parametrize(
    ("link", "phase", "crossover", "samples"), [(1.0, 50.6, 15.33, 2.88), (lead_link_at(80, 5), 70.2, 16.28, 3.76)]
)
def test_margins_of_the_continuous_loops(link: object, phase: float, crossover: float, samples: float) -> None:
    found = margins(control.ss(transfer_function(P) * filtered(PRINTED) * link))
    assert degrees(found.phase_rad) == pytest.approx(phase, abs=0.05)
    assert found.phase_rad_s == pytest.approx(crossover, abs=0.005)
    assert found.delay_s / H == pytest.approx(samples, abs=0.005)


def test_gain_at_the_nyquist_frequency() -> None:
    c, lead = (control.ss(c2d(one, H)) for one in (filtered(PRINTED), lead_link_at(80, 5)))
    end = np.pi / H
    assert abs(frequency_response(c, end)) == pytest.approx(2.63, abs=0.005)
    assert abs(frequency_response(lead, end)) == pytest.approx(5.0, abs=0.005)
    assert abs(frequency_response(c * lead, end)) == pytest.approx(13.1, abs=0.06)
