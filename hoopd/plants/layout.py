"""What a recording of a plant holds: its inputs and channels with their units.

Rules of this file: from a declaration to names; no equations.
"""

from __future__ import annotations

from hoopd.plants.declaration import Plant
from hoopd.recording.column_choice import TICK, SignalLayout


def layout_of(plant: Plant) -> SignalLayout:
    """Give the signals of a plant's recordings; of one that reads the daemon's columns alone, the daemon's.

    Parameters
    ----------
    plant : Plant
        A declaration.

    Returns
    -------
    Layout
        As `hoopd.recording.load` takes it.

    Examples
    --------
    >>> from hoopd.plants.layout import layout_of
    >>> from hoopd.plants.registry import plant_named
    >>> layout_of(plant_named("axis"))
    SignalLayout(inputs={'F': 'N'}, channels={'x': 'm'})
    >>> layout_of(plant_named("hoop")).is_tick
    True
    """
    inputs = {one.name: one.unit for one in plant.inputs}
    channels = {name: one.unit for name, one in plant.channels.items()}
    of_tick = inputs == dict(TICK.inputs) and channels.items() <= dict(TICK.channels).items()
    return TICK if of_tick and channels else SignalLayout(inputs, channels)
