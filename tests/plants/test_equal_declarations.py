"""Functions are built once for what computes the same, and anew for what only has the same name."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import effectcases

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.effects_file import load_effects
from hoopd.plants.fingerprint import fingerprint
from hoopd.plants.free_run import readings, run
from hoopd.plants.likelihood.composites import composite_of, derivatives_of, fitting_effects, key_of


def drag(power: int, name: str = "slide.wind") -> Effect:
    parameter = EffectParameter("c", "-", 0.0, 0.0, 1.0, grid=(0.1,))
    return Effect(name, (parameter,), force=lambda s, e: {"x": -e.c * s.dx**power})


def slide(stiffness: float = 0.0, limit: float = 20.0) -> Plant:
    return replace(
        effectcases.slide(),
        accelerations=lambda s, force: (force - stiffness * s.x) / s.p["m"],
        inputs=(Input("u", "N", limit, "x"),),
    )


def after(plant: Plant, effects: tuple[Effect, ...], u: float = 1.0) -> Any:
    c = composite_of(plant, effects)
    p = c.vector({"slide.wind.c": 0.5})
    return c.step_function([0.3, 2.0], np.full(c.substeps, u), 0.0, 0.02, 0.0, p).full().ravel().tolist()


def test_equal_declarations_share_their_functions() -> None:
    assert composite_of(slide(), (drag(1),)) is composite_of(slide(), (drag(1),))
    c = composite_of(slide(), (drag(1),))
    assert derivatives_of(c, ("m",)) is derivatives_of(c, ("m",))


def test_a_redefined_effect_is_another_one() -> None:
    assert after(slide(), (drag(1),)) != after(slide(), (drag(3),))
    assert after(slide(), (drag(1),)) == after(slide(), (drag(1),))


def test_another_limit_is_another_plant() -> None:
    assert after(slide(limit=5.0), (), 10.0) != after(slide(limit=20.0), (), 10.0)


def test_other_equations_are_another_plant() -> None:
    assert after(slide(0.0), ()) != after(slide(100.0), ())


def test_another_range_or_grid_is_another_effect() -> None:
    one = drag(1)
    other = replace(one, parameters=(replace(one.parameters[0], grid=(0.2,)),))
    assert key_of(one) != key_of(other) and key_of(one) == key_of(drag(1))


def test_a_redefined_effect_of_the_library_stays_what_it_is() -> None:
    plant = effectcases.slide()
    known = library(plant)["slide.quadratic_drag"]
    (same,) = fitting_effects(plant, (library(replace(plant, name="other"))["slide.quadratic_drag"],))
    assert key_of(same) == key_of(known)
    own = drag(3, "slide.quadratic_drag")
    assert fitting_effects(plant, (own,)) == (own,)


def test_code_of_another_module_is_other_code() -> None:
    text = "def f(s, e):\n    return {'x': GAIN * s.dx}\n"
    spaces: list[dict[str, Any]] = [{"GAIN": 1.0}, {"GAIN": 2.0}]
    for space in spaces:
        exec(compile(text, "own.py", "exec"), space)
    assert fingerprint(spaces[0]["f"]) != fingerprint(spaces[1]["f"])
    assert fingerprint(spaces[0]["f"]) == fingerprint(spaces[0]["f"])


def test_values_that_look_alike_are_told_apart() -> None:
    assert len({fingerprint(one) for one in (0.0, -0.0, 0, False, "0", None, (0,), [0], {0: 0})}) == 9
    assert fingerprint(float("nan")) == fingerprint(float("nan"))
    assert fingerprint(partial(max, 1)) == fingerprint(partial(max, 1)) != fingerprint(partial(max, 2))


def test_a_function_that_calls_itself_has_a_fingerprint() -> None:
    def down(n: int) -> int:
        return down(n - 1) if n else 0

    assert fingerprint(down) == fingerprint(down)


# ---------------------------------------------------------------------------------------------- fast plants


def fast(time_scale_s: float) -> Plant:
    """A mirror on a piezo: 2 kHz, sampled each 20 us."""
    w = 2 * np.pi * 2e3
    return Plant(
        name="mirror",
        coordinates=("q",),
        accelerations=lambda s, force: force / s.p["J"] - 0.1 * w * s.dq - w**2 * s.q,
        inputs=(Input("torque", "N m", 0.1, "q"),),
        values={"J": 1e-6},
        channels={"q": Channel("q", "rad", "gauge")},
        slots={
            "piezo": Slot("actuator", "q"),
            "mirror": Slot("body", "q", turns=True, speed=10.0, viscous=lambda s: 1e-4),
            "gauge": Slot("sensor", "q", ("q",), turns=True),
            "air": Slot("push", "q"),
        },
        time_scale_s=time_scale_s,
    )


@pytest.mark.parametrize("name", sorted(library(fast(2e-5))))
def test_every_effect_fits_a_fast_plant(name: str) -> None:
    plant = fast(2e-5)
    effect = library(plant)[name]
    times = [p for p in effect.parameters if p.unit == "s" and p.grid]
    assert all(max(p.grid) < 1e4 * plant.time_scale_s for p in times)
    c = composite_of(plant, (effect,))
    sized = {effect.key(p.name): (p.grid[0] if p.grid else p.neutral) for p in effect.parameters}
    t, u = np.arange(50) * plant.time_scale_s, np.full(49, 0.01)
    z = run(c, sized, [1e-3, 0.0], t, u)
    read = readings(c, sized, [1e-3, 0.0], t, u)
    assert np.isfinite(z).all() and all(np.isfinite(y).all() for y in read.values())
    assert np.abs(z[:, 0]).max() < 1.0


def test_own_effects_of_a_fast_plant_are_tried_in_its_own_time(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(
        "from hoopd.plants.effects.base import Effect, EffectParameter\n"
        "EFFECTS = (Effect('mirror.cubic', (EffectParameter('c', 'N m', 0.0, 0.0, 1.0, grid=(1e-3,)),),\n"
        "                  force=lambda s, e: {'q': -e.c * s.q**3}),)\n"
    )
    assert [one.name for one in load_effects(path, fast(2e-5))] == ["mirror.cubic"]
    with pytest.raises(InputError, match=r"mirror itself moves faster than its usual sample time of 0\.02 s"):
        load_effects(path, fast(0.02))


def test_a_turning_sensor_without_a_rate_has_its_errors() -> None:
    plant = fast(2e-5)
    for name in ("gauge.eccentricity", "gauge.harmonic"):
        effect = library(plant)[name]
        c = composite_of(plant, (effect,))
        reading = c.reading_function([0.2, 0.0], 0.0, c.vector({f"{name}.a": 0.1}))
        n = 1.0 if name.endswith("eccentricity") else 2.0
        assert float(reading) == pytest.approx(0.2 + 0.1 * np.sin(n * 0.2))
