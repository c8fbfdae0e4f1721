"""Options of `hoopd design`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, names_of, option
from hoopd.commands.options.shared import figure_option, json_option, model_option, plant_option


@dataclass(frozen=True, kw_only=True)
class DesignOptions:
    """Design a control law for a model of any plant and write its file: of the hoop the one that the daemon loads."""

    law: str = argument("lqg, lqr, placement, pid, pi, lead, lag, arx or identified.", metavar="LAW")
    model: Path | None = model_option(default=None)
    plant: str | None = plant_option()
    at: str = option(
        "--at",
        text="Another plant: inputs that are held (0), and states near which to look for the equilibrium; one that "
        "needs an input that was not named is refused.",
        metavar="NAME=VALUE,...",
        default="",
    )
    steer: tuple[str, ...] = option(
        "--steer",
        text="Another plant of several inputs: those that the law moves (all of them); the others stay as --at holds "
        "them, as a measured disturbance does.",
        metavar="NAMES",
        default="",
        read=names_of,
    )
    out: Path | None = option("--out", text="Write the controller file here.", metavar="CONTROLLER", python=False)
    recording: str | None = option("--recording", text="arx: the run that the model is fitted to.", metavar="REC")
    identified: Path | None = option(
        "--identified", text="identified: model file of `hoopd identify`.", metavar="FILE", python=False
    )
    omega_rad_s: float | None = option("--omega", "--bandwidth", text="rad/s: where the loop is shaped, the link acts.")
    mt: float | None = option("--mt", text="pid: largest |T| wanted, e.g. 1.25.")
    phase_deg: float | None = option("--phase", text="Degrees; pid: angle of the touching point; pi: phase margin.")
    zeta: float | None = option("--zeta", text="pi: damping, poles placed instead.")
    filter_ratio: float = option(
        "--filter", text="pid: N of the derivative's filter Td/N.", default=15.0, python="filter_ratio"
    )
    lead: tuple[float, float] | None = option("--lead", text="pid: lead link in series, rad/s and N.")
    ratio: float = option("--ratio", text="lead: N; lag: M.", default=5.0)
    gain: float = option("--gain", text="lead, lag, of the hoop: N m/rad.", default=1.0)
    poles: str = option(
        "--poles",
        text="placement: poles in rad/s, one a state; of the hoop three, for its speed and the ball.",
        default="-5+7j,-5-7j,-4",
    )
    weights: tuple[str, ...] = option(
        "--weights",
        text="lqg, arx: deviations that cost the same, e.g. psi=0.2,torque=0.05; also dtheta, dpsi; of another plant "
        "its states and inputs.",
        default=(),
    )
    delay_s: float = option(
        "--delay",
        text="Of the hoop: age of a picture in s when a tick uses it, the camera's delay and half a tick.",
        default=0.05,
    )
    sample_time_s: float | None = option(
        "--sample-time", text="Tick in s: 0.02 unless told, of another plant its usual sample time."
    )
    disturbance_rad: float = option(
        "--disturbance",
        text="Of the hoop: angle in rad of the trial's release and of its one wrong picture.",
        default=0.4,
        python=False,
    )
    figure: Path | None = figure_option()
    json_path: Path | None = json_option()
