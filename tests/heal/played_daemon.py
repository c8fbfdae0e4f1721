"""A daemon that is played: it answers what a healing asks for, and computes what it is told to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hoopd.core.succession import REVERTED
from hoopd.design.comparison import WantedCommand
from hoopd.design.yardstick import TickSample
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.heal_versions import VersionFolder
from hoopd.heal.healing import Healing
from hoopd.heal.plan import HealPlan, HealWork

PERIOD_S, COMPUTES_S = 0.02, 5.0
POLICY = HealPolicy(
    schema="hoopd.policy/1", effects=["hoop.*"], largest={"hoop.coulomb_friction.Fc": 0.02}, pause_s=0.0
)
FRICTION = {
    "kind": "physics", "reason": "new: hoop.coulomb_friction", "learn": True,
    "effects": {"hoop.coulomb_friction": {"Fc": 0.006}}, "probabilities": {"hoop.coulomb_friction": 0.9},
    "parameters": {},
}  # fmt: skip
PROVEN = {
    "proven": True, "why": "90 nats", "key": "heal-1.yaml@abc123abc123", "restores": None,
    "promise": {"measured": 1.0, "before": 1.0, "new": 0.8},
}  # fmt: skip
GOOD, BAD = {"measured": 0.8, "before": 1.0, "new": 0.8}, {"measured": 1.4, "before": 1.0, "new": 0.8}
KEPT = {"remembered": True}


@dataclass
class PlayedDaemon:
    """Answers what a healing asks for, and computes what it is told to."""

    folder: Path
    policy: HealPolicy | None = POLICY
    answers: dict[str, Any] = field(default_factory=dict)
    plan: HealPlan = field(default_factory=HealPlan)
    takes: bool = True
    tells: bool = True
    t: float = 0.0

    def __post_init__(self) -> None:
        self.running = True
        self.acting: str | None = None  # of its statuses
        self.faults = self._faults_before = tuple[str, ...]()
        self.orders: list[tuple[float, WantedCommand]] = []
        self.works: list[HealWork] = []
        self._due: tuple[float, HealWork] | None = None
        self.versions = VersionFolder(self.folder)
        if not self.folder.exists():
            self.versions.begin("hoop")
            self.versions.first("lqg.yaml@000000000000", "law", "model", 0.0, "me")
        self.answers = {"diagnose": FRICTION, "prove": PROVEN, "weigh": GOOD, "remember": KEPT} | self.answers
        self.begin()

    def begin(self, run: str = "one") -> None:
        """A healing of this folder."""
        self.healing = Healing(self.versions, self.plan, self.policy, lambda: self.t, run)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Ticks, until something is so."""
        end = self.t + seconds
        while self.t < end and not until():
            self.t = round(self.t + PERIOD_S, 6)
            self.healing.see(self.faults, self.acting)
            self._read_decision()
            nan = float("nan")
            for order in self.healing.put(TickSample(self.t, self.running, 0.0, 0.0, nan, nan, 0.0)):
                self._obey(order)
            if (work := self.healing.take_work()) is not None:
                self.works.append(work)
                if work.name == "remember":  # takes no time, and whatever is computed goes on
                    self.healing.done(work, self.answers[work.name])
                else:
                    self._due = (self.t + COMPUTES_S, work)
            if self._due is not None and self.t >= self._due[0]:
                done, self._due = self._due[1], None
                self.healing.done(done, self.answers[done.name])

    def _read_decision(self) -> None:
        """A person's word that lies in the folder, as the process looks for it."""
        version = self.healing.version
        decision = None if version is None else self.versions.decision(version.number)
        if decision is not None:
            self.healing.decide(decision.accept, decision.who)

    def _obey(self, order: WantedCommand) -> None:
        self.orders.append((self.t, order))
        if order.name in ("trial", "controller") and self.tells:
            if self.takes:
                told = {"command": order.name, "sha256": order.key.partition("@")[2] + "0" * 52}
                self._faults_before, self.faults = self.faults, ()  # of the model before
                self.healing.note("controller", told)
            else:
                self.healing.note("command_refused", {"command": order.name, "reason": "the model does not fit"})
        if order.name == "accept":
            self.healing.note("operator", {"command": "accept"})
        if order.name == "revert":
            self.faults = self._faults_before
            self.healing.note("trial_returned", {"reason": REVERTED})

    def drift(self) -> None:
        """The model no longer fits."""
        self.faults = ("model_drift",)
        self.healing.note("model_drift", {"channels": ["dtheta"]})

    @property
    def names(self) -> list[str]:
        """Of the orders but `alive`."""
        return [order.name for _, order in self.orders if order.name != "alive"]

    def state(self, number: int = 1) -> str:
        """Of a version."""
        return self.versions.read(number).state if number in self.versions.numbers() else ""


def accepted(folder: Path) -> PlayedDaemon:
    """A daemon whose new version is accepted just now."""
    daemon = PlayedDaemon(folder)
    daemon.drift()
    daemon.run(300.0, lambda: daemon.state() == "accepted")
    return daemon


def rounds(daemon: PlayedDaemon) -> list[HealWork]:
    """What was weighed after the trial."""
    return [one for one in daemon.works if one.name == "weigh"][1:]
