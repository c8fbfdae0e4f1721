"""The sealed device of the bench of campaigns: a run is whole, or ends at a limit as the daemon's law ends it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
sys.path[:0] = [str(TOOLS), str(TOOLS / "bench")]

from concealed.plant import SAMPLE_S  # noqa: E402
from learning import device as sealed  # noqa: E402
from learning.loops import truth_text  # noqa: E402

from hoopd.plants.model_file import load_model  # noqa: E402
from hoopd.recording import load  # noqa: E402

LENGTH = 400


@pytest.fixture(scope="module")
def device() -> sealed.SealedDevice:
    return sealed.SealedDevice((), (5.0, 40.0), (3, 0, 1))


def back_and_forth(torque_nm: float) -> np.ndarray:
    return torque_nm * np.where(np.arange(LENGTH) % 50 < 25, 1.0, -1.0)


@pytest.fixture
def played(device: sealed.SealedDevice, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., np.ndarray]:
    """The torque that a run recorded."""

    def play(torque: np.ndarray) -> np.ndarray:
        monkeypatch.setattr(sealed, "torque_of", lambda score: torque.copy())
        seconds = device.record(["prbs"], 1, tmp_path / "run.mcap")["ended_at_s"]
        recording = load(tmp_path / "run.mcap")
        assert seconds == pytest.approx(len(recording) * SAMPLE_S)
        return recording.signals["u"].values

    return play


def test_a_run_inside_the_limits_is_played_whole(
    device: sealed.SealedDevice, played: Callable[..., np.ndarray]
) -> None:
    torque = back_and_forth(0.03)
    assert played(torque) == pytest.approx(torque)
    assert device.runs[-1].most_speed_rad_s < sealed.LIMITS.speed_limit_rad_s


@pytest.mark.parametrize(("torque_nm", "limit"), [(0.1, "speed"), (0.15, "angle")])
def test_a_run_ends_at_a_limit(
    device: sealed.SealedDevice, played: Callable[..., np.ndarray], torque_nm: float, limit: str
) -> None:
    """A torque one way turns the hoop faster and faster, a larger one takes the ball along before that."""
    torque = played(np.full(LENGTH, torque_nm))
    assert (
        len(torque) < LENGTH and np.count_nonzero(torque == 0.0) == sealed.COAST and not torque[-sealed.COAST :].any()
    )
    run, limits = device.runs[-1], sealed.LIMITS
    speed, angle = run.most_speed_rad_s / limits.speed_limit_rad_s, run.most_angle_rad / limits.angle_limit_rad
    assert 1.0 < (speed if limit == "speed" else angle) < 1.15
    assert (angle if limit == "speed" else speed) < 1.0


def test_the_truth_of_a_device_is_a_model_file(tmp_path: Path) -> None:
    device = sealed.SealedDevice(("hoop.coulomb_friction",), (5.0, 40.0), (3, 1))
    answer = device.answer()
    path = tmp_path / "truth.yaml"
    path.write_text(truth_text(answer))
    model = load_model(path)
    assert model.values() == pytest.approx({name: answer["base"][name] for name in model.values()})
    (effect,) = model.effects
    assert effect.name == "hoop.coulomb_friction"
    assert effect.parameters["Fc"].value == pytest.approx(answer["effects"][0]["as_seen"]["Fc"])
