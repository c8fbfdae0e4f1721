"""The kinds of physics outside the library: how they are drawn and sized, and what is true of them.

Rules of this file: the table decides. `slots`: where a mechanism sits, and after it where no recording of this device
tells it from; `depends_on` names channels, sums of them, and states that nobody measures.
"""

from __future__ import annotations

import numpy as np

from concealed.hidden import Draw, Hidden, Law, Values, log_uniform, nothing, phase, sign


def _sized(key: str, signed: bool = False) -> object:
    """Parameters from a size: what is drawn, and the size under its name."""

    def at(size: float, fixed: Values) -> Values:
        return {**fixed, key: fixed["sign"] * size if signed else size}

    return at


def _kind(name: str, key: str, others: Values, fixed: Draw, first: float, cap: float, law: Law, **more: bool) -> Hidden:
    """A kind whose parameter `key` is its size; `others` are harmless values of the rest where it is not there."""
    at = _sized(key, more.pop("signed", False))
    return Hidden(f"outside.{name}", {key: 0.0, **others}, fixed, at, first, cap, sized=(key,), law=law, **more)  # type: ignore[arg-type]


def _beside(rng: np.random.Generator) -> Values:
    """Where the lens's axis meets the hoop's plane, in rolling radii from its centre."""
    angle, far = phase(rng), float(rng.uniform(0.5, 0.9))
    return {"cx": far * float(np.cos(angle)), "cy": far * float(np.sin(angle))}


KINDS: tuple[Hidden, ...] = (
    _kind(
        "dahl", "F", {"q": 1.0}, lambda rng: {"q": log_uniform(rng, 0.1, 1.0)}, 2e-3, 0.03,
        Law(("hoop",), ("theta since a reversal", "sign theta'"), "way since the last reversal",
            "-F y, q y' = theta' - |theta'| y", "Dahl 1968"),
    ),
    _kind(
        "play", "J", {"b": 1.0}, lambda rng: {"b": log_uniform(rng, 0.05, 0.4)}, 5e-5, 5e-4,
        Law(("hoop",), ("theta", "angle of the loose part"), "angle and speed of the loose part",
            "J v' = -J w^2 o (1 + 0.3 s |o|') - J (v - theta')/(2 s), o what its angle exceeds +-b",
            "Nordin, Gutman 2002"),
    ),
    _kind(
        "running_in", "F", {"L": 1.0}, lambda rng: {"L": log_uniform(rng, 30.0, 200.0)}, 4e-3, 0.05,
        Law(("hoop",), ("dissipated energy", "sign theta'"), "dissipated energy",
            "-F exp(-E/(F L)) sign theta', E' = F exp(-E/(F L)) |theta'|", "Archard 1953"),
    ),
    _kind(
        "dwell", "F", {"L": 1.0}, lambda rng: {"L": log_uniform(rng, 1.0, 5.0)}, 1e-3, 0.02,
        Law(("hoop",), ("age of the contact", "sign theta'"), "age of the contact",
            "-F log(1 + a/0.1 s) sign theta', a' = 1 - |theta'| a/L", "Dieterich 1979, Ruina 1983"),
    ),
    _kind(
        "appendage", "J", {"w": 20.0, "zeta": 0.1},
        lambda rng: {"w": log_uniform(rng, 10.0, 45.0), "zeta": log_uniform(rng, 0.02, 0.1)}, 3e-5, 4e-4,
        Law(("hoop",), ("theta", "angle of the hanging part"), "angle and speed of the hanging part",
            "J v' = -J (w^2 r + 2 zeta w r'), r' = v - theta'", "Den Hartog 1956"),
    ),
    _kind(
        "eddy_brake", "A", {"w0": 1.0}, lambda rng: {"w0": log_uniform(rng, 3.0, 12.0)}, 2e-3, 0.03,
        Law(("hoop",), ("theta'",), "", "-2 A x/(1 + x^2), x = theta'/w0", "Wouterse 1991"),
    ),
    _kind(
        "ratchet", "F", {"q": 0.0, "w": 1.0, "direction": 1.0},
        lambda rng: {"q": phase(rng), "w": rng.uniform(0.4, 0.9), "direction": sign(rng)}, 5e-3, 0.08,
        Law(("hoop",), ("theta", "sign theta'"), "",
            "-F max(0, 1 - (d/w)^2) for theta' of one sign, d from theta to q", "one-sided Coulomb contact"),
    ),
    _kind(
        "bearing_load", "F", {}, nothing, 2e-3, 0.03,
        Law(("hoop",), ("normal force", "psi", "psi'", "sign theta'"), "",
            "-F N/(m g) sign theta', N = m ((Ro-Rb) psi'^2 + g cos psi)", "Coulomb"),
    ),
    _kind(
        "bouc_wen", "F", {"q": 1.0}, lambda rng: {"q": log_uniform(rng, 0.05, 0.5)}, 2e-5, 5e-4,
        Law(("ball",), ("theta - psi since a reversal", "sign phi'"), "way since the last reversal",
            "-F z on phi', q z' = r' - (r' + |r'| sign z)/2 z^2, r = theta - psi", "Wen 1976"),
    ),
    _kind(
        "flat_spot", "A", {"q": 0.0, "w": 1.0}, lambda rng: {"q": phase(rng), "w": rng.uniform(0.5, 0.9)}, 5e-4, 2e-3,
        Law(("ball",), ("theta - psi",), "", "V = -A exp((cos(phi - q) - 1)/w^2), phi = (Ro/Rb)(theta - psi)",
            "conservative, in the ball's own turning"),
    ),
    _kind(
        "magnet", "A", {"q": 0.0, "w": 1.0}, lambda rng: {"q": phase(rng), "w": rng.uniform(0.25, 0.6)}, 5e-4, 1e-2,
        Law(("ball", "hoop"), ("theta - psi",), "", "V = -A exp((cos(psi - theta - q) - 1)/w^2)",
            "conservative, between ball and hoop"),
    ),
    _kind(
        "rim_magnets", "A", {"n": 2.0, "q": 0.0},
        lambda rng: {"n": float(rng.integers(2, 6)), "q": phase(rng)}, 3e-4, 5e-3,
        Law(("ball", "hoop"), ("theta - psi",), "", "V = -A cos(n (psi - theta) - q)",
            "conservative, between ball and hoop"),
    ),
    _kind(
        "wobble", "d", {"q": 0.0}, lambda rng: {"q": phase(rng)}, 0.01, 0.15,
        Law(("frame", "ball"), ("theta", "psi"), "", "V = -m g (Ro-Rb) cos(psi - d cos(theta - q))",
            "gravity in a track that tilts as it turns"),
    ),
    _kind(
        "motor_heating", "a", {"T": 1.0}, lambda rng: {"T": log_uniform(rng, 3.0, 12.0)}, 0.1, 2.0,
        Law(("actuator",), ("torque", "heat of the winding"), "heat of the winding",
            "u/(1 + a H), T H' = (u/0.1 N m)^2 - H", "Joule, Newton's cooling"),
    ),
    _kind(
        "supply_sag", "r", {"T": 1.0}, lambda rng: {"T": log_uniform(rng, 0.1, 1.0)}, 0.05, 2.0,
        Law(("actuator",), ("torque", "power"), "voltage of the supply",
            "u V, T V' = 1 - V - r max(u theta', 0)", "capacitor behind a resistance and a diode"),
    ),
    _kind(
        "dead_time", "d", {"u0": 1.0}, lambda rng: {"u0": log_uniform(rng, 0.03, 0.1)}, 3e-3, 0.02,
        Law(("actuator",), ("torque",), "torque of the sample before", "u(t - d exp(-|u|/u0))",
            "a loop that opens late"),
    ),
    _kind(
        "shaft_twist", "c", {"T": 1.0}, lambda rng: {"T": log_uniform(rng, 3e-3, 0.03)}, 0.02, 1.0,
        Law(("encoder", "actuator"), ("torque",), "twist of the shaft",
            "theta + w, theta' + w', T w' = c tau - w", "Kelvin and Voigt"),
    ),
    _kind(
        "speed_gain", "a", {}, lambda rng: {"sign": sign(rng)}, 0.01, 0.3,
        Law(("encoder",), ("theta'",), "", "theta' (1 + a |theta'|/20 rad/s)", "a timer's dead time"),
        signed=True,
    ),
    _kind(
        "camera_beat", "d", {"P": 1.0, "phi": 0.0}, lambda rng: {"P": log_uniform(rng, 1.5, 8.0)}, 5e-3, 0.06,
        Law(("camera",), ("time", "psi'"), "", "psi(t - d frac(t/P + phi/2 pi))", "two free-running clocks"),
        phased=True,
    ),
    _kind(
        "distortion", "k", {"cx": 0.0, "cy": 0.0}, lambda rng: _beside(rng) | {"sign": sign(rng)}, 0.02, 0.4,
        Law(("camera",), ("psi",), "", "c + (x - c)(1 + k |x - c|^2), x = (sin psi, cos psi)", "Brown 1966"),
        signed=True,
    ),
)  # fmt: skip
