"""Every command's options are one frozen record: the command line is made of it, with its defaults and its help."""

from __future__ import annotations

import inspect
import re
from dataclasses import MISSING, FrozenInstanceError, dataclass, fields
from pathlib import Path
from typing import get_type_hints

import pytest
import typer
from typer.testing import CliRunner

from hoopd import lab
from hoopd.commands.cli import COMMANDS, app
from hoopd.commands.design_options import poles_from
from hoopd.commands.options.declaration import (
    add_command,
    argument,
    command_of,
    from_python,
    names_of,
    option,
    option_name,
    python_names,
)
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
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
    line, heard = typer.Typer(), list[Asked]()

    @line.callback()
    def program() -> None:
        """A program of several commands."""

    def say(options: Asked) -> None:
        heard.append(options)

    add_command(line, Asked, say, panel="Words")
    return CliRunner().invoke(line, ["say", *words]).exit_code, heard


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


# ---------------------------------------------------------------------------------------------- three listings

# What the Python interface has beside the options of the command: settings that no option has, and a former name.
BESIDE = {"design": {"method"}, "simulate": {"window", "torque"}, "experiment": {"rig"}}
IN_PYTHON = {
    "linearize": LinearizeOptions,
    "design": DesignOptions,
    "diagnose": DiagnoseOptions,
    "fit": FitOptions,
    "simulate": SimulateOptions,
    "experiment": ExperimentOptions,
    "trajectory": TrajectoryOptions,
}


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_the_command_line_has_the_options_of_its_record(record: type) -> None:
    name = next(run.__name__ for commands in COMMANDS.values() for one, run in commands if one is record)
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    assert [one.name for one in command.params] == [one.name for one in fields(record)]
    for one, parameter in zip(fields(record), command.params, strict=True):
        assert parameter.opts[0] == (one.metadata["names"] or (one.name,))[0].partition("/")[0]
        assert parameter.help == one.metadata["help"]


@pytest.mark.parametrize("name", IN_PYTHON)
def test_the_python_interface_has_the_options_of_the_record(name: str) -> None:
    record, signature = IN_PYTHON[name], inspect.signature(getattr(lab, name))
    names = python_names(record)
    assert set(signature.parameters) == names.keys() | BESIDE.get(name, set())
    assert all(one.kind is not inspect.Parameter.VAR_KEYWORD for one in signature.parameters.values())
    usual = {one.name: one.default for one in fields(record)}
    for called, parameter in signature.parameters.items():
        assert parameter.annotation is not inspect.Parameter.empty, called
        if called in names and parameter.default not in (None, inspect.Parameter.empty):
            assert parameter.default == usual[names[called]], called


def test_arguments_of_python_are_what_the_command_line_would_have_made() -> None:
    given = from_python(
        DesignOptions, law="lqg", poles=(-2 + 1j, -2 - 1j), weights={"x": 0.01, "F": 5.0}, at={"F": 0.5}
    )
    assert poles_from(given.poles) == (-2 + 1j, -2 - 1j)
    assert (given.weights, given.at, given.filter_ratio) == (("x=0.01", "F=5.0"), "F=0.5", 15.0)
    assert from_python(LinearizeOptions, outputs="x").outputs == ("x",)
    assert from_python(DesignOptions, law="pid", lead=[3.0, 5.0]).lead == (3.0, 5.0)
    with pytest.raises(KeyError):
        from_python(DesignOptions, law="pid", out="law.yaml")


@pytest.mark.parametrize("name", IN_PYTHON)
def test_the_pages_tell_the_options_of_the_record(name: str) -> None:
    told = inspect.getdoc(getattr(lab, name)) or ""
    entries = {one for names in re.findall(r"^(\w+(?:, \w+)*) : ", told, re.MULTILINE) for one in names.split(", ")}
    assert python_names(IN_PYTHON[name]).keys() <= entries
