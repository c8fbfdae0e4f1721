"""The steps of a calibration, and what one of them found.

Rules of this file: plain records; what is drawn is numbers and labels, so that a version can keep it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.files.calibration import Part, StepJudgement

POINTS = 400  # of one curve


class GuideStep(NamedTuple):
    """One step as the page tells it."""

    title: str
    asks: str  # what has to be so beforehand
    moves: bool  # needs the test signal


STEPS: Mapping[str, GuideStep] = {
    "exposure": GuideStep("Picture and exposure", "Hoop and ball in view, light as it will be.", False),
    "circle": GuideStep("Circle", "Ball at rest at the bottom, hoop standing still.", False),
    "threshold": GuideStep("Threshold", "As before; nothing red beside the ball.", False),
    "zero": GuideStep("Zero angle", "Ball at rest, hoop standing still, drive off: two seconds are looked at.", False),
    "signs": GuideStep("Signs", "Torque, hoop and ball must turn the same way.", True),
    "torque": GuideStep("Torque constant", "What the drive gives of the torque that is demanded.", True),
    "delay": GuideStep("Camera delay", "How old pictures are, by what the model foretells of the ball.", True),
}


class CurveOfStep(msgspec.Struct, frozen=True):
    """One thing that is drawn: points, a line, steps or bars; `x` and `y` are of one length."""

    label: str
    kind: str
    x: Sequence[float]
    y: Sequence[float]

    @classmethod
    def of(cls, label: str, kind: str, x: NDArray[Any], y: NDArray[Any]) -> CurveOfStep:
        """Of numbers, as many of them as can be seen."""
        rows = np.linspace(0, len(x) - 1, min(len(x), POINTS)).astype(int)
        return cls(label, kind, np.round(x[rows], 5).tolist(), np.round(y[rows], 5).tolist())


class Drawing(msgspec.Struct, frozen=True):
    """Curves over one axis, with marks on it."""

    x: str
    y: str
    curves: Sequence[CurveOfStep]
    marks: Mapping[str, float] = {}  # upright lines by what they stand for


class StepResult(msgspec.Struct, frozen=True):
    """What a step found."""

    good: bool
    why: str
    values: Mapping[str, Any] = {}
    part: Part = {}
    drawings: Sequence[Drawing] = ()
    notes: Sequence[str] = ()
    at: float = msgspec.field(default_factory=time.time)
    picture: bytes = b""  # JPEG

    def told(self) -> dict[str, Any]:
        """For the page."""
        fields: dict[str, Any] = msgspec.to_builtins(msgspec.structs.replace(self, picture=b""))
        return {**fields, "picture": bool(self.picture)}

    def judgement(self) -> StepJudgement:
        """For a version."""
        return StepJudgement(good=self.good, why=self.why[:300], values=dict(self.values))
