"""Experiments through the whole daemon in lock-step: what is recorded, and that every way out ends with zero torque.

The judge is the board's own log of torque; the device's terminal is tried once in real time.
"""

from __future__ import annotations

import contextlib
import errno
import inspect
import io
import json
import os
import pty
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from system.test_bad_input import call, one_line

from hoopd import cli, experiment
from hoopd.app import Options
from hoopd.conductor import ABORTED, Conductor
from hoopd.experiment import Where
from hoopd.experimentplan import AMPLITUDES_NM, DURATION_S, DURATIONS_S, Plan
from hoopd.files import InputError, parse_yaml
from hoopd.recording.mcap import Run, read_run
from hoopd.replay import replay
from hoopd.shell import recorder
from hoopd.sim import torque_log
from hoopd.sim.torque_log import TorqueLog

ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Experiment:
    """What one experiment left behind."""

    result: dict[str, Any]
    run: Run
    torque: TorqueLog
    path: Path

    @property
    def played(self) -> list[Any]:
        """Rows of the signal."""
        return [row for row in self.run.ticks if row.mode == "RUNNING"]


def perform(folder: Path, plan: Plan, *sets: str, seed: int = 0, figure: Path | None = None) -> Experiment:
    """Play a plan on the rig in virtual time."""
    sets = (f"sim.directory={folder}", "log.level=error", *sets)
    options = Options(sim=True, sets=sets, seed=seed, speed="max", direct=True)
    path = folder / "run.mcap"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        result = experiment.run(plan, options, Where(file=path), figure)
    return Experiment(result, read_run(path), torque_log.read(folder / "torque.jsonl"), path)


def ends_at_rest(found: Experiment) -> bool:
    """The board's last word is zero torque, and so is the recording's."""
    return found.torque.rows[-1].torque_nm == 0.0 and found.run.ticks[-1].u == 0.0


SHORT: dict[str, Plan] = {
    "prbs": Plan("prbs", 6.0),
    "prbs, slow clock": Plan("prbs", 6.0, 0.03, clock_ticks=5),
    "chirp": Plan("chirp", 6.0),
    "multisine": Plan("multisine", 6.0),
    "steps": Plan("steps", 6.0),
    "decay": Plan("decay", 6.0, rest_s=2.0),
    "centring": Plan("prbs", 6.0, centring_nm_per_rad_s=0.002),
    "around a holding law": Plan("prbs", 6.0, around=Path("controllers/lqg.yaml")),
    "around an identified law": Plan("multisine", 6.0, 0.03, around=Path("controllers/arx.yaml")),
    "no ball": Plan("prbs", 6.0, ball=False),
}


@pytest.mark.parametrize("name", SHORT)
def test_what_is_recorded_is_the_signal_and_replays_to_the_bit(name: str, tmp_path: Path) -> None:
    plan = SHORT[name]
    found = perform(tmp_path, plan)
    assert found.result["outcome"] == "done" and found.result["exit"] == 0 and found.result["faults"] == {}
    assert len(found.played) == 300 and ends_at_rest(found)
    assert replay(found.path)["equal"]
    file = parse_yaml(found.run.header.controller, "header")
    gains = file["gains"]
    assert file["limits"]["torque_nm"] == gains["torque_nm"] == plan.torque_limit_nm  # the law's own, and the limiter's
    u, table = np.array([row.u for row in found.played]), np.array(gains["table_nm"])
    if plan.around is None and not plan.centring_nm_per_rad_s:
        body = slice(50, -25)  # between the soft start and the soft end the torque is the table's
        assert np.array_equal(u[body], table[body])
    assert np.abs(u).max() <= plan.torque_limit_nm and np.abs(u[0]) < 0.2 * np.abs(u).max()
    assert not list(tmp_path.glob(".run.mcap.*"))


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    plans = [Plan("prbs", 2.0, seed=seed) for seed in (3, 3, 4)]
    files = []
    for index, plan in enumerate(plans):
        path = tmp_path / f"{index}.mcap"
        options = Options(sim=True, sets=("log.level=error",), seed=plan.seed, speed="max", direct=True)
        with contextlib.redirect_stderr(io.StringIO()):
            experiment.run(plan, options, Where(file=path))
        files.append(path.read_bytes())
    assert files[0] == files[1] and files[2] != files[0]


def test_without_a_ball_the_hoop_is_alone(tmp_path: Path) -> None:
    """u -> dtheta of the recording is the hoop's own inertia and friction, and the angle is missing."""
    found = perform(tmp_path, Plan("prbs", 10.0, ball=False))
    rows = found.played
    assert all(np.isnan(row.psi) for row in found.run.ticks)
    u, speed = np.array([row.u for row in rows]), np.array([row.dtheta for row in rows])
    # the board samples when it takes a new torque: dtheta[k + 2] - dtheta[k + 1] is what u[k] did
    design = np.stack([u[:-2], speed[1:-1]], axis=1)
    gain, loss = np.linalg.lstsq(design, np.diff(speed)[1:], rcond=None)[0]
    assert gain / 0.02 == pytest.approx(1.0 / 1.518e-3, rel=0.03)
    assert -0.8 < loss / 0.02 < -0.1  # bh / Ih = 0.46 per second


# ------------------------------------------------------------------------------------------------ ways out


def test_a_breach_stops_it_and_says_why(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1, clock_ticks=4, angle_limit_rad=0.3))
    assert found.result["outcome"].startswith("ball angle 0.3") and found.result["exit"] == 1
    assert any("it would end early" in note for note in found.result["notes"])
    told = [e for e in found.run.events if e.event == "law_ended"]
    assert len(told) == 1 and told[0].t == found.result["ended_at_s"] and told[0].level == "warning"
    assert found.torque.max_abs(start=told[0].t + 0.002) <= 0.1 and ends_at_rest(found)
    assert {row.mode for row in found.run.ticks if row.t >= told[0].t} == {"STOPPING", "DISARMED"}
    assert replay(found.path)["equal"]


def at(patch: pytest.MonkeyPatch, t: float, act: Any) -> None:
    """Let something happen at a run time."""
    original = Conductor.put

    def put(self: Conductor, record: Any, inputs: Any) -> None:
        original(self, record, inputs)
        if abs(record.t - t) < 0.01:
            act(self)

    patch.setattr(Conductor, "put", put)


def test_abort_switches_off_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, 3.0, Conductor.abort)
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert found.result["outcome"] == ABORTED and found.result["exit"] == 1
    assert found.torque.zero_for_good_from(3.0) <= 0.03
    assert found.run.ticks[-1].mode == "DISARMED" and found.run.ticks[-1].t < 3.2
    assert replay(found.path)["equal"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_in_order(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at(monkeypatch, 3.0, lambda _: os.kill(os.getpid(), number))
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert found.result["outcome"] == (ABORTED if number == signal.SIGINT else "stopped: by the operator")
    asked = next(event.t for event in found.run.events if event.event == "operator" and event.t > 3.0)
    assert asked < 6.1  # virtual time looks at signals once a second, and takes three looks
    assert found.torque.zero_for_good_from(asked) <= (0.03 if number == signal.SIGINT else 1.1) and ends_at_rest(found)
    assert replay(found.path)["equal"]


FAULTS = {
    "link lost": ("board_silent", "link_lost", 0.2),
    "camera lost": ("camera_stall", "camera_lost", 1.4),
    "ball lost": ("ball_gone", "ball_lost", 0.4),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_end_it(name: str, tmp_path: Path) -> None:
    kind, fault, within_s = FAULTS[name]
    found = perform(tmp_path, Plan("prbs", 10.0, 0.1), f"sim.faults=[{{kind: {kind}, at_s: 3.0, for_s: 2.0}}]")
    assert found.result["outcome"] == f"stopped: {fault}" and found.result["exit"] == 1
    assert found.torque.zero_for_good_from(3.0) <= within_s and ends_at_rest(found)
    assert found.run.ticks[-1].t < 3.0 + within_s + 1.0
    assert replay(found.path)["equal"]


def test_no_ball_where_one_is_expected_never_starts(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("prbs", 2.0), "sim.faults=[{kind: ball_gone, at_s: 0.0}]")
    assert found.result["outcome"] == "not started: ball_missing, ball_lost" and found.result["exit"] == 1
    assert found.torque.max_abs() == 0.0 and found.result["played_s"] == 0.0


def test_a_fault_before_the_signal_ends_it_soon(tmp_path: Path) -> None:
    faults = "sim.faults=[{kind: ball_gone, at_s: 0.0}, {kind: board_silent, at_s: 3.0, for_s: 1.0}]"
    found = perform(tmp_path, Plan("prbs", 2.0), faults)
    assert found.result["outcome"].startswith("not started: link_lost") and found.run.ticks[-1].t < 3.5
    assert found.torque.max_abs() == 0.0


def test_a_watcher_that_fails_leaves_zero_torque(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Conductor) -> None:
        raise RuntimeError("no more")

    at(monkeypatch, 3.0, fail)
    with pytest.raises(RuntimeError, match="no more"):
        perform(tmp_path, Plan("prbs", 10.0, 0.1))
    assert torque_log.read(tmp_path / "torque.jsonl").zero_for_good_from(3.0) <= 0.03
    assert replay(tmp_path / "run.mcap")["equal"] and not list(tmp_path.glob(".run.mcap.*"))


@pytest.mark.parametrize("back", [True, False])
def test_a_disk_that_fails_keeps_what_it_took(back: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    put = recorder.Recorder.put

    def timed(self: recorder.Recorder, record: Any, inputs: Any) -> None:
        now[0] = record.t
        put(self, record, inputs)

    class Disk(io.FileIO):
        def write(self, data: Any) -> int:
            if now[0] >= 3.0 and not (back and now[0] > 4.0):
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data) or 0

    def create(where: Path) -> tuple[Path, Disk]:
        path = where / f"run-{len(list(where.glob('run-*'))) + 1:04d}.mcap"
        return path, Disk(path, "xb")

    monkeypatch.setattr(recorder.Recorder, "put", timed)
    monkeypatch.setattr(recorder, "create", create)
    found = perform(tmp_path, Plan("prbs", 4.0, 0.05))
    assert found.result["outcome"] == "done" and found.torque.rows[-1].torque_nm == 0.0
    assert 2.5 < found.run.ticks[-1].t <= 3.0 and any("was refused by the disk" in n for n in found.result["notes"])
    assert (tmp_path / "run-2.mcap").exists() == back == any("run-2.mcap" in n for n in found.result["notes"])
    assert replay(found.path)["equal"] and not list(tmp_path.glob(".run.mcap.*"))


# ------------------------------------------------------------------------------------------------ defaults


@pytest.mark.parametrize("kind", experiment.KINDS)
def test_defaults_move_the_ball_and_stay_inside(kind: str, tmp_path: Path) -> None:
    """Three seeds here; tools/bench/experiments.py does twenty."""
    for seed in range(3):
        (tmp_path / str(seed)).mkdir()
        plan = Plan(kind, DURATIONS_S.get(kind, DURATION_S), seed=seed)
        result = perform(tmp_path / str(seed), plan, seed=seed).result
        assert result["outcome"] == "done" and result["faults"] == {}
        assert 0.5 < result["largest_ball_angle_rad"] < 1.15 and result["largest_hoop_speed_rad_s"] < 40.0
        assert result["amplitude_nm"] in AMPLITUDES_NM
        assert result["largest_ball_angle_rad"] == pytest.approx(result["foreseen_ball_angle_rad"], abs=0.1)


def test_the_command_line_has_the_same_defaults() -> None:
    given = {name: option.default for name, option in inspect.signature(cli.experiment).parameters.items()}
    names = {"amplitude": "amplitude_nm", "seed": "seed", "clock": "clock_ticks", "low": "low_hz", "high": "high_hz"}
    names |= {"hold": "hold_s", "kick": "kick_s", "rest": "rest_s", "around": "around"}
    names |= {"max_torque": "torque_limit_nm", "max_speed": "speed_limit_rad_s", "max_angle": "angle_limit_rad"}
    names |= {"soft_start": "soft_start_s", "soft_end": "soft_end_s", "centring": "centring_nm_per_rad_s"}
    assert {names[name]: given[name] for name in names} == {
        name: value for name, value in Plan._field_defaults.items() if name not in ("duration_s", "ball")
    }
    assert Plan._field_defaults["duration_s"] == DURATION_S


def test_an_amplitude_too_large_for_the_model_is_told(tmp_path: Path) -> None:
    result = perform(tmp_path, Plan("prbs", 10.0, 0.1, clock_ticks=6)).result
    assert any(note.startswith("little room") for note in result["notes"])


def test_a_law_that_swings_for_late_pictures_is_foreseen_to(tmp_path: Path) -> None:
    """The thesis's PID: calm with fresh pictures, a limit cycle with those of the device."""
    found = perform(tmp_path, Plan("prbs", 4.0, 0.03, around=Path("controllers/pid.yaml"))).result
    foreseen, seen = found["foreseen_ball_angle_rad"], found["largest_ball_angle_rad"]
    assert seen > 0.3 and 0.5 < foreseen / seen < 2.0


def test_a_figure_of_what_was_recorded(tmp_path: Path) -> None:
    perform(tmp_path, Plan("prbs", 2.0), figure=tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"


def test_a_figure_that_cannot_be_written_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise InputError(tmp_path / "run.png", "--figure", "no space left on device")

    monkeypatch.setattr("hoopd.plots.style.save", full)
    result = perform(tmp_path, Plan("prbs", 2.0), figure=tmp_path / "run.png").result
    assert result["exit"] == 0 and any("no space left" in note for note in result["notes"])


def test_a_holding_law_brings_its_model(tmp_path: Path) -> None:
    """The filter believes the model that the holding law was designed on, and a recording repeats that."""
    shipped = (ROOT / "config/controllers/lqg.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(shipped.replace("models/hoop.yaml", "models/thesis.yaml"))
    found = perform(tmp_path, Plan("prbs", 2.0, 0.03, around=tmp_path / "mine.yaml"))
    assert found.result["next"].endswith(" --method prediction --out model.yaml")
    assert found.run.header.model == (ROOT / "config/models/thesis.yaml").read_text() and replay(found.path)["equal"]


def test_a_kick_by_hand_without_any_torque(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("decay", 6.0, 0.0, rest_s=2.0), "sim.psi_rad=0.6", "sim.held=false")
    assert found.result["outcome"] == "done" and found.result["largest_torque_nm"] == 0.0
    assert found.result["crest_factor"] is None and found.result["coverage_hz"] == [None, None]
    assert found.torque.max_abs(stop=found.result["ended_at_s"]) == 0.0


def test_the_page_shows_a_file_that_the_daemon_plays(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "experiment.md").read_text()
    (tmp_path / "my.yaml").write_text(page.split("```yaml\n", 1)[1].split("```", 1)[0])
    sets = ("--set", f"control.file={tmp_path / 'my.yaml'}", "--set", "sim.psi_rad=0")
    code, _, errors = call((*LOCKSTEP[:-1], "3", "--record", str(tmp_path), *sets))
    assert code == 0, errors
    played = [row.u for row in read_run(tmp_path / "run-0001.mcap").ticks if row.mode == "RUNNING"]
    assert played == [0.05, 0.05, -0.05, -0.05]


# ------------------------------------------------------------------------------------------------ the command line

LOCKSTEP = ("--sim", "--speed", "max", "--camera", "direct", "--duration", "2")
BAD: dict[str, tuple[tuple[str, ...], str]] = {
    "unknown kind": (("noise", *LOCKSTEP), "unknown kind 'noise'; known: prbs, chirp"),
    "too much torque": (("prbs", *LOCKSTEP, "--amplitude", "0.4"), "--amplitude: 0.4 N m is outside 0 to the limit"),
    "torque that is none": (("prbs", *LOCKSTEP, "--amplitude", "nan"), "--amplitude: nan N m is outside"),
    "speed beyond the fault's": (("prbs", *LOCKSTEP, "--max-speed", "60"), "--max-speed: 60 rad/s must be below"),
    "endless speed": (("prbs", *LOCKSTEP, "--max-speed", "nan"), "--max-speed"),
    "no band": (("chirp", *LOCKSTEP, "--low", "5", "--high", "1"), "experiment chirp: needs 0 < low < high"),
    "band of nothing": (("multisine", *LOCKSTEP, "--low", "0.6", "--high", "0.9"), "experiment multisine: no line"),
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
        "kind: an excitation",
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
    page = (ROOT / "docs" / "experiment.md").read_text()
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
    one_line(*call(("experiment", *(word.replace("FOLDER", str(tmp_path)) for word in arguments))), expected)
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


def test_the_daemon_without_a_ball_refuses_laws_that_need_one() -> None:
    arguments = ("--sim", "--speed", "max", "--duration", "1", "--set", "faults.ball_expected=false")
    one_line(*call(arguments), "faults.ball_expected: false, but lqg acts on the ball")


def test_a_table_without_a_limit_of_the_ball_is_refused_where_a_ball_is_expected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "experiment.md").read_text()
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
    page = (ROOT / "docs" / "experiment.md").read_text()
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


@pytest.mark.realtime
@pytest.mark.parametrize("key", [b"q", b" ", b"\x03"])
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
