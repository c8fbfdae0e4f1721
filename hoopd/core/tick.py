"""One tick: from what is known of the world to one torque, in this order and no other.

Rules of this file: `Tick.step` is a function of its inputs and of the inputs before them; it reads no clock,
opens nothing and waits for nothing, so that recorded inputs give the same commands to the bit. Torque is zero
unless the mode is RUNNING or STOPPING, and every torque passes the limiter last.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan, tau
from typing import Any, NamedTuple

from hoopd.core.ballresponse import BallMotion
from hoopd.core.bridge import Bridge
from hoopd.core.controllers import DONE, Controller, Measurement
from hoopd.core.drift import Level
from hoopd.core.encoderchecks import HoopMotion
from hoopd.core.faulttable import BY_NAME, Action
from hoopd.core.feedforward import FeedForward
from hoopd.core.health import Health, Sent, Thresholds
from hoopd.core.installed import NO_LABEL, ControllerLabel, Demanded, Estimator, Filter, Installed, acted_on
from hoopd.core.limits import Limiter
from hoopd.core.modes import ENERGISED, Event, Mode, next_mode
from hoopd.core.operator import Operator
from hoopd.core.records import Estimate, Inputs, TickRecord, TorqueCommand
from hoopd.core.succession import Make, Succession
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
        *,
        key: str = "",
        label: ControllerLabel = NO_LABEL,
        make: Make | None = None,
    ) -> None:
        """`key`: of what the filter is made from; `label`: of the controller's file; `make`: others, while it runs."""
        self.settings, self.limiter = settings, limiter
        self._filter = Filter(estimator, feedforward or FeedForward(), levels, ball, hoop, key)
        first = Installed(controller, self._filter, limiter.torque_nm, limiter.slew_nm_per_tick, label=label)
        self.health = Health(thresholds, settings.period_s, levels, ball, hoop)
        self.mode = Mode.DISARMED
        self.because: tuple[str, ...] = ()  # faults that led to this mode, whether they last or not
        self.succession = Succession(first, self._note, make, self.health.halting)
        self.operator = Operator(self.health, self.succession, settings.reference_limit_rad, self._note)
        self._bridge = Bridge()
        self._sent = Sent(0.0, 0.0, 0)
        self._added = 0.0  # N m, what feed-forward added to the torque that was sent last
        self._unfed = False  # feed-forward failed in this run, and that has been said
        self._faults: tuple[str, ...] = ()
        self._unreset = ""  # why a law could not be reset in the last tick without torque
        self._seq = -1
        self._stopping_since = 0.0
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
        estimate = self._estimate(self.succession.acting.filter, inputs)
        self.health.suspend(self.succession.suspended(self.mode))
        self.health.update(inputs, estimate, self._sent)
        if self._unreset:  # until it can be reset nobody arms it
            self.health.raise_now("not_finite")
        asked = self.operator.take(inputs.commands, self.mode, inputs.t)
        self._unfed = self._unfed and Event.ARM not in asked
        self._move(asked | self._own_events(inputs, estimate))
        torque = self._torque(inputs, estimate)
        self._watch(inputs.t, estimate)
        self._report_faults()
        command = self._command(inputs, torque)
        return Output(command, self._record(inputs, estimate, command), tuple(self._notes))

    def _estimate(self, filter_: Filter, inputs: Inputs) -> Estimate:
        return filter_.estimator.update(
            inputs.t,
            self._sent.torque_nm,
            self._sent.t + inputs.execution_s + self.settings.wire_s,
            inputs.driver,
            inputs.camera,
            held=self.mode is not Mode.RUNNING,
            unmodelled=self.succession.unmodelled(self.mode),
            may_fly=self.succession.may_fly(self.mode),
        )

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
        if self.mode is not Mode.RUNNING:
            self.operator.release()
        level = "error" if self.mode is Mode.FAULT else "info"
        causes = self.health.halting()
        # what led to a stop led to its end, too, though it may be over by then
        self.because = tuple(dict.fromkeys((*self.because, *causes))) if before is Mode.STOPPING else causes
        self._note("mode", level, mode=str(self.mode), was=str(before), because=list(causes))

    def _torque(self, inputs: Inputs, estimate: Estimate) -> float:
        if self.mode is Mode.RUNNING:
            wanted = self._run(inputs, estimate)
        else:
            self._added = 0.0
            self._bridge.reset()
            self.succession.leave(self.mode, inputs.t)
            self._follow_controller()
            if self.mode is not Mode.STOPPING:
                self._reset_laws()
                self.limiter.reset()
                return 0.0
            wanted = self._brake(inputs)
        if not isfinite(wanted):
            self.health.raise_now("not_finite")
            self._move(frozenset({Event.CUT}))
            self.succession.leave(self.mode, inputs.t)
            return 0.0
        return self.limiter.apply(wanted)

    def _run(self, inputs: Inputs, estimate: Estimate) -> float:
        """The torque of the acting law, or of the one that takes over in this tick."""
        follower = self.succession.follower
        asked = self.succession.acting.demand(self._measurement(inputs, estimate))
        other, its = Demanded(nan), estimate
        if follower is not None:
            if follower.filter is not self.succession.acting.filter:
                its = self._estimate(follower.filter, inputs)
            other = follower.demand(self._measurement(inputs, its), acting=False)
        wanted = self._bridge.over(asked.torque_nm, self.settings.period_s)
        judged = (inputs.t, self.operator.reference, self._sent.torque_nm)
        if self.succession.next(*judged, (estimate, its), (asked, other)):
            self._follow_controller()
            before = self._sent.torque_nm if asked.ended else wanted  # what is over asks for nothing any more
            asked, wanted = other, self._bridge.begin(before, other.torque_nm, self._sent.torque_nm)
        self._added = asked.added_nm
        self._tell_troubles(asked)
        if asked.ended and isfinite(wanted):
            return self._end_law(inputs, asked.ended)
        return wanted

    def _tell_troubles(self, asked: Demanded) -> None:
        if asked.failed:
            self._note("law_failed", "error", reason=asked.failed)
        if asked.unfed and not self._unfed:  # one event a run: it may fail in every tick
            self._unfed = True
            self._note("feedforward_failed", "error", reason=asked.unfed, says=UNFED_SAYS)

    def _end_law(self, inputs: Inputs, why: str) -> float:
        """A law that is over (`Ending`) stops the run in this very tick, as the operator's stop would."""
        self._added = 0.0
        self._note("law_ended", "info" if why == DONE else "warning", reason=why)
        self._move(frozenset({Event.STOP}))
        return self._brake(inputs)

    def _reset_laws(self) -> None:
        try:
            self.succession.acting.law.reset()
            if self.succession.follower is not None:
                self.succession.follower.law.reset()
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            if not self._unreset:  # it is reset in every tick without torque, the fact is one
                self._note("law_failed", "error", reason=reason)
            self._unreset = reason
            self.health.raise_now("not_finite")
        else:
            self._unreset = ""

    def _follow_controller(self) -> None:
        """Limits and filter of the controller that acts from now on."""
        acting = self.succession.acting
        self.limiter.torque_nm, self.limiter.slew_nm_per_tick = acting.torque_nm, acting.slew_nm_per_tick
        if acting.filter is not self._filter:
            left, self._filter = self._filter.key, acting.filter
            self.health.follow(left, acting.filter.key, acting.filter.levels, acting.filter.ball, acting.filter.hoop)

    def _brake(self, inputs: Inputs) -> float:
        if self._sent.enabled_for == 0 or self._stopping_since == 0.0:
            self._stopping_since = inputs.t
            self.limiter.reset()  # with a slow slew limit the law's torque would drive the hoop on
        limit = self.settings.brake_limit_nm
        return min(limit, max(-limit, -self.settings.brake_nm_per_rad_s * self.health.hoop_speed))

    def _measurement(self, inputs: Inputs, estimate: Estimate) -> Measurement:
        camera, driver = inputs.camera, inputs.driver
        x = acted_on(estimate)
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
            torque_added=self._bridge.torque_nm,
            speed=self.operator.speed,
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
        ball = estimate.ball
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
            distance=nan if camera is None else camera.distance,
            ball_mode="" if ball is None else ball.mode,
            mode_probability=nan if ball is None else ball.probability,
            distance_hat=nan if ball is None else ball.distance,
        )

    def _note(self, name: str, level: str, **fields: Any) -> None:
        self._notes.append(Note(name, level, fields))


def _near(angle: float, other: float) -> float:
    """The same angle, by whole turns nearest to another one."""
    return angle + tau * round((other - angle) / tau) if isfinite(other - angle) else angle
