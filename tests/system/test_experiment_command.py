"""The command of an experiment: bad input, what it refuses, and a key on a terminal in real time."""

from __future__ import annotations

import io
import json
import os
import pty
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from harness.timing import on_the_clock
from inprocess import call
from system.experiments import LOCKSTEP, ROOT
from system.test_bad_input import one_line

from hoopd.daemon import experiment
from hoopd.daemon.app import Options
from hoopd.daemon.operator_abort import ABORTED
from hoopd.daemon.recording_target import Where, recorded_parts
from hoopd.exit_codes import PORT_MISSING, UNUSABLE_INPUT
from hoopd.files.reading import InputError
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.recording.mcap import read_run
from hoopd.sim import torque_log

BAD: dict[str, tuple[tuple[str, ...], str]] = {
    "unknown kind": (("noise", *LOCKSTEP), "unknown kind 'noise'; known: prbs, chirp"),
    "too much torque": (("prbs", *LOCKSTEP, "--amplitude", "0.4"), "--amplitude: 0.4 N m is outside 0 to the limit"),
    "torque that is none": (("prbs", *LOCKSTEP, "--amplitude", "nan"), "--amplitude: must be a finite number, not nan"),
    "steps beyond the slew limit": (
        ("prbs", *LOCKSTEP, "--amplitude", "0.1", "--set", "limits.slew_nm_per_tick=0.05"),
        "experiment prbs: table_nm steps by 0.2 N m in a tick, and 0.05 N m are in force",
    ),
    "speed beyond the fault's": (("prbs", *LOCKSTEP, "--max-speed", "60"), "--max-speed: 60 rad/s must be below"),
    "endless speed": (("prbs", *LOCKSTEP, "--max-speed", "nan"), "--max-speed"),
    "no model": (("prbs", *LOCKSTEP, "--model", "FOLDER/none.yaml"), "none.yaml: no such file"),
    "model that is none": (("prbs", *LOCKSTEP, "--model", "FOLDER/../signal.yaml"), "signal.yaml"),
    "more than the limits": (("prbs", *LOCKSTEP, "--use", "1.2"), "--use"),
    "no band": (("chirp", *LOCKSTEP, "--low", "5", "--high", "1"), "experiment chirp: needs 0 < low < high"),
    "band of nothing": (
        ("multisine", *LOCKSTEP, "--low", "0.6", "--high", "0.9"),
        "have no line between 0.6 and 0.9 Hz",
    ),
    "too short": (("decay", *LOCKSTEP), "experiment decay: 50 samples are too short"),
    "two places": (("prbs", *LOCKSTEP, "--out", "FOLDER/a.mcap", "--record", "FOLDER"), "--out: either"),
    "no folder": (("prbs", *LOCKSTEP, "--out", "FOLDER/none/a.mcap"), "--out: no such folder"),
    "no folder to record": (("prbs", *LOCKSTEP, "--record", "FOLDER/none"), "--record: no such folder"),
    "another format": (("prbs", *LOCKSTEP, "--out", "FOLDER/a.csv"), "--out: must end in .mcap"),
    "figure of no kind": (("prbs", *LOCKSTEP, "--figure", "FOLDER/a.gif"), "--figure: unknown extension"),
    "result nowhere": (("prbs", *LOCKSTEP, "--json", "FOLDER/none/a.json"), "--json: no such folder"),
    "law that is none": (("prbs", *LOCKSTEP, "--around", "FOLDER/none.yaml"), "no such file"),
    "holding nothing": (
        ("prbs", *LOCKSTEP, "--no-ball", "--around", "controllers/lqg.yaml"),
        "--around: a holding law",
    ),
    "holding with a test signal": (
        ("prbs", *LOCKSTEP, "--around", "FOLDER/../signal.yaml"),
        "kind: excitation",
    ),
    "holding at another pace": (
        ("prbs", *LOCKSTEP, "--around", "FOLDER/../slow.yaml"),
        "designed for 0.01",
    ),
    "lock-step of the device": (("prbs", "--speed", "max"), "--speed max: only with --sim"),
    "arm without a terminal": (("prbs", "--arm"), "--arm: only on a terminal"),
    "endless rest": (("decay", *LOCKSTEP, "--rest", "inf"), "--rest"),
    "no number of seconds": (("prbs", *LOCKSTEP, "--duration", "nan"), "--duration"),
    "ramp that is none": (("prbs", *LOCKSTEP, "--soft-start", "-1"), "--soft-start"),
    "no port": (("prbs", "--set", "camera.command=['true']", "--set", "serial.port=/dev/none"), "/dev/none"),
}


def laws_beside(folder: Path) -> Path:
    """A folder beside two controller files that hold nothing here."""
    page = (ROOT / "docs" / "guides" / "experiment.md").read_text()
    (folder / "signal.yaml").write_text(page.split("```yaml\n", 1)[1].split("```", 1)[0])
    lqg = (ROOT / "config/controllers/lqg.yaml").read_text()
    (folder / "slow.yaml").write_text(lqg.replace("sample_time_s: 0.02", "sample_time_s: 0.01"))
    (folder / "here").mkdir()
    return folder / "here"


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, expected = BAD[name]
    tmp_path = laws_beside(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.chdir(tmp_path)
    for variable in ("INVOCATION_ID", "NOTIFY_SOCKET"):
        monkeypatch.delenv(variable, raising=False)
    wanted = PORT_MISSING if name == "no port" else UNUSABLE_INPUT
    one_line(*call(("experiment", *(word.replace("FOLDER", str(tmp_path)) for word in arguments))), expected, wanted)
    assert not list(tmp_path.iterdir())


def test_a_rig_that_does_not_keep_up_is_said() -> None:
    real = Options(sim=True)
    (words,) = experiment._too_slow({"camera_lost": 3, "ball_lost": 1}, real)
    assert words.startswith("camera_lost: the rig did not keep up")
    assert (
        experiment._too_slow({"camera_lost": 3}, real._replace(speed="max")) == []
    )  # virtual time waits for everybody
    assert experiment._too_slow({"camera_lost": 3}, Options()) == []  # on the device it is the device
    assert experiment._too_slow({"ball_lost": 1}, real) == []


def test_recordings_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    one_line(
        *call(("experiment", "prbs", *LOCKSTEP, "--out", str(tmp_path / "a.mcap"))), "give another name, or delete it"
    )
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"


def test_runs_that_overlap_overwrite_nothing(tmp_path: Path) -> None:
    where = Where(file=tmp_path / "a.mcap")
    with recorded_parts(where) as (first, parts), recorded_parts(where) as (second, others):
        for folder in (first, second):
            (folder / "run-0001.mcap").write_text(str(folder))
    assert [path.name for path in (*others, *parts)] == ["a.mcap", "a-2.mcap"]
    assert [path.read_text() for path in (*others, *parts)] == [str(second), str(first)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-2.mcap", "a.mcap"]


def test_the_daemon_without_a_ball_refuses_laws_that_need_one() -> None:
    arguments = ("--sim", "--speed", "max", "--duration", "1", "--set", "faults.ball_expected=false")
    one_line(*call(arguments), "faults.ball_expected: false, but lqg acts on the ball")


def test_a_table_without_a_limit_of_the_ball_is_refused_where_a_ball_is_expected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "guides" / "experiment.md").read_text()
    text = page.split("```yaml\n", 1)[1].split("```", 1)[0]
    kept = [line for line in text.splitlines() if "ball_angle_rad" not in line]
    assert len(kept) < len(text.splitlines())
    (tmp_path / "blind.yaml").write_text("\n".join(kept) + "\n")
    monkeypatch.chdir(tmp_path)
    one_line(*call((*LOCKSTEP, "--set", "control.file=blind.yaml")), "gains.ball_angle_rad: missing, but a ball")


AROUND = {"kind": "lqg", "gains": {"k_dtheta": 0.006, "k_psi": 0.12, "k_dpsi": 0.04}}
LAW = "class Law:\n    def update(self, m):\n        return 0.1, {}\n    def reset(self):\n        pass\n"


@pytest.mark.parametrize("name", ["control.file=held.yaml", "control.law=law.py"])
def test_no_other_way_leads_a_law_to_a_hoop_without_its_ball(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An excitation with a holding law, and a law of the user's own beside the file of an excitation."""
    page = (ROOT / "docs" / "guides" / "experiment.md").read_text()
    text = page.split("```yaml\n", 1)[1].split("```", 1)[0]
    (tmp_path / "free.yaml").write_text(text)
    (tmp_path / "held.yaml").write_text(text.rstrip() + f"\n  around: {json.dumps(AROUND)}\n")
    (tmp_path / "law.py").write_text(LAW)
    monkeypatch.chdir(tmp_path)
    free = ("--set", "control.file=free.yaml", "--set", "faults.ball_expected=false")
    assert call((*LOCKSTEP, *free))[0] == 0
    assert call((*LOCKSTEP, "--set", name))[0] == 0  # with a ball both may act
    one_line(*call((*LOCKSTEP, *free, "--set", name)), "acts on the ball")


@pytest.mark.parametrize(("options", "longest"), [(Options(sim=True), 27.0), (Options(), None)])
def test_a_run_that_arms_by_itself_has_an_end(
    options: Options, longest: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the watcher thinks: 20 s to begin, 2 s of signal, 5 s to end."""
    given: list[float | None] = []

    def perform(options: Options, *_: Any) -> None:
        given.append(options.duration_s)
        raise InputError("here", "", "seen")

    monkeypatch.setattr(experiment, "perform", perform)
    with pytest.raises(InputError, match="seen"):
        experiment.run(Plan("prbs", 2.0, 0.03), options, Where(file=tmp_path / "a.mcap"))
    assert given == [longest] and not list(tmp_path.iterdir())


def test_the_command(tmp_path: Path) -> None:
    code, out, _ = call(
        ("experiment", "prbs", *LOCKSTEP, "--record", str(tmp_path), "--json", str(tmp_path / "a.json"))
    )
    result = json.loads((tmp_path / "a.json").read_text())
    assert code == 0 and result["outcome"] == "done" and "outcome" in out
    assert result["file"] == str(tmp_path / "run-0001.mcap") and result["next"].startswith("hoopd fit ")


@pytest.mark.parametrize(("limit", "amplitude"), [("0.03", 0.03), ("0.035", 0.03)])
def test_a_signal_is_as_large_as_the_limits_in_force_let_it(limit: str, amplitude: float, tmp_path: Path) -> None:
    code, _, _ = call(
        ("experiment", "prbs", *LOCKSTEP, "--out", str(tmp_path / "a.mcap"), "--json", str(tmp_path / "a.json"),
         "--set", f"limits.torque_nm={limit}")
    )  # fmt: skip
    result = json.loads((tmp_path / "a.json").read_text())
    assert code == 0 and result["outcome"] == "done"
    assert result["amplitude_nm"] == result["largest_torque_nm"] == amplitude
    assert "0.03 N m, because the limits in force let no more pass" in result["notes"]


@pytest.mark.parametrize("key", [b"q", *(pytest.param(one, marks=pytest.mark.proof) for one in (b" ", b"\x03"))])
def test_a_key_on_the_terminal_aborts(key: bytes, tmp_path: Path) -> None:
    """The rig in real time, the program on a terminal of its own."""
    ours, theirs = pty.openpty()
    command = [
        sys.executable,
        "-m",
        "hoopd",
        "experiment",
        "prbs",
        "--sim",
        "--camera",
        "direct",
        "--amplitude",
        "0.05",
    ]
    command += ["--out", str(tmp_path / "a.mcap"), "--json", str(tmp_path / "a.json")]
    command += [f"--set=sim.directory={tmp_path}", "--set=telemetry.enabled=false"]
    # A shell that leads a session and opens a terminal owns it: only then Ctrl-C is a signal.
    process = subprocess.Popen(
        ["sh", "-c", 'exec "$@" < "$0"', os.ttyname(theirs), *command], start_new_session=True, cwd=tmp_path,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    try:
        wait_for_torque(tmp_path / "torque.jsonl", process)
        pressed_at = time.monotonic()
        os.write(ours, key)
        assert process.wait(10.0) == 1
    finally:
        process.kill()
        process.wait()
        os.close(ours)
        os.close(theirs)
    assert json.loads((tmp_path / "a.json").read_text())["outcome"] == ABORTED
    log = torque_log.read(tmp_path / "torque.jsonl")
    with on_the_clock():
        assert log.zero_for_good_from(pressed_at) < 0.25  # a busy machine; 0.03 s where nothing else runs
    assert read_run(tmp_path / "a.mcap").ticks


def wait_for_torque(path: Path, process: subprocess.Popen[bytes]) -> None:
    """Until the board really moves the hoop."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end and process.poll() is None:
        if path.exists() and torque_log.read(path).max_abs() > 0.01:
            return
        time.sleep(0.05)
    raise AssertionError("no torque")
