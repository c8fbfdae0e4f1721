"""Chapter 5: the loops of PID and lead with the thesis's entries.

Rules of this file: controllers as printed, numbers from `hoopd.design`.
"""

from __future__ import annotations

from math import degrees, isfinite

import control
import numpy as np

from hoopd.design.gang_of_four import gang_of_four
from hoopd.design.laws import ball_angle
from hoopd.design.links import lead_link_at
from hoopd.design.loop_shaping import loopshaping_pid, peak_complementary
from hoopd.design.margins import margins
from hoopd.design.pid import pid
from hoopd.files.controller import load_controller
from hoopd.files.shipped import defaults_folder
from hoopd.ident.transfer_functions import transfer_function
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun, LinearPlant, Scenario, picture_timing
from hoopd.plants.hoop.loop.trial import run
from hoopd.plots.loops import draw_gang_of_four, draw_responses
from thesis.records import Bench, thesis_plant
from thesis.results import Drawn, Row

# Cf_pid, with the derivative's filter as the thesis changed it.
PID_PRINTED = control.tf(
    [0.0026901298082487772, 0.010720638072209578, 0.16425557639727875],
    [0.0010236067274141814, 0.03906614150888865, 0.0],
)
OMEGA_RAD_S, MT, PHI_DEG = 10.0, 1.25, 50.0
LEAD = lead_link_at(80.0, 5.0)
DISTURBANCE_RAD, SETTLED_RAD = 0.4, 0.02
NAMES = {"pid": "PID", "lead": "lead"}
FREQUENCIES = np.geomspace(0.1, 1e3, 2000)
KP_KI_KD_PRINTED = "0.164256, 4.20457, 0.0645572"
WANTED = {"PID as printed": "1.25 at 10 rad/s"}


def gang(bench: Bench) -> Drawn:
    """Gang of four of the printed laws, and of the PID that meets the specification."""
    plant = ball_angle(thesis_plant())
    gains = loopshaping_pid(plant, OMEGA_RAD_S, MT, PHI_DEG)
    laws = {"PID as printed": PID_PRINTED, "lead": LEAD, "PID that meets |T| ≤ 1.25": pid(gains)}
    gangs = {name: gang_of_four(plant, law, w=FREQUENCIES) for name, law in laws.items()}  # type: ignore[arg-type]
    rows = [Row("kp, ki, kd that meet |T| ≤ 1.25", ", ".join(f"{value:.7g}" for value in gains), KP_KI_KD_PRINTED)]
    for name, law in laws.items():
        peak, found = peak_complementary(plant, law), margins(control.ss(transfer_function(plant) * law))
        rows.append(Row(f"{name}: largest |T|", f"{peak.value:.5g} at {peak.w:.4g} rad/s", WANTED.get(name, "")))
        rows.append(Row("phase margin", f"{degrees(abs(found.phase_rad)):.3g}° at {found.phase_rad_s:.4g} rad/s"))
    caption = (
        "Gang of four in continuous time without delay. The printed PID does not meet the loop-shaping specification "
        "that is printed with it (|T| touching 1.25 at 10 rad/s); the one that does is shown without a filter on its "
        "derivative."
    )
    return Drawn(draw_gang_of_four(gangs, "Gang of four, thesis's entries"), caption, tuple(rows))


def impulse(bench: Bench) -> Drawn:
    """Output disturbance of one sample; sampled laws as the daemon runs them, no delay, no noise."""
    runs = {words: _disturbed(name) for name, words in NAMES.items()}
    rows = []
    for name, (nonlinear, linear) in runs.items():
        rows.append(Row(f"{name}: |ψ| below {SETTLED_RAD:g} rad after", _seconds(nonlinear), "about 1.5 s"))
        rows.append(Row(f"{name}: linear", _seconds(linear), "about 1.5 s"))
        rows.append(Row(f"{name}: largest torque", f"{np.abs(nonlinear.u).max():.3g} N m", "limit 0.7 N m"))
    caption = (
        "Closed loop with the shipped discrete PID and lead (Tustin, 20 ms) after one sample of 0.4 rad on the "
        "measured angle: true ball angle, nonlinear plant solid, linear model dashed (they coincide); no noise, no "
        "camera delay, torque limited to 0.7 N m. The PID leaves the hoop turning; its speed decays with the zero of "
        "the plant at -0.473."
    )
    return Drawn(draw_responses(runs, "Output disturbance of 0.4 rad for one sample"), caption, tuple(rows))


def _disturbed(name: str) -> tuple[ClosedLoopRun, ClosedLoopRun]:
    """Nonlinear and linear plant."""
    file, plant = load_controller(defaults_folder() / "controllers" / f"{name}.yaml"), thesis_plant()
    scenario = Scenario(
        duration_s=2.5,
        psi_noise_rad=0.0,
        dtheta_noise_rad_s=0.0,
        encoder_counts=0,
        disturbance_rad=DISTURBANCE_RAD,
        disturbance_at_s=0.0,
        **picture_timing(0.0, file.sample_time_s),  # type: ignore[arg-type]
    )
    nonlinear, linear = (run(file, plant, true, scenario, believe=True) for true in (plant, LinearPlant(plant)))
    return nonlinear, linear


def _seconds(made: ClosedLoopRun) -> str:
    time = made.settled_s(made.psi, SETTLED_RAD)
    return f"{time:.2f} s" if isfinite(time) else f"not within {made.t[-1]:.1f} s"
