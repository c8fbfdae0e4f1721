"""Poles placed, predictors, the gang of four."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest

from hoopd.design.analysis import linear_model, minimal
from hoopd.design.delay import held, sample_delay, smith_predictor
from hoopd.design.gang_of_four import gang_of_four, noise_gain, nyquist_gain, peaks
from hoopd.design.laws import without_hoop
from hoopd.design.lqg import reduced_model
from hoopd.design.pid import Parallel, pid
from hoopd.design.placement import place, place_pi
from hoopd.ident.discretization import c2d
from hoopd.ident.transfer_functions import transfer_function
from hoopd.plants.model_file import load_model, plant_of

CONFIG = Path(__file__).resolve().parents[2] / "config"
THESIS = plant_of(load_model(CONFIG / "models" / "thesis.yaml"))
H = 0.02
P = minimal(linear_model(THESIS)).system
SPECIFIED = Parallel(0.1966658517043, 2.8154612922536, 0.0473455704091)


def closed(plant: control.TransferFunction, gains: Parallel) -> np.ndarray:
    return np.sort_complex(control.feedback(plant * pid(gains), 1).poles())


def test_pi_of_a_first_order_plant() -> None:
    """The example of ControlSystems.jl: Kp 9/5, Ti 9/20 for 2 rad/s and damping 0.7; and one with a zero."""
    gains = place_pi(control.tf([1.0], [1.0, 1.0]), 2.0, 0.7)
    np.testing.assert_allclose(gains, (9 / 5, 9 / 5 / (9 / 20), 0))
    plant = control.tf([0.5, 3.0], [2.0, 1.0])
    np.testing.assert_allclose(closed(plant, place_pi(plant, 2.0, 0.7)), np.sort_complex(np.roots([1, 2.8, 4])))


def test_pi_of_a_second_order_plant_adds_no_damping() -> None:
    plant = control.tf([210.0], [1.0, 3.0, 73.6])
    poles = closed(plant, place_pi(plant, 7.0, 0.1))
    wanted = [*np.roots([1, 1.4, 49]), -1.6]
    np.testing.assert_allclose(poles, np.sort_complex(wanted), atol=1e-9)
    with pytest.raises(ValueError, match="adds no damping"):
        place_pi(without_hoop(THESIS), 8.7, 0.1)
    with pytest.raises(ValueError, match="first order"):
        place_pi(transfer_function(P), 8.7, 0.1)


def test_the_ball_alone_is_the_plant_without_the_hoops_mode() -> None:
    plant, ball = transfer_function(P), without_hoop(THESIS)
    assert len(ball.poles()) == 2
    for w in (5.0, 8.58, 30.0):
        assert ball(1j * w) == pytest.approx(plant(1j * w), rel=5e-3)


@pytest.mark.parametrize("poles", [(0.9, 0.8, 0.7), (0.8 + 0.1j, 0.8 - 0.1j, 0.9), (0.8, 0.8, 0.8), (0.9, 0.8, 0.8)])
def test_state_feedback_places_poles_repeated_ones_too(poles: tuple[complex, ...]) -> None:
    a, b = reduced_model(THESIS, H)
    gain = place(a, b, poles)
    assert gain.shape == (1, 3)
    np.testing.assert_allclose(np.poly(a - b @ gain), np.poly(poles), atol=1e-9)


def test_what_cannot_be_placed_is_said() -> None:
    a, b = reduced_model(THESIS, H)
    with pytest.raises(ValueError, match="3 poles"):
        place(a, b, (0.9, 0.8))
    with pytest.raises(ValueError, match="pairs"):
        place(a, b, (0.9, 0.8 + 0.1j, 0.8))
    with pytest.raises(ValueError, match="does not reach"):
        place(np.diag([0.5, 0.6]), np.array([[1.0], [0.0]]), (0.1, 0.2))


# ------------------------------------------------------------------------------------------ Smith predictor


def test_smith_predictor_takes_the_delay_out_of_the_loop() -> None:
    c, model = c2d(pid(SPECIFIED, 0.016), H), transfer_function(c2d(P, H, "zoh"))
    for samples in (1, 3):
        smith = smith_predictor(c, model, samples)
        late, z = model * sample_delay(samples, H), np.exp(9j * H)
        loop = late(z) * smith(z)
        assert loop / (1 + loop) == pytest.approx(model(z) * c(z) / (1 + model(z) * c(z)) * z**-samples, rel=1e-9)
    with pytest.raises(ValueError, match="sample times"):
        smith_predictor(c, c2d(transfer_function(P), 0.01), 1)


def test_smith_predictor_leaves_the_balls_own_swing() -> None:
    """Why it is not used: the same gains, which damp the ball well without delay, do not behind a predictor."""
    c, model = c2d(pid(SPECIFIED, 0.016), H), transfer_function(c2d(P, H, "zoh"))
    direct = control.feedback(held(P, H) * control.ss(c), 1).poles()
    smith = control.feedback(held(P, H, 3 * H) * control.ss(smith_predictor(c, model, 3)), 1).poles()
    assert max(abs(z) for z in direct if z.imag > 0) < 0.95
    own = [np.exp(p * H) for p in P.poles() if p.imag > 0]
    assert max(abs(z) for z in smith if z.imag > 0) == pytest.approx(abs(own[0]), abs=1e-3)


# ------------------------------------------------------------------------------------------ gang of four


def test_gang_of_four_is_that_of_the_closed_loop() -> None:
    plant, c = held(P, H), control.ss(c2d(pid(SPECIFIED, 0.016), H))
    gang = gang_of_four(plant, c)
    np.testing.assert_allclose(gang.sensitivity + gang.complementary, 1.0)
    s = control.feedback(control.ss([], [], [], 1, H), plant * c)
    for w, load, noise in zip(gang.w[::50], gang.load[::50], gang.noise[::50], strict=True):
        z = np.exp(1j * w * H)
        assert load == pytest.approx(plant(z) * s(z), rel=1e-6)
        assert noise == pytest.approx(c(z) * s(z), rel=1e-6)
    theirs = control.gangof4_response(plant, c, omega=gang.w).frdata[1, 1]
    assert np.abs(theirs - gang.sensitivity).max() > 0.5  # of a continuous loop it would be right
    assert peaks(gang)["sensitivity"] == pytest.approx(1.36, abs=0.01)


def test_noise_gain_is_what_noise_does() -> None:
    plant, c = held(P, H), control.ss(c2d(pid(SPECIFIED, 0.016), H))
    noise = np.random.default_rng(1).normal(size=40_000)
    torque = control.forced_response(control.feedback(c, plant), np.arange(40_000) * H, noise).outputs
    assert noise_gain(plant, c) == pytest.approx(torque.std(), rel=0.02)
    assert nyquist_gain(c) == pytest.approx(abs(c(-1.0)))
