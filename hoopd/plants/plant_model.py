"""Models of any plant (`hoopd.model/1` with `plant`): the plant with a file's numbers, and the effects on it.

Rules of this file: everything wrong in a file is one `InputError`; no equation lives here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from hoopd.files.model import EffectEntry, ModelFile, Parameter, PlantModelFile, model_text
from hoopd.files.plant import LONGEST_SAMPLE_S
from hoopd.files.reading import InputError, read_text, to_struct
from hoopd.files.records import between
from hoopd.files.shipped import way_to
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.found_effects import EffectError, checked
from hoopd.plants.model_file import HOOP, check_parameter, effects_plant, model_content, parse_model
from hoopd.plants.registry import REGISTERED, SUFFIXES, resolve_plant

PROGRAM = ".py"


@dataclass(frozen=True)
class PlantModel:
    """A plant with the numbers of a model file, or its nominal ones."""

    plant: Plant
    file: ModelFile | PlantModelFile
    plant_file: Path | None = None  # where the plant is declared, unless it is a registered one

    @property
    def name(self) -> str:
        """Of the model."""
        return self.file.name

    @property
    def is_hoop(self) -> bool:
        """Whether the daemon can run on it."""
        return isinstance(self.file, ModelFile)

    @property
    def effects(self) -> list[EffectEntry]:
        """Those that the model has."""
        return self.file.effects

    @property
    def known_effects(self) -> dict[str, Effect]:
        """Declarations by name, those of the model among them; none where it has none."""
        return known_effects(self.plant, [one.name for one in self.effects]) if self.effects else {}

    @property
    def simulated_effects(self) -> tuple[Effect, ...]:
        """Declarations of those that a free run has, in ranges that hold the model's values."""
        known, values = self.known_effects, self.values
        return tuple(known[one.name].holding(values) for one in self.effects if known[one.name].is_simulated)

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the plant by name, and the effects' by `slot.effect.parameter`."""
        known, found = self.known_effects, dict(self.plant.values)
        for one in self.effects:
            own = {**known[one.name].neutral(), **{key: p.value for key, p in one.parameters.items()}}
            found |= {f"{one.name}.{key}": value for key, value in own.items()}
        return found


def load_plant_model(path: Path, plant: str | None = None) -> PlantModel:
    """Load a model file of whatever plant.

    Parameters
    ----------
    path : Path
        `hoopd.model/1`.
    plant : str, optional
        The plant whose model it has to be, a name or a file.

    Returns
    -------
    PlantModel
        The plant with the numbers of the file.

    Raises
    ------
    InputError
        A file that cannot be used, or another plant's.

    Examples
    --------
    >>> from hoopd.files.shipped import defaults_folder
    >>> from hoopd.plants.plant_model import load_plant_model
    >>> hoop = load_plant_model(defaults_folder() / "models/hoop.yaml")
    >>> hoop.name, hoop.is_hoop
    ('hoop', True)
    """
    return parse_plant_model(read_text(path), path, plant)


def parse_plant_model(text: str, path: Path, plant: str | None = None) -> PlantModel:
    """The model of a file's text; `path` is what a message calls it, and where plant files are looked for."""
    content = model_content(text, path)
    told = content.get("plant", HOOP) if isinstance(content, dict) else HOOP
    if told == HOOP:
        if plant not in (None, HOOP):
            raise InputError(path, "plant", f"a model of the hoop, not of {plant}")
        model = parse_model(text, path)
        return hoop_model(model)
    file = to_struct(content, PlantModelFile, path)
    if plant is None and Path(file.plant).suffix == PROGRAM:
        # a model is data, from whomever: it must not have a program run
        raise InputError(path, "plant", f"{file.plant} is a program: name it with --plant, which runs it")
    if plant not in (None, file.plant) and (plant == HOOP or {plant, file.plant} <= {*REGISTERED}):
        raise InputError(path, "plant", f"a model of {file.plant}, not of {plant}")
    text = plant or _beside(file.plant, path)
    found = resolve_plant(text)
    _check(path, file, found)
    return PlantModel(replace(found, values={**found.values, **file.values()}), file, _file_of(text))


def with_parameters(
    model: PlantModel, values: Mapping[str, float], intervals: Mapping[str, tuple[float, float]], name: str
) -> PlantModel:
    """The model of another plant than the hoop with other numbers, those of effects by `slot.effect.parameter`."""
    assert isinstance(model.file, PlantModelFile)
    before, units, known = model.values, model.plant.units, model.known_effects

    def entry(key: str, unit: str, old: Parameter | None) -> Parameter:
        if key not in intervals and values.get(key, before[key]) == before[key] and old is not None:
            return old
        return Parameter(values.get(key, before[key]), unit, intervals.get(key), before[key])

    own = {key: entry(key, units.get(key, "-"), model.file.parameters.get(key)) for key in model.plant.values}
    effects = [
        msgspec.structs.replace(
            one,
            parameters={
                key: entry(f"{one.name}.{key}", known[one.name].parameter(key).unit, old)
                for key, old in one.parameters.items()
            },
        )
        for one in model.effects
    ]
    return replace(model, file=msgspec.structs.replace(model.file, name=name, parameters=own, effects=effects))


def is_of_another_plant(path: Path) -> bool:
    """Whether a model file is of another plant than the hoop."""
    content = model_content(read_text(path), path)
    return isinstance(content, dict) and bool(content.get("plant", HOOP) != HOOP)


def plant_model_text(model: PlantModel, path: Path) -> str:
    """The text of a model for a file at `path`, which names the plant's file from its own folder; InputError for a
    model that no command could load."""
    file = model.file
    if isinstance(file, PlantModelFile) and model.plant_file is not None:
        file = msgspec.structs.replace(file, plant=way_to(model.plant_file, path))
    text = model_text(file)
    named = None if isinstance(file, ModelFile) or model.plant_file is None else str(model.plant_file)
    parse_plant_model(text, path, named)
    return text


def nominal_model(plant: str) -> PlantModel:
    """Give a plant with its nominal parameters.

    Parameters
    ----------
    plant : str
        A registered name, or a plant file.

    Returns
    -------
    PlantModel
        The plant and its numbers.

    Raises
    ------
    InputError
        Neither a name nor a file that can be used.

    Examples
    --------
    >>> from hoopd.plants.plant_model import nominal_model
    >>> nominal_model("axis").values["M"]
    100.0
    """
    return declared_model(resolve_plant(plant), plant, _file_of(plant))


def declared_model(plant: Plant, called: str = "", plant_file: Path | None = None) -> PlantModel:
    """A plant with its nominal parameters; `called`: the name or file that a model file says."""
    parameters = {name: Parameter(value, plant.units.get(name, "-")) for name, value in plant.values.items()}
    file = PlantModelFile(
        "hoopd.model/1", plant.name, called or plant.name, parameters, sample_time_s=plant.time_scale_s
    )
    return PlantModel(plant, file, plant_file)


def hoop_model(model: ModelFile) -> PlantModel:
    """A model of the hoop."""
    return PlantModel(effects_plant(model), model)


def _file_of(plant: str) -> Path | None:
    """The file that declares a plant; None of a registered name."""
    return None if plant in REGISTERED else Path(plant)


def _beside(plant: str, path: Path) -> str:
    """A plant file is looked for beside the model first."""
    own = path.parent / plant
    return str(own) if Path(plant).suffix in SUFFIXES and own.exists() else plant


def _check(path: Path, file: PlantModelFile, plant: Plant) -> None:
    for name, entry in file.parameters.items():
        if name not in plant.values:
            known = ", ".join(plant.values)
            raise InputError(path, f"parameters.{name}", f"{plant.name} has no such parameter; it has {known}")
        check_parameter(path, f"parameters.{name}", entry, plant.units.get(name))
        low, high = plant.bounds.get(name, (-float("inf"), float("inf")))
        if not low <= entry.value <= high:
            raise InputError(path, f"parameters.{name}.value", f"{entry.value:g} is outside of {low:g} to {high:g}")
    between(path, "sample_time_s", file.sample_time_s, 0.0, LONGEST_SAMPLE_S)
    effects, seen = known_effects(plant, [one.name for one in file.effects]), set[str]()
    for index, one in enumerate(file.effects):
        key = f"effects[{index}]"
        if one.name in seen:
            raise InputError(path, f"{key}.name", f"{one.name} stands twice")
        seen.add(one.name)
        try:
            checked(plant, one.name, {name: p.value for name, p in one.parameters.items()})
        except EffectError as error:
            raise InputError(path, f"{key}.{error.key}", error.reason) from None
        for name, p in one.parameters.items():
            check_parameter(path, f"{key}.parameters.{name}", p, effects[one.name].parameter(name).unit)
