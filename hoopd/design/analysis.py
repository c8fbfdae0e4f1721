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

from hoopd.physics.effectplant import EffectPlant
from hoopd.physics.plant import Plant

Array = NDArray[Any]

STATES = ("theta", "dtheta", "psi", "dpsi")
INPUT = "torque"
WORDS = {"theta": "hoop angle", "dtheta": "hoop speed", "psi": "ball angle", "dpsi": "ball speed"}

# A coefficient or coupling this small beside the terms it is a sum of is rounding (64-bit floats carry 2e-16).
ROUNDING = 1e-12


def linear_model(
    plant: Plant | EffectPlant, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0, outputs: Sequence[str] = ("psi",)
) -> control.StateSpace:
    """dx/dt = A x + B u, y = C x for small deviations from (x0 (4,), u0), exact; ValueError: unknown output."""
    unknown = [name for name in outputs if name not in STATES]
    if unknown or not outputs or len(set(outputs)) != len(outputs):
        raise ValueError(f"outputs must be different ones of {', '.join(STATES)}, not {', '.join(outputs) or 'none'}")
    a, b = plant.linearize(x0, u0)
    c = np.eye(4)[[STATES.index(name) for name in outputs]]
    return control.ss(a, b, c, 0, states=list(STATES), inputs=[INPUT], outputs=list(outputs), name="plant")


# ---------------------------------------------------------------------------------------------- transfer function


def numerator_and_denominator(system: control.StateSpace) -> tuple[Array, Array]:
    """Coefficients, highest power first, of one input to one output; the denominator is monic, order n in full.

    Source: Faddeev and LeVerrier. adj(sI - A) = sum_k M_k s^(n-k) with M_1 = I, M_k+1 = A M_k + c_k I,
    c_k = -tr(A M_k)/k. Without slycot python-control takes scipy's ss2tf, poly(A - B C) - poly(A), whose differences
    leave rounding as leading coefficients (zeros at 1e13); here cB = 0 stays 0.
    """
    a, b, c, d = system.A, system.B[:, 0], system.C[0], float(system.D[0, 0])
    n = len(a)
    term, size, den, num = np.eye(n), np.eye(n), [1.0], []
    for k in range(1, n + 1):
        num.append(_sum(float(c @ term @ b), float(abs(c) @ size @ abs(b))))
        moved, moved_size = a @ term, abs(a) @ size
        den.append(_sum(-float(np.trace(moved)) / k, float(np.trace(moved_size)) / k))
        term, size = moved + den[-1] * np.eye(n), moved_size + abs(den[-1]) * np.eye(n)
    denominator = np.array(den)
    return np.concatenate([[0.0], num]) + d * denominator, denominator


def _sum(value: float, size: float) -> float:
    """The value, or 0 when it is rounding beside the terms it is a sum of."""
    return value if abs(value) > ROUNDING * size else 0.0


def transfer_function(system: control.StateSpace) -> control.TransferFunction:
    """One input to one output as a python-control object, in full (nothing cancelled), no leading zeros."""
    num, den = numerator_and_denominator(system)
    first = int(np.flatnonzero(num)[0]) if num.any() else len(num) - 1
    return control.tf(num[first:], den, system.dt, inputs=system.input_labels, outputs=system.output_labels)


def zeros(system: control.StateSpace) -> Array:
    """Zeros of one input to one output: roots of the cleaned numerator."""
    num, _ = numerator_and_denominator(system)
    return np.roots(np.trim_zeros(num, "f"))


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
