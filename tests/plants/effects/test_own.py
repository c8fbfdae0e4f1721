"""A user's own effects: the example of the documentation, and what is wrong in such a file as one line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from harness.effectcases import plant, two_level

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.effects_file import load_effects
from hoopd.plants.free_run import readings, run
from hoopd.plants.plant_with_effects import Composite

DOCS = Path(__file__).resolve().parents[3] / "docs/reference/effects.md"
OWN, SLIDE = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)


def write(folder: Path, text: str) -> Path:
    file = folder / "own.py"
    file.write_text(text)
    return file


def test_the_documented_file_works(tmp_path: Path) -> None:
    assert len(OWN.splitlines()) <= 24
    own = load_effects(write(tmp_path, OWN), plant("entries"))
    assert [e.name for e in own] == ["hoop.wind", "hoop.side_friction"]
    assert list(library(plant("entries"), own))[-2:] == ["hoop.wind", "hoop.side_friction"]
    c, (t, u) = Composite(plant("entries"), own), two_level(1.0)
    z = run(c, {"hoop.wind.A": 0.01, "hoop.wind.w": 3.0, "hoop.side_friction.Fc": 0.004}, np.zeros(4), t, u)
    assert np.abs(z - run(Composite(plant("entries")), {}, np.zeros(4), t, u)).max() > 1e-2


def test_the_documented_plant_works() -> None:
    space: dict[str, Plant] = {}
    exec(SLIDE, space)  # type: ignore[arg-type]
    slide = space["SLIDE"]
    found = library(slide)
    assert {"slide.coulomb_friction", "slide.friction_drift", "drive.deadzone", "ruler.latency"} <= set(found)
    c = Composite(slide, [found["slide.coulomb_friction"], found["ruler.latency"]])
    values, t = {"slide.coulomb_friction.Fc": 4.0, "ruler.latency.d": 0.03}, np.arange(51) * 0.02
    # 2 x'' = 10 - 4 - 3 x' from rest:  x = 2 t - 4/3 (1 - e^(-1.5 t)), seen 0.03 s later
    y = readings(c, values, [0.0, 0.0], t, np.full(50, 10.0))["x"]
    late = t[2:] - 0.03
    assert y[2:] == pytest.approx(2 * late - 4 / 3 * (1 - np.exp(-1.5 * late)), abs=1e-9)
    assert not run(c, values, [0.0, 0.0], t, np.full(50, 3.9))[:, 1].any()


def test_effects_may_be_made_for_a_plant(tmp_path: Path) -> None:
    text = OWN.replace("EFFECTS = (", "def effects(plant):\n  return (") + "\n"
    assert len(load_effects(write(tmp_path, text), plant("rolling"))) == 2


HEAD = "from hoopd.plants.effects.base import Effect, EffectParameter\n"
ONE = HEAD + 'EFFECTS = [Effect("{name}", (EffectParameter("A", "N m", 0.0, 0.0, 1.0),), {rest})]\n'


@pytest.mark.parametrize(
    ("text", "key", "reason"),
    [
        ("x = = 1", "line 1", "SyntaxError: invalid syntax"),
        ("import nothing_of_this_name", "line 1", "ModuleNotFoundError"),
        ("a = 1", "", "defines neither EFFECTS nor effects(plant)"),
        ("EFFECTS = 3", "", "defines neither EFFECTS"),
        ("EFFECTS = (3,)", "EFFECTS", "an Effect is expected, not int"),
        ("\ndef effects(plant):\n  return plant.nothing", "line 3", "AttributeError"),
        ("def effects(plant):\n  raise SystemExit(0)", "line 2", "SystemExit"),
        ("import itertools\nEFFECTS = itertools.count()", "EFFECTS", "more than 1000 effects"),
        (HEAD + "EFFECTS = [Effect(None, ())]", "None", "a name is slot.effect"),
        (HEAD + "EFFECTS = [Effect('a.b', 5)]", "a.b", "a tuple of EffectParameter"),
        (HEAD + "EFFECTS = [Effect('a.b', (EffectParameter(5, 'm', 0, 0, 1),))]", "a.b", "are text, not 5, 'm'"),
        (HEAD + "EFFECTS = [Effect('a.b', (EffectParameter('A', 'm', 0, 0, 1e999),))]", "a.b", "A: neutral, low, high"),
        (ONE.format(name="a.b", rest="substeps=10**9"), "a.b", "substeps: a whole number"),
        (ONE.format(name="a.b", rest="statement=5"), "a.b", "statement: must be text"),
        (ONE.format(name="Wind", rest=""), "Wind", "a name is slot.effect"),
        (ONE.format(name="a.b", rest="force=lambda s, e: {'theta': s.p['mx']}"), "a.b", "line 2 KeyError: 'mx'"),
        (ONE.format(name="a.b", rest="force=lambda s, e: {'theta': s.phi}"), "a.b", "the plant has no 'phi'"),
        (ONE.format(name="a.b", rest="force=lambda s, e: {'theta': e.B}"), "a.b", "no attribute 'B'"),
        (ONE.format(name="a.b", rest="lag='T'"), "a.b", "'T' is none of A"),
        (ONE.format(name="a.b", rest="latency={'chi': 'A'}"), "a.b", "'chi' is none of theta, dtheta, psi"),
        (
            ONE.format(name="a.b", rest="force=lambda s, e: {'theta': 1.0}"),
            "a.b",
            "its neutral values change the model",
        ),
        (ONE.format(name="a.b", rest="force=lambda s, e: {'theta': e.A / (e.A - 0.1)}"), "a.b", "not finite"),
        (HEAD + 'EFFECTS = [Effect("a.b", (EffectParameter("A", "m", 0, 2, 1),))]', "line 2", "range 2 to 1"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, text: str, key: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        load_effects(write(tmp_path, text), plant("rolling"))
    assert caught.value.key == key
    assert reason in caught.value.reason
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.py"):
        load_effects(tmp_path / "none.py", plant("rolling"))
