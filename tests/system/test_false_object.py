"""Something on the track that is no ball: it must not be chased for longer than a moment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoopd.daemon import app
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.sim.watchers import DirectWatcher

AT_S = 3.0
STOPPED_WITHIN_S = 2.5


def run(folder: Path, *sets: str, seconds: float = 8.0) -> RecordedRun:
    app.run_daemon(app.Options(True, None, sets, seconds, folder, 0, "max", True))
    return read_run(folder / "run-0001.mcap")


@pytest.mark.parametrize("psi", [0.3, 1.0, 2.5, -0.7])
def test_a_steady_false_object_on_the_track_ends_in_a_controlled_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, psi: float
) -> None:
    see = DirectWatcher.see

    def fooled(self: DirectWatcher, frame: int, t: float, state: Any, distance: float = 1.0) -> Any:
        sample = see(self, frame, t, state, distance)
        return sample if t < AT_S else sample._replace(psi=psi + 0.001 * (frame % 3))

    monkeypatch.setattr(DirectWatcher, "see", fooled)
    rows = run(tmp_path)
    after = [tick for tick in rows.ticks if tick.t > AT_S + STOPPED_WITHIN_S]
    assert after
    assert all(tick.mode == "DISARMED" and tick.u == 0.0 for tick in after)  # and it stays so
    causes = [event.fields["because"] for event in rows.events if event.event == "mode"]
    assert any("ball_implausible" in because for because in causes)


@pytest.mark.parametrize(
    "sets",
    [
        ("sim.angle_offset_rad=3 deg",),
        ("sim.disturbance_rad=0.4", "sim.disturbance_at_s=3"),
        ("sim.psi_noise_rad=0.008",),
        ("sim.model=models/thesis.yaml", "sim.commands=[{at_s: 3, name: reference, value: 0.4}]"),
    ],
)
def test_a_real_ball_with_an_unusual_camera_or_model_is_left_alone(tmp_path: Path, sets: tuple[str, ...]) -> None:
    rows = run(tmp_path, *sets)
    assert rows.ticks[390].mode == "RUNNING"
