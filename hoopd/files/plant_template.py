"""What a new plant file begins as: a plant that works, with a word on every part of it.

Rules of this file: text only; a test holds that each template is a sound plant.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

_HEAD = """\
# A plant file; docs/reference/plant_files.md has every key. Afterwards: hoopd plant check {file}
schema: hoopd.plant/1
name: {name}
description: {description}
"""
_MECHANICAL = """\

# What moves, each with a rate and an acceleration: x, x', x''. Lengths are in m, angles in rad. How far and how fast
# they usually go is where checks begin and what sizes a search tries.
coordinates:
  x: {{unit: m, usual: 0.1, usual_rate: 0.5}}

# What drives it; limit: what the drive gives at most, of either sign. Leave `inputs` out for a body that moves freely.
inputs:
  F: {{unit: N, limit: 20}}

# Numbers of the equations with their units. Those with `held: true` are known and not fitted.
parameters:
  m: {{value: 2.0, unit: kg, bounds: [0.1, 100]}}
  b: {{value: 3.0, unit: N s/m, bounds: [0, .inf]}}
  k: {{value: 50.0, unit: N/m, held: true}}

# One equation for each coordinate: inertia times acceleration = forces. Arithmetic, x^2, pi, t (s), and
# sin cos sqrt abs sign min max tanh exp.
equations:
  x: m*x'' = F - b*x' - k*x

# What is stored, J; `hoopd plant check` compares it with the equations. May be left out.
energy: m/2*x'^2 + k/2*x^2

# What is measured: expressions of states and parameters, and the sensor. Without it every coordinate is.
channels:
  x: {{reads: x, unit: m, sensor: encoder}}

# Usual time between two samples, s: integration steps and searched delays follow it.
sample_time_s: 0.02
"""
_FIRST_ORDER = """\

# What changes, each with a rate of its own: levels, temperatures, currents.
states:
  T: {{unit: K, usual: 20}} # above its surroundings

# What drives it; limit: what the drive gives at most, of either sign.
inputs:
  P: {{unit: W, limit: 100}}

# Numbers of the equations with their units. Those with `held: true` are known and not fitted.
parameters:
  C: {{value: 500, unit: J/K, bounds: [1, 1.0e+6]}}
  G: {{value: 2, unit: W/K, bounds: [0, .inf]}}

# One equation for each state, linear in its rate. Arithmetic, T^2, pi, t (s), and
# sin cos sqrt abs sign min max tanh exp.
equations:
  T: C*T' = P - G*T

# What is measured: expressions of states and parameters, and the sensor. Without it every state is.
channels:
  T: {{reads: T, unit: K, sensor: thermometer}}

# Usual time between two samples, s: integration steps and searched delays follow it.
sample_time_s: 1
"""
# Kind -> what it is, and its body.
_KINDS = {
    "mechanical": ("a mass on a spring, driven by a force", _MECHANICAL),
    "first-order": ("a heated block", _FIRST_ORDER),
}
KINDS: Mapping[str, tuple[str, str]] = MappingProxyType(_KINDS)


def template(kind: str, name: str, file: str) -> str:
    """Text of a new plant file; KeyError for a kind that there is not."""
    description, body = KINDS[kind]
    return _HEAD.format(file=file, name=name, description=description) + body.format()
