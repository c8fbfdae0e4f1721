"""A plant that is a program runs where its user names it, and nowhere else; its mistakes are one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoopd.files.reading import InputError
from hoopd.plants.plant_file import load_plant
from hoopd.plants.plant_model import load_plant_model

HEAD = """
from hoopd.plants.declaration import Channel, Plant
PLANT = Plant("cart", coordinates=("x",), accelerations=lambda s, force: {law},
              values={{"m": 2.0}}, free=("m",), channels={{"x": Channel("x")}})
"""
MODEL = """
schema: hoopd.model/1
name: m
plant: {plant}
parameters: {{m: {{value: 2.0, unit: kg}}}}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "cart.py"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_sound_program_is_a_plant(tmp_path: Path) -> None:
    assert load_plant(written(tmp_path, HEAD.format(law="force / s.p['m']"))).coordinates == ("x",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD.format(law="1 / 0"), "ZeroDivisionError"),
        (HEAD.format(law="force * [1, 2, 3]"), "accelerations: gives 3 values, cart has 1"),
        (HEAD.format(law="force").replace("2.0", "'a\\nb'"), "values.m: must be a finite number"),
        (HEAD.format(law="force").replace("2.0", "float('nan')"), "values.m: must be a finite number"),
        (HEAD.format(law="force").replace('Channel("x")', 'Channel("x", unit=5)'), "channels.x.unit: must be text"),
        (HEAD.format(law="force").replace("channels", "slots={'body': 5}, channels"), "slots.body: a Slot is expected"),
        (HEAD.format(law="force").replace("channels", "time_scale_s=0, channels"), "time_scale_s: must be above 0"),
        (
            HEAD.format(law="force").replace("channels", "bounds={'m': (3, 4)}, channels"),
            "bounds.m: 3 to 4 do not hold",
        ),
        (HEAD.format(law="force").replace("channels", "bounds={'m': 3}, channels"), "TypeError"),
        (HEAD.format(law="force").replace('Channel("x")', "Channel(reading=lambda s: s.v)"), "line 4: AttributeError"),
        (HEAD.format(law="force").replace("channels", "energy=lambda s: 1 / 0, channels"), "ZeroDivisionError"),
        (HEAD.format(law="force").replace("channels", "own_effects=lambda p: [5], channels"), "an Effect is expected"),
        ("import sys\nsys.exit(0)", "line 2: SystemExit"),
        ("def plant():\n    raise SystemExit(3)", "line 2: SystemExit"),
    ],
)
def test_what_is_wrong_in_a_program_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load_plant(written(tmp_path, text))
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_model_file_runs_no_program(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    written(tmp_path, f"open({str(mark)!r}, 'w').close()")
    model = tmp_path / "m.yaml"
    model.write_text(MODEL.format(plant="cart.py"), encoding="utf-8")
    with pytest.raises(InputError, match=r"plant: cart\.py is a program: name it with --plant"):
        load_plant_model(model)
    assert not mark.exists()


def test_a_sample_time_of_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "schema: hoopd.plant/1\nname: p\nstates: {h: {unit: m}}\nparameters: {k: {value: 1, unit: 1/s}}\n"
        'equations: {h: "h\' = -k*h"}\nsample_time_s: 1.0e-300\n',
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="sample_time_s: must be above 2e-06"):
        load_plant(path)
