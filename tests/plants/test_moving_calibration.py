"""Signs, torque and camera delay of a short test signal on the rig, whose truth is known."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from harness.rigrun import run_rig

from hoopd.commands.calibrate_moving import run
from hoopd.commands.options.calibrate import CalibrateOptions
from hoopd.files.calibration_signal import SECONDS, signal_around
from hoopd.files.controller_folder import key_of
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.fitting.moving_calibration import judged, measure
from hoopd.plants.model_file import load_model
from hoopd.recording.edit import between
from hoopd.recording.formats import save
from hoopd.recording.mcap import read
from hoopd.recording.recording import Recording

MODEL = defaults_folder() / "models" / "hoop.yaml"
BEGINS_S = 4.0


def played(folder: Path, *sets: str) -> Recording:
    """The shipped law holds the ball while the page's own test signal is played."""
    folder.mkdir(exist_ok=True)
    text = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
    (folder / "lqg.yaml").write_text(text)
    (folder / "signal.yaml").write_text(signal_around(text, "lqg.yaml"))
    command = f"sim.commands=[{{at_s: {BEGINS_S}, name: experiment, key: '{key_of(folder / 'signal.yaml')}'}}]"
    ends = BEGINS_S + SECONDS
    run_rig(folder / "run", command, f"control.folder={folder}", "sim.psi_rad=0", *sets, duration_s=ends + 1.0)
    return between(read(folder / "run" / "run-0001.mcap"), BEGINS_S, ends)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Of a device that is as its model."""
    return played(tmp_path_factory.mktemp("sound"))


def inside(truth: float, interval: tuple[float, float, float] | None, slack: float) -> bool:
    return interval is not None and interval[1] - slack <= truth <= interval[2] + slack


def test_a_sound_device_is_good_in_every_step_and_is_hardly_moved(sound: Recording) -> None:
    found = measure(sound, load_model(MODEL))
    told = judged(found, 0.37, 0.04)
    assert [step["good"] for step in told.values()] == [True] * 3, told
    assert inside(1.0, found.gain, 0.01) and inside(0.37, found.constant_nm_per_a, 0.002)
    assert inside(0.0, found.delay_s, 0.001)
    assert np.nanmax(np.abs(sound.dtheta)) < 6.0 and np.nanmax(np.abs(sound.psi)) < 0.2


def test_what_is_off_is_found_with_its_number_and_said(tmp_path: Path) -> None:
    gain = "{name: actuator.torque_gain, parameters: {k: 0.8}}"
    late = "{name: camera.latency, parameters: {d: 0.03}}"
    recording = played(tmp_path, f"sim.effects=[{gain}, {late}]", "sim.torque_constant_nm_per_a=0.3")
    found = measure(recording, load_model(MODEL))
    assert inside(0.8, found.gain, 0.01) and inside(0.03, found.delay_s, 0.002)
    told = judged(found, 0.37, 0.04)
    assert told["signs"]["good"] and not told["torque"]["good"] and not told["delay"]["good"]
    assert told["torque"]["part"]["faults"]["torque_constant_nm_per_a"] == pytest.approx(0.3, abs=0.005)
    assert told["delay"]["part"]["camera"]["delay_s"] == pytest.approx(0.07, abs=0.002)


@pytest.mark.parametrize(
    ("turned", "wrong"), [("psi", "the ball"), ("u", "the hoop"), ("dtheta", "the slope of its angle")]
)
def test_a_sign_that_is_turned_round_is_said(sound: Recording, turned: str, wrong: str) -> None:
    found = measure(sound.replaced(**{turned: -sound.column(turned)}), load_model(MODEL))
    told = judged(found)["signs"]
    assert told["good"] is False and wrong in told["why"], told["why"]


def test_nothing_moved_is_one_line(sound: Recording) -> None:
    with pytest.raises(InputError, match="nothing was moved"):
        measure(sound.replaced(u=0.0 * sound.u), load_model(MODEL))


def test_the_command_writes_what_the_page_draws(sound: Recording, tmp_path: Path) -> None:
    path = tmp_path / "signal.mcap"
    save(sound, path)
    options = CalibrateOptions(moving=path, json_path=tmp_path / "result.json", figure=tmp_path / "figure.svg")
    run(options)
    told = msgspec.json.decode((tmp_path / "result.json").read_bytes())
    curves = {name: [one["label"] for one in step[-1]["curves"]] for name, step in told["drawings"].items()}
    assert curves["torque"] == ["measured", "line of the constant"]
    assert curves["signs"] == curves["delay"] == ["measured", "foretold"]
    measured, foretold = (one["y"] for one in told["drawings"]["delay"][0]["curves"])
    assert len(measured) > 300 and np.std(np.subtract(measured, foretold)) < 0.01
    assert (tmp_path / "figure.svg").stat().st_size > 1000
