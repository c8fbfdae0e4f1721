"""What every effect of a library would take from the error of a free run: its first-order change of the run.

One run over each whole stretch leaves an error; an effect changes the run by its sensitivity (a finite difference).
Free of what the parameters and the starts could do as well, these changes explain a share of the error by ordinary
regression, as the screen of the innovations does. What chance alone would gain with the best of the whole library is
told by the same error with random weights, block by block (`best_of_library`).

Rules of this file: a screen proposes; the run itself decides elsewhere. Errors are weighted as
in `free_run_refinement`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.best_of_library import BestOfAll, Choice, given_back
from hoopd.diagnose.proof.free_run_refinement import DIFFERENCE, Refined, sizes
from hoopd.diagnose.proof.simulation import Simulated, Simulator
from hoopd.diagnose.proof.window_comparison import channel_weights, errors_of
from hoopd.diagnose.search.screen import Column, Member, Score, best_scores, members_of, orthonormal
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.recording_parameters import values_of
from hoopd.plants.scales import state_scales

Array = NDArray[np.float64]

# Of an amplitude's usual size: small enough for a straight line over a long run.
SMALL = 0.1
# Directions of the free parameters that the run knows by less than this of the best stay where they are.
KNOWN = 1e-4
# Blocks of which chance makes its errors: so many times the error's own memory, at least so many of them.
BLOCK_MEMORIES, FEWEST_BLOCKS = 2.0, 8


class Sensitivity:
    """The whole library about one free run of a hypothesis."""

    def __init__(self, found: Refined, effects: Sequence[Effect], library: Sequence[Effect], seed: int) -> None:
        self.found, self.effects, self.seed = found, tuple(effects), seed
        self.weights = channel_weights([run.windows.stretch for run in found.runs])
        self._by_free = self._tangent()
        self._basis = orthonormal(self._by_free)
        self.error = np.concatenate([e.ravel() for e in self._errors()])
        self.residual = self._projected(self.error[:, None])[:, 0]
        recordings = tuple(dict.fromkeys(run.windows.stretch.recording for run in found.runs))
        self.members = [m for e in library for m in members_of(e, recordings)]
        self._raw = self._changes()
        self.vectors = self._projected(self._raw)
        self._ends = np.cumsum([len(m.columns) for m in self.members])

    def scores(self) -> list[Score]:
        """Best member of every effect, largest gain first; gains in units of half the weighted squared error."""
        return sorted(best_scores(self.members, self.vectors, self.residual), key=lambda one: -one.gain)

    def beside(self, score: Score) -> dict[str, float]:
        """By how much the free parameters move when the effect comes in as the screen says."""
        k = next(i for i, member in enumerate(self.members) if member is score.member)
        columns = slice(self._ends[k] - len(score.member.columns), self._ends[k])
        weights = np.linalg.lstsq(self.vectors[:, columns], score.vector, rcond=None)[0]
        moves = np.linalg.lstsq(self._by_free, -self._raw[:, columns] @ weights, rcond=KNOWN)[0]
        free = self.found.free
        scale = sizes(self.found.values, free, self.effects, self._plants())
        return {name: float(move * size) for name, move, size in zip(free, moves, scale, strict=False)}

    def chance(self, effect: str, gain: float) -> float:
        """How often the best of the whole library gains of an error without it what is as rare as this."""
        return self._by_chance.chance(effect, gain)

    @cached_property
    def _by_chance(self) -> BestOfAll:
        signed = [np.array([column.signed for column in member.columns]) for member in self.members]
        names = [member.effect.name for member in self.members]
        choices = [Choice(*one) for one in zip(names, self._parts(), signed, strict=True)]
        blocks = self._blocks()
        return BestOfAll(choices, given_back(self.residual, self._basis, blocks), blocks, self.seed)

    def _parts(self) -> list[Array]:
        return np.split(self.vectors, self._ends[:-1], axis=1) if len(self._ends) else []

    def _projected(self, x: Array) -> Array:
        return np.asarray(x - self._basis @ (self._basis.T @ x))

    def _plants(self) -> list[Plant]:
        return [run.windows.stretch.plant for run in self.found.runs]

    def _errors(self) -> list[Array]:
        """(n, nc, 1) of every run."""
        return [errors_of(run.windows, w, run.y) for run, w in zip(self.found.runs, self.weights, strict=True)]

    # ------------------------------------------------------------------------------------------ changes

    def _tangent(self) -> Array:
        """(rows, free parameters and starts) what they change, in units of their size."""
        free = self.found.free
        scale = dict(zip(free, sizes(self.found.values, free, self.effects, self._plants()), strict=True))
        parts = [self._tangent_of(i, scale) for i in range(len(self.found.runs))]
        shared = np.concatenate([a for a, _ in parts])
        starts = np.zeros((len(shared), sum(b.shape[1] for _, b in parts)))
        row = column = 0
        for a, b in parts:
            starts[row : row + len(b), column : column + b.shape[1]] = b
            row, column = row + len(a), column + b.shape[1]
        return np.concatenate([shared, starts], axis=1)

    def _tangent_of(self, i: int, scale: Mapping[str, float]) -> tuple[Array, Array]:
        run, values = self.found.runs[i], self.found.values
        simulator = Simulator(run.windows, self.effects)
        moved = [{**values, name: values[name] + DIFFERENCE * size} for name, size in scale.items()]
        nx, usual = len(run.start), state_scales(simulator.composite.plant)
        columns = [local_values(simulator, one) for one in [*moved, *([values] * nx)]]
        start = np.repeat(run.start[:, :, None], len(columns), axis=2)
        for k in range(nx):
            start[k, :, len(moved) + k] += DIFFERENCE * usual[k]
        change = self._change(i, simulator, columns, start) / DIFFERENCE
        return change[:, : len(moved)], change[:, len(moved) :]

    def _changes(self) -> Array:
        """(rows, columns) of all members."""
        by_effect: dict[str, list[Member]] = {}
        for member in self.members:
            by_effect.setdefault(member.effect.name, []).append(member)
        parts = [
            np.concatenate([self._changes_of(i, group) for group in by_effect.values()], axis=1)
            for i in range(len(self.found.runs))
        ]
        return np.concatenate(parts)

    def _changes_of(self, i: int, group: Sequence[Member]) -> Array:
        """Of the members of one effect in one stretch."""
        run, effect = self.found.runs[i], group[0].effect
        columns = [column for member in group for column in member.columns]
        rows = run.y.size
        if effect.slot not in run.windows.stretch.plant.slots:
            return np.zeros((rows, len(columns)))
        simulator = Simulator(run.windows, [*self.effects, effect])
        here = local_values(simulator, self.found.values)
        tried = [_values(effect, column) for column in columns]
        start = np.zeros((simulator.composite.nx, run.start.shape[1], len(columns)))
        start[: len(run.start)] = run.start[:, :, None]
        change = self._change(i, simulator, [{**here, **values} for values, _ in tried], start)
        mine = [column.recording in (None, run.windows.stretch.recording) for column in columns]
        scale: Array = np.array([share for _, share in tried]) * np.array(mine)
        return change * scale

    def _change(self, i: int, simulator: Simulator, columns: list[dict[str, float]], start: Array) -> Array:
        """(rows, k) what is added to the run, weighted."""
        run, weight = self.found.runs[i], self.weights[i]
        y = simulator.readings(columns, simulator.run(columns, start))
        error = errors_of(run.windows, weight, run.y)
        moved = [(error - errors_of(run.windows, weight, y[..., k])).ravel() for k in range(len(columns))]
        return np.stack(moved, axis=1)

    # ------------------------------------------------------------------------------------------ chance

    def _blocks(self) -> NDArray[np.int64]:
        """(rows,) number of the block that a row's instant belongs to."""
        seconds = self._block_s()
        out, first = [], 0
        for run in self.found.runs:
            t = run.windows.stretch.t[: run.y.shape[0]]
            count = max(round(float(t[-1] - t[0]) / seconds), 1)
            index = np.minimum(((t - t[0]) / (t[-1] - t[0]) * count).astype(np.int64), count - 1)
            out.append(np.repeat(first + index, run.y.shape[1] * run.y.shape[2]))
            first += count
        return np.concatenate(out)

    def _block_s(self) -> float:
        total = sum(float(run.windows.stretch.t[-1] - run.windows.stretch.t[0]) for run in self.found.runs)
        return min(BLOCK_MEMORIES * self._memory_s(), total / FEWEST_BLOCKS)

    def _memory_s(self) -> float:
        """Longest memory of a channel's error."""
        return max([0.1, *(seconds for _, seconds in memories(self.found.runs))])


def memories(runs: Sequence[Simulated]) -> list[tuple[float, float]]:
    """(duration, memory of the error) in seconds of every counted channel of every run."""
    found = []
    for run, weight in zip(runs, channel_weights([run.windows.stretch for run in runs]), strict=True):
        t, e = run.windows.stretch.t, errors_of(run.windows, weight, run.y)
        step = float(np.median(np.diff(t)))
        found += [(float(t[-1] - t[0]), step * memory(e[:, c, 0])) for c in range(e.shape[1]) if np.any(e[:, c, 0])]
    return found


def independent(runs: Sequence[Simulated]) -> float:
    """Samples of the error that do not repeat one another: durations over memories."""
    return max(sum(seconds / memory_s for seconds, memory_s in memories(runs)), 1.0)


def _values(effect: Effect, column: Column) -> tuple[dict[str, float], float]:
    """What is simulated of a column, and by what the change is multiplied."""
    values = dict(column.values)
    amplitudes = [p for p in effect.parameters if p.role == "amplitude" and p.name in values]
    for p in amplitudes:
        values[p.name] = p.neutral + SMALL * (values[p.name] - p.neutral)
    return {effect.key(name): value for name, value in values.items()}, 1.0 / SMALL if amplitudes else 1.0


def local_values(simulator: Simulator, values: Mapping[str, float]) -> dict[str, float]:
    """Values in one stretch, those of the composite where none are given."""
    return {**simulator.composite.values, **values_of(simulator.windows.stretch.recording, values)}


def memory(e: Array) -> float:
    """1 + 2 sum of the autocorrelations up to their first zero, in samples; e (n,)."""
    e = e - e.mean()
    power = np.abs(np.fft.rfft(e, 2 * len(e))) ** 2
    rho = np.fft.irfft(power)[: len(e)]
    rho = rho / max(rho[0], 1e-300)
    zero = int(np.argmax(rho <= 0.0)) if np.any(rho <= 0.0) else len(rho)
    return float(1.0 + 2.0 * rho[1:zero].sum())


def states_of(runs: Sequence[Simulated]) -> list[Array]:
    """(n, nz) of every whole run: references for the next one."""
    return [run.states[:, :, 0] for run in runs]
