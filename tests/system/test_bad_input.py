"""Unusable input: exactly one line on standard error, exit code 2, no traceback, nothing written."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import serial
from harness.runs import run
from inprocess import call

ROOT = Path(__file__).resolve().parents[2]
LOCKSTEP = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "1")
LQG = (ROOT / "config/controllers/lqg.yaml").read_text()

Maker = Callable[[Path], tuple[str, ...]]


def settings(text: str) -> Maker:
    """A configuration file of this text."""

    def make(folder: Path) -> tuple[str, ...]:
        (folder / "bad.yaml").write_text(text)
        return (*LOCKSTEP, "--config", str(folder / "bad.yaml"))

    return make


def override(*texts: str) -> Maker:
    """The same by --set; FOLDER stands for the test's folder."""
    return lambda folder: (*LOCKSTEP, *(p for t in texts for p in ("--set", t.replace("FOLDER", str(folder)))))


def controller(old: str, new: str) -> Maker:
    """A changed controller file."""

    def make(folder: Path) -> tuple[str, ...]:
        assert old in LQG
        (folder / "controller.yaml").write_text(LQG.replace(old, new))
        return (*LOCKSTEP, "--set", f"control.file={folder / 'controller.yaml'}")

    return make


def words(*arguments: str) -> Maker:
    """Plain arguments; FOLDER stands for the test's folder."""
    return lambda folder: tuple(word.replace("FOLDER", str(folder)) for word in arguments)


def law(text: str) -> Maker:
    """A user's own law."""

    def make(folder: Path) -> tuple[str, ...]:
        (folder / "law.py").write_text(text)
        return (*LOCKSTEP, "--set", f"control.law={folder / 'law.py'}")

    return make


def recording(data: bytes) -> Maker:
    """A file that is no recording."""

    def make(folder: Path) -> tuple[str, ...]:
        (folder / "some.mcap").write_bytes(data)
        return ("replay", str(folder / "some.mcap"))

    return make


CASES: dict[str, tuple[Maker, str]] = {
    # the configuration
    "unknown key": (settings("loop: {perod_s: 20 ms}"), "loop.perod_s: unknown key; did you mean period_s"),
    "unknown section": (settings("lop: {}"), "lop: unknown key"),
    "wrong unit": (settings("loop: {period_s: 20 kg}"), "loop.period_s: wrong unit 'kg'"),
    "not a number": (override("sim.psi_rad=many"), "sim.psi_rad: expected a number"),
    "a truth for a number": (override("sim.psi_rad=true"), "sim.psi_rad"),
    "unsafe torque": (override("limits.torque_nm=5"), "limits.torque_nm: Expected `float` <= 0.7"),
    "no torque limit": (override("limits.torque_nm=.nan"), "limits.torque_nm"),
    "no speed limit": (override("faults.hoop_speed_rad_s=.inf"), "faults.hoop_speed_rad_s: must be a finite number"),
    "unsafe period": (override("loop.period_s=5"), "period_s must be between"),
    "not YAML": (settings("a: [1\n"), "not YAML"),
    "not text": (
        lambda f: ((f / "b").write_bytes(b"\xff\xfe"), (*LOCKSTEP, "--config", str(f / "b")))[1],
        "not a text",
    ),
    "a folder": (words(*LOCKSTEP, "--config", "FOLDER"), "is a directory"),
    "no such configuration": (words(*LOCKSTEP, "--config", "FOLDER/none.yaml"), "no such file"),
    "override without a value": (override("limits.torque_nm"), "expected a.b=value"),
    "a section overwritten": (override("limits=5"), "limits: Expected `object`"),
    # what it names
    "missing model": (override("device.model=none.yaml"), "none.yaml: no such file"),
    "missing model of the rig": (override("sim.model=none.yaml"), "none.yaml: no such file"),
    "missing controller": (override("control.file=none.yaml"), "none.yaml: no such file"),
    "missing layout": (override("serial.layout=none.yaml"), "none.yaml: no such file"),
    "missing law": (override("control.law=none.py"), "none.py: no such file"),
    "law that does not parse": (law("x = ("), "cannot be loaded: SyntaxError"),
    "law that is none": (law("x = 1"), "Law: needs a class Law"),
    "controller without a schema": (controller("schema: hoopd.controller/1", ""), "schema"),
    "controller that is not YAML": (controller("gains: {", "gains: {{"), "not YAML"),
    "gain that is not a number": (controller("k_psi: 0.12387277", "k_psi: .nan"), "k_psi: must be a finite number"),
    "controller beyond the limit": (controller("torque_nm: 0.7", "torque_nm: 7"), "limits.torque_nm"),
    "controller of another period": (
        controller("sample_time_s: 0.02", "sample_time_s: 0.01"),
        "sample_time_s: designed",
    ),
    "serial device that is none": (
        words("--duration", "1", "--set", "camera.command=['true']", "--set", "serial.port=/dev/null"),
        "/dev/null: serial.port: could not configure port",
    ),
    "endpoint that is none": (
        words("--sim", "--camera", "direct", "--duration", "1", "--set", "telemetry.endpoint=bogus"),
        "telemetry.endpoint",
    ),
    # the rig
    "unknown fault": (override("sim.faults=[{kind: gremlins, at_s: 1}]"), "sim.faults[0]: unknown fault kind"),
    "unknown fault in real time": (
        words("--sim", "--duration", "1", "--set", "sim.faults=[{kind: gremlins, at_s: 1}]"),
        "sim.faults[0]: unknown fault kind",
    ),
    "fault before the start": (override("sim.faults=[{kind: lost_frames, at_s: -1}]"), "sim.faults[0].at_s"),
    "unknown parameter": (override("sim.faults=[{kind: garbage, at_s: 1, params: {x: 1}}]"), "unknown parameter 'x'"),
    "parameter of words": (
        override("sim.faults=[{kind: implausible_speed, at_s: 0.5, params: {value: many}}]"),
        "value must be a number",
    ),
    "unknown command": (override("sim.commands=[{at_s: 1, name: explode}]"), "sim.commands[0].name"),
    "missing folder of the rig": (override("sim.directory=FOLDER/none"), "sim.directory: no such folder"),
    # the command line
    "missing folder of recordings": (words(*LOCKSTEP, "--record", "FOLDER/none"), "--record: no such folder"),
    "missing folder of the result": (words(*LOCKSTEP, "--json", "FOLDER/none/x.json"), "--json: no such folder"),
    "speed max without the rig": (words("--speed", "max", "--duration", "1"), "--speed max: only with --sim"),
    "no pictures without the rig": (words("--camera", "direct", "--duration", "1"), "--camera direct: only with --sim"),
    "another speed": (words("--sim", "--speed", "2"), "--speed: must be 1 or max"),
    "speed max without an end": (words("--sim", "--speed", "max"), "--speed max: needs --duration"),
    "no duration": (words("--sim", "--duration", "0"), "--duration"),
    "endless duration": (words(*LOCKSTEP[:-1], "inf"), "--duration: must be a finite"),
    "negative seed": (words(*LOCKSTEP, "--seed", "-1"), "--seed"),
    "unknown option": (words("--bogus"), "No such option: --bogus"),
    "unknown subcommand": (words("bogus"), "No such command 'bogus'"),
    "arm without a terminal": (words(*LOCKSTEP, "--arm"), "--arm: only on a terminal"),
    "no daemon to arm": (words("arm", "--set", "commands.socket=/nowhere/hoop.sock"), "no daemon of device"),
    # recordings
    "missing recording": (words("replay", "FOLDER/none.mcap"), "no such file"),
    "empty recording": (recording(b""), "the file is empty"),
    "foreign recording": (recording(b"GIF89a, not a recording at all"), "not an MCAP file"),
}


def one_line(code: int, out: str, errors: str, expected: str, wanted: int = 2) -> None:
    assert code == wanted, errors
    assert errors.startswith("hoopd: ")
    assert errors.count("\n") == 1 and errors.endswith("\n"), errors
    assert expected in errors
    assert out == ""


@pytest.mark.parametrize("name", CASES)
def test_bad_input(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make, expected = CASES[name]
    monkeypatch.setattr("sys.stdin", io.StringIO())  # no terminal
    monkeypatch.delenv("INVOCATION_ID", raising=False)
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    arguments = make(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    one_line(*call(arguments), expected)
    assert sorted(tmp_path.rglob("*")) == before


def test_arm_under_systemd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INVOCATION_ID", "x")
    monkeypatch.setenv("NOTIFY_SOCKET", "/none")
    one_line(*call((*LOCKSTEP, "--arm")), "--arm: refused under systemd")


def test_a_recording_torn_before_its_first_row(tmp_path: Path) -> None:
    whole = run(tmp_path, duration_s=1.0).recordings[0].read_bytes()
    for size in (20, 200, 3000):
        (tmp_path / "torn.mcap").write_bytes(whole[:size])
        code, out, errors = call(("replay", str(tmp_path / "torn.mcap")))
        one_line(code, out, errors, "torn.mcap")
        assert errors.count("torn.mcap") == 1


MISSING_PORT = ("--duration", "1", "--set", "camera.command=['true']", "--set")


@pytest.mark.parametrize("port", ["/dev/none", "FOLDER/dangling", "FOLDER/taken"])
def test_a_port_that_may_come_yet_has_an_exit_code_of_its_own(port: str, tmp_path: Path) -> None:
    """Absent, unplugged with its link left behind, or held by another program."""
    (tmp_path / "dangling").symlink_to(tmp_path / "gone")
    master, slave = os.openpty()
    (tmp_path / "taken").symlink_to(os.ttyname(slave))
    holder = serial.Serial(os.ttyname(slave), exclusive=True)
    name = port.replace("FOLDER", str(tmp_path))
    try:
        one_line(*call((*MISSING_PORT, f"serial.port={name}")), f"{name}: serial.port: ", wanted=3)
    finally:
        holder.close()
        os.close(master)
        os.close(slave)


def test_a_missing_port_as_a_process_leaves_no_recording(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "hoopd", *MISSING_PORT, "serial.port=/dev/none", "--record", tmp_path],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    one_line(done.returncode, done.stdout, done.stderr, "/dev/none: serial.port: no such file", wanted=3)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["unknown key", "serial device that is none", "missing recording", "unknown option"])
def test_the_same_as_a_process(name: str, tmp_path: Path) -> None:
    make, expected = CASES[name]
    done = subprocess.run(
        [sys.executable, "-m", "hoopd", *make(tmp_path)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    one_line(done.returncode, done.stdout, done.stderr, expected)
