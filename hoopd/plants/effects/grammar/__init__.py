"""A grammar of mechanisms: where a missing piece of physics acts, on what it depends, its shape, and its memory.

The library's effects (`plants.effects`) are what laboratories know by name. Beyond them a mechanism is put together
from parts, and its name says which: `hoop.threshold_of_dtheta`, `ball.dahl_of_psi`, `actuator.wear_of_theta_on_u`.
"""
