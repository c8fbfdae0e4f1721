"""What can be said to the program: every configuration key and every command's options, as the code itself has them.

Rules of this file: nothing is listed by hand, so that a new key or option is tried by itself.
"""

from __future__ import annotations

import random
import re
import types
import typing
from collections.abc import Iterator
from functools import cache
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec
import typer.main
from msgspec import Meta

from hoopd.commands.cli import app
from hoopd.core.layout import DEFAULT_LAYOUT, layout_to_table
from hoopd.files.shipped import defaults_folder
from hoopd.plants.effects.library import library
from hoopd.plants.model_file import effects_plant, load_model
from hoopd.shell.config import Config, SimEffect, SimFault
from hoopd.sim.faults import KINDS

WORDS = ("x", "direct", "hoop", "/dev/null", "tcp/127.0.0.1:1", "controllers/pid.yaml", "models/thesis.yaml")
COUNTS = (0, 1, 1, 2, 3)


class Key(NamedTuple):
    """A configuration key and its type."""

    name: str  # a.b.c
    kind: Any


@cache
def settings() -> tuple[Key, ...]:
    """Every key that holds a value."""
    return tuple(_keys(Config, ""))


def _keys(record: Any, above: str) -> Iterator[Key]:
    for name, kind in typing.get_type_hints(record, include_extras=True).items():
        path = f"{above}.{name}" if above else name
        if _is_record(kind):
            yield from _keys(kind, path)
        yield Key(path, kind)


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, msgspec.Struct) or hasattr(kind, "__dataclass_fields__"))


def plausible(kind: Any, rng: random.Random) -> Any:
    """A value that the type takes, at its bounds as often as between them."""
    meta: list[Any] = []
    if get_origin(kind) is typing.Annotated:
        kind, *meta = get_args(kind)
    if special := _special(kind, rng):
        return special
    if _is_record(kind):
        hints = typing.get_type_hints(kind, include_extras=True)
        return {name: plausible(hint, rng) for name, hint in hints.items()}
    return _plain(kind, [m for m in meta if isinstance(m, Meta)], rng)


def _special(kind: Any, rng: random.Random) -> dict[str, Any] | None:
    """Faults and effects have tables of their own beside the types."""
    if kind is SimFault:
        name = rng.choice(sorted(KINDS))
        params = {
            key: rng.choice((0.0, 0.5, 2.0, -1.0, "x", 1e9)) for key in sorted(KINDS[name].params) if rng.random() < 0.8
        }
        return {"kind": name, "at_s": rng.choice((0.0, 0.02)), "for_s": rng.choice((0.0, 1.0)), "params": params}
    if kind is SimEffect:
        effect = library(effects_plant(load_model(defaults_folder() / "models/hoop.yaml")))
        name = rng.choice(sorted(effect))
        sizes = {p.name: p.neutral + rng.choice((0.1, 1.0, -1.0)) * p.size for p in effect[name].parameters}
        return {"name": name, "parameters": sizes}
    return None


def _plain(kind: Any, bounds: list[Meta], rng: random.Random) -> Any:
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return plausible(rng.choice(args), rng)
    if origin is Literal:
        return rng.choice(args)
    if origin in (list, tuple, dict):
        return _several(origin, args, rng)
    if kind in (int, float):
        return _number(kind, bounds, rng)
    return {bool: rng.random() < 0.5, type(None): None}.get(kind, rng.choice(WORDS))


def _several(origin: Any, args: tuple[Any, ...], rng: random.Random) -> Any:
    if origin is dict:
        return {rng.choice(WORDS): rng.choice((0.0, 1.0, "x")) for _ in range(rng.choice(COUNTS))}
    if origin is tuple and Ellipsis not in args:
        return [plausible(arg, rng) for arg in args]
    return [plausible(args[0], rng) for _ in range(rng.choice(COUNTS))]


def _number(kind: Any, bounds: list[Meta], rng: random.Random) -> Any:
    low, high = 0.0, 10.0
    for meta in bounds:
        low = next((float(x) for x in (meta.ge, meta.gt) if x is not None), low)
        high = next((float(x) for x in (meta.le, meta.lt) if x is not None), max(high, low + 1.0))
    value = rng.choice((low, high, rng.uniform(low, high), rng.uniform(low, min(high, low + 1.0)), low + 1e-9))
    return round(value) if kind is int else value


def layout_table() -> dict[str, Any]:
    """The frames' layout as a file holds it."""
    return layout_to_table(DEFAULT_LAYOUT)


class Option(NamedTuple):
    """An option or argument of a command."""

    flag: str  # empty: an argument
    kind: Any  # its annotation
    required: bool
    metavar: str
    words: tuple[str, ...]  # of its help, among them the values that it knows


@cache
def commands() -> dict[str, tuple[Option, ...]]:
    """Every command with its options; the empty name is the daemon."""
    group: Any = typer.main.get_command(app)
    named = {name: tuple(map(_option, command.params)) for name, command in group.commands.items()}
    return {"": tuple(map(_option, group.params))} | named


def _option(parameter: Any) -> Option:
    flags = [text for text in parameter.opts if text.startswith("--")]
    words = tuple(re.findall(r"[a-z_][a-z_0-9.=]*", parameter.help or ""))
    kind = parameter.type_descriptor.annotation
    return Option(flags[0] if flags else "", kind, bool(parameter.required), parameter.metavar or "", words or WORDS)
