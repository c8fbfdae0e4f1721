"""Fields of an options record: names on the command line, help, limits; the record as a command of typer, and from
the arguments of the Python interface.

Rules of this file: nothing here knows a command.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields, is_dataclass
from math import isfinite
from numbers import Real
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import typer

from hoopd.commands.options.help_page import HelpCommand
from hoopd.files.reading import InputError

# Types of fields that are numbers.
NUMBERS = (int, float, int | None, float | None)

Record = TypeVar("Record")
REQUIRED: Any = MISSING


def argument(text: str, *, metavar: str | None = None, default: Any = REQUIRED, python: bool | str = True) -> Any:
    """A field that is given by its place; `text` is its help, `python` as of an `option`."""
    more = {"metavar": metavar}
    return field(default=default, metadata={"names": (), "help": text, "more": more, "python": python})


def option(
    *names: str,
    text: str,
    default: Any = None,
    metavar: str | None = None,
    read: Callable[[str], Any] | None = None,
    python: bool | str = True,
    **limits: float,
) -> Any:
    """A field that is given by name (`--name`); REQUIRED has no default.

    `read`: from the command line's text to the field's value (InputError), where the text is no value of its type; the
    default is then given as text, too. `python`: what the Python interface calls it, unless that is the option's own
    name; False where that has no such argument, because it is handed objects in place of files. `limits`: typer's min
    and max.
    """
    metadata = {"names": names, "help": text, "more": {"metavar": metavar, **limits}, "read": read, "text": default}
    metadata["python"] = python
    return field(default=default if read is None else read(default), metadata=metadata)


def option_name(record: type, name: str) -> str:
    """How a field is called on the command line; KeyError for a field that it has not."""
    known = {one.name: one for one in fields(record)}
    names = known[name].metadata["names"]
    return str(names[0]) if names else name.upper()


def python_names(record: type) -> dict[str, str]:
    """Fields of a record by what the Python interface calls them: `--sample-time` is `sample_time`."""
    found = {}
    for one in fields(record):
        called, names = one.metadata["python"], one.metadata["names"]
        if called is not False:
            own = names[0].partition("/")[0].lstrip("-").replace("-", "_") if names else one.name
            found[called if isinstance(called, str) else own] = one.name
    return found


def from_python(record: type[Record], **given: Any) -> Record:
    """A record from arguments of the Python interface: None is the record's default, a mapping stands for
    "NAME=VALUE,...", one name for a tuple of names. InputError for NaN and infinities."""
    known, hints = python_names(record), get_type_hints(record)
    told = {known[name]: value for name, value in given.items() if value is not None}
    for name, value in told.items():
        _check_finite(option_name(record, name), value)
        if hints[name] in NUMBERS and not isinstance(value, Real):
            raise InputError(option_name(record, name), "", f"must be a number, not {value!r}")
    return record(**{name: _as_field(value, hints[name]) for name, value in told.items()})


def _as_field(value: Any, hint: Any) -> Any:
    """What the command line would have made of it."""
    if isinstance(value, Mapping):
        value = [f"{name}={one}" for name, one in value.items()]
    if _is_list(hint):
        return (value,) if isinstance(value, str) else tuple(value)
    if hint in (str, str | None) and not isinstance(value, str):
        return ",".join(map(str, value))
    return tuple(value) if isinstance(value, list) else value


def words_of(options: Any) -> list[str]:
    """A record as words of the command line; what has its default is left out."""
    words: list[str] = []
    for one in fields(options):
        value = getattr(options, one.name)
        if value == one.default:
            continue
        name = one.metadata["names"][:1]
        if isinstance(value, bool):
            words += name
        elif isinstance(value, tuple) and one.metadata.get("read"):
            words += [*name, ",".join(map(str, value))]
        else:
            words += [word for each in (value if isinstance(value, tuple) else (value,)) for word in (*name, str(each))]
    return words


def add_command(
    app: typer.Typer,
    record: type[Record],
    execute: Callable[[Record], None],
    *,
    panel: str,
    negative_numbers: bool = False,
) -> None:
    """Add a command, called as `execute` is, whose options are the fields of a record and whose help is its docstring.

    `negative_numbers`: what begins with a minus may be a value. TypeError: the record is no dataclass, or a field was
    declared by neither `argument` nor `option`.
    """
    settings = {"ignore_unknown_options": True} if negative_numbers else None
    command = command_of(record, execute)
    app.command(cls=HelpCommand, context_settings=settings, rich_help_panel=panel)(command)


def command_of(record: type[Record], execute: Callable[..., None], *, context: bool = False) -> Callable[..., None]:
    """A function that typer can read: a parameter for every field of the record; `context`: typer's own comes first."""
    if not is_dataclass(record):
        raise TypeError(f"{record.__name__} is no dataclass")
    hints = get_type_hints(record)
    readers = {one.name: _reader(one, hints[one.name]) for one in fields(record)}

    def command(**values: Any) -> None:
        before = [values.pop("context")] if context else []
        for name, value in values.items():
            _check_finite(option_name(record, name), value)
        execute(*before, record(**{name: readers[name](value) for name, value in values.items()}))

    parameters = [_parameter(one, hints[one.name]) for one in fields(record)]
    if context:
        parameters.insert(0, inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))
    command.__name__, command.__doc__ = execute.__name__, record.__doc__
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # typer reads it
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command


def _parameter(one: Field[Any], hint: Any) -> inspect.Parameter:
    if "help" not in one.metadata:
        raise TypeError(f"{one.name} is declared by neither argument nor option")
    more = {key: value for key, value in one.metadata["more"].items() if value is not None}
    names, text = one.metadata["names"], one.metadata["help"]
    info = typer.Option(*names, help=text, **more) if names else typer.Argument(help=text, **more)
    default = inspect.Parameter.empty if one.default is MISSING else one.default
    if one.metadata.get("read"):
        hint, default = str, one.metadata["text"]
    elif _is_list(hint):
        hint = list[get_args(hint)[0]]  # type: ignore[misc]  # what typer takes for a repeatable option
        default = inspect.Parameter.empty if one.default is MISSING else [*one.default]
    return inspect.Parameter(
        one.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[hint, info]
    )


def _reader(one: Field[Any], hint: Any) -> Callable[[Any], Any]:
    """From what typer hands over to the value of a field."""
    if one.metadata.get("read"):
        return one.metadata["read"]  # type: ignore[no-any-return]
    return (lambda given: tuple(given or ())) if _is_list(hint) else lambda given: given


def _check_finite(name: str, value: Any) -> None:
    """InputError for NaN and infinities: no option means them, and comparisons with limits let NaN pass."""
    for number in value if isinstance(value, list | tuple) else (value,):
        if isinstance(number, float) and not isfinite(number):
            raise InputError(name, "", f"must be a finite number, not {number}")


def names_of(text: str) -> tuple[str, ...]:
    """The names in "dtheta,psi"."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _is_list(hint: Any) -> bool:
    """A tuple of any length is a repeatable option."""
    return get_origin(hint) is tuple and get_args(hint)[1:] == (Ellipsis,)
