"""A case by its number: files, spoiled, and the command that reads them.

Rules of this file: the same seed and number give the same case, byte for byte; every file and whatever the command may
write stands in the case's own folder, which is also where it runs.
"""

from __future__ import annotations

import os
import random
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from fuzzing import damage, plants, schema, sound
from fuzzing.containers import INSIDE
from hoopd.files.yaml_text import text_of

TEXT_KINDS = frozenset(kind for kind, ending in sound.EXTENSIONS.items() if ending in (".yaml", ".py", ".csv"))
# How often a kind comes, beside the others.
SHARES = {
    "key": 30,
    "command": 10,
    "configuration": 12,
    "model": 10,
    "plant": 6,
    "controller": 8,
    "experiment table": 5,
    "frame layout": 6,
    "identified model": 4,
    "law": 2,
    "effects": 2,
    "mcap": 14,
    "mat": 8,
    "hdf5": 8,
    "csv": 8,
    "plant csv": 6,
    "plant mcap": 4,
    "plant hdf5": 4,
    "plant mat": 4,
    "plant file": 20,
    "plant program": 2,
    "plant run": 3,
    "other model": 4,
    "struct mat": 4,
    "table mat": 4,
    "columns": 6,
    "positions csv": 3,
    "positions npy": 3,
    "picture": 4,
}
# How often a file is spoiled from within; the texts of plant files are spoiled as "plant".
INSIDE_SHARES = {"plant file": 0.98, "other model": 0.8}
# Virtual time, and nothing that another program could see; in the end, where it wins.
RUN = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "0.1")
ALONE = ("--set", "telemetry.enabled=false", "--set", "commands.enabled=false")
REAL = ("--sim", "--camera", "direct", "--duration", "0.3")
# Commands that only a process of its own may try: they talk to a daemon, or start a rig in real time.
OUTSIDE = frozenset(("check", "arm", "disarm", "stop", "clear", "ref", "tune", "status"))


class Case(NamedTuple):
    """One case."""

    kind: str
    arguments: list[str]


def make(
    seed: str, number: int, sounds: Path, folder: Path, *, whole: bool, kinds: tuple[str, ...] = tuple(SHARES)
) -> Case:
    """The case of one of these kinds, its files in `folder`; `whole`: for a process of its own."""
    rng = random.Random(f"{seed}/{'process' if whole else 'case'}/{number}")
    _surroundings(folder)
    kind = rng.choices(kinds, [SHARES[one] for one in kinds])[0]
    if kind == "key":
        return Case(kind, _keys(rng, whole=whole))
    if kind == "command":
        return Case(kind, _command(rng, sounds, folder, whole=whole))
    if kind == "columns":
        return Case(kind, _columns(rng, sounds))
    path = folder / f"spoiled{sound.EXTENSIONS[kind]}"
    damage.put(path, _content(kind, sounds, rng), rng)
    return Case(kind, rng.choice(readings(kind, str(path), sounds)))


def _surroundings(folder: Path) -> None:
    """What rubbish may name: a pipe, a folder, a link to itself."""
    os.mkfifo(folder / "fifo")
    os.mkfifo(folder / "fifo.h5")
    (folder / "folder").mkdir()
    (folder / "link").symlink_to("link")


@cache
def _contents(sounds: Path) -> dict[str, bytes]:
    return {kind: sound.path_of(sounds, kind).read_bytes() for kind in sound.EXTENSIONS}


def _content(kind: str, sounds: Path, rng: random.Random) -> bytes:
    if kind in INSIDE and rng.random() < INSIDE_SHARES.get(kind, 0.5):
        return INSIDE[kind](sound.path_of(sounds, kind), rng)
    contents = _contents(sounds)
    others = [data for other, data in contents.items() if other != kind]
    return damage.spoil(contents[kind], rng, text=kind in TEXT_KINDS, others=others)


def readings(kind: str, path: str, sounds: Path) -> tuple[list[str], ...]:
    """Commands that read a file of this kind."""
    model, record = str(sound.path_of(sounds, "model")), str(sound.path_of(sounds, "csv"))
    long = str(sound.path_of(sounds, "long csv"))
    run, to_run = [*RUN, *ALONE], lambda key: [*RUN, "--set", f"{key}={path}", *ALONE]
    recordings = (["convert", path, "out.csv"], ["simulate", "--model", model, "--input", path])
    of_plant, columns = str(sound.path_of(sounds, "plant csv")), ("--columns", "F=Force:kN,x=Position:mm")
    of_axis = ["convert", path, "out.mcap", "--plant", "axis"]
    of_any = [str(sound.path_of(sounds, "plant run")), "--plant", path]
    by_name = ["--columns", "t=Time:ms,F=Force:kN,x=Position:mm"]
    ways: dict[str, tuple[list[str], ...]] = {
        "configuration": ([*run, "--config", path], ["status", "--config", path]),
        "model": (
            to_run("device.model"),
            to_run("sim.model"),
            ["linearize", "--model", path],
            ["simulate", "--model", path, "--input", record],
        ),
        "plant": (
            ["plant", "show", path],
            ["convert", of_plant, "out.mcap", "--plant", path, *columns],
            ["fit", of_plant, "--plant", path, *columns],
        ),
        "plant file": (
            ["plant", "show", path],
            ["plant", "check", path],
            ["fit", *of_any],
            ["simulate", "--input", *of_any],
            ["identify", *of_any, "--order", "2"],
            ["linearize", "--plant", path],
            ["design", "lqg", "--plant", path],
            ["experiment", "steps", "--plant", path, "--duration", "1", "--out", "out.mcap"],
        ),
        "plant program": (["plant", "show", path], ["plant", "check", path], ["linearize", "--plant", path]),
        "plant run": ([*of_axis, "--columns", "F=F0,x=q0"],),
        "other model": (
            ["linearize", "--model", path],
            ["linearize", "--model", path, "--plant", "axis"],
            ["simulate", "--model", path, "--input", of_plant, *columns],
            ["diagnose", of_plant, "--model", path, *columns],
        ),
        "struct mat": ([*of_axis, *by_name],),
        "table mat": ([*of_axis, *by_name],),
        "controller": (to_run("control.file"),),
        "experiment table": (to_run("control.file"),),
        "frame layout": (to_run("serial.layout"),),
        "law": (to_run("control.law"),),
        "identified model": (["design", "identified", "--model", model, "--identified", path],),
        "effects": (["diagnose", long, "--effects", path],),
        "mcap": (["replay", path], ["convert", path, "out.mat"], ["calibrate", "--positions", path], *recordings),
        "plant csv": ([*of_axis, *columns], [*of_axis, "--columns", "F,x,-"]),
        "plant mcap": (of_axis, ["convert", path, "out.h5"]),
        "plant hdf5": (of_axis, ["convert", path, "out.csv"]),
        "plant mat": (of_axis, [*of_axis, "--columns", "F=F:kN,x=x:mm", "--hold", "linear"]),
        "positions csv": (["calibrate", "--positions", path],),
        "positions npy": (["calibrate", "--positions", path],),
        "picture": (["calibrate", path],),
    }
    return ways.get(kind, recordings)


def _keys(rng: random.Random, *, whole: bool) -> list[str]:
    """Keys of the configuration, with rubbish or with values at their bounds."""
    sets: list[str] = []
    live = False
    for _ in range(rng.choice((1, 1, 2, 4))):
        key = rng.choice(schema.settings())
        text = damage.value(rng) if rng.random() < 0.5 else _flow(schema.plausible(key.kind, rng))
        sets += ["--set", f"{key.name}={text}"]
        live |= key.name.startswith(("telemetry", "commands", "log"))
    if live and whole:
        return [*REAL, "--set", "telemetry.endpoint=unixsock-stream/bench.sock", *_unseen(sets)]
    return [*RUN, *_unseen(sets), *ALONE]


def _columns(rng: random.Random, sounds: Path) -> list[str]:
    """A sound file with any words about its columns."""
    path = str(sound.path_of(sounds, rng.choice(("plant csv", "plant mat", "plant mcap", "struct mat", "table mat"))))
    command = rng.choice((["convert", path, "out.csv"], ["fit", path], ["simulate", "--input", path]))
    return _unseen([*command, "--plant", "axis", "--columns", plants.columns(rng)])


def _unseen(sets: list[str]) -> list[str]:
    """Without what no argument of a program can hold."""
    return [text.replace("\0", "\\0").encode(errors="replace").decode() for text in sets]


def _flow(value: Any) -> str:
    return text_of(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()


def _command(rng: random.Random, sounds: Path, folder: Path, *, whole: bool) -> list[str]:
    """A command with some of its options, sound ones and others."""
    names = [name for name in schema.commands() if whole or name not in OUTSIDE]
    name = rng.choice(names)
    arguments = [name] if name else [*RUN]
    if name in ("check", "experiment"):
        arguments += ["--sim"] + (["--speed", "max", "--camera", "direct"] if name == "experiment" else [])
    for option in schema.commands()[name]:
        if option.required or rng.random() < 0.25:
            arguments += _option(option, rng, sounds, folder)
    if name == "":
        arguments += ALONE
    return _unseen(arguments)


def _option(option: schema.Option, rng: random.Random, sounds: Path, folder: Path) -> list[str]:
    text = _said(option, rng, sounds, folder) if rng.random() < 0.7 else damage.value(rng)
    if not option.flag:
        return [text]
    if option.kind is bool:
        return [option.flag]
    return [option.flag, *text.split("\n")] if isinstance(option.kind, type) else [option.flag, text]


def _said(option: schema.Option, rng: random.Random, sounds: Path, folder: Path) -> str:
    """A value that the option may take: a file of its kind, a word of its help, a number."""
    meant = {
        "REC": ("csv", "mat", "mcap", "hdf5"),
        "IN": ("csv", "mat", "mcap", "hdf5"),
        "MODEL": ("model",),
        "CONTROLLER": ("controller",),
        "FILE.py": ("effects",),
        "KEY=VALUE": (),
    }
    kinds = meant.get(option.metavar.split(".")[0] if option.metavar != "FILE.py" else "FILE.py", ())
    if option.flag in ("--out", "--write", "--figure", "--json", "--report", "--save", "--record"):
        return rng.choice(
            ("out.yaml", "out.png", "out.json", "out.mcap", "folder", "fifo", "no/where.csv", ".", "link")
        )
    if option.metavar == "KEY=VALUE":
        key = rng.choice(schema.settings())
        return f"{key.name}={_flow(schema.plausible(key.kind, rng))}"
    if kinds:
        return str(sound.path_of(sounds, rng.choice(kinds))) + rng.choice(("", "", "", "@0:1", ":Exp1", "@x:y"))
    if "int" in str(option.kind) or "float" in str(option.kind):
        return rng.choice(("0", "1", "-1", "0.02", "1e9", "1e-9", "nan", "inf", "-inf", "1e400", "9" * 400, "x", "2,3"))
    return rng.choice((*option.words, "", "x=1", "psi=0.1", "a=b=c", ","))
