"""The test signal of a calibration: laid where the daemon loads it, played by its own command, kept as a recording.

Rules of this file: the hoop moves by the documented command of somebody who is logged in, and by nothing else; nothing
is replaced, in the daemon's folder or among the recordings.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.work.bench import Bench
from hoopd.files.calibration_signal import NAME, SECONDS, signal_around
from hoopd.files.reading import InputError
from hoopd.recording.formats import save
from hoopd.recording.recording import from_columns

AFTER_S = 0.5  # what is kept beyond the signal: the ball comes to rest
SETTLE_S = 1.5  # until telemetry has told all of it
LEAST_SHARE = 0.8  # of the rows that the signal has: a browser's server may have missed some
COLUMNS = ("t", "u", "theta", "dtheta", "current", "psi", "y_t", "psi_t")
ENDED = "experiment_ended"
PLAYED = "done"


def lay_in(bench: Bench, controller: Mapping[str, Any]) -> str:
    """NAME.yaml@SHA256 of the signal around the controller that acts; InputError says what is missing.

    controller : as the device's status tells it
    """
    if bench.controllers is None:
        raise InputError("controllers", "", "this server was started without --controllers: it cannot lay a signal in")
    name, sha256 = str(controller.get("file", "")), str(controller.get("sha256", ""))
    if controller.get("purpose") != "controller":
        raise InputError("controller", "", f"{name[:60]} is on {str(controller.get('purpose'))[:20]}: end that first")
    text = signal_around(bench.controllers.text(f"{Path(name).name}@{sha256}"), name[:60])
    digits = hashlib.sha256(text.encode()).hexdigest()[:12]
    return bench.controllers.add(f"{NAME}-{digits}.yaml", text)


def why_ended(device: ShownDevice, since_s: float) -> str:
    """What the daemon told of the signal's end; empty when nothing yet."""
    told = [one for one in device.events_since(since_s) if one.get("event") == ENDED]
    fields = told[-1].get("fields") if told else None
    return str(fields.get("reason", ""))[:200] if isinstance(fields, dict) else ""


def keep(bench: Bench, device: ShownDevice, run: str, begun_t: float, config: str) -> str:
    """The rows of the signal as a recording of the bench; its name. InputError for too few.

    run, begun_t : name of the run, and run time (s) of the tick that began it
    config : the daemon's configuration
    """
    if device.run != run:
        raise InputError(device.name, "", "the daemon was started anew meanwhile")
    table = device.columns(COLUMNS)
    t = table["t"]
    rows = (t >= begun_t - 1e-9) & (t <= begun_t + SECONDS + AFTER_S)
    expected = SECONDS / float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if np.count_nonzero(rows) < LEAST_SHARE * expected:
        raise InputError(device.name, "", f"{np.count_nonzero(rows)} rows came of the signal: the line is too slow")
    name = f"{NAME}-{datetime.now(UTC):%Y%m%d-%H%M%S}-{device.name}.mcap"
    path = bench.recordings.folder / name
    if path.exists():
        raise InputError(name, "", "is there already")
    save(from_columns({key: values[rows] for key, values in table.items()}, name, config), path)
    return name


def now_s() -> float:
    """Wall clock, as events are stamped with."""
    return time.time()
