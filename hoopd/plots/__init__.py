"""Every figure, drawn without a screen: `from hoopd.plots import bode, compare_plot, plot, pzmap, resid, step`.

The names of this package are pictures of models and data, one call each; they are looked up when they are used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hoopd.plots.model_plots import (
        bode as bode,
        compare_plot as compare_plot,
        impulse as impulse,
        plot as plot,
        pzmap as pzmap,
        resid as resid,
        step as step,
    )

__all__ = ["bode", "compare_plot", "impulse", "plot", "pzmap", "resid", "step"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.model_plots"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
