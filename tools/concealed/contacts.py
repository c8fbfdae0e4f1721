"""Dry friction and the ball's contact by their own stick logic: the impulse that would stop, never above the limit.

Rules of this file: velocities in, velocities out, arrays (B,); h is the substep in s, limits are in N m or N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from concealed.plant import Array, Body

SWEEPS = 4  # of two frictions; one settles in one
SLIDING_SWEEPS = 12  # the contact and both frictions share the ball: 12 leave less than 1e-3 of the impulse


def clip(x: Array, limit: Array) -> Array:
    """x between -limit and limit; np.clip takes three times as long on a batch."""
    return np.minimum(np.maximum(x, -limit), limit)


@dataclass(frozen=True)
class Rub:
    """A line of friction, rate = n_theta theta' + n_psi psi', and the velocities that an impulse along it gives."""

    n: tuple[Array, Array]
    answer: tuple[Array, Array]
    own: Array

    def stop(self, dtheta: Array, dpsi: Array) -> Array:
        """Impulse that brings the line's rate to zero."""
        return -(self.n[0] * dtheta + self.n[1] * dpsi) / self.own


def lines(device: Body) -> tuple[Rub, Rub]:
    """Friction against theta', and against phi' = (Ro/Rb)(theta' - psi')."""
    one = np.ones_like(device.i11)
    along = device.ratio * (device.i11 - device.i12)
    across = device.ratio * (device.i12 - device.i22)
    return (
        Rub((one, 0 * one), (device.i11, device.i12), device.i11),
        Rub((device.ratio, -device.ratio), (along, across), device.ratio * (along - across)),
    )


def rub(rubs: tuple[Rub, ...], dtheta: Array, dpsi: Array, limits: tuple[Array, ...], h: float) -> tuple[Array, Array]:
    """theta', psi' (B,) after dry friction along each line, none above its limit in N m."""
    given = [0.0 * dtheta for _ in rubs]
    for _ in range(SWEEPS if len(rubs) > 1 else 1):
        for index, (line, limit) in enumerate(zip(rubs, limits, strict=True)):
            now = clip(given[index] + line.stop(dtheta, dpsi), limit * h)
            more, given[index] = now - given[index], now
            dtheta, dpsi = dtheta + line.answer[0] * more, dpsi + line.answer[1] * more
    return dtheta, dpsi


def slide(
    device: Body,
    v: Array,
    forces: tuple[Array, Array, Array],
    grip_n: Array,
    dry: tuple[Array | None, Array | None],
    h: float,
) -> Array:
    """(theta', psi', w) (3, B) one substep later when the contact carries no more than `grip_n` = mu N.

    Newton and Euler with the contact force F on the ball: Ih theta'' = .. - F Ro, m R^2 psi'' = .. + F R,
    Ib w' = .. + F Rb; rolling is the F that keeps Ro theta' - R psi' - Rb w at 0. forces: on theta, on psi, on phi';
    dry: limits of friction against theta' and phi' in N m, None where there is none.
    """
    p = device.given
    radius = p["Ro"] - p["Rb"]
    inverse = np.stack((1 / p["Ih"], 1 / (p["mb"] * radius**2), 1 / p["Ib"]))
    on_theta, on_psi, on_roll = forces
    # phi' = w - psi'
    v = v + h * inverse * np.stack((on_theta, on_psi - on_roll, on_roll))
    zero, one = np.zeros_like(grip_n), np.ones_like(grip_n)
    along = ((p["Ro"], -radius, -p["Rb"]), (one, zero, zero), (zero, -one, one))
    limits = (grip_n, *dry)
    given = [
        (line, inverse * line, limit * h, [zero])
        for line, limit in zip((np.stack(each) for each in along), limits, strict=True)
        if limit is not None
    ]
    for _ in range(SLIDING_SWEEPS if len(given) > 1 else 1):
        for line, answer, most, impulse in given:
            now = clip(impulse[0] - (line * v).sum(0) / (line * answer).sum(0), most)
            v, impulse[0] = v + answer * (now - impulse[0]), now
    return v
