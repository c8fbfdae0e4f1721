"""The configuration: layers, units, and one clear line for every mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoopd.files.reading import InputError, parse_yaml, to_struct
from hoopd.files.shipped import or_shipped
from hoopd.plants.model_file import load_model
from hoopd.shell.config import Config, defaults_folder, dump, find, load


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_shipped_configurations_are_valid() -> None:
    assert load(None, sim=False, overrides=[]).telemetry.commands is False
    assert load(None, sim=True, overrides=[]).sim.delay_frames == 2.0


def test_later_layers_win(tmp_path: Path) -> None:
    path = write(tmp_path, "camera: {fps: 40}\ntelemetry: {commands: false}\n")
    config = load(path, sim=True, overrides=["camera.fps=30"])
    assert (config.camera.fps, config.telemetry.commands) == (30.0, False)
    assert config.camera.exposure_s == 0.005


@pytest.mark.parametrize(
    ("text", "value"), [("20 ms", 0.02), ("0.02 s", 0.02), ("0.02", 0.02), ("20000 us", 0.02), ("2e-2 s", 0.02)]
)
def test_a_quantity_may_carry_its_unit(text: str, value: float) -> None:
    assert load(None, sim=False, overrides=[f"loop.period_s={text}"]).loop.period_s == pytest.approx(value)


def test_angles_in_degrees_and_sizes_in_gibibytes() -> None:
    config = load(None, sim=False, overrides=["vision.zero_angle_rad=1 deg", "recording.quota_bytes=1 GiB"])
    assert config.vision.zero_angle_rad == pytest.approx(0.0174533, abs=1e-6)
    assert config.recording.quota_bytes == 2**30


@pytest.mark.parametrize(
    ("text", "key", "word"),
    [
        ("camera: {fsp: 50}", "camera.fsp", "did you mean fps"),
        ("loop: {period_ms: 20}", "loop.period_ms", "did you mean period_s"),
        ("loop: {period_s: 20 mm}", "loop.period_s", "wrong unit 'mm'"),
        ("loop: {period_s: fast}", "loop.period_s", "expected a number"),
        ("limits: {torque_nm: 5}", "limits.torque_nm", "<= 0.7"),
        ("limits: {torque_nm: -0.1}", "limits.torque_nm", "> 0.0"),
        ("loop: {period_s: 1.0}", "loop", "between 0.005 and 0.1"),
        ("camera: {backend: webcam}", "camera.backend", "webcam"),
        ("telemetry: {commands: sometimes}", "telemetry.commands", "bool"),
        ("device: {name: 'a b'}", "device.name", "regex"),
        ("sim: {faults: [{kind: x, at_s: -1}]}", "sim.faults[0].at_s", ">= 0"),
        ("nonsense: 1", "nonsense", "unknown key"),
        ("faults: {hoop_speed_rad_s: .nan}", "faults.hoop_speed_rad_s", "finite"),
        ("faults: {hoop_speed_rad_s: 1e999}", "faults.hoop_speed_rad_s", "finite"),
        ("faults: {hoop_speed_rad_s: 1000}", "faults", "hoop_speed_rad_s must be above 0 and at most 200"),
        ("faults: {minimum_confidence: 0}", "faults", "minimum_confidence"),
        ("faults: {camera_delay_s: 5}", "faults", "camera_delay_s"),
        ("faults: {torque_constant_nm_per_a: -1}", "faults", "negative"),
        ("faults: {limit: 1}", "faults.limit", "unknown key"),
        ("loop: {stopping_s: 1e9}", "loop", "stopping_s must be between 0 and 10"),
        ("loop: {reference_limit_rad: 100}", "loop", "reference_limit_rad"),
        ("camera: {stall_s: .inf}", "camera.stall_s", "finite"),
        ("camera: {stall_s: 1000}", "camera.stall_s", "<= 5"),
        ("vision: {homography: [[1]]}", "vision", "three rows of three"),
        ("vision: {homography: [[1, 0, 0], [1, 0, 0], [0, 0, 1]]}", "vision", "inverted"),
        ("vision: {ball_radius_px: 1e9}", "vision.ball_radius_px", "<= 400"),
        ("vision: {weights: [0, 0, 0]}", "vision", "above zero"),
        ("camera: {width_px: 481}", "camera.width_px", "multiple of 2"),
        ("vision: {threshold: .nan}", "vision.threshold", "finite"),
        ("just text", "", "expected keys and values"),
        ("a: [1, 2", "line", "not YAML"),
    ],
)
def test_a_mistake_is_one_line_with_file_and_key(tmp_path: Path, text: str, key: str, word: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load(path, sim=False, overrides=[])
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    assert key in line
    assert word in line


@pytest.mark.parametrize("text", ["camera.fps", "=3", "camera.fps=[", "camera.fps.x=1"])
def test_a_wrong_override_is_named(text: str) -> None:
    with pytest.raises(InputError, match="--set"):
        load(None, sim=False, overrides=[text])


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "absent.yaml", sim=False, overrides=[])
    with pytest.raises(InputError, match="no such file"):
        find("models/absent.yaml", None)
    with pytest.raises(InputError, match="file name too long"):
        find("x" * 5000, None)
    with pytest.raises(InputError, match="file name too long"):
        load_model(or_shipped(Path("x" * 5000)))


def test_the_resolved_configuration_reads_back() -> None:
    config = load(None, sim=True, overrides=["sim.psi_rad=0.1", "vision.homography=[[1,0,0],[0,1,0],[0,0,1]]"])
    assert to_struct(parse_yaml(dump(config), "dump"), Config, "dump") == config


def test_defaults_come_from_the_checkout_or_the_package() -> None:
    assert (defaults_folder() / "hoop.yaml").is_file()


def test_one_number_of_a_circle_may_be_set_alone() -> None:
    circle = load(None, sim=False, overrides=["vision.circle_px.radius=170"]).vision.circle_px
    assert (circle.centre, circle.radius) == ((240.0, 240.0), 170.0)


def test_secrets_of_any_shape_stay_out_of_the_text_that_travels() -> None:
    secrets = ["a: ''b''", "it's, #1", "plain words"]
    zenoh = {
        "transport": {
            "auth": {"usrpwd": {"user": "me", "password": secrets[0]}},
            "link": {"tls": {"listen_private_key_base64": secrets[1], "users": [{"password": secrets[2]}]}},
        }
    }
    config = to_struct({"telemetry": {"zenoh": zenoh}}, Config, "here")
    text = dump(config)
    for part in ("''b", "#1", "words"):
        assert part not in text
    again = to_struct(parse_yaml(text, "again"), Config, "again")
    assert dump(again) == text
    assert again.telemetry.zenoh["transport"]["auth"]["usrpwd"]["user"] == "me"
