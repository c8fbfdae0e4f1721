"""Dry friction and the ball's contact by their own stick logic: the impulse that would stop, never above the limit.

Rules of this file: velocities in, velocities out, arrays (B,); h is the substep in s, limits are in N m or N.
"""

from __future__ import annotations

import numpy as np

from concealed.plant import Array, Body

SWEEPS = 4  # of two frictions; one settles in one
SLIDING_SWEEPS = 12  # the contact and both frictions share the ball: 12 leave less than 1e-3 of the impulse


def rub(device: Body, dtheta: Array, dpsi: Array, hoop: Array | None, roll: Array | None, h: float) -> Array:
    """(theta', psi') (2, B) after friction against theta' (limit `hoop`) and phi' (limit `roll`); a None is absent."""
    along = device.ratio * (device.i11 - device.i12)  # theta' per impulse on phi'
    across = device.ratio * (device.i12 - device.i22)  # psi' per impulse on phi'
    own = device.ratio * (along - across)  # phi' per impulse on phi'
    given_hoop, given_roll = np.zeros_like(dtheta), np.zeros_like(dtheta)
    for _ in range(SWEEPS if hoop is not None and roll is not None else 1):
        if hoop is not None:
            given = np.clip(given_hoop - dtheta / device.i11, -hoop * h, hoop * h)
            dtheta, dpsi = (
                dtheta + device.i11 * (given - given_hoop),
                dpsi + device.i12 * (given - given_hoop),
            )
            given_hoop = given
        if roll is not None:
            given = np.clip(given_roll - device.ratio * (dtheta - dpsi) / own, -roll * h, roll * h)
            dtheta, dpsi = dtheta + along * (given - given_roll), dpsi + across * (given - given_roll)
            given_roll = given
    return np.stack((dtheta, dpsi))


def slide(
    device: Body, v: Array, forces: tuple[Array, Array, Array], grip_n: Array, hoop: Array, roll: Array, h: float
) -> Array:
    """(theta', psi', w) (3, B) one substep later when the contact carries no more than `grip_n` = mu N.

    Newton and Euler with the contact force F on the ball: Ih theta'' = .. - F Ro, m R^2 psi'' = .. + F R,
    Ib w' = .. + F Rb; rolling is the F that keeps Ro theta' - R psi' - Rb w at 0. forces: on theta, on psi, on phi'.
    """
    p = device.given
    radius = p["Ro"] - p["Rb"]
    inverse = np.stack((1 / p["Ih"], 1 / (p["mb"] * radius**2), 1 / p["Ib"]))
    on_theta, on_psi, on_roll = forces
    # phi' = w - psi'
    v = v + h * inverse * np.stack((on_theta, on_psi - on_roll, on_roll))
    zero, one = np.zeros_like(grip_n), np.ones_like(grip_n)
    contact = np.stack((p["Ro"], -radius, -p["Rb"]))
    lines = (contact, np.stack((one, zero, zero)), np.stack((zero, -one, one)))
    limits = (grip_n * h, hoop * h, roll * h)
    given = [zero, zero, zero]
    for _ in range(SLIDING_SWEEPS):
        for index, (line, limit) in enumerate(zip(lines, limits, strict=True)):
            answer = inverse * line
            stop = given[index] - (line * v).sum(0) / (line * answer).sum(0)
            now = np.clip(stop, -limit, limit)
            v, given[index] = v + answer * (now - given[index]), now
    return v
