"""The printed line of the next experiment runs where the recordings were made."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import typer
from diagnose.examples import coulomb

from hoopd.commands.cli import app
from hoopd.diagnose.case import Case
from hoopd.diagnose.proof.experiment_menu import command
from hoopd.diagnose.run import _played_where_recorded
from hoopd.plants.hoop.loop.experiment_plan import Plan


def case(*rigs: bool) -> Case:
    return cast(Case, SimpleNamespace(train=[SimpleNamespace(recording=SimpleNamespace(rig=rig)) for rig in rigs]))


@pytest.mark.parametrize(("rigs", "sim"), [((True, True), True), ((True, False), False), ((False,), False)])
def test_what_was_recorded_on_the_rig_is_recorded_there_again(rigs: tuple[bool, ...], sim: bool) -> None:
    planned = coulomb()[0].next_experiment
    told = _played_where_recorded(planned, case(*rigs))
    assert planned is not None and told is not None
    assert told.command == planned.command + (" --sim" if sim else "")


def test_the_line_for_the_rig_is_understood_by_the_command() -> None:
    words = f"{command(Plan('chirp', 20.0, amplitude_nm=0.06, low_hz=0.1, high_hz=1.0))} --sim".split()
    group: Any = typer.main.get_command(app)
    experiment = group.commands[words[1]]
    given = experiment.make_context("experiment", words[2:], resilient_parsing=False).params
    assert given["sim"] is True and given["amplitude_nm"] == 0.06
