"""From drawn cases to the columns of one simulation.

Rules of this file: a column is one recording of one case with the effects that it shall have; inputs are scaled on
the plain device until ball and hoop move as far as the case wants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from concealed import control, disturbances, drives
from concealed.effects import ALL
from concealed.hidden import Values
from concealed.plant import PIECES, Array, Body, body, coast, entries
from concealed.recipes import Recipe
from concealed.sensors import Noise
from concealed.simulate import WARM, Columns

ROUNDS = 4  # of scaling; the ball's angle is nearly linear in the torque
TRIES = 24  # inputs to choose from
COARSE = 8  # substeps while scaling


@dataclass(frozen=True)
class Column:
    """One recording: whose, which, and with which effects at which sizes."""

    recipe: Recipe
    recording: int
    sizes: dict[str, float]


def columns_of(wanted: Sequence[Column]) -> Columns:
    """One batch; all its recordings have one length."""
    (samples,) = {item.recipe.samples(item.recording) for item in wanted}
    rows = samples + WARM
    return Columns(
        device=devices([item.recipe for item in wanted]),
        effects=_effects(wanted),
        start=np.stack([_start(item) for item in wanted], axis=1),
        feed=np.stack([_feed(item, rows) for item in wanted], axis=1),
        push=np.stack([_push(item, rows) for item in wanted], axis=2),
        noise=_noise(wanted, rows),
        law=_law(wanted, rows),
    )


def devices(recipes: Sequence[Recipe]) -> Body:
    """The devices of these cases as one batch."""
    return body({key: np.array([recipe.base[key] for recipe in recipes]) for key in recipes[0].base})


def _effects(wanted: Sequence[Column]) -> dict[str, dict[str, Array]]:
    """Parameters by effect, neutral in the columns that lack it."""
    names = [name for name in ALL if any(name in item.sizes for item in wanted)]
    return {name: _parameters(name, wanted) for name in names}


def _parameters(name: str, wanted: Sequence[Column]) -> dict[str, Array]:
    values = [_values(name, item) for item in wanted]
    return {key: np.array([value[key] for value in values]) for key in ALL[name].neutral}


def _values(name: str, item: Column) -> Values:
    if name not in item.sizes:
        return dict(ALL[name].neutral)
    return item.recipe.parameters(name, item.recording, item.sizes[name])


def _start(item: Column) -> Array:
    rng = item.recipe.rng("start", item.recording)
    return rng.uniform((-30.0, -4.0, -0.1, -0.5), (30.0, 4.0, 0.1, 0.5))


def _feed(item: Column, rows: int) -> Array:
    """Torque that is not feedback, N m (rows,)."""
    recipe, index = item.recipe, item.recording
    unit = _shape(recipe, index, rows)
    return recipe.gains[index] * (0.4 if recipe.wish.closed else 1.0) * unit


def _shape(recipe: Recipe, index: int, rows: int) -> Array:
    """The strongest of some drawn inputs: a person, too, tries until the ball stays in the hoop at a fair torque."""
    if index not in recipe.shapes:
        rng, draw = recipe.rng("drive", index), drives.DRIVES[recipe.kinds[index]]
        own = {name: float(value) for name, value in entries(recipe_device(recipe)).items()}
        tried = [draw(rng, rows) for _ in range(TRIES)]
        limits = np.array((recipe.most_speed[index], recipe.most_psi[index]))
        found = [
            (limits / drives.reach(unit, tuple(own[k] for k in ("J11", "L1", "K2", "L2")))).min() for unit in tried
        ]
        recipe.shapes[index] = tried[int(np.argmax(found))]
    return recipe.shapes[index]


def recipe_device(recipe: Recipe) -> Body:
    """The device of one case, numbers instead of arrays."""
    return body({key: np.float64(value) for key, value in recipe.base.items()})


def _push(item: Column, rows: int) -> Array:
    return disturbances.path(item.recipe.colour, item.recipe.rng("push", item.recording), rows * PIECES)


def _law(wanted: Sequence[Column], rows: int) -> control.Law:
    gains = np.array([_gains(item.recipe) for item in wanted]).T
    return control.Law(*gains, reference=np.stack([_reference(item, rows) for item in wanted], axis=1))


def _gains(recipe: Recipe) -> tuple[float, float, float]:
    if not recipe.wish.closed:
        return 0.0, 0.0, 0.0
    rng = recipe.rng("law")
    return rng.uniform(0.03, 0.12), rng.uniform(0.006, 0.018), rng.uniform(0.0005, 0.002)


def _reference(item: Column, rows: int) -> Array:
    """A reference in rad: sines or steps, as strong as the input."""
    if not item.recipe.wish.closed:
        return np.zeros(rows)
    rng = item.recipe.rng("reference", item.recording)
    shape = drives.multisine if rng.uniform() < 0.5 else drives.multi_level
    return item.recipe.gains[item.recording] * 8.0 * shape(rng, rows)


def _noise(wanted: Sequence[Column], rows: int) -> Noise:
    parts = [_noise_of(item, rows) for item in wanted]
    return Noise(*(np.stack(part, axis=1) for part in zip(*parts, strict=True)))


def _noise_of(item: Column, rows: int) -> tuple[Array, ...]:
    recipe, rng = item.recipe, item.recipe.rng("noise", item.recording)
    dtheta, psi = _tails(recipe, rng, rows) * recipe.dtheta_noise, _tails(recipe, rng, rows) * recipe.psi_noise
    chance = rng.uniform(size=(3, rows))
    late = chance[1] < item.sizes.get("camera.late_frames", 0.0)
    false = chance[2] < item.sizes.get("camera.outliers", 0.0)
    if recipe.wish.burst and item.recording == recipe.rng("burst").integers(2):
        false |= _burst(recipe, rows)
    spot = rng.uniform(-2.5, 2.5)
    values = rng.uniform(-2.5, 2.5, size=rows) if rng.uniform() < 0.5 else spot + 0.02 * rng.standard_normal(rows)
    return dtheta, psi, chance[0] < recipe.missing, late, np.where(false, values, np.nan)


def _tails(recipe: Recipe, rng: np.random.Generator, rows: int) -> Array:
    """Unit noise; heavy tails: Student's t with 4 degrees of freedom, scaled to unit variance."""
    plain = rng.standard_normal(rows)
    return rng.standard_t(4, size=rows) / np.sqrt(2.0) if recipe.wish.heavy else plain


def _burst(recipe: Recipe, rows: int) -> Array:
    """Nearly all frames of less than a second are false."""
    rng = recipe.rng("burst", 1)
    first, length = int(rng.integers(100, rows - 100)), int(rng.integers(8, 45))
    index = np.arange(rows)
    return (index >= first) & (index < first + length) & (rng.uniform(size=rows) < 0.8)


def scale_inputs(recipes: Sequence[Recipe], recording: int) -> None:
    """Sets each case's input strength so that the plain device reaches the angle, speed or torque that it wants."""
    for _ in range(ROUNDS):
        batch = columns_of([Column(recipe, recording, {}) for recipe in recipes])
        psi, speed, torque = _reached(batch)
        for i, recipe in enumerate(recipes):
            room = (
                recipe.most_psi[recording] / psi[i],
                recipe.most_speed[recording] / speed[i],
                recipe.most_torque[recording] / torque[i],
            )
            factor = float(np.clip(min(room), 0.2, 5.0))
            recipe.gains[recording] *= factor
            recipe.reached[recording] = (factor * float(psi[i]), factor * float(speed[i]), factor * float(torque[i]))


def _reached(batch: Columns) -> tuple[Array, Array, Array]:
    """Largest |psi|, |theta'| and |u| (B,) of the plain devices, simulated coarsely."""
    x, most = batch.start, np.full((3, batch.start.shape[1]), 1e-6)
    follower = control.Follower(x[2])
    for k in range(len(batch.feed)):
        follower.update(x[2])
        u = control.torque(batch.law, batch.feed[k], k, follower, x[1])
        x = coast(batch.device, x, u, substeps=COARSE)
        most = np.maximum(most, np.abs((x[2], x[1], u)))
    return most[0], most[1], most[2]
