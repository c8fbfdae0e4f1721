"""What the inputs can steer and what the measured outputs can see: ranks, singular values, and in words.

Rules of this file: every yes or no comes with the numbers and the tolerance that it was decided by.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.analysis import INPUT, WORDS

Array = NDArray[Any]

# Beside the largest singular value: what is weaker than this is there on paper and drowned by any noise.
WEAK = 1e-3
# A pole this near to the edge of stability counts as on it (the hoop angle's is there exactly).
EDGE = 1e-9
# A mode is invisible when its direction changes the outputs by less than this part of its size (PBH test).
MODE = 1e-9


class Rank(NamedTuple):
    """Of a controllability or observability matrix."""

    full: bool
    rank: int
    order: int
    singular_values: tuple[float, ...]
    tolerance: float  # singular values up to here count as zero: order * epsilon * the largest
    lost: tuple[str, ...]  # states that lie wholly in what is lost
    weak: tuple[str, ...]  # states that carry what is present but weaker than WEAK


class Detectability(NamedTuple):
    """May a filter be built: is every mode that does not die out seen?"""

    detectable: bool
    hidden: tuple[complex, ...]  # poles that do not die out and are not seen
    states: tuple[str, ...]  # what carries them


def in_usual_sizes(system: control.StateSpace, sizes: Mapping[str, float]) -> control.StateSpace:
    """The same with states and inputs over their usual sizes, outputs over what these make of them, and the time over
    that of the fastest pole: what is weak in it does not depend on units.

    `sizes`: by name, 1 where there is none; a late input has the input's. Without any the system as it is.
    """
    if not sizes:
        return system
    late = {name: sizes.get(name.rpartition("_")[0], 1.0) for name in system.state_labels}
    x = np.array([sizes.get(name, late[name]) for name in system.state_labels])
    u = np.array([sizes.get(name, 1.0) for name in system.input_labels])
    y = np.abs(system.C) @ x
    y = np.where(y > 0.0, y, 1.0)[:, None]
    fastest = np.abs(system.poles()).max(initial=0.0)
    time = 1.0 if system.isdtime(strict=True) or not fastest > 0.0 else 1.0 / fastest
    labels = {"states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels}
    a, b = time * system.A * x / x[:, None], time * system.B * u / x[:, None]
    return control.ss(a, b, system.C * x / y, system.D * u / y, system.dt, name=system.name, **labels)


def controllability(system: control.StateSpace) -> Rank:
    """Rank of [B, AB, ...]: can the input bring the state anywhere?"""
    return _rank(control.ctrb(system.A, system.B).T, system.state_labels)


def observability(system: control.StateSpace) -> Rank:
    """Rank of [C; CA; ...]: do the outputs tell the whole state?"""
    return _rank(control.obsv(system.A, system.C), system.state_labels)


def _rank(matrix: Array, names: list[str]) -> Rank:
    _, sizes, directions = np.linalg.svd(matrix)
    sizes = np.pad(sizes, (0, len(names) - len(sizes)))
    tolerance = float(sizes[0] * max(matrix.shape) * np.finfo(float).eps)
    rank = int((sizes > tolerance).sum())
    lost = directions[rank:]  # orthonormal rows
    weak = [directions[k] for k in range(rank) if sizes[k] < WEAK * sizes[0]]
    return Rank(
        rank == len(names),
        rank,
        len(names),
        tuple(map(float, sizes)),
        tolerance,
        tuple(name for i, name in enumerate(names) if np.linalg.norm(lost[:, i]) > 1.0 - 1e-6),
        tuple(dict.fromkeys(names[int(np.argmax(np.abs(row)))] for row in weak)),
    )


def detectability(system: control.StateSpace) -> Detectability:
    """PBH: a mode p with eigenvector v that does not die out is seen when C v is not zero.

    python-control's `lqe` and `dlqe` stop with a bare error of the Riccati solver when this fails; for this device it
    is the hoop angle alone, so a filter is made on `minimal(system)`, or the hoop angle is measured too.
    """
    poles, vectors = np.linalg.eig(system.A)
    size = np.abs(poles) - 1.0 if system.isdtime(strict=True) else poles.real
    hidden, states = [], []
    for pole, vector in zip(poles[size >= -EDGE], vectors.T[size >= -EDGE], strict=True):
        if np.linalg.norm(system.C @ vector) <= MODE * np.linalg.norm(system.C):
            hidden.append(complex(pole))
            states.append(system.state_labels[int(np.argmax(np.abs(vector)))])
    return Detectability(not hidden, tuple(hidden), tuple(dict.fromkeys(states)))


def in_words(system: control.StateSpace) -> list[str]:
    """Sentences about what is not steered, not seen, or hardly."""
    outputs = ", ".join(system.output_labels)
    steered, seen, filtered = controllability(system), observability(system), detectability(system)
    moving = "the torque" if system.input_labels == [INPUT] else " or ".join(system.input_labels)
    notes = [f"{named(name)} is not moved by {moving}" for name in steered.lost]
    notes += [f"{named(name)} is not seen from {outputs}: no output depends on it" for name in seen.lost]
    notes += [
        f"{named(name)} is hardly seen from {outputs}: singular value {_weakest(seen):.2g} beside "
        f"{seen.singular_values[0]:.3g}"
        for name in seen.weak
        if not name.startswith(tuple(f"{one}_" for one in system.input_labels))
    ]
    if not filtered.detectable:
        what = ", ".join(map(named, filtered.states))
        notes.append(
            f"not detectable: {what} does not die out and is not seen, so no filter on all states exists "
            "(lqe, dlqe stop); leave it out, or measure it too"
        )
    return notes


def _weakest(rank: Rank) -> float:
    return rank.singular_values[rank.rank - 1]


def named(state: str) -> str:
    """A state in words, with its name."""
    return f"{WORDS[state]} ({state})" if state in WORDS else state
