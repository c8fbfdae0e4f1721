"""What users copied from the pages of the last version goes on working; what has moved says where it is now."""

from __future__ import annotations

import re
import shutil
import sys
import warnings
from pathlib import Path

import pytest

from hoopd import moved
from hoopd.files.shipped import defaults_folder
from hoopd.lab.recordings import experiment
from hoopd.recording import save
from hoopd.recording.recording import from_columns

HERE = Path(__file__).parent / "data/before_the_move"
EXAMPLES = re.findall(r"^## (\S+)\n\n```python\n(.*?)```", (HERE / "examples.md").read_text("utf-8"), re.S | re.M)
# What has moved since, by a word of the example in which it stands.
MOVED = {
    "loopshaping_pid": ["hoopd.design.loopshaping is now", "hoopd.modelfiles is now"],
    "operating_point": ["hoopd.design.analysis.transfer_function is now", "hoopd.design.operating is now"],
    "DryFriction": ["hoopd.physics.effects.base is now"],
    "SLIDE": ["hoopd.physics.declared is now", "DeclaredPlant is now Plant"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the examples name."""
    place = tmp_path_factory.mktemp("yesterday")
    shutil.copy(HERE / "01-lqg.mcap", place / "run-0001.mcap")
    shutil.copy(HERE / "01-lqg.mcap", place / "torn.mcap")
    run = experiment("prbs", duration=6, seed=1)
    rows = {name: getattr(run, name) for name in ("t", "u", "theta", "dtheta", "psi")}
    save(run, place / "run.mcap")
    for name in ("my.csv", "chirp.mat"):
        save(from_columns(rows), place / name)  # as other programs write them: all of a row at once
    shutil.copy(next(HERE.glob("*.h5")), place / "experiments.h5")
    return place


@pytest.mark.parametrize(("page", "text"), EXAMPLES, ids=[f"{page}-{k}" for k, (page, _) in enumerate(EXAMPLES)])
def test_an_example_of_the_last_version_runs(
    page: str, text: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    space: dict[str, object] = {"path": defaults_folder() / "models/hoop.yaml", "__name__": "example"}
    if 'load("experiments.h5:Exp2")' in text:
        text = text.replace("Exp2", "Exp1")  # the file of the tests has one
    for old in [name for name, module in sys.modules.items() if isinstance(module, moved.Moved)]:
        del sys.modules[old]  # it warns where it is first imported, and another test may have done so
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        exec(compile(text, page, "exec"), space)
    told = {str(one.message) for one in said if one.category is DeprecationWarning}
    for word, begins in MOVED.items():
        if word in text:
            for begin in begins:
                assert any(one.startswith(begin) for one in told), (begin, told)


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 10
