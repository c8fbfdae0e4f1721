"""The eight entries J, K, L of the two equations of motion, from physical parameters, and what ties them.

    theta'' = J11 theta' + J12 psi' + K1 sin psi + L1 tau
    psi''   = J21 theta' + J22 psi' + K2 sin psi + L2 tau

Both kinematics give M q'' = -B q' - (0, G) sin psi + (tau, 0) with six combinations of parameters in it: M11, M12, M22,
bh, d = bb (Ro/Rb)^2 and G = m g (Ro-Rb); B = [[d + bh, -d], [-d, d]].

Rules of this file: whatever depends on a kinematics is derived from the equations of `plant`, never typed again.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.hoop.equations import Symbols, accelerations, equations_of_motion, lagrangian, symbols
from hoopd.plants.hoop.parameters import KINEMATICS, PARAMETER_UNITS, check_parameters

Array = NDArray[np.float64]

ENTRIES = ("J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2")
COMBINATIONS: Mapping[str, str] = MappingProxyType(
    {
        "M11": "kg m^2",
        "M12": "kg m^2",
        "M22": "kg m^2",
        "bh": "N m s",
        "bb (Ro/Rb)^2": "N m s",
        "mb g (Ro-Rb)": "N m",
    }
)

# What the combinations are made of, for messages (checked against the equations by a test).
FORMULAS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "rolling": MappingProxyType(
            {
                "M11": "Ih + Ib (Ro/Rb)^2",
                "M12": "-Ib (Ro/Rb) (Ro/Rb - 1)",
                "M22": "mb (Ro - Rb)^2 + Ib (Ro/Rb - 1)^2",
                "bh": "bh",
                "bb (Ro/Rb)^2": "bb (Ro/Rb)^2",
                "mb g (Ro-Rb)": "mb g (Ro - Rb)",
            }
        ),
        "published": MappingProxyType(
            {
                "M11": "Ih + Ib (Ro/Rb + 1)^2",
                "M12": "-Ib (Ro/Rb) (Ro/Rb + 1)",
                "M22": "mb (Ro - Rb)^2 + Ib (Ro/Rb)^2",
                "bh": "bh",
                "bb (Ro/Rb)^2": "bb (Ro/Rb)^2",
                "mb g (Ro-Rb)": "mb g (Ro - Rb)",
            }
        ),
    }
)


def entries_of(structure: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """J11 ... L2 of a model (1/s, 1/s^2, 1/(kg m^2)); of `entries` they are its own."""
    p = check_parameters(structure, parameters)
    found = _functions(structure)[0](list(p.values())).full().ravel()
    return dict(zip(ENTRIES, map(float, found), strict=True))


def entries_jacobian(structure: str, parameters: Mapping[str, float]) -> Array:
    """(8, n) derivatives of the entries by the structure's parameters in the order of `PARAMETER_UNITS`, exact."""
    p = check_parameters(structure, parameters)
    return np.asarray(_functions(structure)[1](list(p.values())).full())


def combinations_of(kinematics: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """The six combinations (units: `COMBINATIONS`) of a physical model."""
    p = check_parameters(kinematics, parameters)
    found = _functions(kinematics)[2](list(p.values())).full().ravel()
    return dict(zip(COMBINATIONS, map(float, found), strict=True))


def combinations_jacobian(kinematics: str, parameters: Mapping[str, float]) -> Array:
    """(6, n) derivatives of the combinations by the parameters in the order of `PARAMETER_UNITS`, exact."""
    p = check_parameters(kinematics, parameters)
    return np.asarray(_functions(kinematics)[3](list(p.values())).full())


def spin_ratio(kinematics: str, parameters: Mapping[str, float]) -> float:
    """Turns of the ball about its own axis for each turn of psi with the hoop held (against psi, hence negative)."""
    p = check_parameters(kinematics, parameters)
    return float(_functions(kinematics)[4](list(p.values())))


def equivalent(kinematics: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the other kinematics with the same eight entries: only Ro, Rb and bb differ; ValueError if none.

    w = (Ro/Rb) theta' - (Ro/Rb - 1) psi' rolling, w = (Ro/Rb + 1) theta' - (Ro/Rb) psi' published: Ro/Rb differs by one
    while Ro-Rb, mb, Ib, Ih, bh and bb (Ro/Rb)^2 stay.
    """
    p = check_parameters(kinematics, parameters)
    ratio, distance = p["Ro"] / p["Rb"], p["Ro"] - p["Rb"]
    other = ratio - 1.0 if kinematics == "rolling" else ratio + 1.0
    if kinematics not in KINEMATICS or other <= 1.0:
        raise ValueError(f"no equivalent of {kinematics} with Ro/Rb = {ratio:.3g}")
    # Ro-Rb = Rb (Ro/Rb - 1)
    ball = distance / (other - 1.0)
    return {**p, "Rb": ball, "Ro": other * ball, "bb": p["bb"] * (ratio / other) ** 2}


# ---------------------------------------------------------------------------------------------- two constraints


def implied(entries: Mapping[str, float]) -> dict[str, float]:
    """J21 and J22 that the other six entries demand of any parameters under either kinematics.

    M^-1 = [[L1, L2], [L2, n]] and K = -M^-1 (0, G) give G = -K1/L2, n = L2 K2/K1; J = -M^-1 B gives J12 = d (L1 - L2),
    J22 = d (L2 - n), J11 = -L1 (d + bh) + L2 d and J21 = -L2 (d + bh) + n d.
    """
    e = entries
    n, d = e["L2"] * e["K2"] / e["K1"], e["J12"] / (e["L1"] - e["L2"])
    # d + bh = (L2 d - J11) / L1
    both = (e["L2"] * d - e["J11"]) / e["L1"]
    return {"J21": -e["L2"] * both + n * d, "J22": d * (e["L2"] - n)}


def constraint_misfit(entries: Mapping[str, float]) -> dict[str, float]:
    """J21 and J22 less what the other six demand (1/s): 0 and 0 when physical parameters can give the entries."""
    return {name: entries[name] - value for name, value in implied(entries).items()}


def combinations_from(entries: Mapping[str, float]) -> dict[str, float]:
    """The six combinations from all entries but J21 and J22; a negative one: no physical parameters."""
    e = entries
    n, d = e["L2"] * e["K2"] / e["K1"], e["J12"] / (e["L1"] - e["L2"])
    mass = np.linalg.inv(np.array([[e["L1"], e["L2"]], [e["L2"], n]]))
    hoop = (e["L2"] * d - e["J11"]) / e["L1"] - d
    values = (mass[0, 0], mass[0, 1], mass[1, 1], hoop, d, -e["K1"] / e["L2"])
    return dict(zip(COMBINATIONS, map(float, values), strict=True))


# ---------------------------------------------------------------------------------------------- from the plant


@lru_cache(maxsize=8)
def _functions(structure: str) -> tuple[ca.Function, ...]:
    """Entries and their Jacobian; of a kinematics also the combinations, their Jacobian and the spin ratio."""
    names = tuple(PARAMETER_UNITS[structure])
    p, x, u = ca.SX.sym("p", len(names)), ca.SX.sym("x", 4), ca.SX.sym("u")
    s = symbols(x, u, {name: p[index] for index, name in enumerate(names)})
    at_rest = ca.Function("at_rest", [x, u, p], [_entries(structure, s)])(ca.SX.zeros(4), 0, p)
    found = [at_rest, ca.jacobian(at_rest, p)]
    if structure in KINEMATICS:
        combinations = ca.Function("c", [x, u, p], [_combinations(structure, s)])(ca.SX.zeros(4), 0, p)
        found += [combinations, ca.jacobian(combinations, p), _spin(structure, s)]
    return tuple(ca.Function("f", [p], [ca.densify(one)]) for one in found)


def _entries(structure: str, s: Symbols) -> ca.SX:
    """d(theta'', psi'')/d(theta', psi', psi, tau); at rest sin psi is psi."""
    a = accelerations(structure, s, ca.vertcat(s.u, 0))
    rows = [ca.horzcat(*(ca.jacobian(a[i], one) for one in (s.dtheta, s.dpsi, s.psi, s.u))) for i in (0, 1)]
    return ca.horzcat(*rows).T


def _combinations(kinematics: str, s: Symbols) -> ca.SX:
    mass, rhs = equations_of_motion(kinematics, s, ca.SX.zeros(2))
    damping = -ca.jacobian(rhs, ca.vertcat(s.dtheta, s.dpsi))
    gravity = -ca.jacobian(rhs[1], s.psi)
    # B11 = d + bh, B12 = -d
    return ca.vertcat(mass[0, 0], mass[0, 1], mass[1, 1], damping[0, 0] + damping[0, 1], -damping[0, 1], gravity)


def _spin(kinematics: str, s: Symbols) -> ca.SX:
    """w = a theta' + c psi': c, from M12 = Ib a c and M22 = mb (Ro-Rb)^2 + Ib c^2 of the same Lagrangian."""
    by_ball = ca.jacobian(ca.gradient(lagrangian(kinematics, s).kinetic, s.dpsi), s.dpsi)
    # the ball turns against psi: a rolling ball's far side moves back
    return -ca.sqrt(ca.jacobian(by_ball, s.p["Ib"]))
