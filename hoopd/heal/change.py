"""What a diagnosis of the newest minutes says of a loop that runs: another parameter, another physics, a broken sensor.

A sensor that is broken is never learned. Broken is what a row of the fault table names, a share of false or late
pictures, a length that seems to have changed, commands that the drive does not hear, and whatever a diagnosis finds at
a sensor's slot, new or changed, but a delay of up to 60 ms: a filter can be told how late a sample is, and it can not
be told the truth that a sensor no longer sees.

Rules of this file: a diagnosis and seconds of faults in, one judgement out; pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isclose
from types import MappingProxyType

from hoopd.core.faulttable import BY_NAME, Action
from hoopd.diagnose.record import Diagnosis, EffectFinding, Quantity
from hoopd.files.model import ModelFile, PlantModelFile

NOTHING, PARAMETERS, PHYSICS, UNKNOWN, SENSOR = ("nothing", "parameters", "physics", "unknown", "sensor")
LEARNABLE = (PARAMETERS, PHYSICS)
# Rows that are of the computer and not of a sensor.
OF_THE_COMPUTER = frozenset(
    {"overrun", "overrun_repeated", "overrun_persistent", "recorder_trouble", "telemetry_trouble", "model_drift"}
)
# A share of the minutes in which a row that control survives is active: more is no accident.
LEAST_SHARE = 0.02
# The filter's history bears delays up to this; later is a fault of its own.
MOST_DELAY_S = 0.06
SENSOR_SLOTS, LENGTH, LOST = ("camera", "encoder"), "m", "actuator.lost_commands"
DELAYS: Mapping[str, str] = MappingProxyType(
    {"camera.latency": "d", "encoder.latency": "d", "encoder.speed_lag": "T", "actuator.delay": "d"}
)
DOUBTED = ("weak", "untested", "not_confirmed")
# An effect that makes a simulation of held-out data better by less, in percent points, is a correction and no change;
# so is a parameter that changed by a smaller share.
LEAST_GAIN_PERCENT, LEAST_CHANGE = 0.5, 0.02
# No length of a device changes while it runs. One that seems to, by so much and beyond its interval, is how a camera
# sees it: a scale that is wrong, a lens that has moved.
MOST_LENGTH_CHANGE = 0.05


@dataclass(frozen=True)
class ChangeJudgement:
    """What the newest minutes say.

    `effects`: parameters of what is new and confirmed, by name; `probabilities`: of these; `parameters`: of the model's
    parameters outside of whose interval the old value lies, the change as a share of it, None where it was 0; `values`:
    what these are now. What the model that is loaded changes beside these, `written_changes` tells.
    """

    kind: str
    reason: str
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    probabilities: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float | None] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def may_be_learned(self) -> bool:
        """Whether a model of it makes sense."""
        return self.kind in LEARNABLE


def judged(diagnosis: Diagnosis, faults_s: Mapping[str, float], window_s: float) -> ChangeJudgement:
    """The judgement of one diagnosis; `faults_s`: for how long each row was active in its minutes."""
    if why := broken_sensor(diagnosis, faults_s, window_s):
        return ChangeJudgement(SENSOR, why)
    unknown = [one.name for one in diagnosis.effects if one.is_unknown]
    if unknown or diagnosis.verdict == "unknown_physics":
        return ChangeJudgement(UNKNOWN, f"{', '.join(unknown) or 'what acts'} has no law: a person has to look")
    large = [one for one in diagnosis.effects if _is_large(one)]
    sure = [one for one in large if one.status not in DOUBTED and one.in_model is not False]
    changed = _changed(diagnosis.base.parameters)
    values = _values({name: diagnosis.base.parameters[name] for name in changed})
    if sure:
        names = ", ".join(one.name for one in sure)
        probabilities = {one.name: one.probability or 0.0 for one in sure}
        return ChangeJudgement(PHYSICS, f"new: {names}", _sizes(sure), probabilities, changed, values)
    if large:
        told = ", ".join(f"{one.name} ({one.status})" for one in large)
        return ChangeJudgement(NOTHING, f"not sure enough: {told}")
    if changed:
        told = ", ".join(f"{name} {_words(share)}" for name, share in changed.items())
        return ChangeJudgement(PARAMETERS, f"changed: {told}", parameters=changed, values=values)
    return ChangeJudgement(NOTHING, "the model explains these minutes")


@dataclass(frozen=True)
class WrittenChanges:
    """What one model has otherwise than another, by parameter or SLOT.EFFECT.PARAMETER.

    `shares`: of the old value, where it is more than a correction, None where that was 0; `values`: what each is now,
    by however little.
    """

    shares: Mapping[str, float | None]
    values: Mapping[str, float]


def written_changes(before: ModelFile | PlantModelFile, after: ModelFile | PlantModelFile) -> WrittenChanges:
    """What acts otherwise once `after` takes the place of `before`: whatever the data exclude or not.

    Effects that `before` does not have are none of it; of one that is gone everything is 0 now.
    """
    old = numbers(before)
    new = dict.fromkeys(old, 0.0) | numbers(after)
    values = {name: new[name] for name in old if not isclose(new[name], old[name])}
    shares = {name: _share(old[name], value) for name, value in values.items()}
    return WrittenChanges({name: one for name, one in shares.items() if _size(one) >= LEAST_CHANGE}, values)


def numbers(model: ModelFile | PlantModelFile) -> dict[str, float]:
    """Every number of a model, those of its effects as SLOT.EFFECT.PARAMETER."""
    effects = {f"{one.name}.{key}": told.value for one in model.effects for key, told in one.parameters.items()}
    return {**model.values(), **effects}


def broken_sensor(diagnosis: Diagnosis, faults_s: Mapping[str, float], window_s: float) -> str:
    """Why a sensor is taken for broken; empty when none is."""
    for name, seconds in faults_s.items():
        row = BY_NAME.get(name)
        if row is None or name in OF_THE_COMPUTER:
            continue
        if row.action >= Action.PAUSE or seconds > LEAST_SHARE * window_s:
            return f"{name} was active for {seconds:.1f} s: {row.meaning}"
    for one in diagnosis.effects:
        if one.status != "not_confirmed" and _is_large(one) and (why := _broken(one.name, one.slot, one.parameters)):
            return why
    base = diagnosis.base.parameters
    for name, share in _changed(base).items():
        effect, _, parameter = name.rpartition(".")
        if effect and (why := _broken(effect, effect.partition(".")[0], {parameter: base[name]})):
            return why
        if base[name].unit == LENGTH and _size(share) > MOST_LENGTH_CHANGE:
            return (
                f"{name} seems to be {_words(share)}, and no length changes while it runs: the camera's scale is wrong"
            )
    return ""


def _is_large(one: EffectFinding) -> bool:
    """Whether it is more than a correction; of what a judge of samples counts nothing is simulated."""
    gain = one.evidence.heldout_gain_percent
    return gain is None or gain >= LEAST_GAIN_PERCENT


def _broken(name: str, slot: str, parameters: Mapping[str, Quantity]) -> str:
    """Why an effect, new or changed, is of a sensor that nobody may learn."""
    size = _value(parameters.get(DELAYS.get(name, "")))
    if name in DELAYS and size is not None:
        return f"{name} of {1e3 * size:.0f} ms is more than {1e3 * MOST_DELAY_S:.0f} ms" if size > MOST_DELAY_S else ""
    if name == LOST:
        return f"{name}: the line to the drive has to be mended"
    return f"{name}: a sensor has to be repaired or calibrated" if slot in SENSOR_SLOTS else ""


def _sizes(findings: list[EffectFinding]) -> dict[str, dict[str, float]]:
    return {one.name: _values(one.parameters) for one in findings}


def _values(parameters: Mapping[str, Quantity]) -> dict[str, float]:
    return {name: one.value for name, one in parameters.items() if one.value is not None}


def _changed(parameters: Mapping[str, Quantity]) -> dict[str, float | None]:
    """Of what is re-estimated, that which the data do not let stay: the change as a share of the old value."""
    found: dict[str, float | None] = {}
    for name, one in parameters.items():
        low, high = one.ci95 or (None, None)
        if one.value is None or one.nominal is None or low is None or high is None:
            continue
        share = _share(one.nominal, one.value)
        if not low <= one.nominal <= high and _size(share) >= LEAST_CHANGE:
            found[name] = share
    return found


def _share(before: float, now: float) -> float | None:
    """A change, of what it was before; None where that was 0: files keep no infinite number."""
    return (now - before) / abs(before) if before else None


def _size(share: float | None) -> float:
    return inf if share is None else abs(share)


def _words(share: float | None) -> str:
    return "from 0" if share is None else f"{share:+.0%}"


def _value(one: Quantity | None) -> float | None:
    return None if one is None else one.value
