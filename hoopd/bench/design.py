"""`hoopd design`: a law from a model and a specification, judged, written as the file that the daemon loads.

Rules of this file: from files to a file and a result, no mathematics; an unstable design writes nothing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from math import degrees, inf, isfinite
from pathlib import Path
from typing import Any

from hoopd.design.closedloop import Run
from hoopd.design.controllerfile import controller_data, controller_text
from hoopd.design.gangoffour import gang_of_four, noise_gain, nyquist_gain, peaks
from hoopd.design.laws import LAWS, Law, Pole, Spec, closed_loop_poles, design_arx, unstable
from hoopd.design.lqg import Weights
from hoopd.design.margins import Margins, margins
from hoopd.design.trial import Trial, at_rest, figures_of, trial
from hoopd.files import InputError, os_reason
from hoopd.modelfiles import ControllerFile, ModelFile, load_model, parse_controller, plant_of
from hoopd.physics.plant import Plant
from hoopd.plots import style
from hoopd.shipped import defaults_folder, or_shipped

KINDS = (*LAWS, "arx")
HEAD = "Made by `hoopd design {law}` from {model}."
# Below these a loop is fragile (Astrom and Murray, Feedback Systems, 10.3: 30 to 60 degrees, Ms 1.2 to 2).
LEAST_PHASE_DEG, LARGEST_MS, LEAST_GAIN_UP = 30.0, 2.0, 2.0
DELAY_POLE = 0.01  # |z|: below it a pole's response is over within a tick; a fourfold one is found at 1e-4, not at 0
WEIGHT_NAMES = {"dtheta": "dtheta_rad_s", "psi": "psi_rad", "dpsi": "dpsi_rad_s", "torque": "torque_nm"}


def run(
    law: str,
    model_path: Path,
    spec: Spec,
    *,
    recording: str | None = None,
    out: Path | None = None,
    figure: Path | None = None,
    disturbance_rad: float = 0.4,
) -> dict[str, Any]:
    """Design, judge, write and draw; the result as plain data. InputError: unusable input or an unstable loop."""
    check_targets(out, figure)
    model_path = or_shipped(model_path)
    model = load_model(model_path)
    plant = plant_of(model)
    designed = _designed(law, plant, spec, recording)
    poles = closed_loop_poles(designed.loop)
    _refuse_unstable(law, poles, spec)
    text = _text(law, designed, spec, model, model_path, out)
    file = parse_controller(text, out or law)
    found, runs = margins(designed.loop), trial(file, plant, disturbance_rad, spec.delay_s)
    if figure is not None:
        _draw(law, designed, runs, figure)
    _write(out, text)
    return _result(law, file, designed, spec, poles, found, runs) | {
        "model": model_path.name,
        "controller": "" if out is None else out.name,
        "warnings": [*designed.notes, *_poor(found, spec), *_restless(runs)],
    }


# Option of each number of the specification, and between which values it makes sense.
RANGES = {
    "omega_rad_s": ("--omega", 0.0, 1e3),
    "mt": ("--mt", 1.0, 100.0),
    "phase_deg": ("--phase", -180.0, 180.0),
    "zeta": ("--zeta", 0.0, 10.0),
    "filter_ratio": ("--filter", 0.0, 1e3),
    "ratio": ("--ratio", 0.0, 1e3),
    "sample_time_s": ("--sample-time", 0.0, 0.1),
}
LONGEST_DELAY_S = 0.2  # the filter's memory is 0.25 s


def spec_from(**values: Any) -> Spec:
    """A specification; InputError names the option whose number makes no sense."""
    for name, (option, low, high) in RANGES.items():
        value = values.get(name)
        if value is not None and not low < value <= high:
            raise InputError(option, "", f"must be above {low:g} and at most {high:g}, not {value:g}")
    if not 0.0 <= values.get("delay_s", 0.0) <= LONGEST_DELAY_S:
        raise InputError("--delay", "", f"must be from 0 to {LONGEST_DELAY_S:g} s, not {values['delay_s']:g}")
    if not isfinite(values.get("gain", 1.0)):
        raise InputError("--gain", "", "must be a finite number")
    if values.get("lead") is not None and not all(0.0 < value <= 1e3 for value in values["lead"]):
        raise InputError("--lead", "", "takes rad/s and N, both above 0 and at most 1000")
    return Spec(**values)


def weights_from(texts: list[str]) -> Weights:
    """Weights of "psi=0.2" and the like; InputError for a name or a number that is none."""
    changes: dict[str, float] = {}
    for text in (part for item in texts for part in item.split(",")):
        name, equals, value = text.strip().partition("=")
        number = _number(value)
        if not equals or name not in WEIGHT_NAMES or not 0.0 < number < inf:
            names = ", ".join(f"{one}=..." for one in WEIGHT_NAMES)
            raise InputError("--weights", "", f"expected {names} with numbers above 0, not {text!r}")
        changes[WEIGHT_NAMES[name]] = number
    return replace(Weights(), **changes)


def poles_from(text: str) -> tuple[complex, ...]:
    """Poles of "-6+6j,-6-6j,-1" in rad/s; InputError unless all are stable numbers."""
    try:
        poles = tuple(complex(part.strip().replace("i", "j")) for part in text.split(","))
    except ValueError:
        raise InputError("--poles", "", f"expected complex numbers such as -6+6j,-6-6j,-1, not {text!r}") from None
    if not all(pole.real < 0.0 and isfinite(abs(pole)) for pole in poles):
        raise InputError("--poles", "", "a stable loop has poles with negative real parts (rad/s, continuous time)")
    return poles


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


# ---------------------------------------------------------------------------------------------- design


def _designed(law: str, plant: Plant, spec: Spec, recording: str | None) -> Law:
    if law not in KINDS:
        raise InputError("LAW", "", f"unknown law {law!r}; known: {', '.join(KINDS)}")
    if (law == "arx") != (recording is not None):
        raise InputError("--recording", "", "goes with the law arx, and only with it")
    try:
        if recording is None:
            return LAWS[law](plant, spec)
        from hoopd.recording import load

        return design_arx(plant, spec, load(recording))
    except InputError:
        raise
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"design {law}", "", str(error)) from None


def _refuse_unstable(law: str, poles: list[Pole], spec: Spec) -> None:
    if worst := unstable(poles):
        z = f"{worst.z.real:.4g}" + (f" +- {abs(worst.z.imag):.4g}j" if abs(worst.z.imag) > 1e-9 else "")
        where = f"pole z = {z}, |z| = {abs(worst.z):.4g}, {worst.natural_rad_s:.3g} rad/s"
        reason = f"the closed loop is unstable with pictures {1e3 * spec.delay_s:.3g} ms old: {where}; nothing written"
        raise InputError(f"design {law}", "", reason)


def _poor(found: Margins, spec: Spec) -> list[str]:
    """What is wrong with margins that are smaller than a loop on a real device needs."""
    phase, ms = degrees(abs(found.phase_rad)), found.peak_sensitivity
    checks = (
        (phase < LEAST_PHASE_DEG, f"phase margin {phase:.1f} degrees, below {LEAST_PHASE_DEG:g}"),
        (ms > LARGEST_MS, f"largest |S| {ms:.2f}, above {LARGEST_MS:g}"),
        (found.gain_up < LEAST_GAIN_UP, f"gain margin {found.gain_up:.2f}, below {LEAST_GAIN_UP:g}"),
        (found.delay_s < spec.sample_time_s, f"bears {1e3 * found.delay_s:.0f} ms more delay, less than one tick"),
    )
    return [text for poor, text in checks if poor]


def _restless(runs: Trial) -> list[str]:
    names = ("disturbed", "released")
    return [f"ball not at rest at the end of the nonlinear run {n!r}" for n in names if not at_rest(getattr(runs, n))]


# ---------------------------------------------------------------------------------------------- files


def check_targets(out: Path | None, figure: Path | None) -> None:
    """InputError, before any work, when the results could not be written."""
    if figure is not None:
        style.check_path(figure)
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        raise InputError(out, "--out", "is a directory" if out.is_dir() else "no such folder")


def _text(law: str, designed: Law, spec: Spec, model: ModelFile, model_path: Path, out: Path | None) -> str:
    data = controller_data(
        out.stem if out is not None else law,
        designed.kind,
        designed.gains,
        model=_way_to(model_path, out),
        notes=f"designed as {law} for pictures {1e3 * spec.delay_s:g} ms old",
        sample_time_s=spec.sample_time_s,
        torque_nm=min(0.7, model.device.torque_limit_nm),
    )
    return controller_text(data, HEAD.format(law=law, model=model_path.name))


def _way_to(model_path: Path, out: Path | None) -> str:
    """The model as the controller file names it: a shipped one by its name, another from the file's own folder."""
    model = model_path.resolve()
    if model.is_relative_to(defaults_folder()):
        return model.relative_to(defaults_folder()).as_posix()
    return model.name if out is None else Path(os.path.relpath(model, out.resolve().parent)).as_posix()


def _write(out: Path | None, text: str) -> None:
    if out is None:
        return
    part = out.with_name(f".{out.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, out)  # noqa: PTH105
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(out, "--out", os_reason(error, "cannot be written")) from None


def _draw(law: str, designed: Law, runs: Trial, path: Path) -> None:
    from hoopd.plots.loops import draw_design

    gang = gang_of_four(designed.plant, designed.controller, designed.loop)
    style.save(draw_design(gang, runs, title=f"Closed loop: {law}"), path)


# ---------------------------------------------------------------------------------------------- result


def _result(
    law: str, file: ControllerFile, designed: Law, spec: Spec, poles: list[Pole], found: Margins, runs: Trial
) -> dict[str, Any]:
    p, c, loop, limit = designed.plant, designed.controller, designed.loop, file.limits.torque_nm
    return {
        "law": law,
        "kind": file.kind,
        "sample_time_s": spec.sample_time_s,
        "delay_s": spec.delay_s,
        "gains": file.gains,
        "design": _finite(designed.numbers),
        **_poles(poles),
        "margins": _finite(_margins(found)),
        "gang_of_four": _finite(
            peaks(gang_of_four(p, c, loop)) | {"nyquist_gain": nyquist_gain(c), "noise_gain": noise_gain(p, c, loop)}
        ),
        "closed_loop": {name: _figures(getattr(runs, name), limit) for name in ("disturbed", "released", "wrong_zero")},
    }


def _figures(made: Run, limit_nm: float) -> dict[str, Any]:
    values: dict[str, Any] = _finite(figures_of(made, limit_nm))
    return values


def _margins(found: Margins) -> dict[str, Any]:
    """Margins of a stable loop in degrees and ms, and where they are in rad/s."""
    return {
        "phase_deg": degrees(abs(found.phase_rad)),
        "phase_rad_s": found.phase_rad_s,
        "delay_ms": 1e3 * found.delay_s,
        "gain_up": found.gain_up,
        "gain_up_rad_s": found.gain_up_rad_s,
        "gain_down": found.gain_down,
        "peak_sensitivity": found.peak_sensitivity,
        "peak_complementary": found.peak_complementary,
    }


def _poles(poles: list[Pole]) -> dict[str, Any]:
    """The poles that shape the response; of those at 0, torques and pictures on their way, only the number."""
    slow = [pole for pole in poles if abs(pole.z) >= DELAY_POLE]
    rows = [
        {"re": pole.z.real, "im": pole.z.imag, "natural_rad_s": pole.natural_rad_s, "damping": pole.damping}
        for pole in slow
    ]
    return {"closed_loop_poles": _finite(rows), "delay_poles": len(poles) - len(slow)}


def _finite(values: Any) -> Any:
    """The same with None for what JSON cannot hold: no limit, not a number."""
    if isinstance(values, Mapping):
        return {key: _finite(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [_finite(value) for value in values]
    return values if not isinstance(values, float) or isfinite(values) else None
