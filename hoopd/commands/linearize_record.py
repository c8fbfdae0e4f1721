"""The record of `hoopd linearize`: what the analysis found, as plain data with notes.

Rules of this file: numbers come from `hoopd.design`, sentences are made here. JSON knows no infinity: a margin or a
bandwidth without a bound is null, and a note says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import control
import numpy as np

from hoopd.design import visibility
from hoopd.design.analysis import STATES, channel, minimal
from hoopd.design.effects_near import Near
from hoopd.design.margins import Margins, margins
from hoopd.design.speed import Bandwidth, bandwidth, sampling_advice, step_info
from hoopd.files.model import ModelFile
from hoopd.ident.transfer_functions import numerator_and_denominator, transfer_function, zeros
from hoopd.plants.hoop.loop.operating_points import OperatingPoint

# A pole and a zero this near to each other (beside the larger) leave next to nothing of the mode in the output.
NEAR = 0.05


def report(
    file: ModelFile,
    point: OperatingPoint,
    system: control.StateSpace,
    sampling: tuple[float | None, int],
    near: Near,
) -> dict[str, Any]:
    """The result record."""
    head: dict[str, Any] = {
        "model": file.name,
        "structure": file.structure,
        "operating_point": {**dict(zip(STATES, map(float, point.x), strict=True)), "torque": float(point.u)},
    }
    if file.effects:
        head["effects"] = {
            "included": list(near.included),
            "left_out": [{"name": name, "reason": reason} for name, reason in near.left_out],
            "delay_s": near.delay_s,
        }
    return record_of(head, system, sampling, [*_effects_in_words(near, sampled=sampling[0] is not None), *point.notes])


def record_of(
    head: dict[str, Any],
    system: control.StateSpace,
    sampling: tuple[float | None, int],
    notes: list[str],
    matrices: control.StateSpace | None = None,
    sizes: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The result record of one input; `matrices`: those that are printed, where the plant has several inputs; `sizes`:
    usual ones of states and inputs, in which is told what is steered and seen."""
    seen = visibility.in_usual_sizes(system, sizes or {})
    first, *others = [channel(system, name) for name in system.output_labels]
    notes, driven, own_units = [*notes, *visibility.in_words(seen)], bool(system.B.any()), sizes is not None
    effects = {"effects": head.pop("effects")} if "effects" in head else {}
    result = {
        **head,
        "sample_time_s": sampling[0],
        "delay_samples": sampling[1],
        "state_space": _matrices(system if matrices is None else matrices),
        "poles": _complex(system.poles()),
        **(_channel(first, notes, own_units=own_units) if driven else {"output": first.output_labels[0]}),
        "controllability": _rank(visibility.controllability(seen)),
        "observability": {"measured": list(system.output_labels), **_rank(visibility.observability(seen))},
        "detectability": _detectability(visibility.detectability(seen)),
    }
    result |= effects
    if others and driven:
        result["further_outputs"] = {one.output_labels[0]: _channel(one, notes, own_units=own_units) for one in others}
    return {**result, "notes": list(dict.fromkeys(notes))}


def _effects_in_words(near: Near, *, sampled: bool) -> list[str]:
    notes = [f"{name} is not part of the linear model: {reason}" for name, reason in near.left_out]
    if near.delay_s and not sampled:
        notes.append(
            f"the model's {1e3 * near.delay_s:.4g} ms of delay are no part of a continuous model: they turn the phase "
            f"by -{math.degrees(near.delay_s):.3g} deg a rad/s; with --sample-time they are in it exactly"
        )
    return [*notes, *near.notes]


def _channel(system: control.StateSpace, notes: list[str], *, own_units: bool = False) -> dict[str, Any]:
    """Torque to one output, as its own loop under unit feedback; what is unbounded is said in `notes`.

    `own_units`: of a plant whose units say nothing of how fast it is: its gain is no bandwidth.
    """
    less, loop, wide = minimal(system), margins(system), bandwidth(system)
    name = system.output_labels[0]
    found = _zeros(system)
    notes += _cancelled(less.unseen, name) + _nearly(less.system, name)
    notes += _unbounded(name, loop, wide, system)
    step = step_info(system)
    if step is None:
        notes.append(f"{name}: no step figures, it does not settle (a pole on or beyond the edge of stability)")
    elif step["SteadyStateValue"] == 0.0:
        notes.append(f"{name}: the step response ends at 0: nothing to measure rise, settling and overshoot by")
    return {
        "output": name,
        "zeros": found,
        "transfer_function": _fraction(system),
        "minimal": {
            "states": list(less.system.state_labels),
            "unseen": list(less.unseen),
            "unmoved": list(less.unmoved),
            "poles": _complex(less.system.poles()),
            "zeros": _zeros(less.system),
            **_fraction(less.system),
        },
        "margins": _margins(loop, system),
        "bandwidth": {field: _bounded(value) for field, value in wide._asdict().items()},
        "sampling": _sampling(wide.below_dc_rad_s if own_units else wide.absolute_rad_s, notes),
        "step": None if step is None else _step(step),
    }


def _margins(m: Margins, system: control.StateSpace) -> dict[str, Any]:
    """The usual names; null: no such crossing."""
    factor = _bounded(m.gain_up)
    record = {
        "closed_loop_stable": m.stable,
        "gain_margin": factor,
        "gain_margin_db": None if factor is None else 20.0 * math.log10(factor),
        "gain_margin_rad_s": _bounded(m.gain_up_rad_s),
        "gain_reduction_margin": _bounded(m.gain_down) or None,
        "gain_reduction_margin_rad_s": _bounded(m.gain_down_rad_s),
        "phase_margin_deg": _bounded(math.degrees(m.phase_rad)),
        "phase_margin_rad_s": _bounded(m.phase_rad_s),
        "delay_margin_s": _bounded(m.delay_s),
        "delay_margin_rad_s": _bounded(m.delay_rad_s),
        "peak_sensitivity": _bounded(m.peak_sensitivity),
        "peak_sensitivity_rad_s": _bounded(m.peak_sensitivity_rad_s),
        "peak_complementary": _bounded(m.peak_complementary),
        "peak_complementary_rad_s": _bounded(m.peak_complementary_rad_s),
    }
    if system.isdtime(strict=True):
        record["delay_margin_samples"] = _bounded(m.delay_s / system.dt)
    return record


def _unbounded(name: str, m: Margins, wide: Bandwidth, system: control.StateSpace) -> list[str]:
    """Why a number is null."""
    notes = []
    if not m.stable:
        notes.append(
            f"{name}: under unit feedback the loop is unstable: no delay margin, and the others are distances only"
        )
    if math.isinf(m.gain_up):
        notes.append(f"{name}: no gain margin (infinite): the phase does not reach -180 deg where |L| is below 1")
    if math.isinf(m.phase_rad):
        notes.append(f"{name}: no phase margin: |L| is nowhere 1")
    if math.isinf(wide.dc_gain):
        notes.append(f"{name}: no bandwidth below DC: it integrates, its DC gain is infinite")
    if math.isinf(wide.absolute_rad_s):
        notes.append(f"{name}: no absolute bandwidth: the response does not fall below 1/sqrt 2")
    return notes


def _cancelled(unseen: Sequence[str], output: str) -> list[str]:
    return [
        f"{visibility.named(state)} cancels: its pole is not seen from {output}; margins, bandwidth and step are those "
        "of the model without it (kept, its 0/0 at w = 0 would read as a gain margin)"
        for state in unseen
    ]


def _nearly(system: control.StateSpace, output: str) -> list[str]:
    """Poles next to a zero."""
    near = [(p, z) for p in system.poles() for z in zeros(system) if 0 < abs(p - z) < NEAR * max(abs(p), abs(z))]
    continuous = not system.isdtime(strict=True)  # near z = 1 everything slow is near everything else
    return [
        f"pole {p.real:.6g} and zero {z.real:.6g} nearly cancel in {output}: there is little of this mode in it"
        for p, z in near
        if continuous and p.imag == 0.0
    ]


def _sampling(bandwidth_rad_s: float, notes: list[str]) -> dict[str, float] | None:
    if not math.isfinite(bandwidth_rad_s) or bandwidth_rad_s == 0.0:
        return None
    advice = sampling_advice(bandwidth_rad_s)
    notes.append(
        f"sample at 10 to 30 times the bandwidth: {advice.slowest_hz:.3g} to {advice.fastest_hz:.3g} Hz for "
        f"{bandwidth_rad_s:.4g} rad/s; a closed loop that is faster needs more"
    )
    return {"slowest_hz": advice.slowest_hz, "fastest_hz": advice.fastest_hz}


def _step(info: dict[str, float]) -> dict[str, float | None]:
    names = {
        "rise_time_s": "RiseTime",
        "settling_time_s": "SettlingTime",
        "overshoot_percent": "Overshoot",
        "peak": "Peak",
        "peak_time_s": "PeakTime",
        "final_value": "SteadyStateValue",
    }
    return {name: _bounded(info[theirs]) for name, theirs in names.items()}


def _fraction(system: control.StateSpace) -> dict[str, Any]:
    """Coefficients, highest power first."""
    _, denominator = numerator_and_denominator(system)
    numerator = transfer_function(system).num[0][0]
    variable = "z" if system.isdtime(strict=True) else "s"
    return {
        "variable": variable,
        "numerator": list(map(float, numerator)),
        "denominator": list(map(float, denominator)),
    }


def _rank(rank: visibility.Rank) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in rank._asdict().items()}


def _detectability(found: visibility.Detectability) -> dict[str, Any]:
    return {"detectable": found.detectable, "hidden": _complex(found.hidden), "states": list(found.states)}


def _matrices(system: control.StateSpace) -> dict[str, Any]:
    names = {"states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels}
    matrices = {"A": system.A, "B": system.B, "C": system.C, "D": system.D}
    return {**{k: list(v) for k, v in names.items()}, **{k: np.asarray(v).tolist() for k, v in matrices.items()}}


def _zeros(system: control.StateSpace) -> list[dict[str, float]]:
    return _complex(zeros(system))


def _complex(values: Any) -> list[dict[str, float]]:
    """As {re, im}, slowest first."""
    ordered = sorted(map(complex, values), key=lambda v: (round(abs(v), 9), -v.imag))
    return [{"re": value.real + 0.0, "im": value.imag + 0.0} for value in ordered]


def _bounded(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
