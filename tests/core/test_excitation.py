"""The law of an experiment: its table, its limits, its end; alone and inside the tick."""

from __future__ import annotations

from itertools import pairwise
from math import inf, nan, pi, tau

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from hoopd.core.controllers import DONE, Lqg, LqgGains, Measurement, TransferFunctionController
from hoopd.core.excitation import Excitation, ExcitationLimits, soft_factor
from hoopd.core.health import Thresholds
from hoopd.core.hooponly import HoopOnly
from hoopd.core.limits import Limiter
from hoopd.core.modes import Mode
from hoopd.core.records import CameraSample, Command, DriverSample, Inputs, LinkCounts
from hoopd.core.tick import Tick
from hoopd.core.ticksettings import TickSettings

LIMITS = ExcitationLimits(0.3, 45.0, 1.25)
HOLD = LqgGains(k_dtheta=0.006, k_psi=0.12, k_dpsi=0.04)


def measured(dtheta: float = 0.0, psi: float = 0.0, *, ready: bool = True, **changes: float) -> Measurement:
    values = {"dtheta_measured": dtheta, "psi_measured": psi, **changes}
    seen = values["psi_measured"], True, values["dtheta_measured"]
    return Measurement(0.0, np.array([0.0, dtheta, psi, 0.0]), ready, *seen, 0.0, 0.0, 0.02)


def played(law: Excitation, ticks: int, m: Measurement | None = None) -> list[float]:
    return [law.update(m or measured())[0] for _ in range(ticks)]


def test_plays_the_table_once_and_ends() -> None:
    law = Excitation([0.1, -0.2, 0.3], LIMITS)
    assert played(law, 3) == [0.1, -0.2, 0.3] and law.ended == ""
    assert played(law, 2) == [0.0, 0.0] and law.ended == DONE
    law.reset()
    assert law.ended == "" and played(law, 1) == [0.1]


def test_soft_start_and_end() -> None:
    u = played(Excitation([0.1] * 100, LIMITS, soft_start_ticks=20, soft_end_ticks=10), 100)
    assert u[0] < 0.001 and u[-1] < 0.003 and u[20:89] == [0.1] * 69
    assert all(a < b for a, b in pairwise(u[:20]))
    assert max(abs(b - a) for a, b in pairwise(u)) < 0.1 * pi / 2 / 10
    assert soft_factor(0, 5, 0, 0) == 1.0


@pytest.mark.parametrize(("m", "says"), [
    (measured(46.0), "hoop speed 46.00 rad/s beyond 45"),
    (measured(0.0, dtheta_measured=-50.0), "hoop speed 50.00"),
    (measured(50.0, dtheta_measured=nan), "hoop speed 50.00"),
    (measured(psi=-1.3), "ball angle 1.300 rad beyond 1.25"),
    (measured(psi_measured=2.0), "ball angle 2.000"),
    (measured(psi=nan, psi_measured=nan), "ball angle nan"),
    (measured(nan, dtheta_measured=nan), "hoop speed nan"),
    (measured(ready=False), "the estimate was lost"),
])  # fmt: skip
def test_a_breach_ends_it_for_good(m: Measurement, says: str) -> None:
    law = Excitation([0.1] * 10, LIMITS)
    assert played(law, 3) == [0.1] * 3
    assert law.update(m)[0] == 0.0 and law.ended.startswith(says)
    assert played(law, 5) == [0.0] * 5 and law.ended.startswith(says)


def test_a_ball_that_went_round_is_judged_from_its_own_bottom() -> None:
    law = Excitation([0.1] * 3, LIMITS)
    assert played(law, 2, measured(psi=tau + 0.5)) == [0.1, 0.1]


def test_without_a_ball_no_angle_is_watched() -> None:
    law = Excitation([0.1] * 3, ExcitationLimits(0.3, 45.0))
    assert played(law, 3, measured(psi=3.0)) == [0.1] * 3


def test_centring_and_holding_are_added_and_cut() -> None:
    assert played(Excitation([0.1], LIMITS, centring_nm_per_rad_s=0.01), 1, measured(5.0)) == pytest.approx([0.05])
    around = Excitation([0.1, 0.1], LIMITS, around=Lqg(HOLD))
    assert around.update(measured(psi=0.2))[0] == pytest.approx(0.1 - 0.024)
    assert around.update(measured(psi=-1.2, dtheta=-44.0))[0] == 0.3


def test_a_holding_integrator_does_not_add_up_the_signal() -> None:
    """At rest a PI on the angle asks for nothing, so the sum is the table, and with centring the table less that."""
    table = [0.1, 0.1, -0.2, 0.1, 0.1, 0.1]
    law = Excitation(table, LIMITS, around=TransferFunctionController([1.0, -0.9], [1.0, -1.0]))
    sent = [0.0]
    for _ in table:
        sent.append(law.update(measured()._replace(torque_previous=sent[-1]))[0])
    assert sent[1:] == pytest.approx(table)
    centred = Excitation(table, LIMITS, around=TransferFunctionController([1.0, -0.9], [1.0, -1.0]),
                         centring_nm_per_rad_s=0.01)  # fmt: skip
    first = centred.update(measured(1.0))[0]
    second = centred.update(measured(1.0)._replace(torque_previous=first))[0]
    assert [first, second] == pytest.approx([0.09, 0.09])


@pytest.mark.parametrize(("table", "limits"), [
    ([], LIMITS),
    ([nan], LIMITS),
    ([inf], LIMITS),
    ([0.31], LIMITS),
])  # fmt: skip
def test_tables_that_are_none(table: list[float], limits: ExcitationLimits) -> None:
    with pytest.raises(ValueError, match="table"):
        Excitation(table, limits)


@pytest.mark.parametrize("gain", [nan, inf, -0.01])
def test_centring_that_is_none(gain: float) -> None:
    with pytest.raises(ValueError, match="centring"):
        Excitation([0.1], LIMITS, centring_nm_per_rad_s=gain)


@pytest.mark.parametrize("bad", [(0.0, 1.0, 1.0), (inf, 1.0, 1.0), (0.1, nan, 1.0), (0.1, inf, 1.0), (0.1, 1.0, 0.0)])
def test_limits_that_limit_nothing(bad: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="limits"):
        ExcitationLimits(*bad)


ANY = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=300, deadline=None)
@given(
    table=st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=30),
    seen=st.lists(st.tuples(ANY, ANY, ANY, ANY, st.booleans()), min_size=1, max_size=40),
    soft=st.tuples(st.integers(0, 40), st.integers(0, 40)),
    centring=st.sampled_from([0.0, 0.01, 0.05]),
    held=st.booleans(),
)
def test_limits_are_never_exceeded(table, seen, soft, centring, held) -> None:
    """Whatever is measured: no torque beyond the limit, and none at all beyond a limit of speed or angle."""
    around = Lqg(HOLD) if held else None
    law = Excitation(
        table, LIMITS, soft_start_ticks=soft[0], soft_end_ticks=soft[1], centring_nm_per_rad_s=centring, around=around
    )
    over = False
    for dtheta, psi, dtheta_measured, psi_measured, ready in seen:
        m = measured(dtheta, psi, ready=ready, dtheta_measured=dtheta_measured, psi_measured=psi_measured)
        torque, _ = law.update(m)
        assert abs(torque) <= LIMITS.torque_nm
        beyond = not ready or not abs(dtheta) <= 45.0 or (np.isfinite(dtheta_measured) and abs(dtheta_measured) > 45.0)
        over = over or beyond
        if over:
            assert torque == 0.0 and law.ended
        if not law.ended and not held and not centring:
            assert abs(torque) <= max(map(abs, table))


# ------------------------------------------------------------------------------------------------ in the tick


class Bench:
    """A tick with a hoop of its own, without a ball; the hoop turns as it is told."""

    def __init__(self, law: Excitation) -> None:
        thresholds = Thresholds(ball_expected=False, accepted_off=("current_implausible",))
        self.tick = Tick(TickSettings(), thresholds, HoopOnly(), law, Limiter(0.7, 1.4))
        self.k, self.theta, self.enabled = 0, 0.0, False
        self.notes: list[tuple[str, dict]] = []

    def step(self, dtheta: float = 0.0, *commands: str, driver: bool = True, camera: CameraSample | None = None):
        self.k += 1
        t = self.k * 0.02
        self.theta += 0.02 * dtheta
        status = 1 if self.enabled else 0
        answer = DriverSample(t - 0.019, 0, status, 0, self.theta, dtheta, 0.0, round(1e3 * t) % 65536)
        inputs = Inputs(
            self.k, t, camera, answer if driver else None, LinkCounts(good=1), tuple(Command(c) for c in commands), 0.0,
            0.001, False, 0,
        )  # fmt: skip
        output = self.tick.step(inputs)
        self.enabled = output.command.enable
        self.notes += [(note.name, note.fields) for note in output.notes]
        return output

    def armed(self) -> None:
        for _ in range(60):
            self.step()
        self.step(0.0, "arm")
        while self.tick.mode is not Mode.RUNNING:
            self.step()


def test_the_tick_brakes_in_the_very_tick_of_the_end() -> None:
    bench = Bench(Excitation([0.1] * 5, ExcitationLimits(0.3, 45.0)))
    bench.armed()
    u = [bench.step(1.0).command.torque_nm for _ in range(4)]
    assert u == [0.1] * 4
    output = bench.step(1.0)
    assert output.record.mode == "STOPPING" and output.command.torque_nm == pytest.approx(-0.01)
    assert ("law_ended", {"reason": DONE}) in bench.notes
    outputs = [bench.step(0.1) for _ in range(4)]
    assert outputs[-1].record.mode == "DISARMED" and outputs[-1].command.torque_nm == 0.0
    assert not outputs[-1].command.enable


def test_the_tick_stops_on_a_breach() -> None:
    bench = Bench(Excitation([0.1] * 500, ExcitationLimits(0.3, 5.0)))
    bench.armed()
    bench.step(4.0)
    output = bench.step(6.0)
    assert output.record.mode == "STOPPING" and output.command.torque_nm < 0.0
    assert bench.notes[-2][0] == "law_ended" and "hoop speed 6.00" in bench.notes[-2][1]["reason"]


@pytest.mark.parametrize(("command", "mode"), [("disarm", "DISARMED"), ("stop", "STOPPING")])
def test_the_operator_is_obeyed(command: str, mode: str) -> None:
    bench = Bench(Excitation([0.1] * 500, ExcitationLimits(0.3, 45.0)))
    bench.armed()
    output = bench.step(2.0, command)
    assert output.record.mode == mode and output.command.torque_nm <= 0.0
    assert output.command.enable == (mode == "STOPPING")


def test_without_a_ball_the_link_still_cuts_and_pictures_mean_nothing() -> None:
    bench = Bench(Excitation([0.1] * 500, ExcitationLimits(0.3, 45.0)))
    bench.armed()
    picture = CameraSample(1, 0.0, 0.0, 0.3, 1.0, 0.0, 0.0)
    assert np.isnan(bench.step(1.0, camera=picture).record.psi)
    outputs = [bench.step(driver=False) for _ in range(3)]
    assert outputs[-1].record.mode == "FAULT" and outputs[-1].command.torque_nm == 0.0


def test_an_answer_that_is_no_number_leaves_the_last_one() -> None:
    hoop = HoopOnly()
    good = DriverSample(0.0, 0, 1, 0, 1.0, 2.0, 0.0, 0)

    def seen(driver: DriverSample | None) -> tuple[bool, list[float]]:
        estimate = hoop.update(0.0, 0.0, 0.0, driver, None, held=False)
        return estimate.ready, estimate.x.tolist()

    assert seen(None) == seen(good._replace(dtheta=nan)) == (False, [0.0] * 4)
    for driver in (good, None, good._replace(theta=nan), good._replace(dtheta=inf)):
        assert seen(driver) == (True, [1.0, 2.0, 0.0, 0.0])
    hoop.reset()
    assert seen(None) == (False, [0.0] * 4)
