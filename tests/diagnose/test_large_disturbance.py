"""Something acts, though no law is proven: a disturbance far beyond the usual is no reason to call a model right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shared import shared_path

from hoopd import lab
from hoopd.diagnose.proof.large_disturbance import FEWEST_READINGS
from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS, Diagnosis
from hoopd.diagnose.report.headline import certainty_sentence, next_sentence, verdict_sentence
from hoopd.diagnose.report.plain_words import plain_sentence
from hoopd.diagnose.report.sentences import lawless

G, STEP_S, FINE_S = 9.81, 1.0 / 15.0, 1e-3


def fallen(folder: Path, drag: float, seed: int, shake: float = 0.0) -> Path:
    """A body of 1 kg that falls 2.8 s with c v |v| of drag, as a camera with errors of 4 cm sees it; `shake`: what the
    picture jumps by, kept for two frames."""
    random, h, v, seen = np.random.default_rng(seed), 46.0, -1.0, []
    for _ in range(42):
        seen.append(h)
        for _ in range(round(STEP_S / FINE_S)):
            v += FINE_S * (-G - drag * v * abs(v))
            h += FINE_S * v
    error = 0.04 * random.normal(size=42) + shake * np.repeat(random.normal(size=21), 2)
    t = STEP_S * np.arange(42)
    path = folder / f"fall_{seed}.csv"
    np.savetxt(path, np.column_stack([t, np.array(seen) + error]), delimiter=",", header="t,h", comments="", fmt="%.6f")
    return path


def diagnosed(*paths: Path) -> Diagnosis:
    """With the last third of each held out."""
    return lab.diagnose([lab.load(str(one), plant="falling") for one in paths], plant="falling").diagnosis


def test_one_fall_through_air_is_not_explained_by_free_fall(tmp_path: Path) -> None:
    found = diagnosed(fallen(tmp_path, 0.018, 1))
    assert found.verdict == "unknown_physics"
    (one,) = found.effects
    assert one.name == "unknown.body" and one.nearest == "body.quadratic_drag" and one.in_model is False
    size, usual = one.parameters["size"], one.parameters["usual"]
    assert size.value is not None and usual.value is not None and size.value > 3.0 * usual.value and size.unit == "N"
    assert one.status == "untested"
    assert found.location.slot == "body" and found.location.channel == "h"
    assert found.unexplained is not None and found.unexplained.curve is None and lawless(found)
    # what a law would take is not called invisible, and the candidates add up with what is told
    assert "body.quadratic_drag" not in found.power
    chances = {one.name: one.probability for one in found.candidates}
    assert (chances[NONE_OF_THESE] or 0.0) > 0.95 and one.probability is None
    assert sum(p for p in chances.values() if p is not None) <= 1.0 + 1e-6 and chances.get(PARAMETERS, 0.0) < 0.1
    for text in (verdict_sentence(found), plain_sentence(found)):
        assert "body.quadratic_drag" in text
    assert "nats" in certainty_sentence(found) and "very law" not in certainty_sentence(found)
    assert "record the same once more" in next_sentence(found)


def test_a_fall_without_drag_is_consistent(tmp_path: Path) -> None:
    for seed in range(4):
        assert diagnosed(fallen(tmp_path, 0.0, seed)).verdict == "consistent"


def test_what_lasts_for_two_readings_may_be_their_own_error(tmp_path: Path) -> None:
    found = diagnosed(fallen(tmp_path, 0.0, 5, shake=0.15))
    assert found.verdict == "consistent" and FEWEST_READINGS > 2


@pytest.mark.parametrize("number", [1, 2])
def test_the_air_is_told_of_a_real_light_ball_and_not_of_a_heavy_one(number: int) -> None:
    light = diagnosed(shared_path(f"plants/drop_tennis_ball_{number}.csv"))
    assert light.verdict == "unknown_physics" and light.effects[0].nearest == "body.quadratic_drag"
    heavy = diagnosed(shared_path(f"plants/drop_bowling_ball_{number}.csv"))
    assert heavy.verdict == "consistent"
