"""Where recordings and a model differ: the physics that was left out, named and proven.

Rules of this file: `hoopd diagnose` on recordings in memory; nothing is computed here.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from threadpoolctl import threadpool_limits

from hoopd.commands.diagnose import judged_model, searched, write_model
from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.diagnose.inputs import Source, source_of
from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.report.terminal import report_text
from hoopd.diagnose.run import Outcome
from hoopd.files.whole_files import replace_file
from hoopd.lab.models import Model, check_of_hoop, model_of, shipped
from hoopd.plants.declaration import Plant
from hoopd.plants.plant_model import PlantModel, hoop_model
from hoopd.plants.recorded_sizes import with_recorded_sizes
from hoopd.recording import Recording

WIDTH = 100


@dataclass(frozen=True, repr=False)
class Diagnosed:
    """What a diagnosis found."""

    outcome: Outcome
    base: PlantModel

    def __repr__(self) -> str:
        out = io.StringIO()
        report_text(self.diagnosis, Console(file=out, width=WIDTH))
        return out.getvalue()

    @property
    def diagnosis(self) -> Diagnosis:
        """The record of `hoopd diagnose --json`."""
        return self.outcome.diagnosis

    @property
    def verdict(self) -> str:
        """consistent, parameters, missing_physics, unknown_physics ..."""
        return str(self.diagnosis.verdict)

    @property
    def effects(self) -> dict[str, dict[str, float | None]]:
        """Named effects with the values of their parameters."""
        return {
            one.name: {name: value.value for name, value in one.parameters.items()} for one in self.diagnosis.effects
        }

    @property
    def parameters(self) -> dict[str, float | None]:
        """Re-estimated parameters of the model by name."""
        return {name: one.value for name, one in self.diagnosis.base.parameters.items()}

    def report(self, path: Path | str) -> Path:
        """Write the whole report as one page."""
        from hoopd.diagnose.report.page import page

        replace_file(Path(path), page(self.diagnosis, self.outcome.shown))
        return Path(path)

    def save(self, path: Path | str, *, yes: bool = False) -> Path:
        """Write a model (`hoopd.model/1`) with what was found; `yes`: also one with a parameter of another sign than
        before, or beyond its bounds (InputError otherwise)."""
        return write_model(self.outcome, self.base, Path(path), yes=yes)


def diagnose(
    recordings: Recording | Sequence[Recording],
    *,
    plant: Plant | str | None = None,
    model: Model | PlantModel | Path | str | None = None,
    holdout: Recording | Sequence[Recording] = (),
    effects: Path | str | None = None,
    without: Sequence[str] | str = (),
    seed: int = 0,
    free_run: bool = True,
    free_run_choice: bool = False,
    grammar: bool = True,
    jobs: int = 1,
) -> Diagnosed:
    """Say where recordings and a model differ, name the physics that was left out, prove it on data never fitted.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        What was measured.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the hoop unless given.
    model : Model, str or Path, optional
        The model that is judged, or its file; the plant's nominal values (of the hoop the thesis's) unless given.
    holdout : Recording or sequence of Recording
        Recordings that prove the gain; the last third of each unless given.
    effects : str or Path, optional
        File with effects of your own beside the library.
    without : sequence of str
        Effects that are not to be looked for, ("body.cogging",).
    seed : int
        Of everything random in the search.
    free_run : bool
        Also refine and compare one run over whole recordings.
    free_run_choice : bool
        Look, too, for effects that make that run better (minutes).
    grammar : bool
        Also look for mechanisms that the library has no name for.
    jobs : int
        Processes that share the work: less time, the same numbers.

    Returns
    -------
    Diagnosed
        The `verdict`, the named `effects` and the re-estimated `parameters`; `report` writes a page, `save` a model.

    Raises
    ------
    ValueError
        No recording.
    InputError
        Nothing to judge a model by.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> swing = lab.load("decay.csv", "alpha=Angle:deg", plant="pendulum")  # doctest: +SKIP
    >>> found = lab.diagnose(swing, plant="pendulum")  # doctest: +SKIP
    >>> found.verdict, found.effects  # doctest: +SKIP
    """
    train, held = _several(recordings), _several(holdout)
    if not train:
        raise ValueError("diagnose takes a recording or several: diagnose([lab.load('a.mcap'), lab.load('b.mcap')])")
    base = model_of(plant, model) or (hoop_model(model.file) if isinstance(model, Model) else _hoop(model))
    if base.is_hoop:
        check_of_hoop([*train, *held])
    base = replace(base, plant=with_recorded_sizes(base.plant, train))
    asked = from_python(
        DiagnoseOptions,
        recordings=(),
        effects=None if effects is None else Path(effects),
        without=without,
        seed=seed,
        free_run=free_run,
        free_run_choice=free_run_choice,
        grammar=grammar,
        jobs=jobs,
    )
    # many small matrices gain nothing from threads; a notebook has imported numpy long before anyone could say so
    with threadpool_limits(limits=1, user_api="blas"):
        outcome = searched(_sources(train, base.plant), _sources(held, base.plant, len(train)), base, asked)
    return Diagnosed(outcome, base)


def _several(given: Recording | Sequence[Recording]) -> tuple[Recording, ...]:
    found = (given,) if isinstance(given, Recording) else tuple(given)
    if not all(isinstance(one, Recording) for one in found):
        raise ValueError("recordings are needed, as lab.load reads them")
    return found


def _sources(recordings: Sequence[Recording], plant: Plant, before: int = 0) -> list[Source]:
    """By the names of their files, or their number."""
    names = [one.source or f"recording {before + number}" for number, one in enumerate(recordings, 1)]
    twice = {name for name in names if names.count(name) > 1}
    named = [f"{name} ({number})" if name in twice else name for number, name in enumerate(names, 1)]
    return [source_of(name, one, plant) for name, one in zip(named, recordings, strict=True)]


def _hoop(model: PlantModel | Path | str | None) -> PlantModel:
    if isinstance(model, PlantModel):
        return model
    return judged_model(None, None if model is None else shipped("models", model))
