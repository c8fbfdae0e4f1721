"""Doubts are raised where there is a reason, and only there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hoopd.plants.hoop.recordings.suspicions import ABOVE_BALL_HZ, COUNT_RAD, _fast, suspicions
from hoopd.plants.model_file import load_model, plant_of
from hoopd.recording import Recording, load
from hoopd.recording.edit import joined
from hoopd.recording.recording import from_columns
from tests.shared import ROOT, shared_path

PLANT = plant_of(load_model(ROOT / "config" / "models" / "hoop.yaml"))


def driven(u: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of the plant under a torque, with noise of sensors and counts of the encoder."""
    state, rows, rng = np.zeros(4), [], np.random.default_rng(3)
    for torque in u:
        rows.append(state)
        state = np.asarray(PLANT.advance(state, float(torque), 0.02))
    theta, dtheta, psi, _ = np.array(rows).T
    psi = psi + rng.normal(0, 0.003, len(u))
    return {
        "t": 0.02 * np.arange(len(u)),
        "u": u,
        "theta": np.round(theta / COUNT_RAD) * COUNT_RAD,
        "dtheta": dtheta,
        "psi": psi,
    }


def torques() -> dict[str, np.ndarray]:
    """Torques that excite differently."""
    t, rng = 0.02 * np.arange(1500), np.random.default_rng(4)
    return {
        "prbs": 0.1 * np.sign(rng.normal(size=300)).repeat(5),
        "chirp": 0.1 * np.sin(2 * np.pi * (0.05 + 0.06 * t) * t),
        "noise": rng.normal(0, 0.1, 1500),
        **{f"sine {f} Hz": 0.05 * np.sin(2 * np.pi * f * t) for f in (0.05, 0.2, 0.5, 1.0, 2.0, 5.0)},
    }


@pytest.mark.parametrize("name", torques())
def test_a_sound_recording_raises_no_doubt(name: str) -> None:
    assert suspicions(from_columns(driven(torques()[name]))) == []


@pytest.mark.parametrize("name", ["prbs", "chirp", "noise", "sine 5.0 Hz"])
def test_a_current_in_the_place_of_psi(name: str) -> None:
    columns = driven(torques()[name])
    rng = np.random.default_rng(5)
    columns["psi"] = 2.7 * columns["u"] + rng.normal(0, 0.05, len(columns["u"]))
    (said,) = suspicions(from_columns(columns))
    assert "may be a motor current; then load with --columns u,theta,dtheta,current" in said


def changed(**changes: object) -> Recording:
    columns = driven(torques()["prbs"])
    return from_columns({**columns, **{k: f(columns) for k, f in changes.items()}})  # type: ignore[operator]


def put(column: np.ndarray, row: int, value: float) -> np.ndarray:
    """A copy with one number changed."""
    column = column.copy()
    column[row] = value
    return column


def with_repeated_row() -> Recording:
    columns = driven(torques()["prbs"])
    row = int(np.argmax(np.abs(columns["dtheta"])))
    return from_columns({n: c if n in ("t", "u") else put(c, row + 1, c[row]) for n, c in columns.items()})


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (lambda: changed(psi=lambda c: 0 * c["t"] + 0.7), "psi never changes (0.7 rad): no ball"),
        (lambda: changed(u=lambda c: 0 * c["t"]), "u never changes (0 N m)"),
        (lambda: changed(u=lambda c: 1000 * c["u"]), "u reaches 100, the drive's limit is 0.7 N m"),
        (lambda: changed(u=lambda c: c["t"] * np.nan), "u is missing in every row"),
        (lambda: changed(dtheta=lambda c: 0.8 * c["dtheta"]), "dtheta is 0.80 times the slope of theta"),
        (lambda: changed(dtheta=lambda c: -c["dtheta"]), "dtheta is not the slope of theta (correlation -1.00)"),
        (lambda: changed(psi=lambda c: put(c["psi"], 500, 3.0)), "psi has 1 outlier (at 10 s)"),
        (lambda: changed(theta=lambda c: put(c["theta"], 500, 1e3)), "theta has 1 outlier (at 10 s)"),
        (
            lambda: changed(t=lambda c: c["t"] + 0.5 * (c["t"] > 7)),
            "rows are missing at 1 place, the longest step is 0.52 s",
        ),
        (with_repeated_row, "1 row the same as the one before while the hoop turns"),
    ],
)
def test_each_doubt(recording: object, says: str) -> None:
    assert any(sentence.startswith(says) for sentence in suspicions(recording()))  # type: ignore[operator]


def test_missing_rows_and_joints_are_no_outliers() -> None:
    """Over a gap the ball swings on, and between two recordings everything begins anew."""
    columns = driven(torques()["prbs"])
    psi = columns["psi"].copy()
    psi[np.random.default_rng(5).random(len(psi)) < 0.3] = np.nan
    assert suspicions(from_columns({**columns, "psi": psi})) == []
    parts = [from_columns({name: column[k : k + 700] for name, column in columns.items()}) for k in (0, 650)]
    assert not any("outlier" in text for text in suspicions(joined(parts)))


def test_a_wrapped_angle_is_said_and_is_no_outlier() -> None:
    columns = driven(torques()["prbs"])
    wrapped = {"psi": np.angle(np.exp(1j * 12 * columns["t"]))}
    doubts = suspicions(from_columns({**columns, **wrapped}))
    assert [text for text in doubts if text.startswith("psi is wrapped (at 57 places)")]
    assert not any("outlier" in text for text in doubts)


def test_a_held_hoop() -> None:
    t = 0.02 * np.arange(100)
    held = from_columns({"t": t, "u": 0.1 * np.sin(t), "theta": COUNT_RAD * (t > 1), "dtheta": 0 * t, "psi": np.cos(t)})
    assert suspicions(held) == ["theta moves one count of the encoder at most: the hoop was held, or stuck"]


@pytest.mark.parametrize("rows", [1, 2, 5, 30])
def test_short_and_empty_recordings(rows: int) -> None:
    t = 0.02 * np.arange(rows)
    assert suspicions(from_columns({"t": t, "u": t * np.nan}))
    assert isinstance(suspicions(from_columns({"t": t, "u": t, "theta": t, "dtheta": t, "psi": t})), list)


def test_the_real_recordings() -> None:
    said = {path.stem: " ".join(suspicions(load(path))) for path in sorted(real().glob("*.mat"))}
    assert [name for name, text in said.items() if "motor current" in text] == ["meas_hoop02_chirp"]
    assert [name for name, text in said.items() if "psi never changes" in text] == ["meas_hoop01_f05_a01"]
    assert [name for name, text in said.items() if "the hoop was held" in text] == ["meas_ballOnly01"]
    assert [name for name, text in said.items() if "trust theta" not in text] == ["meas_ballOnly01"]


def real() -> Path:
    """Folder of the real recordings."""
    return shared_path("recordings/meas_ballOnly01.mat").parent


def test_what_is_fast_is_what_a_butterworth_filter_there_and_back_lets_through() -> None:
    from scipy.signal import butter, sosfiltfilt

    t, noise = 0.02 * np.arange(1500), np.random.default_rng(2).normal(size=1500)
    x = 3.0 + 0.1 * np.cumsum(noise) + np.sin(2 * np.pi * 1.2 * t) + 0.2 * np.sin(2 * np.pi * 4.0 * t)
    expected = sosfiltfilt(butter(4, ABOVE_BALL_HZ, "highpass", fs=50.0, output="sos"), x)
    found = _fast(x, 0.02)
    assert found is not None and np.allclose(found[60:-60], expected[60:-60], rtol=0, atol=1e-4)
    assert np.corrcoef(found, expected)[0, 1] > 0.9995
