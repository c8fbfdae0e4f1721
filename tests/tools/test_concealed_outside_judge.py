"""The judge of physics outside the library: its oracle, the nearest name of the library, and what counts as found."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import cases, recipes, report  # noqa: E402
from concealed.batch import scale_inputs  # noqa: E402
from concealed.judged import Judged  # noqa: E402
from concealed.metrics import summary  # noqa: E402
from concealed.outside import judge  # noqa: E402
from concealed.outside.nearest import fine, nearest  # noqa: E402
from concealed.outside.oracle import oracle  # noqa: E402
from concealed.recipes import Wish, draw  # noqa: E402


def made(name: str, size: float, **fixed: float) -> cases.Case:
    """A calm case of 4 s recordings with a mechanism of a size."""
    recipe = draw(Wish("outside", (name,), calm=True), (8, 1))
    for recording in range(3):
        scale_inputs([recipe], recording)
    recipe.fixed[name] |= fixed
    recipe.sizes[name], recipe.nats[name] = size, 100.0
    traces = cases.traces([recipe])
    return cases._case(recipe, [traces[recipe.identifier, index] for index in range(3)])


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, name, 4.0)


def told(case: cases.Case) -> dict[str, Any]:
    return oracle(case.files, case.signals, case.answer)


def told_channels(size: float) -> dict[str, Any]:
    """What the oracle tells of the held-out recording of a presliding friction of this size."""
    found = told(made("outside.dahl", size, q=0.5))
    assert set(found["fit"]["heldout"]) == {"holdout.csv"}
    assert set(found["fit"]["train"]) == {"train_1.csv", "train_2.csv"}
    (channels,) = found["fit"]["heldout"].values()
    return channels


def test_the_oracle_gains_by_the_truth(short: None) -> None:
    channels = told_channels(8e-3)
    # a calm case: what is left with the truth is noise
    assert channels["psi"]["with_effects"] > channels["psi"]["base_refit"] + 1
    assert channels["theta_rate"]["with_effects"] > max(95.0, channels["theta_rate"]["base_refit"] + 1)


@pytest.mark.proof
def test_the_oracle_gains_nothing_by_nothing(short: None) -> None:
    channels = told_channels(0.0)
    assert channels["psi"]["with_effects"] == channels["psi"]["base_refit"]


@pytest.mark.proof
def test_the_oracle_knows_what_a_mechanism_remembers_where_a_window_begins(short: None) -> None:
    """A motor that is warm already: taken for cold it would be simulated hardly better than without."""
    (channels,) = told(made("outside.motor_heating", 1.0, T=6.0))["fit"]["heldout"].values()
    assert channels["theta_rate"]["base_refit"] < 95.0
    assert min(one["with_effects"] for one in channels.values()) > 98.0


@pytest.mark.proof
def test_the_nearest_name_is_the_limit_of_a_mechanism(short: None) -> None:
    """Presliding over a way of next to nothing is Coulomb's friction; over a long one it is not."""
    made_up = [made("outside.dahl", 4e-3, q=q) for q in (1e-3, 2.0)]
    near, far = (nearest(case.files, case.signals, case.answer) for case in made_up)
    assert near["name"] in ("hoop.coulomb_friction", "hoop.stribeck_friction")
    assert near["left_nats"] < 0.1 * near["nats"]
    assert near["left"]["camera.latency"] > 0.5 * near["nats"]
    assert far["left"]["hoop.coulomb_friction"] > 0.3 * far["nats"]


def test_the_past_of_a_window_is_the_true_motion() -> None:
    t = 0.02 * np.arange(50)
    states = np.stack((np.sin(3 * t), 3 * np.cos(3 * t), np.cos(2 * t), -2 * np.sin(2 * t)), axis=1)
    motion = fine(states)[25 * 8 :]
    when = 0.0025 * np.arange(len(motion))
    assert np.abs(motion[:, 0] - np.sin(3 * when)).max() < 1e-6
    assert np.abs(motion[:, 3] + 2 * np.sin(2 * when)).max() < 1e-3
    assert np.allclose(fine(states)[0, 0], states[0, 0] - 0.5 * states[0, 1])


def outside(*said: dict[str, Any], gain: float | None = 2.0, kept: float = 1.9, left: float = 50.0) -> Judged:
    """A case of a mechanism on the hoop that remembers, and what was said of it."""
    law = {"slots": ["hoop", "actuator"], "memory": "way", "depends_on": ["theta"], "formula": "", "source": ""}
    answer = {
        "family": "outside",
        "effects": [{"name": "outside.dahl", "slot": "hoop", "nats": 80.0, "law": law}],
        "flags": {"two_level": False, "closed_loop": False},
        "disturbance": {"rms_nm": [1e-3, 1e-4]},
    }

    def fit(points: float) -> dict[str, Any]:
        return {"heldout": {"holdout.csv": {"psi": {"base_refit": 90.0, "with_effects": 90.0 + points}}}}

    found = {"verdict": "missing_physics" if said else "parameters", "effects": list(said), "fit": fit(kept)}
    best = None if gain is None else {"fit": fit(gain), "nearest": {"name": "hoop.coulomb_friction", "left_nats": left}}
    return Judged(answer, found, 1.0, best)


UNKNOWN = {"name": "unknown.hoop"}
MADE_OF_PARTS = {"name": "hoop.dahl_of_theta", "formula": "-F y", "probability": 0.9}
COULOMB = {"name": "hoop.coulomb_friction"}


def test_what_counts_as_found_and_what_as_wrong() -> None:
    assert judge.found(outside(UNKNOWN)) and not judge.formula(outside(UNKNOWN))
    assert judge.found(outside({"name": "unknown.actuator"}))  # no recording tells it from the hoop's
    assert not judge.found(outside({"name": "unknown.camera"}))
    assert judge.formula(outside(MADE_OF_PARTS)) and not judge.sure_names(outside(MADE_OF_PARTS))
    assert judge.sure_names(outside(UNKNOWN, COULOMB)) == ["hoop.coulomb_friction"]
    assert judge.sure_names(outside({**COULOMB, "probability": 0.4})) == []
    assert judge.sure_names(outside({**COULOMB, "probability": 0.6})) == ["hoop.coulomb_friction"]
    failed = Judged(outside().answer, None)
    assert not judge.found(failed) and judge.gained(failed) == 0.0


def test_a_share_counts_where_there_is_a_point_to_keep() -> None:
    assert judge.share(outside(UNKNOWN)) == pytest.approx(0.95)
    assert judge.share(outside(UNKNOWN, gain=0.9)) is None
    assert judge.share(outside(UNKNOWN, gain=0.9, kept=0.45), judge.GAINS_LITTLE) == pytest.approx(0.5)
    assert judge.share(outside(UNKNOWN, gain=None)) is None


def test_figures_of_the_family_and_their_tables() -> None:
    said = [
        outside(UNKNOWN),
        outside(COULOMB, kept=-1.0),
        outside(COULOMB, left=2.0),
        outside(MADE_OF_PARTS),
        outside(),
    ]
    result = judge.summary(said)
    rates = {key: (one["k"], one["n"]) for key, one in result["rates"].items()}
    assert rates["found"] == rates["found_memory"] == (2, 5)
    assert rates["sure_wrong"] == (2, 5)
    assert rates["sure_wrong_tellable"] == (1, 4)
    assert rates["kept"] == (4, 5)
    assert rates["silent"] == (1, 5)
    assert rates["worse"] == (1, 4)
    assert rates["without_probability"] == (3, 4)
    (row,) = result["by_kind"]
    assert (row["n"], row["found"], row["said"][0]) == (5, 2, "hoop.coulomb_friction")
    shown = report.markdown(summary(said, {}), "head")
    assert "| declared unknown or given a formula, at the right slot | 40 % (2/5, 5-85) |" in shown
    assert "| dahl | hoop | yes | 5 |" in shown
    # other families have no such tables
    assert "Outside the library" not in report.markdown(summary([], {}), "head")
