"""Recording after recording until it is known what a model leaves out.

Rules of this file: thin over `hoopd learn`; the rig alone, the device is for the command line.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.commands.options.declaration import from_python, words_of
from hoopd.commands.options.learn import LONGEST_S, LearnOptions
from hoopd.lab.models import Model, as_model, model
from hoopd.lab.pictures import Picture
from hoopd.lab.recordings import on_the_rig
from hoopd.plants.model_file import HOOP
from hoopd.plots.learning import draw_beliefs


@dataclass(frozen=True, repr=False)
class LearnedModel:
    """What a campaign came to."""

    result: Mapping[str, Any]  # as `hoopd learn --json` writes it

    def __repr__(self) -> str:
        return f"LearnedModel({self.result['explanation']}: {self.result['ended_because']})"

    @property
    def settled(self) -> bool:
        """Whether it is as sure as was asked for."""
        return bool(self.result["settled"])

    @property
    def laws(self) -> list[str]:
        """What the model left out, the strongest first."""
        return list(self.result["laws"])

    @property
    def model(self) -> Model:
        """With what was found."""
        return model(self.result["model"])

    @property
    def story(self) -> Path:
        """The page."""
        return Path(self.result["story"])

    def plot(self) -> Picture:
        """What was believed after each run."""
        shares = [tuple(one.items()) for one in self.result["beliefs"]]
        return Picture(draw_beliefs([(f"run {number}", one) for number, one in enumerate(shares, 1)]))


def learn(
    *,
    rig: Model | str = "hoop",
    budget: str | None = None,
    confidence: float | None = None,
    seed: int | None = None,
    folder: Path | str = "learned",
    memory: Path | str | None = None,
    jobs: int | None = None,
    sets: Mapping[str, Any] | None = None,
) -> LearnedModel:
    """Record on the rig and diagnose until it is known what the model leaves out, then try a controller that knows it.

    Parameters
    ----------
    rig : Model or str
        The model that the rig's plant follows, which nobody else is told.
    budget : str, optional
        Recorded time at most, "10min" or "90s"; 10 minutes.
    confidence : float, optional
        Probability that an explanation shall reach among the laws that are known; 0.95.
    seed : int, optional
        Of signals, rig and search; 0.
    folder : str or Path
        Of the campaign; one that was broken off goes on.
    memory : Path or str, optional
        What is known of this device (`hoopd.memory/1`): the prior of each diagnosis, and what is learned is added.
    jobs : int, optional
        Processes that share a diagnosis; 1.
    sets : mapping of str to object, optional
        Keys of the configuration, {"sim.delay_frames": 3}.

    Returns
    -------
    LearnedModel
        Whether it is `settled`, the `laws`, the `model` with them and the page of its `story`.

    Raises
    ------
    ValueError
        In the words of the command when it refuses.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> hidden = {"sim.effects": "[{name: hoop.coulomb_friction, parameters: {Fc: 0.006}}]"}
    >>> lab.learn(budget="3min", sets=hidden).laws  # doctest: +SKIP
    ['hoop.coulomb_friction']
    """
    place = Path(folder)
    changes = dict(sets or {})
    if rig != HOOP:
        changes["sim.model"] = as_model(rig).save(place.with_name(f"{place.name}_rig.yaml")).path
    known = None if memory is None else Path(memory)
    asked = from_python(
        LearnOptions,
        budget=budget,
        confidence=confidence,
        seed=seed,
        folder=place,
        memory=known,
        jobs=jobs,
        sets=changes,
    )
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "told.json"
        words = [*words_of(asked), "--sim", "--json", str(told)]
        on_the_rig("learn", *words, told=told, no_is_an_answer=True, patience_s=LONGEST_S)
        return LearnedModel(json.loads(told.read_text()))
