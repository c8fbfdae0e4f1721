"""The calibrate command: what it writes, and one clear line for what it cannot use."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from harness.picture import Look, ball_centre, picture

from hoopd.commands.calibrate import run
from hoopd.files.reading import InputError


@pytest.fixture
def still(tmp_path: Path) -> Path:
    path = tmp_path / "ball.png"
    cv2.imwrite(str(path), picture())
    return path


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    t = np.arange(0.0, 10.0, 0.02)
    psi = 0.8 * np.exp(-0.1 * t) * np.cos(8.5 * t) + 0.05
    lines = [
        f"{238.0 - 184.0 * np.sin(p):.3f}, {237.0 + 184.0 * np.cos(p):.3f}, {s:.2f}"
        for p, s in zip(psi, t, strict=True)
    ]
    lines[10] = ",,0.2"
    path = tmp_path / "swing.csv"
    path.write_text("\n".join(["x_px, y_px, t", *lines]) + "\n")
    return path


def test_a_picture_gives_the_promised_keys_and_a_figure(still: Path, tmp_path: Path) -> None:
    result = run(still, None, tmp_path / "ball.json")
    written = json.loads((tmp_path / "ball.json").read_text())
    assert written == result
    assert written["ball_px"] == pytest.approx(ball_centre(Look(), 0.0), abs=0.5)
    assert written["circle_px"]["centre"] == pytest.approx(Look().centre, abs=1.0)
    assert written["circle_px"]["radius"] == pytest.approx(Look().track_radius, abs=1.0)
    assert written["weights"][0] == 1.0 and written["weights_order"] == "RGB"
    assert 0 < written["threshold"] < 255
    assert {"zero_angle_rad", "ball_radius_px", "hoop_outer_radius_px", "confidence", "notes"} <= set(written)
    assert any("not perspective" in note for note in written["notes"])
    figure = cv2.imread(written["figure"])
    assert figure is not None and figure.shape[1] == 960
    assert np.array_equal(cv2.imread(str(still)), picture())


def test_nothing_is_written_unless_asked(still: Path) -> None:
    run(still)
    assert [p.name for p in still.parent.iterdir()] == ["ball.png"]


def test_configuration_is_saved_on_request_only(still: Path, tmp_path: Path) -> None:
    result = run(still, save_path=tmp_path / "vision.yaml")
    section = yaml.safe_load((tmp_path / "vision.yaml").read_text())["vision"]
    assert section["weights"] == result["weights"]
    assert section["circle_px"] == result["circle_px"]
    assert set(section) == {"weights", "threshold", "circle_px", "zero_angle_rad", "ball_radius_px", "band_px"}


def test_a_run_of_positions_gives_circle_and_zero(swing: Path, tmp_path: Path) -> None:
    result = run(None, swing, tmp_path / "run.json")
    assert result["circle_px"]["centre"] == pytest.approx([238.0, 237.0], abs=0.1)
    assert result["circle_px"]["radius"] == pytest.approx(184.0, abs=0.1)
    assert result["zero_angle_rad"] == pytest.approx(0.05, abs=0.01)
    assert result["zero_from"] == "swing" and "weights" not in result
    assert Path(result["figure"]).exists()


def test_picture_and_run_together(still: Path, swing: Path, tmp_path: Path) -> None:
    result = run(still, swing, tmp_path / "both.json")
    assert result["circle_px"]["centre"] == pytest.approx([238.0, 237.0], abs=0.1)
    assert "weights" in result and result["zero_from"] == "swing"


def array_file(shape: str) -> bytes:
    """An npy file of version 1 whose header says this shape."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header


def test_npy_positions(tmp_path: Path) -> None:
    psi = np.linspace(-1.0, 1.0, 100)
    np.save(tmp_path / "p.npy", np.column_stack([238.0 - 184.0 * np.sin(psi), 237.0 + 184.0 * np.cos(psi), psi]))
    assert run(None, tmp_path / "p.npy")["circle_px"]["radius"] == pytest.approx(184.0, abs=0.1)


def test_unusable_input_is_one_clear_line(tmp_path: Path, still: Path) -> None:
    def write(name: str, data: bytes) -> Path:
        (tmp_path / name).write_bytes(data)
        return tmp_path / name

    empty_picture = tmp_path / "empty_hoop.png"
    cv2.imwrite(str(empty_picture), picture(Look(ball=False)))
    cases: list[tuple[dict[str, Path | None], str]] = [
        ({"picture": None}, "needs a picture"),
        ({"picture": tmp_path / "absent.png"}, "no such file"),
        ({"picture": tmp_path}, "is a directory"),
        ({"picture": write("empty.png", b"")}, "not a picture"),
        ({"picture": write("text.png", b"hello")}, "not a picture"),
        ({"picture": write("torn.png", still.read_bytes()[:100])}, "not a picture"),
        ({"picture": empty_picture}, "no ball found"),
        ({"picture": None, "positions": write("a.txt", b"1,2")}, "expected positions"),
        ({"picture": None, "positions": write("b.csv", b"x,y\n1,2\n")}, "column is missing"),
        ({"picture": None, "positions": write("c.csv", b"x_px,y_px\n1,two\n")}, "line 2, y_px: expected a number"),
        ({"picture": None, "positions": write("d.csv", b"x_px,y_px\n1,2\n")}, "too few"),
        ({"picture": None, "positions": write("e.csv", b"\xff\xfe\x00")}, "not a text file"),
        ({"picture": None, "positions": write("f.csv", b"")}, "column is missing"),
        ({"picture": None, "positions": write("g.npy", b"no array")}, "not a numeric npy array"),
        ({"picture": None, "positions": write("h.npy", array_file(f"({10**40}, 2)"))}, "not a numeric npy array"),
        ({"picture": None, "positions": write("i.npy", array_file("(3, 2"))}, "not a numeric npy array"),
        ({"picture": still, "json_path": tmp_path / "no" / "x.json"}, "--json: no such folder"),
        ({"picture": still, "figure_path": still}, "is never overwritten"),
        ({"picture": still, "json_path": tmp_path / "x", "save_path": tmp_path / "x"}, "is already where --json goes"),
    ]
    for arguments, reason in cases:
        with pytest.raises(InputError) as caught:
            run(**{"picture": None, **arguments})  # type: ignore[arg-type]
        assert reason in str(caught.value)
        assert "\n" not in str(caught.value)


def test_positions_may_come_from_a_recording(tmp_path: Path) -> None:
    from hoopd.daemon.app import Options, run_daemon

    run_daemon(Options(sim=True, duration_s=6.0, record=tmp_path, speed="max", sets=("sim.held=false",)))
    found = run(None, tmp_path / "run-0001.mcap")
    assert found["circle_px"]["radius"] == pytest.approx(182.0, abs=3.0)
    assert found["circle_px"]["centre"] == pytest.approx([240.0, 240.0], abs=3.0)


def test_a_link_to_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.symlink_to(path.name)
    with pytest.raises(InputError):
        run(None, path, tmp_path / "found.json")
