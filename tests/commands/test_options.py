"""Every command's options are one frozen record: the command line is made of it, with its defaults and its help."""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError, dataclass, fields
from pathlib import Path
from typing import get_type_hints

import pytest
import typer
from typer.testing import CliRunner

from hoopd.commands.cli import COMMANDS
from hoopd.commands.options.declaration import add_command, argument, command_of, names_of, option, option_name
from hoopd.commands.options.fit import FitOptions
from hoopd.files.reading import InputError

RECORDS = [record for commands in COMMANDS.values() for record, _ in commands]


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Say it."""

    source: Path = argument("Where from.", metavar="IN")
    names: tuple[str, ...] = option("--names", text="Which.", default="a,b", read=names_of)
    more: tuple[str, ...] = option("--more", text="Repeatable.", default=())
    step_s: float = option("--step", text="Seconds.", default=0.5, min=0.1)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_field_says_what_it_is(record: type) -> None:
    assert record.__doc__ and record.__dataclass_params__.frozen  # type: ignore[attr-defined]
    for one in fields(record):
        assert one.metadata["help"].endswith((".", ")")), one.name
        assert option_name(record, one.name)


def said(*words: str) -> tuple[int, list[Asked]]:
    """Exit code and what the command was handed."""
    app, heard = typer.Typer(), list[Asked]()

    @app.callback()
    def program() -> None:
        """A program of several commands."""

    def say(options: Asked) -> None:
        heard.append(options)

    add_command(app, Asked, say, panel="Words")
    return CliRunner().invoke(app, ["say", *words]).exit_code, heard


def test_a_command_is_handed_its_record() -> None:
    assert said("here") == (0, [Asked(source=Path("here"))])
    code, (asked,) = said("here", "--names", "c, d", "--more", "x", "--more", "y", "--step", "2")
    assert (code, asked) == (0, Asked(source=Path("here"), names=("c", "d"), more=("x", "y"), step_s=2.0))
    assert said() == (2, []) and said("here", "--step", "0") == (2, [])


def numbers_of(record: type) -> list[tuple[str, type]]:
    """Names of the fields that take floats, and their types."""
    return [(name, kind) for name, kind in get_type_hints(record).items() if "float" in str(kind)]


NUMBERS = [(record, name, "tuple" in str(kind)) for record in RECORDS for name, kind in numbers_of(record)]


@pytest.mark.parametrize("number", ["nan", "inf"])
@pytest.mark.parametrize(("record", "name", "pair"), NUMBERS, ids=lambda one: getattr(one, "__name__", str(one)))
def test_no_number_may_be_infinite_or_none(record: type, name: str, pair: bool, number: str) -> None:
    """NaN passes every comparison with a limit: it is refused by the option's own name, before any command begins."""
    app = typer.Typer()
    heard: list[object] = []

    @app.callback()
    def program() -> None:
        """A program of several commands."""

    def act(options: object) -> None:
        heard.append(options)

    add_command(app, record, act, panel="Words")
    called = option_name(record, name)
    needed = [one for one in fields(record) if one.default is MISSING and one.name != name]
    given = [word for one in needed for word in (*one.metadata["names"][:1], "1")]
    told = [called, *["1"] * pair, number] if called.startswith("-") else [number]
    result = CliRunner().invoke(app, ["act", *given, *told])
    reason = str(result.exception) if isinstance(result.exception, InputError) else result.output
    assert not heard and result.exit_code != 0
    assert called in reason and "required" not in reason


def test_a_record_cannot_be_changed_and_needs_declared_fields() -> None:
    with pytest.raises(FrozenInstanceError):
        Asked(source=Path()).step_s = 1.0  # type: ignore[misc]
    assert FitOptions(recordings=("a.mcap",)).free == ()

    @dataclass(frozen=True)
    class Bare:
        """No help."""

        name: str = ""

    with pytest.raises(TypeError, match="name is declared by neither"):
        command_of(Bare, print)
    with pytest.raises(TypeError, match="no dataclass"):
        command_of(int, print)
