"""Chapter 4: the linear model with the thesis's entries, and the linear against the nonlinear plant.

Rules of this file: numbers from `hoopd.design`, beside the printed ones.
"""

from __future__ import annotations

from math import degrees

import numpy as np

from hoopd.design.analysis import linear_model, minimal
from hoopd.design.margins import margins
from hoopd.design.speed import bandwidth, step_info
from hoopd.ident.transfer_functions import zeros
from hoopd.plants.fits.nrmse import nrmse_percent
from hoopd.plants.hoop.loop.closed_loop import LinearPlant, Moving
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.recordings.recorded_runs import SimulatedStretch
from hoopd.plots.linear import draw_nyquist, draw_poles, draw_step
from hoopd.plots.linearity import ComparedRuns, draw_linearity
from hoopd.plots.printed_margin import PrintedMargin, draw_bode_beside
from thesis.records import Bench, thesis_plant
from thesis.results import Drawn, Row

PRINTED_MARGIN = PrintedMargin(16.845711769073052, 1.570004618148971)
SMALL_RAD, LARGE_RAD, SWING_S = 0.1, 1.2, 6.0
FINE_S = 0.005


def poles(bench: Bench) -> Drawn:
    """Poles and zeros."""
    system = linear_model(thesis_plant())
    slow, fast = sorted((z for z in system.poles() if abs(z) > 1e-9 and z.imag >= 0), key=abs)
    rows = (
        Row("pole of the hoop", f"{slow.real:.10g}", "-0.4816611437"),
        Row("poles of the ball", f"{fast.real:.10g} ± {fast.imag:.10g}j", "-0.1676636944 ± 8.579375020j"),
        Row("zero", f"{min(zeros(minimal(system).system).real):.10g}", "-0.4727679267"),
    )
    caption = (
        "Poles and zeros from torque to ball angle. The hoop angle's pole at 0 is covered by a zero: nothing depends "
        "on it. Without slow pole and zero, which nearly cancel, a damped pendulum is left."
    )
    return Drawn(draw_poles(system, "Thesis's entries, torque to ball angle"), caption, rows)


def step(bench: Bench) -> Drawn:
    """Step response."""
    system = linear_model(thesis_plant())
    info = step_info(system)
    assert info is not None
    rows = (
        Row("final value", f"{info['SteadyStateValue']:.4g} rad/(N m)"),
        Row("overshoot", f"{info['Overshoot']:.3g} %"),
        Row("within 2 % after", f"{info['SettlingTime']:.4g} s"),
    )
    caption = "Step of 1 N m, linear model: a picture of the model, not of the device, whose ball would leave the hoop."
    return Drawn(draw_step(system, "Thesis's entries"), caption, rows)


def bode(bench: Bench) -> Drawn:
    """Bode with both phase margins."""
    system = linear_model(thesis_plant())
    found, wide = margins(system), bandwidth(system)
    rows = (
        Row(
            "phase margin",
            f"{degrees(found.phase_rad):.7f}° at {found.phase_rad_s:.7f} rad/s",
            f"{PRINTED_MARGIN.degrees:.7f}° at {PRINTED_MARGIN.w_rad_s:.7f} rad/s",
        ),
        Row("gain margin", f"{found.gain_up:g}", "Inf"),
        Row("|P| = 1/√2 at", f"{wide.absolute_rad_s:.4g} rad/s", "19.25 (drawn), 19.5 (text)"),
        Row("3 dB below |P(0)| at", f"{wide.below_dc_rad_s:.4g} rad/s"),
        Row("delay margin", f"{1e3 * found.delay_s:.3g} ms"),
    )
    caption = (
        "Bode plot of the plant. The printed margin is a point of a frequency grid a little beyond the crossover; "
        "the exact one is where the gain is 1. The bandwidth that the thesis marks is where |P| falls to 1/√2 "
        "absolutely."
    )
    return Drawn(draw_bode_beside(system, PRINTED_MARGIN, "Thesis's entries, torque to ball angle"), caption, rows)


def nyquist(bench: Bench) -> Drawn:
    """Nyquist."""
    system = linear_model(thesis_plant())
    found = margins(system)
    rows = (Row("nearest approach to -1 (1/Ms)", f"{1.0 / found.peak_sensitivity:.4g}"),)
    return Drawn(
        draw_nyquist(system, "Thesis's entries"),
        "Nyquist plot: the whole curve, whose size is the ball's resonance, and the part around -1 that the thesis "
        "shows.",
        rows,
    )


# ---------------------------------------------------------------------------------------------- linear, nonlinear


def linearity(bench: Bench) -> Drawn:
    """Released at a small and a large angle; both experiments."""
    plant = thesis_plant()
    released = [_released(plant, angle) for angle in (SMALL_RAD, LARGE_RAD)]
    played = [_played(bench, key) for key in ("first", "second")]
    rows = [
        Row(f"released at {angle:g} rad: largest difference", f"{_difference(one):.3g} rad")
        for angle, one in zip((SMALL_RAD, LARGE_RAD), released, strict=True)
    ]
    rows += [
        Row(f"{one.name}: fit linear, nonlinear", f"{_fit(one, one.linear):.1f} %, {_fit(one, one.nonlinear):.1f} %")
        for one in played
    ]
    caption = (
        "Ball angle of the nonlinear plant and of its linear model: released with the thesis's entries, and with the "
        "recorded torque from the same start with the entries re-estimated from that recording. sin ψ differs from ψ "
        "by 2 % at 0.35 rad; beyond, the linear swing is too fast."
    )
    return Drawn(draw_linearity(released, played, "Linear against nonlinear"), caption, tuple(rows))


def _difference(one: ComparedRuns) -> float:
    return float(np.abs(one.nonlinear - one.linear).max())


def _fit(one: ComparedRuns, simulated: np.ndarray) -> float:
    assert one.measured is not None and one.nodes is not None
    return nrmse_percent(one.measured, simulated[one.nodes])


def _released(plant: HoopPlant, angle: float) -> ComparedRuns:
    t = np.arange(0.0, SWING_S + FINE_S / 2, FINE_S)
    start, none = np.array([0.0, 0.0, angle, 0.0]), np.zeros(len(t) - 1)
    runs = [_run(moving, start, t, none)[:, 2] for moving in (plant, LinearPlant(plant))]
    return ComparedRuns(f"released at {angle:g} rad", t, *runs)


def _played(bench: Bench, key: str) -> ComparedRuns:
    """The fitted entries' free run and the linear model's from its start."""
    score = bench.scores(key)["re-estimated"][0]
    run: SimulatedStretch = score.runs[0]
    linear = _run(LinearPlant(HoopPlant("entries", bench.fitted(key).values)), run.start, run.part.t, run.part.u)[:, 2]
    trace = score.traces["psi"]
    t, measured = trace.t[trace.fresh], trace.measured[trace.fresh]
    return ComparedRuns(
        bench.origin(key), run.part.t, run.states[:, 2], linear, t, measured, np.searchsorted(run.part.t, t - 1e-9)
    )


def _run(moving: Moving, start: np.ndarray, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """States (n, 4) at t with the torques u (n-1,) held."""
    states = [start]
    for step_s, torque in zip(np.round(np.diff(t), 9), u, strict=True):
        states.append(moving.advance(states[-1], float(torque), float(step_s)))
    return np.array(states)
