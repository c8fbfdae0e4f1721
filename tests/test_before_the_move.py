"""Runs that an earlier state of the program recorded: they replay to the same bits and load with the same columns."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import before_the_move as before
import pytest

from hoopd.daemon.replay import replay

DIGESTS = json.loads((before.KEPT / "digests.json").read_text())
PATHS = before.recordings()
RUNS = [path for path in PATHS if path.suffix == ".mcap"]


# What replays otherwise by a decision that the changelog names, from where on, and in which field first.
DECIDED = {
    # the hoop's wanted speed goes on from one reference to another, and back to the bottom
    "01-lqg.mcap": "row 82 at 1.6400 s: u",
    "05-hidden-effects.mcap": "row 100 at 2.0000 s: u",
    "06-effects-written-back.mcap": "row 3 at 0.0600 s: x_hat",  # dry friction that holds is given to the covariance
}


def named(path: Path) -> str:
    return path.name


def test_every_recording_is_still_there() -> None:
    assert sorted(DIGESTS) == [path.name for path in PATHS]
    assert len(RUNS) >= 10
    assert sum(path.stat().st_size for path in PATHS) < 2_000_000


@pytest.mark.parametrize("path", PATHS, ids=named)
def test_the_file_and_its_columns_are_the_same(path: Path) -> None:
    kept = DIGESTS[path.name]
    assert hashlib.sha256(path.read_bytes()).hexdigest() == kept["file"]
    assert before.columns(path) == kept["columns"]


@pytest.mark.parametrize("path", RUNS, ids=named)
def test_what_a_run_holds_is_read_as_before(path: Path) -> None:
    kept = {name: value for name, value in DIGESTS[path.name].items() if name not in ("file", "columns")}
    assert before.contents(path) == kept


@pytest.mark.parametrize("path", RUNS, ids=named)
def test_a_run_replays_to_the_same_bits(path: Path) -> None:
    result = replay(path, run_law=path.name == "12-own-law.mcap")
    if path.name in DECIDED:
        assert (result["equal"], result["first_difference"]) == (False, DECIDED[path.name])
        return
    assert result["equal"], result["first_difference"]
    assert (result["ticks"], result["lost"]) == (DIGESTS[path.name]["rows"], "")
