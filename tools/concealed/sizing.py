"""Finds the size at which an effect is as visible as was drawn.

Rules of this file: a secant search on log nats against log size, all cases of a batch at once; each step simulates
anew, because the trajectory depends on the effect. An effect that reaches its physical cap keeps it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from concealed import nats
from concealed.batch import Column, columns_of
from concealed.effects import ALL
from concealed.recipes import TRAINING, Recipe
from concealed.simulate import simulate

# Of log nats, by step: good enough. The size that was tried best is kept with its own nats, whatever the target was.
CLOSE = (0.1, 0.1, 0.1, 0.2, 0.3, 0.4, 0.4, 0.4, 0.4)
SLOPES = (0.4, 10.0)  # of log nats by log size; 2 for a linear effect
JUMP = 12.0  # largest factor of one step
SEARCH_SUBSTEPS = 16  # a third of the time; the nats are those of the final steps within a few percent (tested)
BATCH = 400  # columns of one simulation: 0.4 MB each; a batch of 100 takes nearly as long


@dataclass
class Search:
    """The search for one effect's size in one case, alone."""

    recipe: Recipe
    name: str
    size: float
    tried: list[tuple[float, float]] = field(default_factory=list)  # (log size, log nats)
    nats: float = 0.0
    capped: bool = False
    done: bool = False

    def take(self, found: float) -> None:
        """Notes the nats of the present size and chooses the next one."""
        self.nats = found
        target = np.log(self.recipe.targets[self.name])
        self.tried.append((float(np.log(self.size)), float(np.log(max(found, 1e-6)))))
        if abs(self.tried[-1][1] - target) < CLOSE[len(self.tried) - 1]:
            self.done = True
            return
        cap = ALL[self.name].cap
        self.capped = bool(self.size >= cap * (1 - 1e-9) and self.tried[-1][1] < target)
        if self.capped:
            self.done = True
            return
        self.size = float(min(np.exp(self._next(float(target))), cap))

    def _next(self, target: float) -> float:
        """Next log size: a secant within the bracket, its middle where the secant leaves it."""
        here, value = self.tried[-1]
        # below a threshold there is nothing to extrapolate from
        guess = here + (np.log(2.0) if value < np.log(1e-3) else (target - value) / self._slope())
        guess = float(np.clip(guess, here - np.log(JUMP), here + np.log(JUMP)))
        low = max((s for s, n in self.tried if n < target), default=-np.inf)
        high = min((s for s, n in self.tried if n > target), default=np.inf)
        if low < high < np.inf and low > -np.inf and not low < guess < high:
            return (low + high) / 2
        return guess

    def _slope(self) -> float:
        if len(self.tried) < 2:
            return 2.0
        (s0, n0), (s1, n1) = self.tried[-2:]
        slope = (n1 - n0) / (s1 - s0) if abs(s1 - s0) > 1e-9 else 2.0
        return float(np.clip(slope, *SLOPES))


def find_sizes(recipes: Sequence[Recipe], say: Callable[[str], None] = lambda text: None) -> None:
    """Sets `sizes`, `nats` and `capped` of every case; sizes that are drawn are taken as they are."""
    searches = []
    for recipe in recipes:
        for name in recipe.wish.effects:
            if ALL[name].drawn:
                recipe.sizes[name], recipe.nats[name] = recipe.targets[name], float("nan")
                continue
            recipe.fixed[name] |= scale(recipe, name)
            searches.append(Search(recipe, name, ALL[name].first))
    for _ in CLOSE:
        waiting = [search for search in searches if not search.done]
        if not waiting:
            break
        for search, found in zip(waiting, visible([(s.recipe, {s.name: s.size}) for s in waiting]), strict=True):
            search.recipe.sizes[search.name] = search.size
            search.take(found)
        say(f"{sum(search.done for search in searches)} of {len(searches)} sizes found")
    for search in searches:
        best = min(search.tried, key=lambda tried: abs(tried[1] - np.log(search.recipe.targets[search.name])))
        search.recipe.sizes[search.name], search.recipe.nats[search.name] = (float(np.exp(x)) for x in best)
        search.recipe.capped[search.name] = search.capped


def scale(recipe: Recipe, name: str) -> dict[str, float]:
    """What the case's inputs decide for effects that are limits."""
    reached = [recipe.reached[index] for index in TRAINING]
    if name == "actuator.saturation":
        return {"peak": max(torque for _, _, torque in reached)}
    if name == "actuator.back_emf_limit":
        return {"fastest": max(speed for _, speed, _ in reached)}
    return {}


def visible(wanted: Sequence[tuple[Recipe, dict[str, float]]]) -> list[float]:
    """Nats over the training recordings of each case with the given effects and sizes."""
    columns = [Column(recipe, index, sizes) for recipe, sizes in wanted for index in TRAINING]
    grams: dict[int, np.ndarray] = {}
    for indices in batches(columns):
        for index, matrix in zip(indices, _grams([columns[i] for i in indices]), strict=True):
            grams[index] = matrix
    each = len(TRAINING)
    return [nats.gain(sum(grams[each * i + j] for j in range(each))) for i in range(len(wanted))]


def batches(columns: Sequence[Column]) -> Iterable[list[int]]:
    """Indices of columns that are simulated together: effects alike beside each other, sliding balls on their own."""
    order = sorted(range(len(columns)), key=lambda i: ("ball.slip" in columns[i].sizes, sorted(columns[i].sizes)))
    sliding = [i for i in order if "ball.slip" in columns[i].sizes]
    rolling = order[: len(order) - len(sliding)]
    for part in (rolling, sliding):
        yield from (part[first : first + BATCH] for first in range(0, len(part), BATCH))


def _grams(columns: Sequence[Column]) -> np.ndarray:
    batch = columns_of(columns)
    trace = simulate(batch, SEARCH_SUBSTEPS)
    recipes = [column.recipe for column in columns]
    sigmas = nats.sigmas_of(np.array([r.dtheta_noise for r in recipes]), np.array([r.psi_noise for r in recipes]))
    return nats.gram(
        trace, batch, [r.colour for r in recipes], sigmas, [nats.change(trace, batch, substeps=SEARCH_SUBSTEPS)]
    )
