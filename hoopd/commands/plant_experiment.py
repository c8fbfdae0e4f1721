"""`hoopd experiment --plant`: a test signal on the model of any plant, simulated and recorded.

Rules of this file: nothing is played on a device; what belongs to one is refused. Times that are not told grow with the
plant's usual sample time, so that a signal has as many samples as on the hoop.
"""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.inputs import read_values
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.output_files import check_results
from hoopd.files.reading import InputError
from hoopd.ident.signals import Signal as Table
from hoopd.plants.declaration import Plant
from hoopd.plants.free_run import FreeRun
from hoopd.plants.hoop.loop.experiment_plan import DURATION_S, DURATIONS_S, Plan, unit_table
from hoopd.plants.plant_model import nominal_model
from hoopd.recording import save
from hoopd.recording.recording import Recording, Signal, from_signals
from hoopd.recording.tables import MAX_ROWS

Array = NDArray[np.float64]

# The sample time for which a plan's usual times and frequencies are meant, s.
TICK_S = 0.02
TIMES, FREQUENCIES = ("hold_s", "kick_s", "rest_s"), ("low_hz", "high_hz")
SOFT = ("soft_start_s", "soft_end_s")  # of the device alone: nobody tells them here
# Of a signal's kind, the times that have to be a sample at least.
HELD = {"steps": ("hold_s",), "decay": ("kick_s", "rest_s")}
OF_A_DEVICE = (
    "config", "sets", "arm", "around", "camera", "centring_nm_per_rad_s", "no_ball", "torque_limit_nm",
    "speed_limit_rad_s", "angle_limit_rad", "soft_start_s", "soft_end_s", "model", "use_share",
)  # fmt: skip
KINDS = ("prbs", "chirp", "multisine", "steps", "decay")
# Of a limit, what a signal uses where nobody says an amplitude.
USUAL_SHARE = 0.1
FEWEST_ROWS = 2


def run(options: ExperimentOptions) -> dict[str, Any]:
    """Simulate the plant that is named, and write; what was recorded."""
    return simulate(options, nominal_model(str(options.plant)).plant)


def simulate(options: ExperimentOptions, plant: Plant) -> dict[str, Any]:
    """Simulate a plant and write. InputError: a signal that cannot be, a run that leaves all bounds."""
    _refuse_device(options)
    check_results(options.out, options.figure)
    out, told = _target(options, plant), _operating_point(plant, options.at)
    plan = _plan(options, plant)
    t, u = _signal(plan, plant, told, options.seed)
    try:
        found = FreeRun(plant).run([], [told.get(name, 0.0) for name in plant.states], t, _held(u, plant))
    except (ValueError, ArithmeticError) as error:
        raise InputError("--plant", plant.name, f"cannot be simulated: {error}") from None
    recording = _recording(plant, t, u, found.readings, out)
    save(recording, out)
    if options.figure is not None:
        from hoopd.plots import style
        from hoopd.plots.plant import draw_comparison

        style.save(draw_comparison(plant.name, recording, recording, {}), options.figure)
    return {
        "experiment": plan.kind,
        "plant": plant.name,
        "simulated": True,
        "amplitude": plan.amplitude_nm if plant.inputs else None,
        "seconds": float(t[-1]),
        "rows": len(t),
        "recording": str(out),
        "peaks": {name: float(np.max(np.abs(found.readings[:, i]))) for i, name in enumerate(plant.channels)},
    }


def _refuse_device(options: ExperimentOptions) -> None:
    """InputError for what only a device, or the hoop, has."""
    usual = {one.name: one.default for one in fields(ExperimentOptions)}
    for name in OF_A_DEVICE:
        if getattr(options, name) != usual[name]:
            raise InputError(option_name(ExperimentOptions, name), "", "is of the device: --plant simulates a model")
    if options.kind not in KINDS:
        raise InputError("KIND", "", f"unknown {options.kind!r}; known: {', '.join(KINDS)}")


def _target(options: ExperimentOptions, plant: Plant) -> Path:
    if options.out is not None:
        return options.out
    if options.record is not None and options.record.is_dir():
        return options.record / f"{plant.name}-{options.kind}-{options.seed}.mcap"
    raise InputError("--out", "", "is needed (or --record FOLDER that is there): where the recording goes")


def _operating_point(plant: Plant, text: str) -> dict[str, float]:
    names = (*(one.name for one in plant.inputs), *plant.states)
    return read_values("--at", text, names) if text else {}


def _plan(options: ExperimentOptions, plant: Plant) -> Plan:
    """The signal in the plant's own times and sizes."""
    by = plant.time_scale_s / TICK_S
    usual: dict[str, Any] = Plan._field_defaults
    asked = {name: getattr(options, name) for name in Plan._fields if hasattr(options, name) and name not in SOFT}
    grown = {name: usual[name] * (1.0 / by if name in FREQUENCIES else by) for name in (*TIMES, *FREQUENCIES, *SOFT)}
    plan = Plan(**grown | {name: value for name, value in asked.items() if value is not None})
    for name in HELD.get(options.kind, ()) if plant.inputs else ():
        if not (seconds := getattr(plan, name)) >= plant.time_scale_s:
            reason = f"{seconds:g} s are less than a sample of {plant.name}, {plant.time_scale_s:g} s"
            raise InputError(option_name(ExperimentOptions, name), "", reason)
    usual_s = DURATIONS_S.get(options.kind, DURATION_S) * by
    seconds = usual_s if options.duration_s is None else options.duration_s
    amplitude = options.amplitude_nm if options.amplitude_nm is not None else _usual_amplitude(plant)
    if plant.inputs and abs(amplitude) > plant.limit:
        reason = f"{amplitude:g} is beyond the limit of {plant.inputs[0].name}, {plant.limit:g} {plant.force_unit}"
        raise InputError("--amplitude", "", reason)
    return plan._replace(duration_s=seconds, amplitude_nm=amplitude)


def _usual_amplitude(plant: Plant) -> float:
    """The first input's usual size, else a share of its limit."""
    if not plant.inputs:
        return 0.0
    name = plant.inputs[0].name
    return plant.scales.get(name, USUAL_SHARE * plant.limit if np.isfinite(plant.limit) else 1.0)


def _signal(plan: Plan, plant: Plant, told: dict[str, float], seed: int) -> tuple[Array, Array]:
    """Rows t (n,) and inputs (n, inputs): the first one moves about where it is held, the others stay."""
    step = plant.time_scale_s
    if not FEWEST_ROWS <= plan.duration_s / step + 0.5 <= MAX_ROWS:
        wanted = f"{FEWEST_ROWS} to {MAX_ROWS} samples of {plant.name}, which is sampled every {step:g} s"
        raise InputError("--duration", "", f"{plan.duration_s:g} s are not {wanted}")
    if not plant.inputs:
        if plan.kind != "decay":
            raise InputError("KIND", "", f"{plant.name} has no input: decay from --at alone can be simulated")
        n = round(plan.duration_s / step)
        return np.asarray(np.arange(n) * step, float), np.zeros((n, 0))
    try:
        table: Table = unit_table(plan, seed, step)
    except ValueError as error:
        raise InputError(f"experiment {plan.kind}", "", str(error)) from None
    u = np.tile([told.get(one.name, 0.0) for one in plant.inputs], (len(table), 1))
    u[:, 0] += (plan.amplitude_nm or 0.0) * np.asarray(table)
    if np.isfinite(plant.limit) and np.abs(u[:, 0]).max() > plant.limit * (1.0 + 1e-9):
        raise InputError("--amplitude", "", f"with --at beyond the limit of {plant.inputs[0].name}, {plant.limit:g}")
    return np.asarray(np.arange(len(table)) * step, float), u


def _held(u: Array, plant: Plant) -> Array:
    """As a free run takes the inputs between its nodes."""
    return u[:-1, 0] if len(plant.inputs) == 1 else u[:-1]


def _recording(plant: Plant, t: Array, u: Array, readings: Array, out: Path) -> Recording:
    if not np.isfinite(readings).all():
        raise InputError("--plant", plant.name, "the run leaves every bound; try a smaller --amplitude, or --at")
    inputs = {one.name: Signal(u[:, i], t, one.unit) for i, one in enumerate(plant.inputs)}
    channels = {name: Signal(readings[:, i], t, one.unit) for i, (name, one) in enumerate(plant.channels.items())}
    return replace(from_signals(t, inputs, channels), source=out.name)
