"""One tick: from what is known of the world to one torque, in this order and no other.

Rules of this file: `Tick.step` is a function of its inputs and of the inputs before them; it reads no clock,
opens nothing and waits for nothing, so that recorded inputs give the same commands to the bit. Torque is zero
unless the mode is RUNNING or STOPPING, and every torque passes the limiter last.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan, tau
from typing import Any, NamedTuple, Protocol

from hoopd.core.ballresponse import BallMotion
from hoopd.core.controllers import DONE, Controller, Measurement
from hoopd.core.drift import Level
from hoopd.core.encoderchecks import HoopMotion
from hoopd.core.faulttable import BY_NAME, Action
from hoopd.core.feedforward import FeedForward
from hoopd.core.health import Health, Sent, Thresholds
from hoopd.core.limits import Limiter
from hoopd.core.modes import ENERGISED, Event, Mode, next_mode
from hoopd.core.operator import Operator
from hoopd.core.records import (
    CameraSample,
    DriverSample,
    Estimate,
    Inputs,
    TickRecord,
    TorqueCommand,
    Vector,
)
from hoopd.core.ticksettings import TickSettings

DRIFT_SAYS = (
    "for half a minute the device has not moved as the model says: run `hoopd diagnose` on the recording of this run"
)

UNFED_SAYS = "the law's torque is sent as it is, until the feed-forward works again"

# A single missing picture is no news; a cut is.
LEVELS = {
    Action.FLAG: "warning",
    Action.PREDICT: "debug",
    Action.PAUSE: "warning",
    Action.STOP: "warning",
    Action.CUT: "error",
}


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
    ) -> Estimate: ...

    def reset(self) -> None: ...


class Note(NamedTuple):
    """One fact worth a line in the log."""

    name: str
    level: str  # debug | info | warning | error
    fields: dict[str, Any]


class Output(NamedTuple):
    """What one tick decided."""

    command: TorqueCommand
    record: TickRecord
    notes: tuple[Note, ...]


class Tick:
    """State of the control loop from one tick to the next."""

    def __init__(
        self,
        settings: TickSettings,
        thresholds: Thresholds,
        estimator: Estimator,
        controller: Controller,
        limiter: Limiter,
        feedforward: FeedForward | None = None,
        levels: Mapping[str, Level] | None = None,
        ball: BallMotion | None = None,
        hoop: HoopMotion | None = None,
    ) -> None:
        self.settings, self.estimator, self.controller, self.limiter = settings, estimator, controller, limiter
        self.feedforward = feedforward or FeedForward()
        self.health = Health(thresholds, settings.period_s, levels, ball, hoop)
        self.mode = Mode.DISARMED
        self.operator = Operator(self.health, controller, settings.reference_limit_rad, self._note)
        self._sent = Sent(0.0, 0.0, 0)
        self._added = 0.0  # N m, what feed-forward added to the torque that was sent last
        self._unfed = False  # feed-forward failed in this run, and that has been said
        self._faults: tuple[str, ...] = ()
        self._seq = -1
        self._stopping_since = 0.0
        self._over = ""
        self._notes: list[Note] = []

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the active faults in table order."""
        return tuple(fault.name for fault in self.health.active())

    @property
    def armable(self) -> bool:
        """An arm command would be obeyed now."""
        return self.mode in (Mode.DISARMED, Mode.FAULT) and not self.health.arming_hindrances()

    def next_seq(self) -> int:
        """Number of the next request, modulo 256."""
        self._seq = (self._seq + 1) % 256
        return self._seq

    def step(self, inputs: Inputs) -> Output:
        """Decide one torque."""
        self._notes = []
        if not self.health.thresholds.ball_expected:
            inputs = inputs._replace(camera=None)  # whatever the camera takes for a ball is none
        estimate = self.estimator.update(
            inputs.t,
            self._sent.torque_nm,
            self._sent.t + inputs.execution_s + self.settings.wire_s,
            inputs.driver,
            inputs.camera,
            held=self.mode is not Mode.RUNNING,
        )
        self.health.update(inputs, estimate, self._sent)
        asked = self.operator.take(inputs.commands, self.mode)
        self._unfed = self._unfed and Event.ARM not in asked
        self._move(asked | self._own_events(inputs, estimate))
        torque = self._torque(inputs, estimate)
        self._watch(inputs.t, estimate)
        self._report_faults()
        command = self._command(inputs, torque)
        return Output(command, self._record(inputs, estimate, command), tuple(self._notes))

    def _own_events(self, inputs: Inputs, estimate: Estimate) -> frozenset[Event]:
        events: set[Event] = set()
        action = self.health.action()
        if action == Action.CUT:
            events.add(Event.CUT)
        if action >= Action.STOP:
            events.add(Event.STOP)
        if action >= Action.PAUSE:
            events.add(Event.PAUSE)
        if self.health.board_enabled and self.health.ball_steady and estimate.ready and action < Action.PAUSE:
            events.add(Event.GO)
        if self.mode is Mode.STOPPING and self._stopped(inputs):
            events.add(Event.STOPPED)
        return frozenset(events)

    def _stopped(self, inputs: Inputs) -> bool:
        at_rest = abs(self.health.hoop_speed) < self.settings.stopped_rad_s
        return at_rest or inputs.t - self._stopping_since >= self.settings.stopping_s

    def _move(self, events: frozenset[Event]) -> None:
        before, self.mode = self.mode, next_mode(self.mode, events)
        if self.mode is Mode.DISARMED:
            self.health.acknowledge()
        if self.mode is before:
            return
        if self.mode not in ENERGISED:
            self.operator.reference = 0.0  # the next arm begins at the bottom, not where somebody once wanted the ball
        level = "error" if self.mode is Mode.FAULT else "info"
        causes = [fault.name for fault in self.health.active() if fault.action >= Action.PAUSE]
        self._note("mode", level, mode=str(self.mode), was=str(before), because=causes)

    def _torque(self, inputs: Inputs, estimate: Estimate) -> float:
        self._added = 0.0
        if self.mode is Mode.RUNNING:
            wanted = self._ask_law(inputs, estimate)
            if self._over and isfinite(wanted):
                wanted = self._end_law(inputs)
            elif isfinite(wanted):
                wanted = self._feed_forward(estimate, wanted)
        elif self.mode is Mode.STOPPING:
            wanted = self._brake(inputs)
        else:
            self._reset_law()
            self.limiter.reset()
            return 0.0
        if not isfinite(wanted):
            self.health.raise_now("not_finite")
            self._move(frozenset({Event.CUT}))
            return 0.0
        return self.limiter.apply(wanted)

    def _feed_forward(self, estimate: Estimate, wanted: float) -> float:
        """The torque that moves the hoop as the wanted one would without missing physics."""
        if not estimate.ready:
            return wanted
        demanded = self.feedforward.demand(_acted_on(estimate), wanted)
        if self.feedforward.trouble and not self._unfed:  # one event a run: it may fail in every tick
            self._unfed = True
            self._note("feedforward_failed", "error", reason=self.feedforward.trouble, says=UNFED_SAYS)
        self._added = demanded - wanted
        return demanded

    def _ask_law(self, inputs: Inputs, estimate: Estimate) -> float:
        """The law's torque; a law that fails (a user's own may) is one whose torque is not a number."""
        self._over = ""
        try:
            wanted, _ = self.controller.update(self._measurement(inputs, estimate))
            ended = getattr(self.controller, "ended", "")
            self._over = ended if isinstance(ended, str) else ""
            return float(wanted)
        except Exception as error:
            self._note("law_failed", "error", reason=f"{type(error).__name__}: {error}")
            return nan

    def _end_law(self, inputs: Inputs) -> float:
        """A law that is over (`Ending`) stops the run in this very tick, as the operator's stop would."""
        self._note("law_ended", "info" if self._over == DONE else "warning", reason=self._over)
        self._move(frozenset({Event.STOP}))
        return self._brake(inputs)

    def _reset_law(self) -> None:
        try:
            self.controller.reset()
        except Exception as error:
            if "not_finite" not in self._faults:  # it is reset in every tick without torque, the fact is one
                self.health.raise_now("not_finite")
                self._note("law_failed", "error", reason=f"{type(error).__name__}: {error}")

    def _brake(self, inputs: Inputs) -> float:
        if self._sent.enabled_for == 0 or self._stopping_since == 0.0:
            self._stopping_since = inputs.t
        limit = self.settings.brake_limit_nm
        return min(limit, max(-limit, -self.settings.brake_nm_per_rad_s * self.health.hoop_speed))

    def _measurement(self, inputs: Inputs, estimate: Estimate) -> Measurement:
        camera, driver = inputs.camera, inputs.driver
        x = _acted_on(estimate)
        x.flags.writeable = False  # the record shows it, too
        return Measurement(
            t=inputs.t,
            x=x,
            ready=estimate.ready,
            psi_measured=nan if camera is None else camera.psi,
            psi_fresh=camera is not None and estimate.psi_accepted,
            dtheta_measured=nan if driver is None else driver.dtheta,
            reference=self.operator.reference,
            torque_previous=self._sent.torque_nm - self._added,  # a law knows the plant without missing physics
            dt=self.settings.period_s,
        )

    def _watch(self, t: float, estimate: Estimate) -> None:
        """One fact when the innovations say that the model is not the device; control goes on."""
        if channels := self.health.watch(t, estimate, acting=self.mode is Mode.RUNNING):
            self._note("model_drift", "warning", channels=list(channels), says=DRIFT_SAYS)

    def _report_faults(self) -> None:
        active = {fault.name: fault for fault in self.health.active()}
        for name, fault in active.items():
            if name not in self._faults and fault.action > Action.NOTE:
                action = fault.action.name.lower()
                self._note("fault", LEVELS[fault.action], fault=name, meaning=fault.meaning, action=action)
        for name in self._faults:
            if name not in active and BY_NAME[name].action > Action.NOTE:
                self._note("fault_cleared", "debug" if BY_NAME[name].action is Action.PREDICT else "info", fault=name)
        self._faults = tuple(active)

    def _command(self, inputs: Inputs, torque: float) -> TorqueCommand:
        enable = self.mode in ENERGISED
        if self.mode is not Mode.STOPPING:
            self._stopping_since = 0.0
        clear = self.health.board_latched and (self.mode is Mode.READY or self.operator.waits)
        self._sent = Sent(inputs.t, torque, self._sent.enabled_for + 1 if enable else 0)
        return TorqueCommand(self.next_seq(), enable, clear, torque)

    def _record(self, inputs: Inputs, estimate: Estimate, command: TorqueCommand) -> TickRecord:
        driver, camera = inputs.driver, inputs.camera
        x0, x1, x2, x3 = estimate.x.tolist()
        return TickRecord(
            t=inputs.t,
            id=inputs.id,
            mode=str(self.mode),
            u=command.torque_nm,
            theta=nan if driver is None else driver.theta,
            dtheta=nan if driver is None else driver.dtheta,
            current=nan if driver is None else driver.current,
            psi=nan if camera is None else _near(camera.psi, x2),
            y_t=nan if driver is None else driver.t,
            psi_t=nan if camera is None else camera.t,
            x_hat=(x0, x1, x2, x3),
            reference=self.operator.reference,
            status=0 if driver is None else driver.status,
            errors=0 if driver is None else driver.errors,
            lateness_s=inputs.lateness_s,
            execution_s=inputs.execution_s,
        )

    def _note(self, name: str, level: str, **fields: Any) -> None:
        self._notes.append(Note(name, level, fields))


def _acted_on(estimate: Estimate) -> Vector:
    """The state on which this tick's torque will act."""
    return estimate.x if estimate.ahead is None else estimate.ahead


def _near(angle: float, other: float) -> float:
    """The same angle, by whole turns nearest to another one."""
    return angle + tau * round((other - angle) / tau) if isfinite(other - angle) else angle
