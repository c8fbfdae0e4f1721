"""Models: shipped ones by name, files by path, changed ones.

Rules of this file: thin over `hoopd.plants.model_file`; a model is never changed in place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec

from hoopd.commands.plant_inputs import other_model
from hoopd.files.model import ModelFile, Parameter, model_text
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.files.whole_files import replace_file
from hoopd.plants.declaration import Plant
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, ParameterError
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import load_model, parse_model, plant_of
from hoopd.plants.plant_model import PlantModel, declared_model
from hoopd.recording.recording import Recording


@dataclass(frozen=True, repr=False)
class Model:
    """A model file's content; `path`: where it is, None for one that was not saved."""

    file: ModelFile
    path: Path | None = None

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={entry.value:.5g}" for name, entry in self.file.parameters.items())
        return f"Model({self.name}, {self.structure}: {values})"

    @property
    def name(self) -> str:
        """What files and figures call it."""
        return self.file.name

    @property
    def structure(self) -> str:
        """entries, rolling or published."""
        return self.file.structure

    @property
    def parameters(self) -> dict[str, float]:
        """Every parameter of the structure in SI units, device constants included."""
        return self.file.values()

    @cached_property
    def plant(self) -> HoopPlant:
        """The nonlinear plant: `plant.derivative(x, u)`, `plant.advance(x, u, h)`, x = (theta, dtheta, psi, dpsi)."""
        return plant_of(self.file)

    def with_parameters(self, **changes: float) -> Model:
        """The same with other numbers, whose intervals go; ParameterError (a ValueError) for an unknown or impossible
        one.

        >>> model("hoop").with_parameters(bh=1e-3).parameters["bh"]
        0.001
        """
        units = PARAMETER_UNITS[self.structure]
        for name in changes:
            if name not in units:
                raise ParameterError(name, f"not a parameter of the {self.structure} model; known: {', '.join(units)}")
        entries = {
            name: Parameter(value=float(value), unit=units[name], nominal=self.parameters[name])
            for name, value in changes.items()
        }
        file = msgspec.structs.replace(self.file, parameters={**self.file.parameters, **entries})
        return Model(parse_model(model_text(file), self.name))

    def save(self, path: Path | str) -> Model:
        """Write `hoopd.model/1`, named after its file, as every command and the daemon take it; the saved model."""
        target = Path(path)
        file = msgspec.structs.replace(self.file, name=target.stem)
        replace_file(target, model_text(file).encode())
        return Model(file, target)

    def table(self) -> str:
        """Parameters, their 95 % intervals and units as text."""
        lines = [f"{self.name} ({self.structure})"]
        for name, entry in self.file.parameters.items():
            ci = "" if entry.ci95 is None else f"[{entry.ci95[0]:.5g}, {entry.ci95[1]:.5g}]"
            lines.append(f"{name:>4} {entry.value:12.6g} {ci:<26} {entry.unit}")
        return "\n".join(lines)


def model(name: Path | str) -> Model:
    """Load a model.

    Parameters
    ----------
    name : str or Path
        Its shipped name ("hoop", "thesis"), or its file's path.

    Returns
    -------
    Model
        Its `parameters` in SI units and its `plant`.

    Raises
    ------
    InputError
        A file that cannot be used.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> thesis = lab.model("thesis")
    >>> thesis.structure, round(thesis.parameters["L2"], 2)
    ('entries', 210.12)
    """
    path = shipped("models", name)
    file = load_model(path)
    if file.effects:
        names = ", ".join(entry.name for entry in file.effects)
        raise InputError(
            path,
            "effects",
            f"the lab takes models without effects, and this one has {names}: use `hoopd simulate`, `fit`, `design`",
        )
    return Model(file, path)


def model_of(plant: Plant | str | None, model: Model | PlantModel | Path | str | None) -> PlantModel | None:
    """The model of another plant than the hoop that is asked about; None for the hoop. ValueError for a plant that is
    declared here and a model's file, which names its own."""
    if isinstance(model, PlantModel | Model):
        if plant is not None:
            raise ValueError("a model knows its plant: give one or the other")
        return None if isinstance(model, Model) or model.is_hoop else model
    if isinstance(plant, Plant):
        if model is not None:
            raise ValueError("model belongs to a plant by name or file: give one or the other")
        return declared_model(plant)
    if model is not None and not isinstance(model, Path | str):
        raise ValueError(f"expected a model, its name or its path, not {model!r}")
    if plant is not None:
        return other_model(plant, None if model is None else Path(model))
    return None if model is None else other_model(None, shipped("models", model))


def check_of_hoop(recordings: Sequence[Recording]) -> None:
    """ValueError for another plant's recording, where nobody said whose it is."""
    for one in recordings:
        if missing := [name for name in ("u", "theta", "psi") if name not in one.signals]:
            there = ", ".join(one.signals) or "nothing"
            lacks = f"{one.source or 'a recording'} has {there} and no {', '.join(missing)}"
            raise ValueError(f"{lacks}: no recording of the hoop; whose it is says plant=...")


def as_model(given: Model | Path | str) -> Model:
    """A model as it is, or by name or path."""
    if not isinstance(given, Model | Path | str):
        raise ValueError(f"expected a model, its name or its path, not {given!r}")
    return given if isinstance(given, Model) else model(given)


def shipped(folder: str, name: Path | str) -> Path:
    """A path as it stands, or the shipped file of a bare name; InputError tells which names there are."""
    if not isinstance(name, Path | str):
        raise InputError(name, "", f"a path or a shipped name of {folder} is expected")
    path = Path(name)
    if path.suffix or path.exists() or len(path.parts) > 1:
        return path
    known = {one.stem: one for one in sorted((defaults_folder() / folder).glob("*.yaml"))}
    if str(name) not in known:
        raise InputError(name, "", f"no such file, and shipped are only {', '.join(known)}")
    return known[str(name)]
