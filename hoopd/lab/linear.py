"""Linear models and what they say.

Rules of this file: thin over `hoopd.design`; systems are python-control's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import control
from numpy.typing import NDArray

from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.commands.plant_linear import first_input, linearized
from hoopd.design import analysis, margins, visibility
from hoopd.design.delay import held
from hoopd.design.linear_plant import Equilibrium
from hoopd.design.speed import Bandwidth, bandwidth, step_info
from hoopd.ident import transfer_functions
from hoopd.lab.models import Model, as_model, model_of
from hoopd.lab.pictures import Picture
from hoopd.lab.signatures import with_named_keywords
from hoopd.plants.declaration import Plant
from hoopd.plants.hoop.loop.operating_points import HeldBall, OperatingPoint, operating_point, told
from hoopd.plants.plant_model import PlantModel
from hoopd.plants.scales import usual_sizes
from hoopd.plots.linear import DRAWINGS


@dataclass(frozen=True)
class Linear:
    """A linear model around an operating point; `.system` is python-control's, for all that it can do.

    What is said of one input and one output is said of the first ones.
    """

    system: control.StateSpace
    point: OperatingPoint | Equilibrium
    name: str
    notes: tuple[str, ...] = ()  # what the model leaves out
    sizes: Mapping[str, float] = field(default_factory=dict)  # usual ones of another plant's states and inputs

    @property
    def transfer_function(self) -> control.TransferFunction:
        """The first input to the first output, in full."""
        return transfer_functions.transfer_function(self._first)

    @property
    def poles(self) -> NDArray[Any]:
        """In rad/s; z of a sampled system."""
        poles: NDArray[Any] = self.system.poles()
        return poles

    @property
    def zeros(self) -> NDArray[Any]:
        """Of the first input to the first output."""
        return transfer_functions.zeros(self._first)

    @property
    def controllability(self) -> visibility.Rank:
        """What the inputs steer; of another plant than the hoop in its usual sizes."""
        return visibility.controllability(visibility.in_usual_sizes(self.system, self.sizes))

    @property
    def observability(self) -> visibility.Rank:
        """What the outputs tell; of another plant than the hoop in its usual sizes."""
        return visibility.observability(visibility.in_usual_sizes(self.system, self.sizes))

    @property
    def bandwidth(self) -> Bandwidth:
        """In rad/s, in both definitions."""
        return bandwidth(self._first)

    @property
    def step_info(self) -> dict[str, float] | None:
        """Of one unit of the input; None when it does not settle."""
        return step_info(self._first)

    def margins(self, controller: Any = 1.0, delay: float = 0.0) -> margins.Margins:
        """Of the loop system times controller under negative feedback, `delay` s late; phases in rad, delays in s."""
        return margins.margins(control.ss(self._first * controller), delay)

    def plot(self, kind: str = "overview") -> Picture:
        """overview, bode, nyquist, poles or step."""
        if kind not in DRAWINGS:
            raise ValueError(f"unknown {kind!r}; known: {', '.join(DRAWINGS)}")
        output, first = self.system.output_labels[0], self.system.input_labels[0]
        return Picture(DRAWINGS[kind](self._first, title=f"{self.name}: {output} / {first}"))

    @property
    def _first(self) -> control.StateSpace:
        return analysis.channel(first_input(self.system), self.system.output_labels[0])


# What an operating point of the hoop is told by: where the ball is held, or how fast the hoop turns.
POINT = tuple(HeldBall.__annotations__)
USUAL_OUTPUTS = ("psi",)


@with_named_keywords
def linearize(
    model: Model | PlantModel | Path | str | None = None,
    outputs: Sequence[str] | str = (),
    *,
    plant: Plant | str | None = None,
    at: Mapping[str, float] | None = None,
    top: bool = False,
    sample_time: float | None = None,
    delay: int = 0,
    **point: Unpack[HeldBall],
) -> Linear:
    """Linearise a model of any plant about an operating point.

    The hoop is at rest at the bottom, at the `top`, or where `psi` or `hoop_speed` says; another plant where it stays
    under the inputs of `at`, near its states.

    Parameters
    ----------
    model : Model, str or Path, optional
        A model, its name or its path; another plant's nominal values unless given.
    outputs : sequence of str
        Of the hoop theta, dtheta, psi (unless told) and dpsi; of another plant its channels, all unless told.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the model's unless given.
    at : mapping of str to float, optional
        Of another plant: inputs that are held, and states near which to look; one that needs an input that was not
        named is refused.
    top : bool
        The ball at the top.
    sample_time : float, optional
        Step in s over which the inputs are held; continuous unless given.
    delay : int
        Samples by which the inputs are late.
    psi : float, optional
        Of the hoop: angle in rad at which the ball is held.
    hoop_speed : float, optional
        Of the hoop: speed in rad/s at which it turns.

    Returns
    -------
    Linear
        The `system`, python-control's, about its `point`, with `poles`, `zeros` and what else is asked of it.

    Raises
    ------
    NoEquilibriumError
        The hoop cannot stay there (a ValueError).
    ValueError
        Arguments that contradict each other, and another plant that stays nowhere near.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> [round(float(abs(pole)), 2) for pole in lab.linearize("thesis").poles if pole.imag > 0]
    [8.58]
    >>> lab.linearize(plant="axis").poles.real.tolist()
    [0.0, -2.0]
    """
    if unknown := point.keys() - POINT:
        raise TypeError(f"linearize has no argument {', '.join(sorted(unknown))}; known: {', '.join(POINT)}")
    angle, speed = told(point)
    if delay and sample_time is None:
        raise ValueError("delay counts samples: give sample_time too")
    if sample_time is not None and not (sample_time > 0.0 and math.isfinite(sample_time)):
        raise ValueError(f"sample_time must be a positive time in s, not {sample_time}")
    if (other := model_of(plant, model)) is not None:
        if top or angle is not None or speed is not None:
            raise ValueError(f"top, {', '.join(POINT)} are of the hoop: another plant's operating point is told by at")
        asked = from_python(LinearizeOptions, outputs=outputs, at=at)
        found = linearized(other, asked.at, asked.outputs)
        system = _sampled(found.system, sample_time, delay)
        return Linear(system, found.point, other.name, found.left_out, usual_sizes(other.plant))
    if at:
        raise ValueError(f"at is of other plants: top, {', '.join(POINT)} say where the hoop is")
    if model is None or isinstance(model, PlantModel):
        raise ValueError("linearize takes a model, or another plant than the hoop: linearize(plant='axis')")
    if top and (angle is not None or speed is not None):
        raise ValueError("top fixes the ball's angle: give nothing beside it")
    own = as_model(model)
    limit = own.file.device.torque_limit_nm
    held_at = math.pi if top else angle
    here = operating_point(own.plant, psi_rad=held_at, dtheta_rad_s=speed, torque_limit_nm=limit)
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs) or USUAL_OUTPUTS
    system = analysis.linear_model(own.plant, here.x, here.u, names)
    return Linear(_sampled(system, sample_time, delay), here, own.name)


def _sampled(system: control.StateSpace, sample_time: float | None, delay: int) -> control.StateSpace:
    """With the inputs held over a step, and late; as it is without one."""
    return system if sample_time is None else held(system, sample_time, delay * sample_time)
