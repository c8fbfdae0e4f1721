"""One case as the scorer sees it: the sealed answer and what was said about it.

Rules of this file: pure; a case without a diagnosis said nothing, and nothing that is counted to its credit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from concealed.classes import alike, conditions, exact, wide

ALARMS = ("missing_physics", "unknown_physics")
SILENT = ("consistent", "parameters")  # right for a null; a diagnosis that failed is not
NO_EFFECT = "actuator.torque_gain"  # a base parameter of `entries`: "parameters" is the right verdict
NAMELESS = "unknown."  # a finding without a name


@dataclass(frozen=True)
class Judged:
    """One case: the sealed answer and what was said."""

    answer: Mapping[str, Any]
    said: Mapping[str, Any] | None  # diagnosis; None when there is none
    seconds: float = 0.0
    oracle: Mapping[str, Any] | None = None

    @property
    def hidden(self) -> list[str]:
        """Names of what is hidden, the gain among them."""
        return [effect["name"] for effect in self.answer["effects"]]

    @property
    def truth(self) -> list[str]:
        """Names of what is hidden and is an effect."""
        return [name for name in self.hidden if name != NO_EFFECT]

    @property
    def names(self) -> list[str]:
        """Names that were said, strongest first."""
        return [effect["name"] for effect in (self.said or {}).get("effects", [])]

    @property
    def known_names(self) -> list[str]:
        """Names of the library that were said."""
        return [name for name in self.names if not name.startswith(NAMELESS)]

    @property
    def offered(self) -> list[str]:
        """What was named with what is not excluded beside each, in the order of the JSON, no name twice."""
        effects = (self.said or {}).get("effects", [])
        return list(dict.fromkeys(n for one in effects for n in (one["name"], *one.get("not_excluded", []))))

    @property
    def verdict(self) -> str:
        """The verdict, `failed` when there is no diagnosis."""
        return str(self.said["verdict"]) if self.said else "failed"

    @property
    def alarm(self) -> bool:
        """Was physics said to be missing?"""
        return self.verdict in ALARMS

    @property
    def silent(self) -> bool:
        """Was it said that nothing is missing?"""
        return self.verdict in SILENT

    @property
    def nats(self) -> float | None:
        """How visible the first effect is."""
        return self.answer["effects"][0]["nats"] if self.answer["effects"] else None

    def family(self, *names: str) -> bool:
        """Is it one of these families?"""
        return self.answer["family"] in names

    @cached_property
    def given(self) -> frozenset[str]:
        """Conditions of the case that some classes need."""
        return conditions(self.answer)

    @property
    def right(self) -> bool:
        """The first name is the truth."""
        return bool(self.names) and any(exact(self.names[0], name) for name in self.truth)

    @property
    def in_class(self) -> bool:
        """The first name is of the truth's class in this case."""
        return self._first_alike(self.given)

    @property
    def in_wide_class(self) -> bool:
        """The same where the contract's doubts count for the tool."""
        return self._first_alike(self.given | wide(self.answer))

    def _first_alike(self, given: frozenset[str]) -> bool:
        return bool(self.names) and any(alike(self.names[0], name, given) for name in self.truth)
