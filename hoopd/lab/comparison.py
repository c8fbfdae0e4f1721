"""Two laws that take turns on the rig.

Rules of this file: thin over `hoopd compare`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.commands.options.compare import CompareOptions
from hoopd.commands.options.declaration import from_python, words_of
from hoopd.design.comparison import RESULTS
from hoopd.lab.controllers import Controller, as_controller
from hoopd.lab.models import Model
from hoopd.lab.pictures import Picture
from hoopd.lab.recordings import QUIETLY, on_the_rig, rig_words
from hoopd.plots.comparison import draw_comparison


@dataclass(frozen=True, repr=False)
class ComparedControllers:
    """What an alternating run showed."""

    result: Mapping[str, Any]  # as `hoopd compare --json` writes it

    def __repr__(self) -> str:
        return f"ComparedControllers({self.verdict}: {self.result['reason']})"

    @property
    def verdict(self) -> str:
        """Of the candidate: better, worse, not told apart, went back, stopped."""
        return str(self.result["verdict"])

    @property
    def change(self) -> float | None:
        """Of what decides, in percent; negative is better."""
        return self.result[RESULTS[self.result.get("judged_by", "cost")]]["change_percent"]  # type: ignore[no-any-return]

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Where the change of what decides lies, in percent, whenever the run ended; None: no bound yet."""
        low, high = self.result[RESULTS[self.result.get("judged_by", "cost")]]["interval_percent"]
        return low, high

    def plot(self) -> Picture:
        """Pairs of blocks, and the change with its interval."""
        return Picture(draw_comparison(self.result))


def compare(
    accepted: Controller | str,
    candidate: Controller | str,
    *,
    rig: Model | str = "hoop",
    blocks: int | None = None,
    settle: float | None = None,
    hold: float | None = None,
    amplitude: float | None = None,
    by: str | None = None,
    alpha: float | None = None,
    seed: int | None = None,
    folder: Path | str | None = None,
    **sets: Any,
) -> ComparedControllers:
    """Let two laws take turns in one run of the daemon on the rig, in random order, until it is clear which is better.

    Parameters
    ----------
    accepted, candidate : Controller or str
        Designs, or controllers by name or path.
    rig : Model or str
        The model that the rig's plant follows, which nobody else is told.
    blocks : int, optional
        Blocks at most, an even number; 20.
    settle, hold : float, optional
        s of each block that do not count, and of each of its four references; 2.
    amplitude : float, optional
        Angle in rad of the references; 0.1.
    by : str, optional
        What decides: "ball", its error, or "cost", of the design, which charges torque; "ball".
    alpha : float, optional
        How often two equal laws may be called different; 0.05.
    seed : int, optional
        Of the order, and of the rig; 0.
    folder : str or Path, optional
        Existing folder for the recording.
    **sets : object
        Entries of the configuration with __ for the dot, sim__delay_frames=3.

    Returns
    -------
    ComparedControllers
        The `verdict`, the `change` of what decides in percent and its `interval`.

    Raises
    ------
    ValueError
        In the words of the command when it refuses.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.compare("lqg", "arx", blocks=8, seed=1).verdict
    'worse'
    """
    with tempfile.TemporaryDirectory() as place:
        files = [_file(law, Path(place), name) for law, name in ((accepted, "accepted"), (candidate, "candidate"))]
        asked = from_python(
            CompareOptions, accepted=files[0], candidate=files[1], blocks=blocks, settle=settle, hold=hold,
            amplitude=amplitude, by=by, alpha=alpha, seed=seed, folder=None if folder is None else Path(folder),
        )  # fmt: skip
        told = Path(place) / "told.json"
        changes = [part for name, value in sets.items() for part in ("--set", f"{name.replace('__', '.')}={value}")]
        words = [*words_of(asked), *QUIETLY, *rig_words(rig, place), *changes, "--json", str(told)]
        on_the_rig("compare", *words, told=told, no_is_an_answer=True)
        return ComparedControllers(json.loads(told.read_text()))


def _file(law: Controller | str, folder: Path, name: str) -> Path | None:
    own = as_controller(law)
    known = own.model.save(folder / f"{name}-model.yaml")
    return Controller(own.controller_file, known).save(folder / f"{name}.yaml").path
