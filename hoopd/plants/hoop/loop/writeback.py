"""What a daemon makes of the effects of a model file: its filter's model, delays and corrections, its feed-forward.

Rules of this file: it sorts effects by what they do and hands callables to the core; no equation and no number of an
effect stands here. What the daemon cannot use is named with the reason.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from hoopd.core.ballresponse import BallMotion
from hoopd.core.encoderchecks import HoopMotion
from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.feedforward import WANTED, Bound, FeedForward, FeedForwardPart
from hoopd.core.hybrid_estimator import HybridEkf
from hoopd.core.late import Delays, LateEstimator
from hoopd.plants.compensation import cancels, demand_of, in_order
from hoopd.plants.effects.base import Effect
from hoopd.plants.found_effects import REGION_NAMES, FoundEffects, Region
from hoopd.plants.hoop.loop.filter_modes import ball_modes
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.recordings.sensor_correction import correction, misleads

# A rate that comes through a filter of its own says what the angle says, later: it gets no weight.
NO_WEIGHT = 1e6
# Of the torque limit, what feed-forward may add: the law keeps the rest.
FEEDFORWARD_SHARE = 0.5
# A limit of the drive is no force: the law is told of it.
ACTUATOR = "actuator"
SATURATION = f"{ACTUATOR}.saturation"
# Where the feed-forward finds what a region bounds.
PLACES = {**{name: index for index, name in enumerate(REGION_NAMES)}, "u": WANTED}


PHASE_LOST = "its phase was another one in each recording: with a wrong one it would be added, not taken off"


class Unused(NamedTuple):
    """An effect of the model file that the daemon leaves out."""

    name: str
    reason: str


def delays_of(found: FoundEffects) -> Delays:
    """By how much torque, pictures and the encoder's readings are late; a lag counts as a delay of its time."""
    torque = camera = encoder = 0.0
    for effect in found.believed().effects():
        values = vars(effect.values(found.values))
        torque += sum(values[name] for name in (effect.delay, effect.lag) if name is not None)
        camera += values[effect.latency["psi"]] if "psi" in effect.latency else 0.0
        encoder += values[effect.latency["theta"]] if "theta" in effect.latency else 0.0
    return Delays(torque, camera, encoder)


def limits_of(found: FoundEffects) -> tuple[float, ...]:
    """Torques (N m) that the drive does not give more of, for the limit of a law."""
    return tuple(one.parameters["s"] for one in found.entries if one.name == SATURATION)


def unused(found: FoundEffects) -> tuple[Unused, ...]:
    """What neither filter nor feed-forward can do anything with."""
    lost = {one.name for one in found.entries if one.phase_lost}
    reasons = {effect.name: PHASE_LOST if effect.name in lost else _reason(effect) for effect in found.effects()}
    return tuple(Unused(name, reason) for name, reason in reasons.items() if reason)


def _reason(effect: Effect) -> str:
    if effect.plant is not None:
        return "the filter has no state for it"
    if effect.found_by == "quality":
        if effect.slot == ACTUATOR:
            return "it is a matter of single commands, which nobody knows beforehand"
        return "it is a matter of single pictures: the filter's gate refuses them"
    if (effect.force or effect.friction or effect.torque) and "t" in effect.depends_on:
        return "it follows the time of the recording in which it was found"
    return ""


def corrected(found: FoundEffects) -> tuple[str, ...]:
    """Those that the filter's readings are corrected for, or that take a reading its weight."""
    return tuple(e.name for e in found.believed().effects() if misleads(e) or e.sensor_lag)


def modes_of(found: FoundEffects) -> tuple[str, ...]:
    """Those by which a ball leaves the outer hoop: the filter follows it."""
    return tuple(e.name for e in found.effects() if e.found_by == "switch")


def filter_effects(found: FoundEffects) -> FoundEffects:
    """Those that the filter's model has; a lean of the frame is a camera's zero to it (they are never told apart)."""
    return found.believed().only(lambda one: one.acts_now and one.shift is None)


def cancelled(found: FoundEffects) -> tuple[str, ...]:
    """Those that feed-forward takes away."""
    sure = found.believed()
    return tuple(effect.name for effect in sure.effects() if cancels(sure, effect))


def filter_plant(found: FoundEffects) -> HoopPlant:
    """The filter's model."""
    inside = filter_effects(found)
    return HoopPlant.with_effects(inside) if inside else HoopPlant(found.structure, found.base)


def estimator_with(found: FoundEffects, settings: EkfSettings) -> DelayedEkf | LateEstimator:
    """The filter on the model with its effects."""
    found = found.believed()
    plant, delays, correct = filter_plant(found), delays_of(found), correction(found)
    if any(effect.sensor_lag for effect in found.effects()):
        settings = replace(settings, r_dtheta=NO_WEIGHT)
    settings = replace(settings, horizon_s=settings.horizon_s + max(delays.camera_s, delays.encoder_s))
    step = plant.filter_step
    inner = HybridEkf(step, ball_modes(found, filter_effects(found), step), settings)
    if correct is None and not any(delays):
        return inner
    return LateEstimator(inner, step, delays, correct)


def ball_motion(found: FoundEffects) -> BallMotion:
    """The ball's own equation at the bottom, driven by the hoop: the torque is put out of the two of the model.

    theta'' = J1 x + K1 sin psi + L1 u, psi'' = J2 x + K2 sin psi + L2 u, c = L2/L1:
    psi'' - c theta'' = (J2 - c J1) x + (K2 - c K1) sin psi
    """
    a, b = HoopPlant(found.structure, found.base).linearize()
    carried = float(b[3, 0] / b[1, 0])
    hoop, ball = a[1], a[3]
    delays = delays_of(found.believed())
    return BallMotion(
        carried,
        float(ball[1] - carried * hoop[1]),
        float(ball[3] - carried * hoop[3]),
        float(carried * hoop[2] - ball[2]),
        delays.camera_s - delays.encoder_s,
    )


def hoop_motion(found: FoundEffects, settings: EkfSettings) -> HoopMotion:
    """The hoop's own equation at the bottom, its ball carried along."""
    a, b = HoopPlant(found.structure, found.base).linearize()
    delays = delays_of(found.believed())
    return HoopMotion(
        gain=float(b[1, 0]),
        friction=float(a[1, 1]),
        gravity=float(a[1, 2]),
        late_s=delays.torque_s + delays.encoder_s,
        speed_sd=settings.r_dtheta**0.5,
        angle_sd=settings.r_theta**0.5,
        speed_lag_s=_speed_lag_s(found.believed()),
    )


def _speed_lag_s(found: FoundEffects) -> float:
    """Of the reported speed behind the hoop's."""
    lags = [one.key(one.sensor_lag["dtheta"]) for one in found.effects() if "dtheta" in one.sensor_lag]
    return sum(found.values[name] for name in lags)


def feedforward_of(
    found: FoundEffects, limit_nm: float, *, tick_s: float, wire_s: float, speed_noise_rad_s: float
) -> FeedForward:
    """Feed-forward of all effects that a torque can cancel, of each no more than it has at least; `limit_nm`: of the
    drive."""
    sure = found.believed().weakened()
    effects, regions = in_order(sure), {one.name: _region(one.valid) for one in found.entries}
    if not effects:
        return FeedForward()
    parts = [FeedForwardPart(effect.name, regions[effect.name]) for effect in effects]
    demand = demand_of(sure, tick_s, wire_s, speed_noise_rad_s)
    return FeedForward(parts, demand, FEEDFORWARD_SHARE * limit_nm)


def _region(valid: Region) -> tuple[Bound, ...]:
    return tuple(Bound(PLACES[name], low, high) for name, (low, high) in valid.items())
