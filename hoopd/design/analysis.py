"""The plant near an operating point: state space, transfer function, poles and zeros, what is steered and seen.

Rules of this file: systems are python-control's `StateSpace` with named states, nothing is read, written or drawn.
python-control does the mathematics where it is safe; where it is not (see each function), the reason stands there.

State: theta, dtheta, psi, dpsi (rad, rad/s); input: torque (N m). Sampled with a delay (`delay.held`), torques on
their way follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.moved import renamed
from hoopd.plants.hoop.plant import HoopPlant

Array = NDArray[Any]

STATES = ("theta", "dtheta", "psi", "dpsi")
INPUT = "torque"
WORDS = {"theta": "hoop angle", "dtheta": "hoop speed", "psi": "ball angle", "dpsi": "ball speed"}


def linear_model(
    plant: HoopPlant, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0, outputs: Sequence[str] = ("psi",)
) -> control.StateSpace:
    """dx/dt = A x + B u, y = C x for small deviations from (x0 (4,), u0), exact; ValueError: unknown output."""
    unknown = [name for name in outputs if name not in STATES]
    if unknown or not outputs or len(set(outputs)) != len(outputs):
        raise ValueError(f"outputs must be different ones of {', '.join(STATES)}, not {', '.join(outputs) or 'none'}")
    a, b = plant.linearize(x0, u0)
    c = np.eye(4)[[STATES.index(name) for name in outputs]]
    return control.ss(a, b, c, 0, states=list(STATES), inputs=[INPUT], outputs=list(outputs), name="plant")


def channel(system: control.StateSpace, output: str) -> control.StateSpace:
    """The same system with one output alone."""
    row = system.output_labels.index(output)
    return control.ss(
        system.A,
        system.B,
        system.C[[row]],
        system.D[[row]],
        system.dt,
        states=system.state_labels,
        inputs=system.input_labels,
        outputs=[output],
        name=system.name,
    )


# ---------------------------------------------------------------------------------------------- what cancels


class Minimal(NamedTuple):
    """What the input moves and the output sees, and what was dropped from the whole for that."""

    system: control.StateSpace
    unseen: tuple[str, ...]  # states that no output depends on
    unmoved: tuple[str, ...]  # states that the input does not reach


def minimal(system: control.StateSpace) -> Minimal:
    """The system without the states that its outputs cannot see or its input cannot move, by name.

    Found from which coupling is zero, so no tolerance decides: the hoop angle drops because nothing depends on it,
    the hoop speed, seen from psi at 5e-5 of the ball's own motion, stays. python-control's `minreal` needs slycot for
    state space, and on transfer functions it cancels by distance.
    """
    a, b, c = system.A, system.B, system.C
    seen = _reached(a.T, np.abs(c).sum(axis=0))
    moved = _reached(a, np.abs(b).sum(axis=1))
    keep = np.flatnonzero(seen & moved)
    names = np.array(system.state_labels)
    labels = {"inputs": system.input_labels, "outputs": system.output_labels, "name": system.name}
    kept = [str(name) for name in names[keep]]
    less = control.ss(a[np.ix_(keep, keep)], b[keep], c[:, keep], system.D, system.dt, states=kept, **labels)
    return Minimal(less, tuple(map(str, names[~seen])), tuple(map(str, names[~moved])))


def _reached(a: Array, start: Array) -> NDArray[np.bool_]:
    """States connected with a start: j is reached from i when a[j, i] is not zero (exact derivatives, held and
    delayed ones too, have exact zeros; any threshold would depend on the units of the states)."""
    found: NDArray[np.bool_] = start != 0.0
    for _ in range(len(a)):
        found = found | (a[:, found] != 0.0).any(axis=1)
    return found


def __getattr__(name: str) -> object:
    """What stood here once."""
    return renamed(__name__, name)
