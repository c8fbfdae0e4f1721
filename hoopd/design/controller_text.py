"""Controller files (`hoopd.controller/1`) as text: what a design leaves for the daemon.

Rules of this file: plain numbers of few digits, which no machine's last bits reach; nothing is written here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from hoopd.core.estimator import EkfSettings
from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.files.yaml_text import text_of

ESTIMATOR_KEYS = ("q", "r_theta", "r_dtheta", "r_psi", "gate_nis", "reacquire_after", "horizon_s")
DIGITS = 8


def plain(value: Any, digits: int = DIGITS) -> Any:
    """Numbers with so many digits, arrays as lists, mappings value by value."""
    if isinstance(value, Mapping):
        return {key: plain(item, digits) for key, item in value.items()}
    if isinstance(value, np.ndarray | tuple | list):
        return [plain(item, digits) for item in np.asarray(value).tolist()]
    return value if isinstance(value, int) else float(f"{value:.{digits}g}")


def controller_data(
    name: str,
    kind: str,
    gains: Mapping[str, Any],
    *,
    model: str,
    notes: str,
    sample_time_s: float,
    torque_nm: float = TORQUE_LIMIT_NM,
    settings: EkfSettings | None = None,
    innovations: Mapping[str, list[float]] | None = None,
) -> dict[str, Any]:
    """The content of a controller file; gains as they stand, the estimator with few digits.

    `torque_nm`: of the drive; a controller may ask for no more than every one may. `innovations`: normal levels
    (`levels`).
    """
    torque_nm = min(TORQUE_LIMIT_NM, torque_nm)
    estimator = asdict(settings or EkfSettings())
    levels = {"innovations": dict(innovations)} if innovations else {}
    return {
        "schema": "hoopd.controller/1",
        "name": name,
        "kind": kind,
        "notes": notes,
        "model": model,
        "sample_time_s": sample_time_s,
        "limits": {"torque_nm": torque_nm, "slew_nm_per_tick": 2.0 * torque_nm},
        "estimator": {**{key: plain(estimator[key]) for key in ESTIMATOR_KEYS}, **levels},
        "gains": dict(gains),
    }


def controller_text(data: Mapping[str, Any], head: str) -> str:
    """The file: a comment of one line, then YAML."""
    return f"# {head}\n" + text_of(dict(data), default_flow_style=None, width=118)
