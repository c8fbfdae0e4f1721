"""What a plant's declaration says of itself, and the words of earlier versions."""

from __future__ import annotations

import ast
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from hoopd.plants import effects
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.former_declaration import DeclaredPlant
from hoopd.plants.free_run import run
from hoopd.plants.plant_with_effects import Composite

MOTOR = Plant(
    name="motor",
    coordinates=("angle",),
    accelerations=lambda s, force: (force + s.p["k"] * s.current - s.p["b"] * s.dangle) / s.p["J"],
    first_order=("current",),
    rates=lambda s: (s.voltage - s.p["R"] * s.current - s.p["k"] * s.dangle) / s.p["L"],
    inputs=(Input("voltage", "V", 24.0), Input("load", "N m", coordinate="angle")),
    values={"J": 1e-4, "b": 1e-5, "k": 0.05, "R": 2.0, "L": 1e-3},
    channels={
        "angle": Channel("angle", "rad", "encoder"),
        "loss": Channel("", "W", reading=lambda s: s.p["R"] * s.current**2),
    },
    slots={"encoder": Slot("sensor", "angle", ("angle",))},
)


def test_states_inputs_and_channels_by_name() -> None:
    assert MOTOR.states == ("angle", "dangle", "current")
    assert (MOTOR.driven, MOTOR.limit, MOTOR.force_unit, MOTOR.usual_input) == (None, 24.0, "V", 24.0)
    assert MOTOR.states_read == ("angle", "") == (MOTOR.state_of("angle"), MOTOR.state_of("nowhere"))
    s = MOTOR.point(np.array([0.1, 2.0, 3.0]), MOTOR.values, np.array([12.0, 0.5]), 7.0)
    assert (s.angle, s.dangle, s.current, s.voltage, s.load, s.u, s.t) == (0.1, 2.0, 3.0, 12.0, 0.5, 12.0, 7.0)
    moved = s.replaced(u=6.0)
    assert (moved.u, moved.voltage, moved.load) == (6.0, 6.0, 0.5)
    assert replace(MOTOR, inputs=()).limit == inf


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"first_order": ("angle",)}, "angle stands twice"),
        ({"inputs": (Input("u", coordinate="x"),)}, "'x', which is no coordinate"),
        ({"channels": {"y": Channel("nothing")}}, "channel y reads 'nothing'"),
        ({"free": ("mass",)}, "mass is no parameter"),
        ({"bounds": {"mass": (0.0, inf)}}, "mass is no parameter"),
    ],
)
def test_a_contradiction_is_one_line(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        replace(MOTOR, **changes)  # type: ignore[arg-type]


def test_a_plant_in_the_words_of_earlier_versions() -> None:
    with pytest.warns(DeprecationWarning, match="is now Plant"):
        slide = DeclaredPlant(
            name="slide",
            coordinates=("x",),
            accelerations=lambda s, force: (force - s.p["b"] * s.dx) / s.p["m"],
            values={"m": 2.0, "b": 3.0},
            free=("m", "b"),
            driven="x",
            channels={"x": "x"},
            slots={"drive": Slot("actuator", "x"), "slide": Slot("body", "x", speed=0.3)},
            units={"m": "kg", "b": "N s/m"},
            least={"m": 0.1},
            force_unit="N",
            limit=20.0,
        )
    assert isinstance(slide, Plant)
    assert (slide.driven, slide.limit, slide.force_unit, slide.state_of("x")) == ("x", 20.0, "N", "x")
    assert slide.bounds == {"m": (0.1, inf)}
    # v(t) = F/b (1 - e^(-b t / m))
    z = run(Composite(slide), {}, [0.0, 0.0], np.arange(51) * 0.02, np.full(50, 2.0))
    assert z[-1, 1] == pytest.approx(2.0 / 3.0 * -np.expm1(-1.5), rel=1e-9)


def test_old_imports_find_it() -> None:
    with pytest.warns(DeprecationWarning):
        import hoopd.physics.declared as old
    assert old.DeclaredPlant is DeclaredPlant  # type: ignore[attr-defined]


def test_the_library_imports_no_plant() -> None:
    for path in Path(effects.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("hoopd.plants.hoop") for name in modules), path.name


def test_own_effects_of_a_plant_are_in_its_library() -> None:
    leak = Effect("tank.leak", (), force=lambda s, e: {"level": -s.level})
    tank = Plant("tank", first_order=("level",), rates=lambda s: -s.level, own_effects=lambda plant: (leak,))
    assert library(tank) == {"tank.leak": leak}
