"""How likely each explanation is that could stand in one place: shares of what their evidence and costs leave.

    p_i = exp(w_i) / sum_j exp(w_j)

with w in nats, told how much was looked at, how coloured the residual is, and what a mechanism's code costs.

What nothing tells from the named one counts with it. What still follows a law beside everything that was named takes
its part first: as much as the names where chance would reach it in one of a hundred recordings.

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import exp, log
from typing import NamedTuple

import numpy as np

from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS

# Odds beyond this are certainty.
MOST_NATS = 50.0
# Beliefs before any data, of about what the proof showed with other seeds than the one that judges. Where nothing is
# found, one time in ten something acts that is too small for these recordings; and of laws that are found, as many as
# this are the nearest of the vocabulary to one that is not in it, without a trace beside them. A law that held-out data
# deny is as likely another one as itself, whatever the data say that it was fitted to.
TOO_SMALL, UNLISTED, DENIED = 0.1, 0.07, 0.5


class Option(NamedTuple):
    """One explanation; `alike`: nothing tells it from the one that was named."""

    name: str
    worth: float  # nats
    alike: bool = False


@dataclass(frozen=True)
class Likely:
    """Probabilities of what could stand in one place."""

    shares: Mapping[str, float] = field(default_factory=dict)  # by name, "none of these" among them; the sum is 1
    alike: frozenset[str] = frozenset()  # the named one and what nothing tells from it

    @property
    def named(self) -> float:
        """Of the named one and what is alike."""
        return sum(share for name, share in self.shares.items() if name in self.alike)

    @property
    def none(self) -> float:
        """That it is nothing which has a name."""
        return self.shares.get(NONE_OF_THESE, 0.0)


def likely(options: Sequence[Option], left: float = -MOST_NATS, unlisted: float = 0.0) -> Likely:
    """Of one place; `left`: log odds that what remains beside all names is more than chance; `unlisted`: belief that
    the law is in no vocabulary, whatever the data say."""
    worths: dict[str, float] = {}
    for one in options:
        worths[one.name] = max(one.worth, worths.get(one.name, -np.inf))
    known = (1.0 - unlisted) / (1.0 + exp(min(max(left, -MOST_NATS), MOST_NATS)))
    most = max(worths.values(), default=0.0)
    weights = {name: exp(worth - most) for name, worth in worths.items()}
    total = sum(weights.values())
    shares = {name: known * weight / total for name, weight in weights.items()} if total else {}
    shares[NONE_OF_THESE] = shares.get(NONE_OF_THESE, 0.0) + 1.0 - known if shares else 1.0
    return Likely(shares, frozenset(one.name for one in options if one.alike))


def too_small(threshold: float) -> Option:
    """Beside parameters that explain everything: what these recordings cannot show."""
    return Option(NONE_OF_THESE, threshold + log(TOO_SMALL / (1.0 - TOO_SMALL)))


def beside_faults(shares: Mapping[str, float], faults: Sequence[float]) -> dict[str, float]:
    """Candidates' probabilities where faults of a sensor were counted, each with its own: parameters alone are wrong
    where any of them is right."""
    found = dict(shares)
    if PARAMETERS in found:
        found[PARAMETERS] *= float(np.prod([1.0 - one for one in faults]))
    return found


def where_recordings_differ(shares: Mapping[str, float], differ: float) -> dict[str, float]:
    """Candidates' probabilities where it is so likely that a number is another one in each recording: no parameters
    alone explain that, and it has no name."""
    found = dict(shares)
    if PARAMETERS in found:
        taken = differ * found[PARAMETERS]
        found |= {PARAMETERS: found[PARAMETERS] - taken, NONE_OF_THESE: found.get(NONE_OF_THESE, 0.0) + taken}
    return found


def among_what_acts(places: Sequence[Likely]) -> dict[str, float]:
    """That a name is in one of several places."""
    names = dict.fromkeys(name for one in places for name in one.shares)
    return {name: float(1.0 - np.prod([1.0 - one.shares.get(name, 0.0) for one in places])) for name in names}
