"""Makes cases: recordings in a folder of random names, and sealed answers somewhere else.

Rules of this file: a case's folder holds what a laboratory would have recorded and nothing more; the answer knows the
rest. Same seed, same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from concealed.batch import Column, columns_of, devices, scale_inputs
from concealed.effects import ALL
from concealed.outside import mechanisms
from concealed.plant import SAMPLE_S, entries
from concealed.recipes import LENGTH_S, RECORDINGS, TRAINING, Recipe, Wish, draw, equivalent
from concealed.simulate import Trace, simulate
from concealed.sizing import batches, find_sizes, visible
from concealed.whole import put

SCHEMA = "hoopd.concealed/1"
OVER_RAD = 1.5  # a ball beyond it would fall, which the plain device does not know
SHRINK = 0.75  # of the input of a case that went too far
ATTEMPTS = 4
OUTSIDE = "outside"  # family of mechanisms that no library has
LEFT_OUT = "left_out"  # family of effects that the library of who is asked lacks
STATES = ("theta", "dtheta", "psi", "dpsi")
Say = Callable[[str], None]
Made = dict[tuple[str, int], Trace]  # by identifier and recording


@dataclass(frozen=True)
class Case:
    """One case: the recordings by file name, and the sealed answer."""

    identifier: str
    files: dict[str, bytes]
    answer: dict[str, Any]
    signals: dict[str, bytes] = field(default_factory=dict)  # of what is outside the library, sealed too


def make(wishes: Sequence[Wish], seed: int, say: Say = lambda text: None) -> list[Case]:
    """Draws, sizes and simulates the cases of a seed; ValueError when two have one number."""
    if len({wish.number for wish in wishes}) < len(wishes):
        raise ValueError("two cases of one number have the same random numbers")
    recipes = [draw(wish, (seed, wish.number)) for wish in wishes]
    made = prepare(recipes, say)
    return [_case(recipe, [made[recipe.identifier, index] for index in range(len(RECORDINGS))]) for recipe in recipes]


def _case(recipe: Recipe, own: Sequence[Trace]) -> Case:
    files = {f"{name}.csv": csv_bytes(trace) for name, trace in zip(RECORDINGS, own, strict=True)}
    if recipe.wish.family != OUTSIDE:
        return Case(recipe.identifier, files, answer(recipe, own))
    signals = {f"{name}.csv": signal_bytes(trace, recipe.sizes) for name, trace in zip(RECORDINGS, own, strict=True)}
    return Case(recipe.identifier, files, answer(recipe, own), signals)


def write(made: Sequence[Case], cases: Path, answers: Path) -> None:
    """A folder for each case's recordings under `cases`; its answer, elsewhere, comes last, after what it refers to."""
    for case in made:
        for name, data in case.files.items():
            put(cases / case.identifier / name, data)
        for name, data in case.signals.items():
            put(answers / "signals" / case.identifier / name, data)
        text = json.dumps(case.answer, indent=1, sort_keys=True, allow_nan=False)
        put(answers / f"{case.identifier}.json", (text + "\n").encode())


def prepare(recipes: Sequence[Recipe], say: Say = lambda text: None) -> Made:
    """Input strengths and sizes of all cases, and their recordings; a ball that went too far gets a weaker input."""
    for recording in range(len(RECORDINGS)):
        scale_inputs(recipes, recording)
    say("inputs scaled")
    waiting, made = list(recipes), {}
    for _ in range(ATTEMPTS):
        find_sizes(waiting, say)
        made |= traces(waiting)
        say(f"{len(waiting)} cases simulated")
        waiting = [recipe for recipe in waiting if _weakened(recipe, made)]
        if not waiting:
            break
    _join(recipes)
    return made


def _weakened(recipe: Recipe, made: Made) -> bool:
    """Weakens the inputs with which the ball went too far; False when there were none."""
    far = [i for i in range(len(RECORDINGS)) if np.abs(made[recipe.identifier, i].states[:, 2]).max() > OVER_RAD]
    for index in far:
        recipe.gains[index] *= SHRINK
    return bool(far)


def _join(recipes: Sequence[Recipe]) -> None:
    """Nats of all effects of a case together."""
    several = [recipe for recipe in recipes if len(recipe.nats) > 1]
    for recipe in recipes:
        recipe.joint_nats = sum(value for value in recipe.nats.values() if value == value)  # noqa: PLR0124
    for recipe, joint in zip(several, visible([(recipe, recipe.sizes) for recipe in several]), strict=True):
        recipe.joint_nats = joint


def traces(recipes: Sequence[Recipe]) -> Made:
    """Every recording of every case, by identifier and index."""
    found: Made = {}
    for group in (TRAINING, (2,)):
        columns = [Column(recipe, index, recipe.sizes) for recipe in recipes for index in group]
        for indices in batches(columns):
            trace = simulate(columns_of([columns[i] for i in indices]))
            for place, index in enumerate(indices):
                one = slice(place, place + 1)
                found[columns[index].recipe.identifier, columns[index].recording] = trace.cut(one)
    return found


def csv_bytes(trace: Trace) -> bytes:
    """A recording: t,u,theta,dtheta,psi; an empty cell for a missing number."""
    t = np.round(np.arange(len(trace.torque)) * SAMPLE_S, 9)
    table = np.column_stack((t, trace.torque[:, 0], trace.rows[..., 0]))
    lines = [",".join("" if x != x else repr(x) for x in row) for row in table.tolist()]  # noqa: PLR0124
    return ("\n".join(("t,u,theta,dtheta,psi", *lines)) + "\n").encode()


def signal_bytes(trace: Trace, names: Mapping[str, float]) -> bytes:
    """What a mechanism outside the library did in each sample: the mean forces on theta, psi and phi' in N m, what it
    added to each sensor, the true motion and its states at the sample's beginning; twelve digits."""
    # those that were simulated beside it remember, too
    memory = {name: trace.memory[name][:-1, 0] for name in mechanisms.states(names)}
    forces = np.zeros((len(trace.torque), 3)) if trace.forces is None else trace.forces[..., 0]
    added = (trace.clean - trace.states[:-1, :3])[..., 0]
    head = (
        "t",
        "on_theta",
        "on_psi",
        "on_phi",
        "theta",
        "dtheta",
        "psi",
        *(f"true_{name}" for name in STATES),
        *memory,
    )
    t = np.arange(len(forces)) * SAMPLE_S
    table = np.column_stack((t, forces, added, trace.states[:-1, :, 0], *memory.values()))
    lines = [",".join(f"{x:.12g}" for x in row) for row in table.tolist()]
    return ("\n".join((",".join(head), *lines)) + "\n").encode()


def answer(recipe: Recipe, own: Sequence[Trace]) -> dict[str, Any]:
    """What is hidden, and all that a scorer needs."""
    w = recipe.wish
    return {
        "schema": SCHEMA,
        "id": recipe.identifier,
        "family": w.family,
        "seed": list(recipe.seed),
        "flags": {"closed_loop": w.closed, "heavy_noise": w.heavy, "two_level": w.two_level, "small_angles": w.small,
                  "large_angles": w.large, "burst": w.burst},
        "effects": [_effect(recipe, name) for name in w.effects if not name.startswith("decoy.")],
        "left_out": list(w.effects) if w.family == LEFT_OUT else [],
        "decoys": [name for name in w.effects if name.startswith("decoy.")] + ["decoy.outlier_burst"] * w.burst,
        "joint_nats": recipe.joint_nats,
        "base": recipe.base,
        "entries": {name: float(value[0]) for name, value in entries(devices([recipe])).items()},
        "noise": {"dtheta_rad_s": recipe.dtheta_noise, "psi_rad": recipe.psi_noise, "missing": recipe.missing},
        "disturbance": {"kind": recipe.colour.kind, "rms_nm": list(recipe.colour.rms_nm),
                        "time_s": list(recipe.colour.time_s)},
        "inputs": dict(zip(RECORDINGS, recipe.kinds, strict=True)),
        "length_s": dict(LENGTH_S),
        "reach": {name: _reach(trace) for name, trace in zip(RECORDINGS, own, strict=True)},
    }  # fmt: skip


def _effect(recipe: Recipe, name: str) -> dict[str, Any]:
    item = ALL[name]
    values = [recipe.parameters(name, index) for index in range(len(RECORDINGS))]
    there = int(recipe.fixed[name].get("recording", 0))
    found = recipe.nats[name]
    law = {} if item.law is None else {"law": asdict(item.law)}
    return {
        "name": name,
        "slot": item.slot,
        "parameters": values[there],
        "as_seen": equivalent(recipe, name, values[there]),
        "by_recording": dict(zip(RECORDINGS, values, strict=True)),
        "sized": list(item.sized),
        "nats": None if found != found else found,  # noqa: PLR0124
        "target": recipe.targets[name],
        "capped": recipe.capped.get(name, False),
        **law,
    }


def _reach(trace: Trace) -> dict[str, float]:
    """How far the truth went."""
    states = np.abs(trace.states[:, :, 0]).max(axis=0)
    return {"psi_rad": float(states[2]), "dtheta_rad_s": float(states[1]), "u_nm": float(np.abs(trace.torque).max())}
