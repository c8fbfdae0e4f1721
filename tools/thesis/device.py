"""Chapter 7, in the rig: the thesis's PID with and without a zero-angle error, and LQG.

Rules of this file: every run is the whole daemon in lock-step with direct pictures, seeded; judged by the true state.
"""

from __future__ import annotations

from math import radians

import numpy as np
from harness.rigrun import RigRun, run_rig

from hoopd.plots import style
from hoopd.plots.device import DeviceRun, draw_device
from thesis.records import Bench
from thesis.results import Drawn, Row

THESIS = ("device.model=models/thesis.yaml", "sim.model=models/thesis.yaml", "sim.delay_frames=1", "sim.psi_rad=0.1")
PID = "control.file=controllers/pid.yaml"
WRONG_ZERO = f"sim.angle_offset_rad={radians(1.0)}"
RUNS = {
    "PID, zero angle 1° wrong": (*THESIS, PID, WRONG_ZERO),
    "PID, zero angle right": (*THESIS, PID),
    "LQG, zero angle 1° wrong": (*THESIS, WRONG_ZERO),
}
COLOURS = (style.VERMILION, style.BLUE, style.GREEN)
WIDTHS_PT = (2.0, 0.9, 1.1)  # the two PIDs see the same
END_S = 3.0


def chapter_seven(bench: Bench) -> Drawn:
    """What was seen on the device."""
    runs = {}
    for index, (name, sets) in enumerate(RUNS.items()):
        bench.say(f"rig: {name}")
        runs[name] = run_rig(bench.scratch / f"device-{index}", *sets, duration_s=15.0)
    rows = [
        Row(
            f"{name}: hoop speed, ψ as seen at the end",
            f"{run.dtheta[end].mean():.3g} rad/s, {np.nanmean(run.psi_seen[end]):.2g} rad",
            "a certain value, about zero" if name.startswith("PID, zero angle 1°") else "",
        )
        for name, run in runs.items()
        for end in [run.after(float(run.t[-1]) - END_S)]
    ]
    caption = (
        "The thesis's device experiment in the rig (its entries, pictures one frame late, noise, released at 0.1 "
        "rad). With a zero angle that is 1° wrong the PID lets the hoop run to a steady speed while the angle it "
        "sees goes to zero, as the device did; with a right one the hoop comes to rest. LQG regulates the hoop's "
        "speed too and leaves the ball at the true bottom, where the camera reads 1°."
    )
    drawn = draw_device(
        {name: seen(run) for name, run in runs.items()},
        "The device experiment in the rig",
        colours=COLOURS,
        widths_pt=WIDTHS_PT,
        psi_label="ball angle as\nthe camera sees it (rad)",
    )
    return Drawn(drawn, caption, tuple(rows))


def seen(run: RigRun) -> DeviceRun:
    """A run with the angle as the camera saw it."""
    return DeviceRun(run.t, run.psi_seen, run.dtheta, run.u)
