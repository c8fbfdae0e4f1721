"""What a running loop may learn without a person (`hoopd.policy/1`): which effects, how large, how often.

    schema: hoopd.policy/1
    effects: [hoop.coulomb_friction, camera.latency]   # names, or "hoop.*"
    parameter_change: 0.3                              # largest share by which a parameter may change; 0: none
    largest: {hoop.coulomb_friction.Fc: 0.02, bh: 0.002}   # of a parameter, in its unit, instead of the share
    least_probability: 0.3                             # of the very law; 0: the fresh seconds prove enough
    most_per_day: 4
    pause_s: 10 min

Rules of this file: one record, its checks, and its answer in words; nothing is measured here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import Strict

DAY_S = 86400.0
Share = Annotated[float, Meta(ge=0.0, le=10.0)]


class HealPolicy(Strict, frozen=True, kw_only=True):
    """`hoopd.policy/1`."""

    schema: Literal["hoopd.policy/1"]
    effects: list[str] = msgspec.field(default_factory=list)
    parameter_change: Share = 0.0
    largest: dict[str, float] = msgspec.field(default_factory=dict)
    least_probability: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    most_per_day: Annotated[int, Meta(ge=0, le=1000)] = 4
    pause_s: Annotated[float, Meta(ge=0.0, le=DAY_S)] = 600.0

    def objection(
        self,
        effects: Mapping[str, Mapping[str, float]],
        probabilities: Mapping[str, float],
        changes: Mapping[str, float | None],
        values: Mapping[str, float],
    ) -> str:
        """Why what was found may not be learned unasked; empty when it may.

        `effects`: parameters by name and parameter; `changes`: of the model's parameters, as shares of what they were,
        None where that was 0; `values`: what these, and others that changed by less, are now, in their units.
        """
        for name, parameters in effects.items():
            if why := self._of_effect(name, parameters, probabilities.get(name, 0.0)):
                return why
        for name, value in values.items():
            if why := self._of_size(name, value):
                return why
        for name, share in changes.items():
            if not (name in self.largest and name in values) and (why := self._of_share(name, share)):
                return why
        return ""

    def _of_effect(self, name: str, parameters: Mapping[str, float], probability: float) -> str:
        if not any(fnmatchcase(name, pattern) for pattern in self.effects):
            return f"{name} is not among the policy's effects"
        if probability < self.least_probability:
            return f"{name} is {probability:.0%} sure, the policy asks for {self.least_probability:.0%}"
        for key, value in parameters.items():
            if why := self._of_size(f"{name}.{key}", value):
                return why
        return ""

    def _of_share(self, name: str, share: float | None) -> str:
        if share is None:
            return f"{name} was 0, of which no share is small: the policy has no largest size of it"
        if abs(share) <= self.parameter_change:
            return ""
        return f"{name} changed by {share:+.0%}, the policy lets a parameter change by {self.parameter_change:.0%}"

    def _of_size(self, name: str, value: float) -> str:
        limit = self.largest.get(name)
        if limit is None or abs(value) <= limit:
            return ""
        return f"{name} is {value:.3g}, the policy's largest is {limit:.3g}"

    def too_often(self, accepted: Sequence[float], now: float) -> str:
        """Why it is too early, or too much for a day; `accepted`: when versions were accepted, in that order; `now`: s,
        one clock, which may have been set back: the last date is then one to come, and a person has to look."""
        last_day = [at for at in accepted if abs(now - at) < DAY_S]
        if len(last_day) >= self.most_per_day:
            return f"{len(last_day)} versions were accepted within a day, the policy's most is {self.most_per_day}"
        since = now - accepted[-1] if accepted else DAY_S
        if since < 0.0:
            return f"the last version was accepted at a time to come: the clock was set back by {-since:.0f} s or more"
        if since < self.pause_s:
            return f"the last version was accepted {since:.0f} s ago, the policy's pause is {self.pause_s:.0f} s"
        return ""


def load_policy(path: Path) -> HealPolicy:
    """A policy file; InputError in one line for everything that is wrong in it."""
    policy = to_struct(parse_yaml(read_text(path), path), HealPolicy, path)
    for name, value in policy.largest.items():
        if value < 0.0:
            raise InputError(
                path, f"largest.{name}", "expected SLOT.EFFECT.PARAMETER (or a parameter) and a size above 0"
            )
    for index, name in enumerate(policy.effects):
        if "." not in name:
            raise InputError(
                path, f"effects[{index}]", f"{name!r} is no SLOT.EFFECT, as hoop.coulomb_friction or hoop.*"
            )
    return policy
