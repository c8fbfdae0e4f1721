"""What a design makes of the effects that its model names: in numbers, in one sentence, and what is left to be wished.

Rules of this file: it says what `plants.hoop.loop.writeback` sorts, and decides nothing.
"""

from __future__ import annotations

from typing import Any

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.writeback import (
    SATURATION,
    cancelled,
    corrected,
    delays_of,
    filter_effects,
    modes_of,
    unused,
)
from hoopd.plots.number_format import listed

NO_EFFECTS = (
    "The model names no effects: nothing is fed forward. Dry friction, and whatever else the device has beside the "
    "model's parameters, is left to the feedback."
)


def told(found: FoundEffects) -> dict[str, Any]:
    """What becomes of each: the law is designed on what feed-forward leaves."""
    return {
        "fed_forward": list(cancelled(found)),
        "in_the_filter": [*filter_effects(found).names],
        "delays_s": delays_of(found)._asdict(),
        "left_out": [one._asdict() for one in unused(found)],
    }


def sentence(found: FoundEffects) -> str:
    """What is done about friction and all else that the model names: fed forward, known to the filter, or nothing."""
    if not found:
        return NO_EFFECTS
    fed, late, without = cancelled(found), delays_of(found), [one.name for one in unused(found)]
    known = [name for name in filter_effects(found).names if name not in fed]
    delays = {"torque": late.torque_s, "pictures": late.camera_s, "encoder": late.encoder_s}
    reckoned = [f"{name} {1e3 * seconds:.3g} ms" for name, seconds in delays.items() if seconds > 0.0]
    mended = [name for name in corrected(found) if name not in (*fed, *known)]
    limits = [name for name in found.names if name == SATURATION and name not in (*fed, *known)]
    parts = [
        f"Fed forward, so that the law need not act on it: {listed(fed)}" if fed else "Nothing is fed forward",
        *([f"the filter knows {listed(known)}"] if known else []),
        *([f"its readings are corrected for {listed(mended)}"] if mended else []),
        *([f"it follows a ball that leaves the hoop, by {listed(left)}"] if (left := modes_of(found)) else []),
        *([f"the torque's limit is that of {listed(limits)}"] if limits else []),
        *([f"the design reckons with delays ({', '.join(reckoned)})"] if reckoned else []),
        *([f"nothing is done about {listed(without)}"] if without else []),
    ]
    return f"{'; '.join(parts)}."


def left_out(law: str, found: FoundEffects) -> list[str]:
    """What the model's effects leave to be wished for."""
    notes = [f"nothing is done about {one.name}: {one.reason}" for one in unused(found)]
    if law == "arx" and cancelled(found):
        notes.append("the law's own model is from a recording: was it taken with the feed-forward of these effects?")
    return notes
