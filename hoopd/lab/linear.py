"""Linear models and what they say.

Rules of this file: thin over `hoopd.design`; systems are python-control's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import control
from numpy.typing import NDArray

from hoopd.design import analysis, margins, visibility
from hoopd.design.delay import held
from hoopd.design.speed import Bandwidth, bandwidth, step_info
from hoopd.ident import transfer_functions
from hoopd.lab.models import Model, as_model
from hoopd.lab.pictures import Picture
from hoopd.plants.hoop.operating_points import OperatingPoint, operating_point
from hoopd.plots.linear import DRAWINGS


@dataclass(frozen=True)
class Linear:
    """A linear model around an operating point; `.system` is python-control's, for all that it can do."""

    system: control.StateSpace
    point: OperatingPoint
    name: str

    @property
    def transfer_function(self) -> control.TransferFunction:
        """Torque to the first output, in full."""
        return transfer_functions.transfer_function(self._first)

    @property
    def poles(self) -> NDArray[Any]:
        """In rad/s; z of a sampled system."""
        poles: NDArray[Any] = self.system.poles()
        return poles

    @property
    def zeros(self) -> NDArray[Any]:
        """Of torque to the first output."""
        return transfer_functions.zeros(self._first)

    @property
    def controllability(self) -> visibility.Rank:
        """What the torque steers."""
        return visibility.controllability(self.system)

    @property
    def observability(self) -> visibility.Rank:
        """What the outputs tell."""
        return visibility.observability(self.system)

    @property
    def bandwidth(self) -> Bandwidth:
        """In rad/s, in both definitions."""
        return bandwidth(self._first)

    @property
    def step_info(self) -> dict[str, float] | None:
        """Of 1 N m; None when it does not settle."""
        return step_info(self._first)

    def margins(self, controller: Any = 1.0, delay: float = 0.0) -> margins.Margins:
        """Of the loop system times controller under negative feedback, `delay` s late; phases in rad, delays in s."""
        return margins.margins(control.ss(self._first * controller), delay)

    def plot(self, kind: str = "overview") -> Picture:
        """overview, bode, nyquist, poles or step."""
        if kind not in DRAWINGS:
            raise ValueError(f"unknown {kind!r}; known: {', '.join(DRAWINGS)}")
        output = self.system.output_labels[0]
        return Picture(DRAWINGS[kind](self._first, title=f"{self.name}: {output} / torque"))

    @property
    def _first(self) -> control.StateSpace:
        return analysis.channel(self.system, self.system.output_labels[0])


# What an operating point of the hoop is told by: where the ball is held, or how fast the hoop turns.
POINT = ("psi", "hoop_speed")


def linearize(
    model: Model | str,
    outputs: Sequence[str] | str = ("psi",),
    *,
    top: bool = False,
    sample_time: float | None = None,
    delay: int = 0,
    **at: float | None,
) -> Linear:
    """Linearise a model about an operating point.

    At rest at the bottom, at the `top`, or where `at` says.

    Parameters
    ----------
    model : Model or str
        The plant, or a model by name or path.
    outputs : sequence of str
        Of theta, dtheta, psi, dpsi.
    top : bool
        The ball at the top.
    sample_time : float, optional
        Step in s over which the torque is held; continuous unless given.
    delay : int
        Samples by which the torque is late.
    **at : float
        Of the hoop: `psi`, the angle in rad at which the ball is held, or `hoop_speed`, in rad/s, at which it turns.

    Returns
    -------
    Linear
        The `system`, python-control's, about its `point`, with `poles`, `zeros` and what else is asked of it.

    Raises
    ------
    NoEquilibriumError
        The plant cannot stay there (a ValueError).
    ValueError
        Arguments that contradict each other.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> [round(float(abs(pole)), 2) for pole in lab.linearize("thesis").poles if pole.imag > 0]
    [8.58]
    """
    if unknown := at.keys() - POINT:
        raise TypeError(f"linearize has no argument {', '.join(sorted(unknown))}; known: {', '.join(POINT)}")
    angle, speed = (at.get(name) for name in POINT)
    if top and (angle is not None or speed is not None):
        raise ValueError("top fixes the ball's angle: give nothing beside it")
    if delay and sample_time is None:
        raise ValueError("delay counts samples: give sample_time too")
    if sample_time is not None and not (sample_time > 0.0 and math.isfinite(sample_time)):
        raise ValueError(f"sample_time must be a positive time in s, not {sample_time}")
    own = as_model(model)
    limit = own.file.device.torque_limit_nm
    held_at = math.pi if top else angle
    point = operating_point(own.plant, psi_rad=held_at, dtheta_rad_s=speed, torque_limit_nm=limit)
    names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    system = analysis.linear_model(own.plant, point.x, point.u, names)
    if sample_time is not None:
        system = held(system, sample_time, delay * sample_time)
    return Linear(system, point, own.name)
