"""What a case is made of: everything that is drawn for it, before anything is simulated.

Rules of this file: every number comes from the case's own seed, in streams that do not depend on each other, so that
a size can change and the noise stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from concealed import disturbances, drives
from concealed.effects import ALL
from concealed.hidden import Values
from concealed.plant import DEVICE, SAMPLE_S, Array

RECORDINGS = ("train_1", "train_2", "holdout")
TRAINING = (0, 1)
LENGTH_S = {"train_1": 30.0, "train_2": 30.0, "holdout": 20.0}
NATS = (25.0, 400.0)  # log-uniform


@dataclass(frozen=True)
class Wish:
    """What a case shall be; the draw fills in the rest."""

    family: str
    effects: tuple[str, ...] = ()
    closed: bool = False
    small: bool = False  # small ball angles
    large: bool = False  # large ones
    two_level: bool = False  # input that takes two values only
    heavy: bool = False  # noise with heavy tails
    calm: bool = False  # no disturbance
    burst: bool = False  # of false detections
    nats: tuple[float, float] | None = None  # log-uniform range of its sizes; the usual one without
    number: int = 0  # among all cases of the run: with the seed, all that the case's random numbers come from


@dataclass
class Recipe:
    """A case, drawn; `sizes` is filled by the search, `gains` by the scaling of the inputs."""

    identifier: str
    wish: Wish
    seed: tuple[int, ...]
    base: Values
    fixed: dict[str, Values]
    targets: dict[str, float]  # nats, or the size itself where it is drawn
    colour: disturbances.Colour
    dtheta_noise: float  # rad/s
    psi_noise: float  # rad
    missing: float  # share
    kinds: tuple[str, str, str]
    most_psi: tuple[float, float, float]  # rad
    most_speed: tuple[float, float, float]  # rad/s
    most_torque: tuple[float, float, float]  # N m
    gains: list[float] = field(default_factory=lambda: [0.1, 0.1, 0.1])  # N m of a unit input
    reached: dict[int, tuple[float, float, float]] = field(default_factory=dict)  # |psi|, |theta'|, |u| when scaled
    shapes: dict[int, Array] = field(default_factory=dict)  # inputs of unit peak, by recording
    sizes: dict[str, float] = field(default_factory=dict)
    nats: dict[str, float] = field(default_factory=dict)  # of each effect alone
    capped: dict[str, bool] = field(default_factory=dict)
    joint_nats: float = 0.0

    def rng(self, stream: str, recording: int = 0) -> np.random.Generator:
        """Random numbers of one purpose."""
        return np.random.default_rng([*self.seed, recording, *stream.encode()])

    def parameters(self, name: str, recording: int, size: float | None = None) -> Values:
        """Parameters of an effect in one recording; neutral where it is not there."""
        item, fixed = ALL[name], dict(self.fixed[name])
        if "recording" in fixed and fixed["recording"] != recording:
            return dict(item.neutral)
        if item.phased:
            fixed["phi"] = float(self.rng("phase", recording).uniform(-np.pi, np.pi))
        values = item.at(self.sizes[name] if size is None else size, fixed)
        return {key: float(values[key]) for key in item.neutral}

    def samples(self, recording: int) -> int:
        """Rows of a recording."""
        return round(LENGTH_S[RECORDINGS[recording]] / SAMPLE_S)


def numbered(wishes: Sequence[Wish]) -> list[Wish]:
    """The same wishes, each with its place among them."""
    return [replace(wish, number=number) for number, wish in enumerate(wishes)]


def draw(wish: Wish, seed: tuple[int, ...]) -> Recipe:
    """The case of a seed."""
    rng = np.random.default_rng([*seed, 0])
    base = _base(rng)
    fixed = {name: ALL[name].fixed(rng) for name in wish.effects}
    targets = {name: _target(name, wish, rng) for name in wish.effects}
    colour = disturbances.draw(rng, 0.0 if wish.calm else 0.8)
    identifier = "".join(f"{x:02x}" for x in rng.integers(256, size=6))
    recipe = Recipe(
        identifier,
        wish,
        seed,
        base,
        fixed,
        targets,
        colour,
        dtheta_noise=float(rng.uniform(0.05, 0.2)),
        psi_noise=float(rng.uniform(1e-3, 4e-3)),
        missing=float(rng.uniform(0.0, 0.03) * (rng.uniform() < 0.8)),
        kinds=_kinds(wish, rng),
        most_psi=_most(rng, (0.12, 0.3) if wish.small else (0.9, 1.3) if wish.large else (0.5, 1.25)),
        most_speed=_most(rng, (25.0, 60.0)),
        most_torque=_most(rng, (0.1, 0.3)),
    )
    for name in wish.effects:
        recipe.fixed[name] |= _placed(name, rng)
    return recipe


def _base(rng: np.random.Generator) -> Values:
    """Parameters 3 to 10 % off the device's; g is known."""
    off = {name: rng.choice((-1, 1)) * rng.uniform(0.03, 0.10) for name in DEVICE if name != "g"}
    return {name: float(value * (1 + off.get(name, 0.0))) for name, value in DEVICE.items()}


def _target(name: str, wish: Wish, rng: np.random.Generator) -> float:
    low, high = ALL[name].drawn or wish.nats or NATS
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _kinds(wish: Wish, rng: np.random.Generator) -> tuple[str, str, str]:
    """Three kinds of input, the last one another than the first two where there is a choice."""
    if wish.two_level:
        return "two_level", "prbs", "two_level"
    first, second = (str(x) for x in rng.choice(list(drives.DRIVES), size=2))
    if not any(kind in drives.GRADED for kind in (first, second)):
        second = str(rng.choice(list(drives.GRADED)))
    return first, second, str(rng.choice([kind for kind in drives.DRIVES if kind not in (first, second)]))


def _most(rng: np.random.Generator, between: tuple[float, float]) -> tuple[float, float, float]:
    return tuple(float(x) for x in rng.uniform(*between, size=3))  # type: ignore[return-value]


def _placed(name: str, rng: np.random.Generator) -> Mapping[str, float]:
    """What depends on the rest of the case."""
    if name == "decoy.hand":
        start, length = rng.uniform(2.0, 27.0), rng.uniform(0.2, 0.9)
        sign, where = float(rng.choice((-1, 1))), float(rng.integers(2))
        return {"t0": start, "t1": start + length, "sign": sign, "recording": where}
    if name == "decoy.drive_off":
        return {"recording": float(rng.integers(2))}
    return {}


def equivalent(recipe: Recipe, name: str, values: Values) -> Values:
    """The parameters as a model sees them that takes mass and geometry of the ball from the device file.

    `entries` puts a force Q on psi as -K2/(m g (Ro-Rb)) Q with the device's m, Ro, Rb: the data fix the acceleration,
    and so a force is seen scaled by the ratio of the weights; a friction against phi' also by that of Ro/Rb.
    """
    true, told = recipe.base, DEVICE
    weight = _weight(told) / _weight(true)
    rolling = weight * (true["Ro"] / true["Rb"]) / (told["Ro"] / told["Rb"])
    scale = {
        ("ball.coulomb_friction", "Fc"): rolling,
        # r N: the normal force is taken with the device's mass and radius too
        ("ball.rolling_resistance", "r"): rolling * true["mb"] / told["mb"],
        ("ball.quadratic_drag", "c"): weight,
    }
    return {key: value * scale.get((name, key), 1.0) for key, value in values.items()}


def _weight(p: Mapping[str, float]) -> float:
    return p["mb"] * p["g"] * (p["Ro"] - p["Rb"])
