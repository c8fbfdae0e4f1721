"""Lead and lag links, with the parameters of ControlSystems.jl.

Rules of this file: python-control's transfer functions out; frequencies in rad/s.
"""

from __future__ import annotations

from math import asin, degrees, radians, sin, sqrt

import control


def lead_link(b: float, n: float, k: float = 1.0) -> control.TransferFunction:
    """C = k n (s + b)/(s + b n) = k (1 + s/b)/(1 + s/(b n)): gain k at low, k n at high frequencies.

    The phase is highest at b sqrt(n), where the gain is k sqrt(n).
    """
    _positive(b=b, n=n)
    return control.tf([k / b, k], [1.0 / (b * n), 1.0])


def lead_link_at(w: float, n: float, k: float = 1.0) -> control.TransferFunction:
    """`lead_link` whose phase is highest at `w`: b = w/sqrt(n)."""
    _positive(w=w, n=n)
    return lead_link(w / sqrt(n), n, k)


def lag_link(a: float, m: float, k: float = 1.0) -> control.TransferFunction:
    """C = k (s + a)/(s + a/m) = k m (1 + s/a)/(1 + s m/a): gain k m at low, k at high frequencies.

    With a = 0.1 of the crossover frequency it takes less than 6 degrees there.
    """
    _positive(a=a, m=m)
    return control.tf([k * m / a, k * m], [m / a, 1.0])


def lead_phase_deg(n: float) -> float:
    """Highest phase of a lead link in degrees: asin((n - 1)/(n + 1))."""
    _positive(n=n)
    return degrees(asin((n - 1.0) / (n + 1.0)))


def lead_ratio(phase_deg: float) -> float:
    """The n of `lead_link` whose highest phase is `phase_deg`, below 90: (1 + sin)/(1 - sin)."""
    if not -90.0 < phase_deg < 90.0:
        raise ValueError(f"one link turns the phase by less than 90 degrees, not by {phase_deg:g}")
    s = sin(radians(phase_deg))
    return (1.0 + s) / (1.0 - s)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be above zero, not {value:g}")
