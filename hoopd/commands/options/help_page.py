"""The page of help of a command, readable in 80 columns: names on the left, what they mean beside or below them.

Rules of this file: no word is cut, and brackets in a text are text, not markup. What draws is imported when a page is
asked for: every start of the program reads this file.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

from typer.core import TyperCommand

from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text

# A longer name has its meaning below it: most are shorter, and the other columns of 80 are left for words.
NAME_COLUMNS: Final = 27
WORDS: Final = {Path: "FILE", float: "NUMBER", int: "WHOLE NUMBER", str: "TEXT"}


class HelpCommand(TyperCommand):
    """A command that shows this page and refuses an option of one value that is given twice."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As click does, which takes the last value of an option and forgets the others without a word."""
        asked = list(args)
        rest = super().parse_args(ctx, args)  # ends where a page of help is asked for
        if ctx.resilient_parsing:
            return rest
        given = Counter(self.make_parser(ctx).parse_args(args=[*asked])[2])  # which empties the list
        for parameter, count in given.items():
            if count > 1 and not (parameter.multiple or getattr(parameter, "is_flag", True)):
                raise InputError(_typed(parameter, asked), "", f"is given {count} times{_but(parameter)}")
        return rest

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print it; typer's own lets the longest name of an option decide how narrow all texts become."""
        from rich.console import Console, Group
        from rich.padding import Padding
        from rich.panel import Panel
        from rich.text import Text

        console = Console(highlight=False)
        told = {kind: [one for one in self.get_params(ctx) if _is_told(one, kind)] for kind in ("argument", "option")}
        usage = " ".join([ctx.command_path, *map(_usage, told["argument"]), "[OPTIONS]"])
        console.print(Padding(Text(f"Usage: {usage}\n\n{' '.join((self.help or '').split())}"), 1))
        for kind, parameters in told.items():
            if parameters:
                rows = Group(*map(_row, parameters))
                console.print(Panel(rows, title=f"{kind.capitalize()}s", title_align="left", border_style="dim"))


def _typed(parameter: Any, words: list[str]) -> str:
    """The name by which an option was given; of several the first that it has."""
    names = {word.partition("=")[0] for word in words}
    typed = [name for name in parameter.opts if name in names]
    return str(typed[0] if len(typed) == 1 else parameter.opts[0])


def _but(parameter: Any) -> str:
    """How an option is given once."""
    metavar = metavar_of(parameter)
    is_list = metavar == "NAMES" or "," in metavar
    return ": all values stand in one, behind commas (A,B)" if is_list else ", and has one value"


def _is_told(parameter: Any, kind: str) -> bool:
    return bool(parameter.param_type_name == kind and not getattr(parameter, "hidden", False))


def _usage(argument: Any) -> str:
    name = metavar_of(argument)
    return name if argument.required else f"[{name}]"


def _row(parameter: Any) -> RenderableType:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    name, text = _name(parameter), Text(parameter.help or "")
    if default := _shown_default(parameter):
        text.append(f" [default: {default}]", style="dim")
    grid = Table.grid(padding=(0, 1))
    grid.add_column(width=NAME_COLUMNS)
    grid.add_column()
    if len(name) <= NAME_COLUMNS:
        grid.add_row(name, text)
        return grid
    grid.add_row("", text)
    return Group(name, grid)


def _name(parameter: Any) -> Text:
    from rich.text import Text

    metavar = metavar_of(parameter)
    if parameter.param_type_name == "argument":
        return Text(metavar, style="bold cyan")
    name = Text(", ".join([*parameter.opts, *parameter.secondary_opts]), style="bold cyan")
    return name.append(f" {metavar}", style="yellow") if metavar else name


def metavar_of(parameter: Any) -> str:
    """What a parameter takes, in one word; empty for a switch."""
    if getattr(parameter, "is_flag", False):
        return ""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar or parameter.name.upper())
    hint = parameter.type_descriptor.annotation if hasattr(parameter, "type_descriptor") else str
    known = (WORDS[part] for part in (hint, *get_args(hint)) if part in WORDS)
    return str(parameter.metavar or next(known, "TEXT"))


def default_of(parameter: Any) -> str:
    """What holds where an option is not given; empty where that is nothing, and for a switch."""
    value = parameter.default() if callable(parameter.default) else parameter.default
    nothing = value is None or value is False or value in ([], (), "") or getattr(parameter, "is_flag", False)
    return "" if nothing else str(value)


def _shown_default(parameter: Any) -> str:
    """The same; of two switches that say the opposite the one that holds."""
    if parameter.param_type_name == "option" and parameter.secondary_opts:
        return str((parameter.opts if parameter.default else parameter.secondary_opts)[0])
    return default_of(parameter)
