"""Plants that nobody builds: equations, names, numbers and units of files, and words of `--columns`.

Rules of this file: pure; whole files that a reader of YAML accepts, so that what is tried lies behind it.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import yaml

from hoopd.files.expressions import FUNCTIONS
from hoopd.files.yaml_text import text_of

NAMES = ("x", "y", "a", "m", "F", "t", "p", "u", "pi", "dx", "sin", "replaced", "T", "id", "nan", "inf", "e1", "x_t")
# Cyrillic, Greek and full-width letters, accents and marks that turn the writing round.
LOOKALIKES = ("\u0445", "\u03bc", "\uff58", "x\u0301", "x\u202e", "\u2112", "x\u200b", "\u00b5", "\u0131", "\u017f")
STRANGE = (*LOOKALIKES, "__class__", "__import__", "_x", "x.y", "lambda", "None", "x" * 41, "", " ", "x y", "0x", "1")
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-308, 5e-324, 1e308, -1e308, 1e30, 1e-30, 1e12, 1e-12, 2**63, 0.1, 1e6)
UNITS = (
    "", "-", "m", "rad", "N", "kg", "N s/m", "kg m2", "m^9", "Gm9", "Gm9 Gm9 Gm9 Gm9 Gm9", "um-9 um-9 um-9 um-9",
    "1/s", "m/", "/", "//s", "m" * 61, "m^99", "parsec", "deg", "turn", "rpm", "%", "m m m m m m m m m", "s/(m", "kn",
)  # fmt: skip
PARTS = (
    "__import__('os')", "x.__class__", "().__class__", "[x]", "x;y", "x=y", "x==y", "lambda: x", "x if x else y",
    "1e400", "1e308*1e308", "10^10^10", "2^2^2^2^2^2", "x^y", "x^-10", "x^0.5", "(-1)^0.5", "0/0", "1/0", "1/(x-x)",
    "sqrt(-1)", "sqrt(-x^2-1)", "exp(exp(exp(exp(9))))", "exp(1e30)", "min()", "min(x)", "max(x,x,x,x,x,x,x,x,x,x)",
    "sin", "sin()", "sin(x,x)", "(" * 70 + "x" + ")" * 70, "-" * 70 + "x", "+".join(["x"] * 900), "*".join("x" * 900),
    "%", "x\u00b2", "\u2212x", "\u00d7", "1_000", "0x10", "1e", ".", "..", "1.2.3", "x'", "x''", "0*x''", "x''-x''",
    "x''^2", "abs(x'')", "sign(x'')*x''", "x''/x''", "x'''''''", "t", "t^10", "sin(t*1e30)", "1/t", "sqrt(t-1)",
    '"x"', "\n", "\0",
)  # fmt: skip


def file_of(sound: Path, rng: random.Random) -> bytes:
    """A plant file with some things odd, or a random one."""
    tree = _random_plant(rng) if rng.random() < 0.6 else yaml.safe_load(sound.read_text())
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        rng.choice(_WAYS)(tree, rng)
    return text_of(tree).encode(errors="replace")


def columns(rng: random.Random) -> str:
    """Words of `--columns` that may mean something or nothing."""
    names = (
        "F",
        "x",
        "t",
        "Force",
        "Position",
        "Time",
        "Time [ms]",
        "state",
        "x_t",
        "F_t",
        "5",
        "nan",
        "1e308",
        "1e999",
    )
    signals = ("F", "x") * 8 + ("t", "x_t", "F_t", "nan", *STRANGE[:3])
    pairs = []
    for _ in range(rng.choice((1, 2, 2, 2, 3, 400))):
        column = rng.choice((*names, *names, *STRANGE, "9" * 400, ":", "=", "a=b"))
        unit = rng.choice(("", "", ":N", ":mm", ":kN", ":", "::", *(f":{text}" for text in UNITS)))
        pairs.append(f"{rng.choice(signals)}{rng.choice('=' * 30 + ':')}{column}{unit}")
    return ",".join(pairs)


def model_of(sound: Path, rng: random.Random) -> bytes:
    """A model file of a plant that is another one, none, or has other parameters."""
    tree = yaml.safe_load(sound.read_text())
    plants: tuple[Any, ...] = (
        "axis",
        "pendulum",
        "tanks",
        "falling",
        "hoop",
        "nobody",
        "./sound_plant.yaml",
        "../x.py",
        "",
    )
    tree["plant"] = rng.choice((*plants, "x.py", "/dev/zero", "folder", "fifo", 1, None, ["axis"], {"axis": 1}))
    entries = {name: {"value": rng.choice(NUMBERS), "unit": rng.choice(UNITS)} for name in rng.choices(NAMES, k=4)}
    if rng.random() < 0.7:
        tree["parameters"] = {"M": {"value": 1.0, "unit": "kg"}, "Fv": {"value": 1.0, "unit": "N s/m"}} | entries
    for key in ("structure", "device", "effects"):
        if rng.random() < 0.6:
            tree.pop(key, None)
    return text_of(tree).encode(errors="replace")


# ------------------------------------------------------------------------------------------------ random plants


# Most of them in a random plant: coordinates, states, inputs, parameters, channels.
MOST = {"q": 8, "h": 20, "F": 8, "c": 40}


def _random_plant(rng: random.Random) -> dict[str, Any]:
    """A plant of some size whose equations have the right form and any laws."""
    counts = {"q": (0, 1, 1, 2, 3, 8), "h": (0, 0, 1, 5, 20), "F": (0, 1, 1, 2, 8), "k": (0, 1, 5, 30, 100)}
    names = {letter: [f"{letter}{i}" for i in range(rng.choice(sizes))] for letter, sizes in counts.items()}
    # a parameter without a unit takes the units off what it stands beside
    known = [f"one*{name}" for name in (*names["q"], *(f"{q}'" for q in names["q"]), "t")]
    known += [*names["h"], *names["F"], *names["k"], "pi"]
    left = {q: " + ".join(f"{_number(rng)}*one*{q2}''" for q2 in _with(q, names["q"], rng)) for q in names["q"]}
    left |= {h: f"{_number(rng)}*one*{h}'" for h in names["h"]}
    forces = iter(names["F"])
    channels = {f"c{i}": _expression(rng, known, 2) for i in range(rng.choice((0, 1, 3, 40)))}
    return {
        "schema": "hoopd.plant/1",
        "name": "random",
        "coordinates": {q: {"unit": rng.choice(("m", "rad"))} for q in names["q"]},
        "states": {h: {"unit": ""} for h in names["h"]},
        "inputs": {F: {"unit": "", "limit": rng.choice((10.0, 1e12, 1e-12))} for F in names["F"]},
        "parameters": {"one": {"value": 1.0, "unit": "", "held": True}}
        | {k: {"value": rng.choice((1.0, 1.0, *NUMBERS)), "unit": ""} for k in names["k"][:99]},
        "equations": {
            name: f"{text} = one*{_expression(rng, known, rng.choice((1, 3, 8)))} + {next(forces, 0)}"
            for name, text in left.items()
        },
        "channels": {} if rng.random() < 0.5 else channels,
        "sample_time_s": rng.choice((0.02, 0.02, 0.02, 2e-6, 1.0, 3600.0)),
    }


def _with(q: str, others: list[str], rng: random.Random) -> list[str]:
    """The coordinate's own acceleration, and sometimes that of all others."""
    return [q, *(one for one in others if one != q)] if rng.random() < 0.3 else [q]


def _number(rng: random.Random) -> str:
    return rng.choice(("1", "1", "1", "2.5", "1e-30", "1e30", "1e12", "-1", "0", "(2 + sin(one*t))"))


def _expression(rng: random.Random, known: list[str], depth: int) -> str:
    if not depth or rng.random() < 0.2:
        return rng.choice((*known, *known, "1", "1e-30", "1e30", "0", "-1"))
    name = rng.choice(("+", "-", "*", "/", "^", *FUNCTIONS))
    parts = [_expression(rng, known, depth - 1) for _ in range(FUNCTIONS.get(name, (2, 2))[0])]
    if name == "^":
        return f"({parts[0]})^{rng.choice(('2', '10', '-10', '0.5', '0', '-1'))}"
    return f"{name}({', '.join(parts)})" if name in FUNCTIONS else f"({parts[0]} {name} {parts[1]})"


# ------------------------------------------------------------------------------------------------ oddities

SECTIONS = ("coordinates", "states", "inputs", "parameters", "channels", "slots")


def _section(tree: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    found = tree.setdefault(rng.choice(SECTIONS), {})
    return found if isinstance(found, dict) else {}


def _names(tree: dict[str, Any], rng: random.Random) -> None:
    """A name that is another's, a word of ours, or none; in the equations, too."""
    section = _section(tree, rng)
    old, new = rng.choice([*section, "x"]), rng.choice((*NAMES, *STRANGE))
    if old in section:
        section[new] = section.pop(old)
    equations = tree["equations"]
    if rng.random() < 0.7:
        tree["equations"] = {new if one == old else one: text.replace(old, new) for one, text in equations.items()}


def _numbers(tree: dict[str, Any], rng: random.Random) -> None:
    for entry in _section(tree, rng).values():
        if isinstance(entry, dict):
            entry[rng.choice(("value", "limit", "usual", "usual_rate"))] = rng.choice(NUMBERS)


def _bounds(tree: dict[str, Any], rng: random.Random) -> None:
    for entry in tree.get("parameters", {}).values():
        if isinstance(entry, dict):
            entry["bounds"] = [rng.choice((*NUMBERS, float("inf"), float("-inf"), float("nan"))) for _ in range(2)]


def _units(tree: dict[str, Any], rng: random.Random) -> None:
    section = _section(tree, rng)
    for name, entry in section.items():
        if rng.random() < 0.5:
            text = rng.choice((*UNITS, *LOOKALIKES))
            section[name] = entry | {"unit": text} if isinstance(entry, dict) else f"{rng.choice(NUMBERS)} {text}"


def _equations(tree: dict[str, Any], rng: random.Random) -> None:
    equations = tree["equations"]
    for name in rng.sample(sorted(equations), min(len(equations), 2)):
        text, part = equations[name], rng.choice((*PARTS, *STRANGE))
        where = rng.randrange(len(text) + 1)
        equations[name] = rng.choice(
            (part, f"{text} + {part}", f"{part} = {text}", f"{text[:where]}{part}{text[where:]}")
        )


def _reading(tree: dict[str, Any], rng: random.Random) -> None:
    tree["energy"] = rng.choice((*PARTS, "M*x'^2/2", "x", "0", ""))
    tree["channels"] = {rng.choice((*NAMES, *STRANGE)): {"reads": rng.choice((*PARTS, "x", "x'"))} for _ in range(3)}


def _many(tree: dict[str, Any], rng: random.Random) -> None:
    section, count = _section(tree, rng), rng.choice((7, 101, 10_000))
    section |= {f"n{i}": "1 m" for i in range(count)}


def _slots(tree: dict[str, Any], rng: random.Random) -> None:
    one = {"kind": rng.choice(("actuator", "body", "sensor", "push", "x")), "coordinate": rng.choice((*NAMES, "q0"))}
    tree["slots"] = {
        rng.choice((*NAMES, *STRANGE)): one | rng.choice(({}, {"channels": ["x", "x"]}, {"device": "camera"}))
    }


def _gone(tree: dict[str, Any], rng: random.Random) -> None:
    tree.pop(rng.choice(sorted(set(tree) - {"equations"}) or ["x"]), None)


def _time(tree: dict[str, Any], rng: random.Random) -> None:
    tree["sample_time_s"] = rng.choice(NUMBERS)


_WAYS: tuple[Any, ...] = (
    _names,
    _numbers,
    _bounds,
    _units,
    _equations,
    _equations,
    _reading,
    _many,
    _slots,
    _gone,
    _time,
)
