"""The pages of help at 80 columns: every word of every option is there and whole."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from hoopd.commands.cli import app, main
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.options.shared import SLICE
from hoopd.files.reading import InputError

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]


def test_an_option_of_one_value_that_is_given_twice_is_refused() -> None:
    """The first value would be forgotten: an input that drives the plant."""
    twice = CliRunner().invoke(app, ["identify", "a.csv", "--input", "u", "--output", "y", "--inputs", "d"])
    assert isinstance(twice.exception, InputError) and "--inputs: is given 2 times" in str(twice.exception)
    for words, said in (
        (("identify", "a.csv", "--output", "A", "--output=B"), "--output: is given 2 times: all values stand in one"),
        (("linearize", "--plant", "axis", "--at", "F=0", "--at", "x=0"), "--at: is given 2 times: all values stand in"),
        (("linearize", "--plant", "axis", "--psi", "1", "--psi", "2"), "--psi: is given 2 times, and has one value"),
    ):
        assert said in str(CliRunner().invoke(app, [*words]).exception)
    asked = ["identify", "a.csv", "--input", "u", "--inputs", "d", "--help"]
    assert CliRunner().invoke(app, asked).exit_code == 0  # a page of help is shown first
    several = ["fit", "no.csv", "--holdout", "a.csv", "--holdout", "b.csv", "--json", "x.json"]
    assert "times" not in CliRunner().invoke(app, several).output


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_word_of_a_page_is_cut(name: str) -> None:
    result = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "80", "TERM": "dumb"})
    assert result.exit_code == 0
    assert max(map(len, result.output.splitlines())) <= 80 and "…" not in result.output
    words = result.output.replace("│", " ").split()
    for parameter in COMMANDS[name].params:
        wanted = [*parameter.opts[: parameter.param_type_name == "option"], *(parameter.help or "").split()]
        assert set(wanted) <= {*words, *(word.rstrip(",") for word in words)}, parameter.name


def test_what_a_recording_may_be_is_told_whole_and_defaults_are() -> None:
    result = CliRunner().invoke(app, ["diagnose", "--help"], env={"COLUMNS": "80"})
    assert SLICE in result.output and "Usage: " in result.output and "diagnose REC... [OPTIONS]" in result.output
    assert "[default: --free-run]" in result.output and "[default: zero]" in result.output
    assert option_name(DiagnoseOptions, "seed") + " WHOLE NUMBER" in result.output


def test_a_start_does_not_draw() -> None:
    """What draws a page takes a tenth of a second to import; a daemon never needs it."""
    code = "import sys, hoopd.commands.cli; print('rich.panel' in sys.modules or 'rich.table' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=os.environ, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("words", "page"),
    [(["simulate", "run.mcap"], "hoopd simulate"), (["fit", "--wrong"], "hoopd fit"), (["--no"], "hoopd")],
)
def test_a_wrong_option_leads_to_the_page_of_its_command(
    words: list[str], page: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["hoopd", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.endswith(f"(see {page} --help)\n") and told.count("\n") == 1
