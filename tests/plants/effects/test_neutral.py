"""Effects at their neutral values leave the base's numbers as they are, bit for bit; every pair composes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from harness.effectcases import NAMES, SIZES, composite, effects, sizes, two_level

from hoopd.plants.free_run import readings, run
from hoopd.plants.plant_with_effects import BACK_STEPS, Composite

# What only says where, how fast or how often: without its amplitude it changes nothing.
SHAPES = {name: {p.key(q.name): SIZES[name][q.name] for q in p.parameters if q.role != "amplitude"} for name in NAMES
          for p in [effects("rolling")[name]] if any(q.role == "amplitude" for q in p.parameters)}  # fmt: skip


def numbers(c: Composite, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Twenty steps from a fast state, and the readings after each."""
    rng = np.random.default_rng(3)
    z = c.beginning(np.array([0.4, 9.0, 0.7, -4.0]), 0.1)
    rows, seen, p = [], [], c.vector(values)
    for k in range(20):
        # beyond the limit, too
        torques, w = np.full(c.substeps, rng.uniform(-1, 1)), np.append(rng.normal(size=2) * 1e-3, 0.0)[: c.nq]
        back = np.full((3, BACK_STEPS), 0.1)
        z = c.step_function(z, torques, w, 0.02, 0.3 + 0.02 * k, p).full().ravel()
        rows.append(z[:4])
        seen.append(c.output_function(z, back, w, 0.3 + 0.02 * k, p).full().ravel())
    return np.array(rows), np.array(seen)


@pytest.mark.parametrize("structure", ["entries", "rolling", "published"])
def test_neutral_is_the_base_bit_for_bit(structure: str) -> None:
    base = {n: numbers(composite(structure, substeps=n), {}) for n in (4, 5, 8, 10)}
    for name in NAMES:
        c = composite(structure, name)
        for values in ({}, SHAPES.get(name, {})):
            states, seen = numbers(c, values)
            assert np.array_equal(states, base[c.substeps][0]), name
            assert np.array_equal(seen, base[c.substeps][1]), name
        # and its size does change something
        if effects(structure)[name].found_by != "quality" and name != "actuator.delay":  # this one acts before the step
            changed = numbers(c, sizes(name))
            assert any(not np.array_equal(one, two) for one, two in zip(changed, base[c.substeps], strict=True)), name


def test_neutral_free_runs_are_the_base_s() -> None:
    t, u = two_level(0.6)
    names = [name for name in NAMES if name != "ball.slip"]
    whole, base = composite("entries", *names), composite("entries", substeps=10)
    x0 = np.array([0.0, 0.0, 0.3, 0.0])
    z, z_base = run(whole, {}, x0, t, u), run(base, {}, x0, t, u)
    assert np.array_equal(z[:, :4], z_base)
    seen, seen_base = readings(whole, {}, x0, t, u), readings(base, {}, x0, t, u)
    assert all(np.array_equal(seen[c], seen_base[c]) for c in ("theta", "dtheta", "psi"))


EQUATIONS = [name for name in NAMES if effects("entries")[name].found_by != "quality"]


def composes(one: str, two: str) -> None:
    """Three steps and a reading of both together are finite numbers of the device's size."""
    c = composite("entries", one, two)
    z = c.beginning(np.array([0.1, 1.0, 0.3, -2.0]), 0.1)
    p = c.vector(sizes(one, two))
    for k in range(3):
        z = c.step_function(z, np.full(c.substeps, 0.1), np.zeros(c.nq), 0.02, 0.3 + 0.02 * k, p)
    y = c.output_function(z, np.full((3, BACK_STEPS), 0.1), np.zeros(c.nq), 0.36, p).full()
    assert np.isfinite(z.full()).all(), (one, two)
    assert np.isfinite(y).all(), (one, two)
    assert np.abs(y).max() < 10.0, (one, two)


def test_pairs_compose() -> None:
    """Each effect with the next of the list, the sixth after it and so on: a fifth of all pairs."""
    for i, j in combinations(range(len(EQUATIONS)), 2):
        if (j - i) % 5 == 1:
            composes(EQUATIONS[i], EQUATIONS[j])


@pytest.mark.proof
def test_every_pair_composes() -> None:
    for pair in combinations(EQUATIONS, 2):
        composes(*pair)
