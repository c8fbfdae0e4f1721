"""Laws of the grammar that textbooks have for a place: they cost less than what is built of the parts at random.

Beside each name of a library stands what its textbook says of the same place in the next chapter: beside Coulomb's
friction the load that drives it, the way that wears it off, the age of its contact, and the spring that it is at first.
There are about as many of these as a library has names, and a device has one less often (`TEXTBOOK_COST_NATS`), as far
as tuning seeds of the proof have shown. A law that is built of the parts at random is rarer still.

Rules of this file: names of mechanisms with their sources; `{q}` is the coordinate that is moved or read, `{o}` the one
beside it, `{u}` the first input.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from hoopd.plants.declaration import Plant, Slot

BODY: Mapping[str, str] = {
    "dahl_of_{q}": "a friction that is a spring before it slides (Dahl 1968)",
    "play_of_{q}": "a spring that yields (Jenkin 1922)",
    "swing_of_d{q}": "a part that hangs on it (Den Hartog 1956)",
    "loose_of_d{q}": "a part with play (Nordin, Gutman 2002)",
    "peak_of_d{q}": "an eddy-current brake (Wouterse 1991)",
    "cubic_of_{q}": "a spring that hardens (Duffing 1918)",
    "detent_of_{q}": "a place that holds it, as a magnet does",
    "linear_of_load_on_sign_d{q}": "dry friction under a load that changes (Amontons 1699)",
    "fading_of_{q}_on_sign_d{q}": "dry friction that is run in (Archard 1953)",
    "age_of_{q}_on_sign_d{q}": "a contact that strengthens at rest (Dieterich 1979, Ruina 1983)",
    "heat_of_d{q}_squared_on_d{q}": "a bearing whose oil warms up (Vogel 1921)",
    "well_of_{q}_on_sign_d{q}": "a place that rubs",
    "well_of_{q}_on_forward_d{q}": "a pawl",
    "well_of_{q}_on_backward_d{q}": "a pawl",
}
COUPLED: Mapping[str, str] = {
    "cubic_of_{q}_less_{o}_pair": "a coupling that hardens (Duffing 1918)",
    "threshold_of_{q}_less_{o}_pair": "a coupling with play (Nordin, Gutman 2002)",
}
ROLLING: Mapping[str, str] = {
    "dahl_of_{q}_less_{o}_pair": "a contact that is a spring at first (Dahl 1968)",
    "play_of_{q}_less_{o}_pair": "a contact whose spring yields (Jenkin 1922; Wen 1976)",
    "detent_of_{q}_less_{o}_pair": "a magnet in the track",
    "wave_of_{q}_less_{o}_pair": "the poles of a machine",
    "detent_of_phi_pair": "a flat on what rolls",
    "wave_of_phi_pair": "a centre of mass beside the middle of what rolls",
    "wave_of_{o}": "a track that wobbles on its shaft",
}
ACTUATOR: Mapping[str, str] = {
    "heat_of_{u}_squared_on_{u}": "a winding that warms up (Joule 1841)",
    "lag_of_drawn_{u}_d{q}_on_{u}": "a supply that sags under its load",
    "hesitation_of_{u}": "a loop that opens late",
    "reversal_of_{u}_on_{u}": "a motion that is lost after a reversal",
}
PLACE: Mapping[str, str] = {
    "lens_of_{q}_in_{q}": "a lens beside the axis of what turns (Brown 1966)",
    "bent_of_{q}_in_{q}": "a lens over a way (Brown 1966)",
    "beat_of_t_on_d{q}_in_{q}": "two clocks that run free",
    "quadratic_of_d{q}_in_{q}": "a reading that is the later the faster it moves",
    "play_of_{q}_in_{q}": "play before the sensor",
    "twist_of_{u}_in_{q}": "a shaft that winds up before the sensor (Kelvin 1865, Voigt 1892)",
}
RATE: Mapping[str, str] = {
    "linear_of_d{q}_in_d{q}": "a tachometer's gain",
    "quadratic_of_d{q}_in_d{q}": "a timer's dead time",
}


def textbook_names(plant: Plant) -> frozenset[str]:
    """Names that mechanisms of a plant have, where they are textbooks' laws.

    Parameters
    ----------
    plant : Plant
        A declaration.

    Returns
    -------
    frozenset of str
        Some of which the plant may not suggest.

    Examples
    --------
    >>> from hoopd.plants.registry import plant_named
    >>> "body.dahl_of_alpha" in textbook_names(plant_named("pendulum"))
    True
    """
    return frozenset(name.lower() for slot, one in plant.slots.items() for name in _of_slot(plant, slot, one))


def _of_slot(plant: Plant, slot: str, one: Slot) -> Iterator[str]:
    u = plant.inputs[0].name if plant.inputs else ""
    for law, q in _laws(plant, one):
        for o in [each for each in plant.coordinates if each != q] or [""]:
            yield f"{slot}.{law.format(q=q, o=o, u=u)}"


def _laws(plant: Plant, one: Slot) -> Iterator[tuple[str, str]]:
    kinds = {"body": {**BODY, **COUPLED}, "rolling_ball": {**BODY, **ROLLING}, "actuator": ACTUATOR}
    moved = plant.moved_by(one) if one.kind == "actuator" else one.coordinate
    yield from ((law, moved) for law in kinds.get(one.kind, {}))
    if one.kind == "sensor":
        for read in (plant.state_of(channel) for channel in one.channels):
            q = read.removeprefix("d")
            if q in plant.coordinates:
                yield from ((law, q) for law in (PLACE if read == q else RATE))
