"""What commands ask of plants and recordings alike: which plant, whose rows, numbers for JSON.

Rules of this file: everything unusable is one `InputError`; no mathematics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.model_file import HOOP
from hoopd.plants.plant_model import PlantModel, is_of_another_plant, load_plant_model, nominal_model
from hoopd.plants.registry import FOLDER, SUFFIXES, resolve_plant
from hoopd.recording.recording import Recording


def other_model(plant: str | None, model: Path | None) -> PlantModel | None:
    """The model of another plant than the hoop that a command is asked about; None for the hoop.

    Without a model file it is the plant with its nominal values.
    """
    if model is not None and (plant not in (None, HOOP) or is_of_another_plant(or_shipped(model))):
        return load_plant_model(or_shipped(model), plant)
    return None if plant in (None, HOOP) else nominal_model(str(plant))


def system_of(model: PlantModel, *, step_s: float | None = None, effects: bool = True) -> tuple[PlantSystem, list[str]]:
    """A model as free runs take it, and what has to be said: effects of it that no free run has."""
    simulated = model.simulated_effects if effects else ()
    own = {key: value for one in simulated for key, value in model.values.items() if key.startswith(f"{one.name}.")}
    names = [one.name for one in model.effects if one.name not in {effect.name for effect in simulated}]
    words = "left out of the model" if not effects else "counted in single samples, in no free run"
    said = [f"{', '.join(names)}: {words}"] if names else []
    return PlantSystem(model.plant, simulated, own, step_s), said


def other_plant(text: str | None) -> Plant | None:
    """The plant of `--plant`; None for the hoop, which has structures and models of its own."""
    return None if text in (None, HOOP) else resolve_plant(str(text))


def plant_path(text: str | None) -> Path | None:
    """The plant's file, of a registered plant the shipped one; None where there is none."""
    if text is None:
        return None
    path = Path(text) if Path(text).suffix in SUFFIXES or "/" in text else FOLDER / f"{text}.yaml"
    return path if path.exists() else None


def refuse_shared(train: Sequence[tuple[str, Recording]], held: Sequence[tuple[str, Recording]]) -> None:
    """A recording counts once, and judges nothing that it was fitted to: half of its rows in another are too many."""
    for index, (name, one) in enumerate([*train, *held]):
        for other, earlier in train[:index]:
            shared = len(_rows(one) & _rows(earlier))
            if 2 * shared > min(len(one), len(earlier)):
                raise InputError(
                    name, "", f"has {shared} rows in common with {other}: it would be fitted twice or judge itself"
                )


def _rows(recording: Recording) -> set[bytes]:
    names = ("u", "theta", "psi") if recording.is_tick else tuple(recording.signals)
    columns = [recording.t, *(recording.column(name) for name in names)]
    return {row.tobytes() for row in np.column_stack(columns)}


def number(value: float) -> float | None:
    """JSON has no NaN."""
    return value if math.isfinite(value) else None
