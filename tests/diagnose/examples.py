"""Made-up diagnoses with the curves behind them, one of each kind, from a small simulation of their own.

Rules of this file: nothing here comes from a recording; sizes and noise are those of the device; seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np

from hoopd.diagnose.record import (
    Ablation,
    Alternative,
    Base,
    Candidate,
    Curve,
    DataQuality,
    Diagnosis,
    EffectFinding,
    Evidence,
    Fit,
    Fits,
    FitTable,
    Location,
    NextExperiment,
    Placebo,
    Quantity,
    RecordingQuality,
    Unexplained,
    Visible,
)
from hoopd.diagnose.report.page import page
from hoopd.diagnose.report_curves import (
    Array,
    Binned,
    Comparison,
    Harmonics,
    LawCurve,
    MissingForce,
    Regressor,
    Shown,
    Strip,
    Trace,
)

STEP_S, FINE = 0.02, 10
FRICTION_NM = 5.1e-3
TRAIN, HELDOUT = "recordings/prbs_a.mcap", "recordings/prbs_b.mcap"
ENTRIES = {
    "J11": (-0.482, "1/s"), "J12": (0.0677, "1/s"), "K1": (-5.12, "1/s^2"), "L1": (586.4, "1/(kg m^2)"),
    "J21": (-0.0033, "1/s"), "J22": (-0.335, "1/s"), "K2": (-73.6, "1/s^2"), "L2": (210.1, "1/(kg m^2)"),
}  # fmt: skip


def run(u: Array, torque: Callable[[Array], float]) -> Array:
    """States (n, 4) theta, theta', psi, psi' of the printed entries with one more torque on the hoop [N m]."""
    x, states, h = np.zeros(4), np.empty((len(u), 4)), STEP_S / FINE
    for k, command in enumerate(u):
        states[k] = x
        for _ in range(FINE):
            push = command + torque(x)
            swing = np.sin(x[2])
            x = x + h * np.array([
                x[1], -0.482 * x[1] + 0.0677 * x[3] - 5.12 * swing + 586.4 * push,
                x[3], -0.0033 * x[1] - 0.335 * x[3] - 73.6 * swing + 210.1 * push,
            ])  # fmt: skip
    return states


def friction(x: Array) -> float:
    return float(-FRICTION_NM * np.tanh(x[1] / 0.05))


def detent(x: Array) -> float:
    """No row of the table: a narrow well twice a turn."""
    return float(-8e-3 * np.sin(2.0 * x[0]) * np.exp(2.0 * (np.cos(2.0 * x[0]) - 1.0)))


def command(seconds: float, seed: int) -> Array:
    """Two levels with random holds."""
    random, n = np.random.default_rng(seed), round(seconds / STEP_S)
    return np.repeat(random.choice([-0.03, 0.03], n // 8 + 1), 8)[:n]


def comparison(missing: Callable[[Array], float], recording: str = HELDOUT, seconds: float = 20.0) -> Comparison:
    """Hoop speed and ball angle in windows of 2 s, without and with the missing torque."""
    u, random = command(seconds, 3), np.random.default_rng(4)
    truth = run(u, missing)
    drift = run(u, lambda x: 0.0) - truth
    window = round(2.0 / STEP_S)
    without = truth + (drift - np.repeat(drift[::window], window, axis=0)[: len(u)]) * 0.4
    without[window - 1 :: window] = np.nan
    traces = []
    for name, unit, column, noise in (("theta_rate", "rad/s", 1, 0.15), ("psi", "rad", 2, 0.004)):
        measured = truth[:, column] + noise * random.standard_normal(len(u))
        after = np.where(np.isnan(without[:, column]), np.nan, truth[:, column])
        traces.append(Trace(name, unit, np.arange(len(u)) * STEP_S, measured, without[:, column], after))
    return Comparison(recording, traces, "windows of 2 s", [(12.0, 12.6, "a hand moved the ball")])


def force(missing: Callable[[Array], float], of: int, name: str, unit: str, law: str | None) -> MissingForce:
    """Smoothed missing torque on the hoop against the state it follows and against the command it does not."""
    u, random = command(30.0, 5), np.random.default_rng(6)
    states = run(u, missing)
    states[:, 0] %= 2.0 * np.pi
    value = np.array([missing(x) for x in states]) + 6e-4 * random.standard_normal(len(u))
    curve_x = np.linspace(states[:, of].min(), states[:, of].max(), 400)
    x = np.zeros((400, 4))
    x[:, of] = curve_x
    drawn = LawCurve(law, curve_x, np.array([missing(one) for one in x])) if law else None
    along = Regressor(name, unit, states[:, of], binned(states[:, of], value), drawn)
    other = Regressor("psi", "rad", states[:, 2], binned(states[:, 2], value))
    return MissingForce("hoop", "N m", np.arange(len(u)) * STEP_S, value, [along, other], TRAIN)


def binned(x: Array, y: Array, bins: int = 16) -> Binned:
    edges = np.quantile(x, np.linspace(0.0, 1.0, bins + 1))
    inside = [y[(x >= low) & (x <= high)] for low, high in pairwise(edges)]
    mean = np.array([part.mean() for part in inside])
    band = np.array([2.0 * part.std() / np.sqrt(len(part) / 8.0) for part in inside])
    return Binned(0.5 * (edges[1:] + edges[:-1]), mean, mean - band, mean + band)


def strips(strong: str = "hoop") -> list[Strip]:
    made, random = [], np.random.default_rng(7)
    for recording, seconds in ((TRAIN, 30.0), (HELDOUT, 20.0)):
        t = np.arange(round(seconds / STEP_S)) * STEP_S
        for slot in ("hoop", "ball"):
            noise = np.convolve(random.standard_normal(len(t)), np.ones(12) / np.sqrt(12.0), "same")
            push = 6.0 * np.sign(np.sin(1.7 * t + 0.8 * np.sin(0.6 * t))) * (slot == strong)
            ignored = [(12.0, 12.6, "a hand moved the ball")] if recording == HELDOUT else []
            made.append(Strip(recording, slot, t, noise + push, ignored))
    return made


def base(shift: float = 0.02) -> Base:
    """The entries, re-estimated near what is printed."""
    random = np.random.default_rng(8)
    values = {}
    for name, (nominal, unit) in ENTRIES.items():
        value = nominal * (1.0 + shift * random.standard_normal())
        half = abs(nominal) * 0.012
        values[name] = Quantity(value=value, unit=unit, ci95=(value - half, value + half), nominal=nominal)
    return Base(model="entries, thesis", parameters=values)


def fits(nominal: float, refit: float, effects: float | None, recording: str) -> Fits:
    def fit(less: float, floor: float) -> Fit:
        cap = min(floor, 99.5)
        with_effects = None if effects is None else min(effects + less / 4.0, cap)
        before = min(nominal + less, cap - 0.3), min(refit + less, cap - 0.1)
        return Fit(nominal=before[0], base_refit=before[1], with_effects=with_effects, noise_floor=floor)

    return {recording: {"dtheta": fit(0.0, 98.4), "theta_rate": fit(0.4, 98.9), "psi": fit(4.0, 99.2)}}


def table(nominal: float, refit: float, effects: float | None) -> FitTable:
    return FitTable(
        train=fits(nominal, refit + 0.6, effects, TRAIN),
        heldout=fits(nominal - 1.0, refit, effects, HELDOUT),
        free_run=fits(nominal - 9.0, refit - 7.0, None if effects is None else effects - 2.0, HELDOUT),
        window_s=2.0,
        how_heldout="Held out: prbs_b.mcap, another signal than the one fitted to.",
        channel_source={"dtheta": "the measured column", "theta_rate": "derivative of theta"},
    )


def quality() -> DataQuality:
    hand = (12.0, 12.6, "a hand moved the ball")
    return DataQuality(
        missing=62, late_frames=9, outliers=6, segments_ignored=[hand], samples=7500, frames=2500,
        recordings={
            TRAIN: RecordingQuality(missing=50, late_frames=7, outliers=0, samples=4500, frames=1500),
            HELDOUT: RecordingQuality(missing=12, late_frames=2, outliers=6, segments_ignored=[hand]),
        },
    )  # fmt: skip


POWER = {
    "actuator.torque_bias": Visible(parameter="b", unit="N m", smallest=3.1e-4, largest=0.05),
    "actuator.delay": Visible(parameter="d", unit="s", smallest=1.4e-3, largest=0.1),
    "hoop.coulomb_friction": Visible(parameter="Fc", unit="N m", smallest=4.2e-4, largest=0.05),
    "hoop.quadratic_drag": Visible(parameter="c", unit="N m s2", smallest=3.3e-6, largest=2e-4),
    "ball.quadratic_drag": Visible(parameter="c", unit="N m s2", smallest=None, largest=1e-4),
    "frame.tilt": Visible(parameter="d", unit="rad", smallest=2.3e-3, largest=0.2),
    "camera.latency": Visible(parameter="d", unit="s", smallest=1.9e-3, largest=0.1),
}


def candidates(*gains: tuple[str, float], threshold: float = 31.0) -> list[Candidate]:
    rest = [("actuator.deadzone", 18.0), ("frame.tilt", 6.1), ("camera.latency", 3.3), ("ball.coulomb_friction", 1.2)]
    known = {name for name, _ in gains}
    return [
        Candidate(name=name, log_likelihood_gain=gain, threshold=threshold)
        for name, gain in [*gains, *(one for one in rest if one[0] not in known)]
    ]


def finding(name: str, gain: float, value: Quantity, symbol: str, statement: str, **more: Any) -> EffectFinding:
    evidence = Evidence(log_likelihood_gain=gain, threshold=31.0, heldout_gain_percent=more.pop("heldout", 61.0))
    more.setdefault("not_excluded", [])
    return EffectFinding(
        name=name,
        slot=name.split(".", maxsplit=1)[0],
        parameters={symbol: value},
        evidence=evidence,
        statement=statement,
        **more,
    )


def _diagnosis(**parts: Any) -> Diagnosis:
    usual: dict[str, Any] = {
        "schema": "hoopd.diagnosis/1", "base": base(), "location": Location.nowhere({"hoop": 4.0, "ball": 1.1}),
        "effects": [], "unexplained": None, "next_experiment": None, "data_quality": quality(), "seed": 1,
        "power": POWER,
    }  # fmt: skip
    return Diagnosis(**{**usual, **parts})


@cache
def coulomb() -> tuple[Diagnosis, Shown]:
    """Dry friction of the hoop; Stribeck's law cannot be excluded."""
    size = Quantity(value=FRICTION_NM, unit="N m", ci95=(4.87e-3, 5.33e-3), nominal=0.0)
    named = finding(
        "hoop.coulomb_friction", 1342.0, size, "Fc",
        "Dry friction holds the hoop back with a constant torque of 5.1 mN m against its motion.",
        not_excluded=["hoop.stribeck_friction"], probability=0.93, formula="-Fc sign(theta')", explained=0.98,
        alternatives=[Alternative(name="hoop.stribeck_friction", behind_nats=1.7, reason="contains the named law")],
        ablation=Ablation(
            log_likelihood_loss=1319.0, heldout_with={"theta_rate": 97.7}, heldout_without={"theta_rate": 87.4}
        ),
        placebo=Placebo(log_likelihood_gain=0.8, held=True, shuffles=20),
    )  # fmt: skip
    diagnosis = _diagnosis(
        verdict="missing_physics", effects=[named], fit=table(79.2, 87.0, 97.6),
        location=Location(slot="hoop", channel="theta_rate", segments=None, depends_on=["dtheta"],
                          evidence={"hoop": 1360.0, "actuator": 412.0, "ball": 96.0, "encoder": 14.0, "camera": 2.1}),
        candidates=candidates(("hoop.coulomb_friction", 1342.0), ("hoop.stribeck_friction", 1340.3),
                              ("hoop.quadratic_drag", 420.0), ("actuator.torque_bias", 61.0)),
        next_experiment=NextExperiment(
            signal="slow ramp", tells_apart=("hoop.coulomb_friction", "hoop.stribeck_friction"), expected_nats=38.0,
            parameters={"amplitude": Quantity(value=0.02, unit="N m", ci95=None, nominal=None),
                        "duration": Quantity(value=30.0, unit="s", ci95=None, nominal=None)},
            reason="Speeds below 0.5 rad/s are visited for 2 % of the time so far; the two laws differ only there.",
            command="hoopd experiment --signal ramp --amplitude 0.02 --duration 30"),
    )  # fmt: skip
    law = force(friction, 1, "dtheta", "rad/s", "hoop.coulomb_friction")
    return diagnosis, Shown([comparison(friction)], [law], strips())


def parameters() -> tuple[Diagnosis, Shown]:
    """Nothing is missing, the numbers were off."""
    diagnosis = _diagnosis(verdict="parameters", fit=table(62.0, 97.4, None), base=base(0.3), candidates=candidates())
    return diagnosis, Shown()


def consistent() -> tuple[Diagnosis, Shown]:
    """The model explains the recordings."""
    return _diagnosis(verdict="consistent", fit=table(97.0, 97.6, None), candidates=candidates()), Shown()


@cache
def unknown() -> tuple[Diagnosis, Shown]:
    """A detent that no row of the table describes."""
    x = np.linspace(0.0, 2.0 * np.pi, 40)
    y = np.array([detent(np.array([one, 0.0, 0.0, 0.0])) for one in x])
    curve = Curve(regressor="theta", regressor_unit="rad", unit="N m", x=x.tolist(), y=y.tolist(),
                  low=(y - 5e-4).tolist(), high=(y + 5e-4).tolist())  # fmt: skip
    size = Quantity(value=8.0e-3, unit="N m", ci95=(7.5e-3, 8.5e-3), nominal=0.0)
    named = finding("unknown.hoop", 3220.0, size, "largest", "A torque on the hoop repeats twice a turn.", heldout=54.0)
    diagnosis = _diagnosis(
        verdict="unknown_physics", effects=[named], fit=table(58.0, 66.0, 93.0),
        location=Location(slot="hoop", channel="theta_rate", segments=None, depends_on=["theta"],
                          evidence={"hoop": 3300.0, "actuator": 1100.0, "ball": 210.0}),
        unexplained=Unexplained(fires=True, slot="hoop", curve=curve, share=0.83),
        candidates=candidates(("hoop.imbalance", 310.0), ("actuator.cogging", 780.0)),
    )  # fmt: skip
    order = np.arange(1.0, 9.0)
    spectrum = Harmonics("hoop", "theta", "N m", order, 3e-3 * (order % 2 == 0) / order + 1e-4, np.full(8, 4e-4))
    return diagnosis, Shown([comparison(detent)], [force(detent, 0, "theta", "rad", None)], strips(), [spectrum])


def exact_class() -> tuple[Diagnosis, Shown]:
    """A turned frame and a turned camera are the same thing to these sensors."""
    size = Quantity(value=0.031, unit="rad", ci95=(0.0297, 0.0323), nominal=0.0)
    named = finding(
        "frame.tilt", 905.0, size, "d", "The frame, or the camera's zero, is turned by 31 mrad (1.8 degrees).",
        not_excluded=["camera.angle_offset"],
        alternatives=[Alternative(name="camera.angle_offset", behind_nats=0.0, reason="the same by its equations")],
    )  # fmt: skip
    diagnosis = _diagnosis(
        verdict="missing_physics", effects=[named], fit=table(84.0, 88.0, 98.5),
        location=Location(slot="frame", channel="psi", segments=None, depends_on=["psi"],
                          evidence={"frame": 930.0, "camera": 928.0, "ball": 220.0}),
        candidates=candidates(("frame.tilt", 905.0), ("camera.angle_offset", 905.0), ("camera.center_offset", 700.0)),
    )  # fmt: skip
    return diagnosis, Shown()


def bad_data() -> tuple[Diagnosis, Shown]:
    """Late frames and outliers enough to be named, intervals set aside, a speed column that is not believed."""
    size = Quantity(value=0.118, unit="-", ci95=(0.104, 0.132), nominal=0.0)
    named = finding("camera.late_frames", 260.0, size, "share", "One camera frame in nine repeats the one before it.")
    set_aside = [(0.0, 0.8, "start-up"), (14.2, 17.1, "a hand moved the ball"), (33.0, 33.4, "burst of outliers")]
    notes = ["dtheta disagrees with the derivative of theta by 18 %: the derivative was used."]
    diagnosis = _diagnosis(
        verdict="missing_physics", effects=[named], fit=table(70.0, 90.0, 95.0),
        location=Location(slot="camera", channel="psi", segments=[(20.0, 31.5)], depends_on=[],
                          evidence={"camera": 270.0, "ball": 30.0}),
        data_quality=DataQuality(missing=457, late_frames=295, outliers=32, frames=2500, segments_ignored=set_aside,
                                 notes=notes),
        candidates=candidates(("camera.late_frames", 260.0)),
        notes=["The last third of every recording was held out."],
    )  # fmt: skip
    return diagnosis, Shown(strips=strips("ball"))


@cache
def long_names() -> tuple[Diagnosis, Shown]:
    """The first with names that no line holds, from files that somebody named badly."""
    diagnosis, shown = coulomb()
    name = f"data/{'very_long_' * 30}<b>&amp;[red]$x$.mcap"
    comparisons = [Comparison(name, one.traces, one.how, one.ignored) for one in shown.comparisons]
    strips = [Strip(name, one.slot, one.t_s, one.strength) for one in shown.strips if one.recording == HELDOUT]
    return renamed(diagnosis, HELDOUT, name), Shown(comparisons, (), strips)


def renamed(diagnosis: Diagnosis, old: str, new: str) -> Diagnosis:
    """The same with another recording's name."""
    text = msgspec.json.encode(msgspec.to_builtins(diagnosis)).decode()
    quoted = msgspec.json.encode(old).decode(), msgspec.json.encode(new).decode()
    return msgspec.json.decode(text.replace(*quoted), type=Diagnosis)


EXAMPLES: dict[str, Callable[[], tuple[Diagnosis, Shown]]] = {
    "coulomb": coulomb,
    "parameters": parameters,
    "consistent": consistent,
    "unknown": unknown,
    "exact_class": exact_class,
    "bad_data": bad_data,
    "long_names": long_names,
}


@cache
def made(name: str) -> bytes:
    """The page of an example: drawn once."""
    return page(*EXAMPLES[name]())
