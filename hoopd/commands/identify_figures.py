"""The figures of `hoopd identify`: predictions, residuals, responses and roots with their 95 % regions.

Rules of this file: files out; the drawing is in `hoopd.plots`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.ident.confidence import pole_spread
from hoopd.ident.data import Data
from hoopd.plots import bode, compare_plot, pzmap, resid, style

# Of the hoop's signals.
HOOP_UNITS = {"torque": "N m", "theta": "rad", "dtheta": "rad/s", "psi": "rad"}
ENDINGS = ("", "_residuals", "_bode", "_roots")


def draw(
    models: Mapping[str, Any], shown: Data, how: str, figure: Path, units: Mapping[str, str], horizon: float,
    offsets: Mapping[str, float],
) -> list[str]:  # fmt: skip
    """The first model is the one that was asked for or chosen, the others stand beside it; names of what was written.

    `offsets`: the operating point that `shown` is about. What is measured and said goes into the file that was asked
    for; residuals, responses and roots beside it.
    """
    name, model = next(iter(models.items()))
    known = ", with 95 % regions" if pole_spread(model) is not None else ""
    drawn = {
        "": compare_plot(models, shown, horizon, title=f"{name}, {how}", units=units, offsets=offsets),
        "_residuals": resid(model, shown, title=f"Residuals, {name}"),
        "_bode": bode(models, shown, title=f"Responses, {name}{known}"),
        "_roots": pzmap({name: model}, title=f"Poles and zeros, {name}{known}"),
    }
    paths = [figure.with_name(f"{figure.stem}{ending}{figure.suffix}") for ending in ENDINGS]
    for path, one in zip(paths, drawn.values(), strict=True):
        style.save(one, path)
    return [path.name for path in paths]
