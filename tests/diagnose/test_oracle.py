"""The oracle is told the names and has everything else as a search has it: what is set aside, and the scans."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from hoopd.diagnose.search.excluded_intervals import CountedData
from hoopd.recording.formats import load

TOOLS = str(Path(__file__).resolve().parents[2] / "tools")
if TOOLS not in sys.path:
    sys.path.append(TOOLS)

from concealed import cases, recipes  # noqa: E402
from concealed.oracle import oracle as adapted  # noqa: E402

import hoopd.diagnose.oracle as told  # noqa: E402


def files_of(name: str, size: float) -> dict[str, bytes]:
    """A made-up case of 8 s each, with an effect of this size."""
    with pytest.MonkeyPatch.context() as patch:
        for recording in recipes.RECORDINGS:
            patch.setitem(recipes.LENGTH_S, recording, 8.0)
        recipe = recipes.draw(recipes.Wish("single", (name,), calm=True), (3, 0))
        recipe.sizes[name] = size
        for recording in range(3):
            cases.scale_inputs([recipe], recording)
        made = cases.traces([recipe])
    return {f"{n}.csv": cases.csv_bytes(made[recipe.identifier, i]) for i, n in enumerate(recipes.RECORDINGS)}


def gains(found: dict[str, Any]) -> list[float]:
    rows = [channel for one in found["heldout"].values() for channel in one.values()]
    return [row["with_effects"] - row["base_refit"] for row in rows]


@pytest.mark.proof
def test_a_scanned_effect_is_found_at_its_frequency() -> None:
    found = adapted(files_of("frame.vibration", 0.6), ["frame.vibration"])
    assert "error" not in found, found
    json.dumps(found, allow_nan=False)
    assert max(gains(found["fit"])) > 3.0


def test_what_the_search_sets_aside_is_set_aside_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = {}
    for name, data in files_of("hoop.coulomb_friction", 0.008).items():
        (tmp_path / name).write_bytes(data)
        loaded[name] = load(tmp_path / name)
    seen: list[Any] = []
    monkeypatch.setattr(told, "training", lambda case, train, nominal: seen.append(train) or _as_is(case, train))
    monkeypatch.setattr(told, "proving", lambda held, base: seen.append(held) or CountedData(held, held))
    told.oracle([loaded["train_1.csv"]], loaded["holdout.csv"], ["hoop.coulomb_friction", "camera.outliers"])
    assert [{one.recording for one in part} for part in seen] == [{"train_1.csv"}, {"holdout.csv"}]


def _as_is(case: Any, train: Any) -> Any:
    nominal = told.fit(train, (), case.values, move=False)
    return CountedData(train, train), nominal, told.fit(train, (), case.values, like=nominal, noise=nominal.noise)
