"""Which run comes next: the one that a diagnosis proposes to tell two laws apart, or the next of a menu of signals.

Rules of this file: a choice is the words of `hoopd experiment`; sizes and limits are that command's own.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.search.naming import NOT_EXCLUDED_NATS
from hoopd.learn.belief import QUIET_KINDS, Belief

# Signals that move the ball and the hoop in different ways: fast and slow, small and large, driven and left alone.
MENU = (
    ("prbs",),
    ("multisine", "--low", "0.05", "--high", "1"),
    ("steps", "--hold", "0.8"),
    ("chirp",),
    ("prbs", "--clock", "4"),
    ("decay", "--rest", "6"),
)
# Signals are counted, whatever was asked of them. A law is shown again by what has shown it, so often at most:
MOST_PROOFS = 2
# What is foreseen to tell rivals apart, or to show a candidate, is played so often at most.
MOST_PROPOSALS = 2
# Rivals that the best of all signals is foreseen to tell apart by less than this stay rivals.
LEAST_TOLD_NATS = 0.5
# Characters of a SHA-256.
DIGEST = 64
# Options of a proposal that say where to play it: the campaign knows.
_PLACES = frozenset({"--sim"})
_SETTINGS = frozenset({"--seed", "--set", "--config"})


@dataclass(frozen=True)
class ChosenRun:
    """Words of `hoopd experiment` behind the command, the reason, and nats that are expected of it where they are."""

    words: tuple[str, ...]
    reason: str
    expected_nats: float | None = None
    amplitude_nm: float | None = None  # where a limit has ended it too early
    halved: int = 0  # so often, for that
    # of what was recorded by hand, each with its experiment and its seconds where the words have them, and of its
    # plant's file
    sha256: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()  # SHA-256 of what drove each of these recordings; none where nothing drives the plant

    @property
    def recordings(self) -> frozenset[str]:
        """What was recorded by hand, by what the files hold; by their names where nobody has looked into them."""
        return frozenset(self.sha256[: len(self.words)] or self.words)

    def is_of_the_same(self, other: ChosenRun) -> bool:
        """Whether both are of the same recordings by hand, and of the same plant, however they are spelled."""
        return self.recordings == other.recordings and self.plant_sha256 == other.plant_sha256

    @property
    def plant_sha256(self) -> tuple[str, ...]:
        """Of the plant's file, where it has one."""
        return self.sha256[len(self.words) :]

    @property
    def kinds(self) -> int:
        """Signals that were recorded by hand: files that hold something else, and were driven by something else."""
        files = {one[:DIGEST] for one in self.sha256[: len(self.words)]}
        return max(1, min(len(files), len({*self.inputs} or files)))

    @property
    def played(self) -> tuple[str, ...]:
        """The words with the amplitude."""
        if self.amplitude_nm is None:
            return self.words
        words = list(self.words)
        if "--amplitude" in words:
            at = words.index("--amplitude")
            del words[at : at + 2]
        return (*words, "--amplitude", f"{self.amplitude_nm:.3g}")


def first() -> ChosenRun:
    """When nothing was recorded yet."""
    return ChosenRun(MENU[0], "nothing is known yet: a fast two-level signal has most of what moves both")


def first_but(given_up: Sequence[tuple[str, ...]]) -> ChosenRun | None:
    """The same, without signals that a limit ends however small they are; None where it ends all of them."""
    words = next((words for words in MENU if words not in given_up), None)
    if words is None or words == MENU[0]:
        return None if words is None else first()
    return ChosenRun(words, "nothing is known yet, and a limit has ended every signal before this one")


def next_choice(
    diagnosis: Diagnosis,
    belief: Belief,
    played: Sequence[tuple[str, ...]],
    shown_by: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    given_up: Sequence[tuple[str, ...]] = (),
) -> ChosenRun | None:
    """The run that is recorded next; None where no signal inside the limits would tell more.

    `played`: the words of the runs that there are; `shown_by`: of the run after which a law was named first;
    `given_up`: of signals that a limit ends however small they are.
    """
    proposed = _unless(_proposed(diagnosis), given_up)
    if proposed is not None and _promises(proposed) and _times(proposed.words, played) < MOST_PROPOSALS:
        return proposed
    if (proof := _unless(_proof(belief, played, shown_by), given_up)) is not None:
        return proof
    if belief.lacks_probability_alone and len({*played}) >= QUIET_KINDS and not _tells(proposed):
        return None
    if (other := _of_the_menu(belief, played, given_up)) is not None:
        return other
    if proposed is None or (proposed.expected_nats or 0.0) <= 0.0:
        return None
    return proposed if _times(proposed.words, played) < MOST_PROPOSALS else None


def _proof(
    belief: Belief, played: Sequence[tuple[str, ...]], shown_by: Mapping[str, tuple[str, ...]]
) -> ChosenRun | None:
    """For a law that is sure and lacks fresh data that confirm it: what has shown it shows it again."""
    words = shown_by.get(belief.unproven[0]) if belief.lacks_proof_alone else None
    if words is None or _times(words, played) > MOST_PROOFS:
        return None
    reason = f"{belief.unproven[0]} is named and not confirmed: the signal that showed it, on data that nobody fitted"
    return ChosenRun(words, reason)


def _unless(choice: ChosenRun | None, given_up: Sequence[tuple[str, ...]]) -> ChosenRun | None:
    return None if choice is None or choice.words in given_up else choice


def _of_the_menu(
    belief: Belief, played: Sequence[tuple[str, ...]], given_up: Sequence[tuple[str, ...]]
) -> ChosenRun | None:
    """What has not been played yet; what a run tells grows with its torque squared, and the first one's is small."""
    if not belief.laws and tuple(played) == (MENU[0],) and MENU[0] not in given_up:
        return ChosenRun(MENU[0], "the first run was careful: the same, as strong as the model that it gave allows")
    words = next((words for words in MENU if words not in (*played, *given_up)), None)
    return None if words is None else ChosenRun(words, f"{_because(belief)}; this signal has not been played yet")


def _because(belief: Belief) -> str:
    return belief.open[0] if belief.open else "to see it once more"


def _tells(choice: ChosenRun | None) -> bool:
    return choice is not None and (choice.expected_nats or 0.0) >= LEAST_TOLD_NATS


def _promises(choice: ChosenRun) -> bool:
    return (choice.expected_nats or 0.0) >= NOT_EXCLUDED_NATS


def _times(words: tuple[str, ...], played: Sequence[tuple[str, ...]]) -> int:
    return list(played).count(words)


def _proposed(diagnosis: Diagnosis) -> ChosenRun | None:
    """The proposal's own command without where it would be played."""
    told = diagnosis.next_experiment
    if told is None or not told.command:
        return None
    words, given = list[str](), iter(shlex.split(told.command)[2:])
    for word in given:
        if word in _SETTINGS:
            next(given, None)
        elif word not in _PLACES:
            words.append(word)
    first_law, second_law = told.tells_apart
    return ChosenRun(tuple(words), f"to tell {first_law} from {second_law}: {told.signal}", told.expected_nats)
