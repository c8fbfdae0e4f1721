"""The page of all commands and their options, from the program's own parser."""

from __future__ import annotations

import re
from typing import Any

import typer

from docpages.markdown import code, plain, sections, table
from hoopd.commands.cli import app
from hoopd.commands.options.help_page import default_of, metavar_of

INTRODUCTION = """# The command line

Every command with its arguments and options, as `hoopd COMMAND --help` tells them. Numbers are SI, angles in rad.
`--json FILE` writes what is printed, with every digit."""
PAGE = re.compile(r"\s*\(docs/[^)]*\)")  # names a page of the checkout: here the reader is on the site


def page() -> str:
    """The whole page: the daemon first, then groups of commands as on the page of help."""
    program: Any = typer.main.get_command(app)
    groups: dict[str, list[str]] = {}
    for name, command in program.commands.items():
        groups.setdefault(command.rich_help_panel or "Commands", []).append(_command(name, command))
    daemon = sections(
        "## hoopd", "Without a command it runs the daemon.", "```\nhoopd [OPTIONS]\n```", _options(program)
    )
    parts = [part for group, commands in groups.items() for part in (f"## {group}", *commands)]
    return sections(INTRODUCTION, f"{program.epilog}", daemon, *parts)


def _command(name: str, command: Any) -> str:
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    usage = " ".join(["hoopd", name, *map(_argument, arguments), "[OPTIONS]"])
    told = table(["argument", "meaning"], [[code(_metavar(one)), one.help or ""] for one in arguments if one.help])
    has_told = any(one.help for one in arguments)
    text = PAGE.sub("", " ".join((command.help or "").split()))
    return sections(f"### hoopd {name}", text, f"```\n{usage}\n```", told if has_told else "", _options(command))


def _argument(one: Any) -> str:
    name = _metavar(one) + ("..." if one.nargs == -1 else "")
    return name if one.required else f"[{name}]"


def _metavar(one: Any) -> str:
    return str(one.metavar or one.name.upper())


def _options(command: Any) -> str:
    rows = [
        [", ".join(map(code, [*one.opts, *one.secondary_opts])), _takes(one), _default(one), plain(one.help or "")]
        for one in command.params
        if one.param_type_name == "option" and not getattr(one, "hidden", False)
    ]
    return table(["option", "takes", "default", "meaning"], rows) if rows else ""


def _takes(one: Any) -> str:
    if one.is_flag:
        return ""
    low, high = getattr(one, "min", None), getattr(one, "max", None)
    bounds = f"{low:g} to {high:g}" if None not in (low, high) else f"from {low:g}" if low is not None else ""
    return " ".join(part for part in (code(metavar_of(one)), bounds, "repeatable" if one.multiple else "") if part)


def _default(one: Any) -> str:
    return code(told) if (told := default_of(one)) else ""
