"""The board's slew limit as a recording tells it."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from hoopd.recording.board_limits import torque_slew
from hoopd.recording.recording import Recording
from hoopd.shell import config as configuration


def test_a_daemon_s_recording_tells_its_board_s_slew_limit_and_another_none() -> None:
    config = configuration.load(None, sim=True, overrides=["sim.board.slew_nm_per_ms=0.35"])
    told = Recording(np.arange(3.0), config=configuration.dump(config))
    assert torque_slew(told) == pytest.approx(350.0)
    assert torque_slew(Recording(np.arange(3.0))) == inf
