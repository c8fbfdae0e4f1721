"""`hoopd check`: every verdict, with fakes; the board's time-out against boards that get it wrong."""

from __future__ import annotations

import math

import pytest

from hoopd.core.records import CameraSample, DriverSample
from hoopd.daemon import checks as check
from hoopd.daemon.checks import CheckResult, Verdict
from hoopd.files.reading import InputError

ENABLED, TIMEOUT, FAULT = 1, 2, 8


class FakeBoard:
    """Status bits of a board; `broken` names what this firmware does wrong."""

    def __init__(self, broken: str = "") -> None:
        self.broken = broken
        self.enabled, self.latched, self.quiet_s = False, True, 1.0
        self.asked: list[tuple[bool, bool]] = []

    def exchange(self, enable: bool, clear: bool) -> DriverSample | None:
        self.asked.append((enable, clear))
        silent, self.quiet_s = self.quiet_s > 0.1, 0.02
        if self.broken == "deaf" or (self.broken == "dies" and silent and len(self.asked) > 1):
            return None
        if silent and self.broken != "no time-out":
            self.latched = True
        if clear and self.broken != "cannot clear":
            self.latched = False
        self.enabled = enable and (not self.latched or self.broken == "stays on")
        status = ENABLED * self.enabled | TIMEOUT * self.latched | FAULT * (self.broken == "fault")
        if self.broken == "forgets":
            self.latched = False
        return DriverSample(0.0, 0, status, 0, 0.0, 0.0, 0.0, 0)

    def silence(self, seconds: float) -> None:
        self.quiet_s += seconds


class LosesOne(FakeBoard):
    """The fifth answer gets lost."""

    def exchange(self, enable: bool, clear: bool) -> DriverSample | None:
        answer = super().exchange(enable, clear)
        return None if len(self.asked) == 5 else answer


def test_a_good_board_proves_its_time_out_and_is_left_switched_off():
    board = FakeBoard()
    row = check.board_timeout(board)
    assert row.verdict is Verdict.OK
    assert board.asked[-1] == (False, True)
    assert not board.enabled
    assert not board.latched


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        ("no time-out", "not switched off"),
        ("stays on", "not switched off"),
        ("forgets", "not switched off"),
        ("cannot clear", "cannot be cleared"),
        ("deaf", "no answer before"),
        ("dies", "no answer after"),
        ("fault", "reports a fault"),
    ],
)
def test_a_board_without_a_proven_time_out_fails(broken, reason):
    board = FakeBoard(broken)
    row = check.board_timeout(board)
    assert row.verdict is Verdict.FAIL
    assert reason in row.granted
    assert "do not arm" in row.advice
    assert board.asked[-1] == (False, True)


def test_board_answers():
    assert check.board_answers(FakeBoard()).verdict is Verdict.OK
    assert check.board_answers(FakeBoard("deaf")).verdict is Verdict.FAIL
    row = check.board_answers(LosesOne())
    assert row.verdict is Verdict.WARN
    assert row.granted.startswith("9 answers")


@pytest.mark.parametrize(
    ("failure", "verdict", "advice"),
    [
        ("", Verdict.OK, ""),
        ("No such file or directory", Verdict.FAIL, "serial.port"),
        ("Could not exclusively lock port", Verdict.FAIL, "stop the daemon"),
    ],
)
def test_serial_port(failure, verdict, advice):
    row = check.serial_port("/dev/hoop-driver", 115200, failure)
    assert row.verdict is verdict
    assert advice in row.advice


def pictures(rate: float, count: int, found: int) -> list[CameraSample]:
    return [
        CameraSample(n, n / rate, n / rate + 0.04, 0.1 if n < found else math.nan, 0.9, 1.0, 1.0) for n in range(count)
    ]


@pytest.mark.parametrize(
    ("samples", "camera", "ball"),
    [
        (pictures(50.0, 50, 50), Verdict.OK, Verdict.OK),
        (pictures(30.0, 30, 30), Verdict.WARN, Verdict.OK),
        (pictures(50.0, 50, 5), Verdict.OK, Verdict.WARN),
        (pictures(50.0, 50, 0), Verdict.OK, Verdict.WARN),
        (pictures(50.0, 1, 1), Verdict.FAIL, Verdict.OK),
        ([], Verdict.FAIL, Verdict.SKIPPED),
    ],
)
def test_camera_and_ball(samples, camera, ball):
    assert check.camera_rate("rpicam", 50.0, samples).verdict is camera
    assert check.ball_seen(samples).verdict is ball


def test_camera_tells_rate_and_age():
    assert check.camera_rate("rpicam", 50.0, pictures(50.0, 50, 50)).granted == "50.0 pictures a second, 40 ms old"


@pytest.mark.parametrize(
    ("policy", "priority", "verdict"),
    [("fifo", 50, Verdict.OK), ("fifo", 10, Verdict.WARN), ("other", 0, Verdict.WARN)],
)
def test_scheduling(policy, priority, verdict):
    granted = {"policy": policy, "priority": priority, "rtprio_limit": 0}
    row = check.scheduling(50, granted, "this process")
    assert row.verdict is verdict
    assert f"{policy} {priority}" in row.granted


def test_memory_lock_reports_what_was_granted():
    assert check.memory_lock("", 2**28, None).verdict is Verdict.OK
    assert check.memory_lock("cannot allocate memory", 0, 2**23).granted == "cannot allocate memory, limit 8 MiB"
    assert check.memory_lock("", 0, None).verdict is Verdict.WARN  # no reason, and nothing locked either


def test_clock():
    assert check.clock(0.02, 1e-9, [1e-4] * 50).verdict is Verdict.OK
    assert check.clock(0.02, 1e-9, [5e-3] * 50).verdict is Verdict.WARN
    assert check.clock(0.02, 4e-3, [1e-4] * 50).verdict is Verdict.FAIL
    assert [check.wall_clock(known).verdict for known in (True, False, None)] == [
        Verdict.OK,
        Verdict.WARN,
        Verdict.SKIPPED,
    ]


@pytest.mark.parametrize(
    ("word", "verdict", "text"),
    [
        (None, Verdict.SKIPPED, "not a Raspberry Pi"),
        (0x0, Verdict.OK, "none"),
        (0x50000, Verdict.WARN, "now: none; since power-on: undervoltage, throttled (0x50000)"),
        (0x50005, Verdict.FAIL, "now: undervoltage, throttled; since"),
        (0x80008, Verdict.FAIL, "now: soft temperature limit"),
        (0x20000, Verdict.WARN, "since power-on: clock capped"),
    ],
)
def test_power_bits(word, verdict, text):
    row = check.power(word)
    assert row.verdict is verdict
    assert text in row.granted
    assert ("power supply" in row.advice) == (word in (0x50000, 0x50005))


GIB = 2**30


@pytest.mark.parametrize(
    ("used", "free", "verdict"),
    [(0, 10 * GIB, Verdict.OK), (0, GIB, Verdict.WARN), (2 * GIB, GIB, Verdict.OK), (0, 1000, Verdict.FAIL)],
)
def test_disk_against_the_quota(used, free, verdict):
    assert check.disk("/var/lib/hoopd", 2 * GIB, used, free, 200 * 2**20).verdict is verdict


def test_telemetry_and_files():
    assert check.telemetry("tcp/127.0.0.1:7447", "").verdict is Verdict.OK
    assert check.telemetry("tcp/127.0.0.1:7447", "address already in use").verdict is Verdict.WARN
    expected = {"model": "hoopd.model/1"}
    assert check.configuration_files({"model": "hoopd.model/1"}, expected).verdict is Verdict.OK
    assert check.configuration_files({"model": "hoopd.model/2"}, expected).granted == "model: hoopd.model/2"
    assert check.configuration_files({}, expected).verdict is Verdict.FAIL


def broken() -> CheckResult:
    raise OSError("gone [again]")


def unusable() -> CheckResult:
    raise InputError("hoop.yaml", "serial", "unknown key")


def test_a_check_that_breaks_is_a_row_and_the_others_go_on(capsys):
    rows = check.run_checks([("camera", broken), ("power", lambda: check.power(None))])
    assert [row.verdict for row in rows] == [Verdict.FAIL, Verdict.SKIPPED]
    assert check.exit_code(rows) == 1
    assert check.exit_code(rows[1:]) == 0
    data = check.as_data(rows)
    assert data["exit"] == 1
    assert data["checks"][0]["granted"] == "OSError: gone [again]"
    check.print_table(rows)
    out = capsys.readouterr().out
    assert "[again]" in out
    assert "1 fail" in out


def test_unusable_input_is_not_a_row():
    with pytest.raises(InputError):
        check.run_checks([("files", unusable)])


@pytest.mark.parametrize(
    ("allowed", "isolated", "late_s", "verdict", "advice"),
    [
        ({0, 1, 2, 3}, set(), 0.0001, Verdict.OK, ""),
        ({3}, {3}, 0.0001, Verdict.OK, ""),
        ({0, 1, 2}, {3}, 0.0001, Verdict.WARN, "CPUAffinity"),
        ({2, 3}, {3}, 0.0001, Verdict.WARN, "CPUAffinity"),
        ({3}, set(), 0.0001, Verdict.WARN, "isolcpus"),
        ({3}, {3}, 0.004, Verdict.WARN, "what else runs"),
    ],
)
def test_cores(allowed, isolated, late_s, verdict, advice):
    late = {core: [0.00005, late_s] for core in allowed}
    row = check.cores(allowed, "the unit", {0, 1, 2, 3}, isolated, late, 0.02)
    assert row.verdict is verdict
    assert advice in row.advice
    assert f"{1e3 * late_s:.2f} ms" in row.granted
    assert "(the unit)" in row.granted
