"""Which controller acts, which was accepted, which waits: the commands that change it, and what they lead to.

    controller  DISARMED, FAULT, READY: in force at once; RUNNING: follows for a while, then takes over
    trial       RUNNING: as controller, but the accepted one follows on and is back in the tick in which the trial ends
    experiment  READY, RUNNING: plays once; at its end the accepted one is back

A law whose memory means something else than the acting law's follows for half a second before it takes over; one with
a filter of its own for two, and only if the innovations fit. `revert`, whatever switches off, and whatever ends
RUNNING, ends a trial or an experiment with the accepted controller and forgets who waits (`revert`: for these two).

Rules of this file: pure; limits never widen: no law gets more than the run began with, and a signal that would need
more is refused; every command is told once, obeyed or refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, isfinite

from hoopd.core.controllers import DONE, Successor
from hoopd.core.installed import Demanded, Filter, Installed
from hoopd.core.modes import Mode, mode_words
from hoopd.core.records import Command, Estimate
from hoopd.core.shadow import SHADOW_S, Shadow
from hoopd.core.trial import BASELINE_S, LEAST_BASELINE_S, LawTrial, References, RunningCost, cost_of

CONTROLLER, TRIAL, EXPERIMENT = LOADED = ("controller", "trial", "experiment")
ACCEPT, REVERT, ALIVE = ("accept", "revert", "alive")
REVERTED = "reverted"
NO_NUMBER = "its torque is not a number"
NAMES = (*LOADED, ACCEPT, REVERT, ALIVE)
# An observer of what arrives knows the plant after so long (12 lags of an ARX model and some).
FOLLOW_S = 0.5
WITHOUT_TORQUE = (Mode.DISARMED, Mode.FAULT)
# In which modes what may be loaded.
ALLOWED = {
    CONTROLLER: (*WITHOUT_TORQUE, Mode.READY, Mode.RUNNING),
    TRIAL: (Mode.RUNNING,),
    EXPERIMENT: (Mode.READY, Mode.RUNNING),
}

# Text of a command and the filter in force -> what it stands for; made of the same model, with that very filter.
Make = Callable[[str, Filter], Installed]


@dataclass
class _Waiting:
    """Who follows, for what, until when."""

    next: Installed
    purpose: str
    until: float
    shadow: Shadow | None


class Succession:
    """The controllers of a tick."""

    def __init__(
        self,
        first: Installed,
        tell: Callable[..., None],
        make: Make | None = None,
        because: Callable[[], tuple[str, ...]] = tuple,
    ) -> None:
        """`make`: None where nothing can be loaded; `because`: the faults behind the mode, for who is refused."""
        self.acting = self.accepted = self._first = first
        self.limit_nm = first.torque_nm  # what the drive may be asked for at most, in this run
        self.since = 0.0  # s, run time: the acting one acts since then
        self.purpose = CONTROLLER  # what the acting one was loaded for
        self._tell, self._make, self._because = tell, make, because
        self._waiting: _Waiting | None = None
        self._trial: LawTrial | None = None
        self._began = False  # what was loaded has acted
        self._reverted = False  # somebody asked for the accepted one
        self._baseline = RunningCost(BASELINE_S)
        self._references = References()

    @property
    def follower(self) -> Installed | None:
        """Who is told of every tick beside the acting one: the next one, or the accepted one."""
        if self._waiting is not None:
            return self._waiting.next
        return None if self.acting is self.accepted else self.accepted

    @property
    def waiting(self) -> str:
        """Name of the file that follows before it takes over; empty: none."""
        return self._waiting.next.label.name if self._waiting is not None else ""

    # ------------------------------------------------------------------------------------------ commands

    def take(self, command: Command, mode: Mode, t: float) -> None:
        """Obey or refuse one command of `NAMES`."""
        if command.name in LOADED:
            self._load(command, mode, t)
        elif command.name == REVERT and self._waiting is not None and self._waiting.purpose != CONTROLLER:
            self._tell("operator", "info", command=REVERT)
            self._forget(REVERTED)
        elif command.name == REVERT and self.acting is not self.accepted:
            self._revert(mode, t)
        elif self._trial is None or self._reverted:
            self._refuse(command.name, "there is no trial")
        elif command.name == ALIVE:
            self._trial.alive(t)
            self._tell("operator", "debug", command=ALIVE)
        else:
            self._accept()

    def suspended(self, mode: Mode) -> tuple[str, ...]:
        """Rows of the fault table that the acting law's plan would raise by itself; of a law that plays one alone."""
        told = self._of_a_plan("suspended", mode)
        return told if isinstance(told, tuple) else ()

    def unmodelled(self, mode: Mode) -> float:
        """What the acting law's plan adds to the ball's unmodelled accelerations, (rad/s)^2/s."""
        told = self._of_a_plan("unmodelled", mode)
        return told if isinstance(told, float) else 0.0

    def may_fly(self, mode: Mode) -> bool:
        """Whether the acting law's plan lets the ball leave the hoop."""
        return self._of_a_plan("may_fly", mode) is True

    def _of_a_plan(self, name: str, mode: Mode) -> object:
        """What a law tells of the plan that it plays, while it acts."""
        return getattr(self.acting.law, name, None) if self.purpose == EXPERIMENT and mode is Mode.RUNNING else None

    def tune(self, key: str, value: float) -> bool:
        """A number of the acting law."""
        return bool(self.acting.law.tune(key, value))

    @property
    def tunables(self) -> Mapping[str, float]:
        """Numbers of the acting law by their names; none of a law that tells none."""
        told = None
        with suppress(Exception):
            told = getattr(self.acting.law, "tunables", None)
        return told if isinstance(told, Mapping) else {}

    @property
    def speed_limit(self) -> float:
        """The fastest hoop, rad/s, that the acting law can be asked for; 0: it follows no speed."""
        with suppress(Exception):  # a user's own law may tell anything
            told = float(getattr(self.acting.law, "speed_limit", 0.0))
            return told if 0.0 <= told < inf else 0.0
        return 0.0

    def _load(self, command: Command, mode: Mode, t: float) -> None:
        try:
            self._begin(command.name, self._made(command, mode), mode, t)
        except ValueError as error:
            self._refuse(command.name, str(error), _sha256(command))
        except Exception as error:  # whatever it is made of, the law that acts goes on
            self._refuse(command.name, f"{type(error).__name__}: {error}", _sha256(command))

    def _made(self, command: Command, mode: Mode) -> Installed:
        """What a command brings; ValueError with the reason why not."""
        if self._make is None:
            raise ValueError("this run loads none")
        if mode not in ALLOWED[command.name]:
            raise ValueError(self._in_mode(mode))
        if self._trial is not None or self.acting is not self.accepted:
            raise ValueError(f"{self.acting.label.name} is on {self.purpose}: accept or revert it first")
        if self._waiting is not None:
            raise ValueError(f"{self.waiting} is about to take over")
        if hasattr(self.accepted.law, "ended"):
            raise ValueError("the law in force ends by itself, as an experiment does")
        if not command.text:
            raise ValueError("nothing was loaded with it")
        made = self._make(command.text, self.acting.filter)
        if command.name == EXPERIMENT:  # cut short it would be another signal
            check_limits(made, self._first)
        return limited(made, self._first)

    def _begin(self, purpose: str, made: Installed, mode: Mode, t: float) -> None:
        other = made.filter is not self.acting.filter
        if hasattr(made.law, "ended") != (purpose == EXPERIMENT):
            wanted = "an excitation" if purpose == EXPERIMENT else "a law that holds the ball"
            raise ValueError(f"{made.label.name} is not {wanted}")
        if other and (purpose == EXPERIMENT or mode is Mode.READY):
            raise ValueError(f"{made.label.name} was designed on another model or filter: {self._in_mode(mode)}")
        if purpose == TRIAL and self._baseline.seconds < LEAST_BASELINE_S:
            raise ValueError(f"the accepted law has to act for {LEAST_BASELINE_S:g} s first")
        if mode is not Mode.RUNNING:
            self._put(made, purpose, t, acts=False)
            return
        knows = isinstance(made.law, Successor) and made.law.take_over(self.acting.law)
        shadow = Shadow(t, made.filter.levels) if other else None
        wait_s = SHADOW_S if other else 0.0 if knows else FOLLOW_S
        self._waiting = _Waiting(made, purpose, t + wait_s, shadow)

    def _revert(self, mode: Mode, t: float) -> None:
        """Back in this tick: while the law acts that is where its torque is asked for. What is given up first, as a
        maneuver that brakes the hoop, ends by itself; the second time it is back all the same."""
        self._tell("operator", "info", command=REVERT)
        if self._gives_up(mode):
            return
        self._reverted = True
        if mode is not Mode.RUNNING:
            self._back(t, REVERTED)

    def _gives_up(self, mode: Mode) -> bool:
        """Whether the acting law ends its plan by itself from now on."""
        give_up = self._of_a_plan("give_up", mode)
        with suppress(Exception):
            return callable(give_up) and give_up(REVERTED) is True
        return False

    def _accept(self) -> None:
        self._trial, self.accepted, self.purpose = None, self.acting, CONTROLLER
        self._baseline.clear()
        self._tell("operator", "info", command=ACCEPT)

    # ------------------------------------------------------------------------------------------ ticks

    def leave(self, mode: Mode, t: float) -> None:
        """A tick without the law's torque: who waits is forgotten, the accepted one is back."""
        self._baseline.clear()
        self._forget(self._in_mode(mode))
        if self.acting is not self.accepted and (self._began or mode is not Mode.READY):
            self._back(t, self._in_mode(mode))

    def next(
        self,
        t: float,
        reference: float,
        torque_nm: float,
        estimates: tuple[Estimate, Estimate],
        asked: tuple[Demanded, Demanded],
    ) -> bool:
        """Judge one tick in which the law acts; True when the follower takes over in it.

        Parameters
        ----------
        t, reference : s and rad
        torque_nm : what was sent last
        estimates, asked : of the acting controller and of the follower, now
        """
        self._began = True
        cost = self._cost(t, reference, torque_nm, estimates[0])
        if self.acting is self.accepted:
            self._baseline.add(t, cost)
            return self._arrived(t, estimates, asked[1])
        if over := self._over(t, cost, asked[0]):
            self._back(t, over)
            return True
        return False

    def _cost(self, t: float, reference: float, torque_nm: float, estimate: Estimate) -> float:
        return cost_of(self._references.distance(t, reference, float(estimate.x[2])), torque_nm)

    def _over(self, t: float, cost: float, asked: Demanded) -> str:
        """Why what is on trial, or an experiment, is over; empty while it goes on."""
        if asked.failed or not isfinite(asked.torque_nm):
            return asked.failed or NO_NUMBER
        if self._reverted:
            return REVERTED
        return self._trial.verdict(t, cost) if self._trial is not None else asked.ended

    def _arrived(self, t: float, estimates: tuple[Estimate, Estimate], asked: Demanded) -> bool:
        """Whether who waits takes over now."""
        waiting = self._waiting
        if waiting is None:
            return False
        if waiting.shadow is not None:
            waiting.shadow.add(t, estimates[1].surprise, estimates[0].surprise)
        if t < waiting.until:
            return False
        self._waiting = None
        misfit = waiting.shadow.misfit() if waiting.shadow is not None else ""
        if misfit or asked.failed or not isfinite(asked.torque_nm):
            reason = f"the model does not fit: {misfit}" if misfit else asked.failed or NO_NUMBER
            self._refuse(waiting.purpose, reason, waiting.next.label.sha256)
            return False
        self._put(waiting.next, waiting.purpose, t, acts=True)
        return True

    # ------------------------------------------------------------------------------------------ changes

    def _put(self, made: Installed, purpose: str, t: float, *, acts: bool) -> None:
        """A loaded controller is in force from now on; `acts`: its torque is that of this very tick."""
        self.acting, self.purpose, self.since, self._began = made, purpose, t, acts
        if purpose == CONTROLLER:
            self.accepted = made
            self._baseline.clear()
        elif purpose == TRIAL:
            self._trial = LawTrial(t, self._baseline.mean)
        name, sha256, by = made.label
        self._tell("controller", "info", command=purpose, file=name, sha256=sha256, by=by)

    def _back(self, t: float, reason: str) -> None:
        """The accepted controller acts again."""
        level = "info" if reason in (DONE, REVERTED) else "warning"
        name = f"{self.purpose}_returned" if self.purpose == TRIAL else f"{self.purpose}_ended"
        left = self.acting.label.name
        self.acting, self.purpose, self.since = self.accepted, CONTROLLER, t
        self._trial, self._reverted = None, False
        self._baseline.clear()
        self._tell(name, level, file=left, reason=reason, back_to=self.acting.label.name)

    def _forget(self, reason: str) -> None:
        """Who waits does not take over."""
        if self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            self._refuse(waiting.purpose, reason, waiting.next.label.sha256)

    def _in_mode(self, mode: Mode) -> str:
        return mode_words(mode, self._because())

    def _refuse(self, command: str, reason: str, sha256: str = "") -> None:
        """`sha256`: of the file that was to be loaded, for whoever asked for one of several."""
        which = {"sha256": sha256} if sha256 else {}
        self._tell("command_refused", "warning", command=command, reason=reason, **which)


def _sha256(command: Command) -> str:
    """Of the file that it loads, as far as its key tells it."""
    return command.key.partition("@")[2]


def check_limits(made: Installed, first: Installed) -> None:
    """ValueError for a file that may ask for more than the run began with."""
    for name in ("torque_nm", "slew_nm_per_tick"):
        wants, may = getattr(made, name), getattr(first, name)
        if wants > may:
            raise ValueError(f"limits.{name} of {wants:g} is more than the {may:g} that the run began with")


def limited(made: Installed, first: Installed) -> Installed:
    """What was loaded, with no more than the run began with: as the first file was held by the configuration."""
    torque_nm = min(first.torque_nm, made.torque_nm)
    return replace(made, torque_nm=torque_nm, slew_nm_per_tick=min(first.slew_nm_per_tick, made.slew_nm_per_tick))
