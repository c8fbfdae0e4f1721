"""What a controller file stands for in the tick: law, feed-forward, limits, and the filter that it was designed with.

Rules of this file: pure; a law or a feed-forward that fails is told, never raised: the caller decides what follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import NamedTuple, Protocol

from hoopd.core.ballresponse import BallMotion
from hoopd.core.controllers import Controller, Measurement
from hoopd.core.drift import Level
from hoopd.core.encoderchecks import HoopMotion
from hoopd.core.feedforward import FeedForward
from hoopd.core.records import CameraSample, DriverSample, Estimate, Vector


class Estimator(Protocol):
    """What the tick asks of a state estimator."""

    def update(
        self,
        t: float,
        torque_previous: float,
        t_applied: float,
        driver: DriverSample | None,
        camera: CameraSample | None,
        *,
        held: bool,
        unmodelled: float = 0.0,
        may_fly: bool = False,
    ) -> Estimate: ...

    def reset(self) -> None: ...


@dataclass(frozen=True, eq=False)
class Filter:
    """An estimator, and what its model says of an honest device."""

    estimator: Estimator
    feedforward: FeedForward = field(default_factory=FeedForward)
    levels: Mapping[str, Level] | None = None  # normal innovations by channel; None: learned
    ball: BallMotion | None = None
    hoop: HoopMotion | None = None
    key: str = ""  # of what it was made from: equal keys, equal filters


class ControllerLabel(NamedTuple):
    """Which file a law came from, and who asked for it."""

    name: str = ""
    sha256: str = ""  # of the file's bytes
    by: str = ""


NO_LABEL = ControllerLabel()


class Demanded(NamedTuple):
    """What a law asks of the drive in one tick."""

    torque_nm: float  # with feed-forward; NaN when the law failed
    added_nm: float = 0.0  # of it feed-forward
    ended: str = ""  # why the law is over
    failed: str = ""  # why its torque is none
    unfed: str = ""  # why feed-forward added nothing where it should have


@dataclass(frozen=True, eq=False)
class Installed:
    """A law with all that belongs to it."""

    law: Controller
    filter: Filter
    torque_nm: float
    slew_nm_per_tick: float
    fed: bool = True  # with the filter's feed-forward; a test signal is played as it was asked for, a plan has it in it
    label: ControllerLabel = NO_LABEL

    def demand(self, measurement: Measurement, *, acting: bool = True) -> Demanded:
        """The law's torque and feed-forward's; a law that fails (a user's own may) has one that is not a number.

        `acting`: False while another one drives the hoop: a law that plays a table does not begin then, and one whose
        memory is of its own doing takes it from the plant (`follow`).
        """
        try:
            update = self.law.update if acting else getattr(self.law, "follow", self.law.update)
            wanted, _ = update(measurement)
            wanted = float(wanted)
            ended = getattr(self.law, "ended", "")
        except Exception as error:
            return Demanded(nan, failed=f"{type(error).__name__}: {error}")
        ended = ended if isinstance(ended, str) else ""
        if ended or not (self.fed and measurement.ready and isfinite(wanted)):
            return Demanded(wanted, ended=ended)
        # The torque that moves the hoop as the wanted one would without missing physics.
        forward = self.filter.feedforward
        demanded = forward.demand(measurement.x, wanted)
        return Demanded(demanded, demanded - wanted, unfed=forward.trouble)


def acted_on(estimate: Estimate) -> Vector:
    """The state on which this tick's torque will act."""
    return estimate.x if estimate.ahead is None else estimate.ahead
