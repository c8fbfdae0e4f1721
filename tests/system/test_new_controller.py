"""A new controller in a running daemon: in lock-step on the rig, and every recording replays to the bit."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from harness.runs import TORQUE_LIMIT_NM, Run, run, serve_late

from hoopd.core.records import CameraSample, DriverSample
from hoopd.daemon.build import Prepared, build_tick, filter_of, make_controller, read_texts
from hoopd.daemon.loading import ControllerLoader
from hoopd.daemon.preparation import prepared_filter
from hoopd.daemon.replay import replay
from hoopd.files.controller import load_controller
from hoopd.files.loaded_controller import parse_loaded
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.shell.config import Config, load

SHIPPED = defaults_folder() / "controllers"


class Folder:
    """A daemon's folder of controllers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.mkdir()

    def key(self, name: str, digits: int = 16) -> str:
        return f"{name}@{hashlib.sha256((self.path / name).read_bytes()).hexdigest()[:digits]}"

    def copied(self, name: str) -> str:
        """Key of a shipped one."""
        (self.path / name).write_bytes((SHIPPED / name).read_bytes())
        return self.key(name)

    def changed(self, name: str, *, of: str = "lqg.yaml", **changes: Any) -> str:
        """Key of a shipped one with other values: `gains__k_psi` is a key within a key."""
        content = yaml.safe_load((SHIPPED / of).read_text())
        for key, value in changes.items():
            *way, last = key.split("__")
            place = content
            for part in way:
                place = place[part]
            place[last] = value
        (self.path / name).write_text(yaml.safe_dump(content))
        return self.key(name)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "controllers")


def played(tmp_path: Path, folder: Folder, *commands: tuple[Any, ...], duration_s: float = 6.0, **sim: Any) -> Run:
    """A run with commands (s, name, key or value), judged for what holds of every run."""
    rows = [
        {"at_s": at_s, "name": name, **({"value": rest} if isinstance(rest, float) else {"key": rest})}
        for at_s, name, rest in commands
    ]
    done = run(
        tmp_path / "run", config={"control": {"folder": str(folder.path)}}, commands=rows, duration_s=duration_s, **sim
    )
    result = replay(done.recordings[0])
    assert result["equal"] and result["ticks"] == len(done.ticks), result["first_difference"]
    assert done.torque.max_abs() <= TORQUE_LIMIT_NM
    assert not done.torque.rows[-1].enabled
    return done


def told(done: Run, event: str) -> list[tuple[float, dict[str, Any]]]:
    return [(round(one.t, 6), dict(one.fields)) for one in done.events if one.event == event]


def largest_step(done: Run, start: float, stop: float) -> float:
    """Largest change of the torque from one tick to the next, N m."""
    u = [tick.u for tick in done.ticks if start <= tick.t < stop]
    return max(abs(b - a) for a, b in itertools.pairwise(u))


def test_other_gains_take_over_without_a_bump_and_hold_the_ball(tmp_path: Path, folder: Folder) -> None:
    stiffer = folder.changed("stiffer.yaml", gains__k_psi=0.2, gains__k_dpsi=0.055)
    done = played(
        tmp_path,
        folder,
        (2.0, "reference", 0.1),
        (2.6, "controller", stiffer),
        (4.0, "controller", folder.copied("arx.yaml")),
    )
    (first, fields), (second, _) = told(done, "controller")
    assert (first, fields["file"]) == (2.6, "stiffer.yaml") and second == pytest.approx(4.5)
    assert fields["sha256"].startswith(stiffer.partition("@")[2])
    usual = largest_step(done, 2.3, 2.6)
    assert largest_step(done, 2.58, 2.9) <= 1.5 * usual
    assert largest_step(done, 4.4, 5.0) < 0.03
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 5.9} == {"RUNNING"}
    error = [tick.x_hat[2] - tick.reference for tick in done.ticks if 3.5 < tick.t < 4.0]
    assert max(map(abs, error)) < 0.02


def test_what_was_loaded_stands_in_the_recorded_inputs(tmp_path: Path, folder: Folder) -> None:
    key = folder.changed("other.yaml", gains__k_psi=0.15)
    done = played(tmp_path, folder, (2.0, "controller", key), duration_s=3.0)
    (command,) = (one for inputs in done.inputs for one in inputs.commands if one.name == "controller")
    loaded = parse_loaded(command.text)
    assert loaded.controller.gains["k_psi"] == 0.15 and loaded.file == "other.yaml"
    assert loaded.sha256 == hashlib.sha256((folder.path / "other.yaml").read_bytes()).hexdigest()
    assert str(tmp_path) not in command.text and "/" not in command.text.partition('"model"')[0]


def test_a_controller_that_was_loaded_disarmed_is_the_one_that_was_started_with(tmp_path: Path, folder: Folder) -> None:
    """From its first tick with torque on: the same run as of a daemon that began with it."""
    key = folder.changed("other.yaml", gains__k_psi=0.15)
    loaded = played(tmp_path, folder, (0.5, "controller", key), duration_s=3.0)
    started = run(tmp_path / "started", config={"control": {"file": str(folder.path / "other.yaml")}}, duration_s=3.0)
    assert [tick.u for tick in loaded.ticks] == [tick.u for tick in started.ticks]
    assert any(tick.u for tick in loaded.ticks)


def test_a_law_comes_back_after_a_narrower_one_within_the_limits_of_the_start(tmp_path: Path, folder: Folder) -> None:
    """A file that asks for more than the configuration lets it is held by that, as at the start."""
    narrow = folder.changed("narrow.yaml", limits__torque_nm=0.02)
    told_by_hand = [(1.5, "controller", narrow), (2.5, "controller", folder.copied("lqg.yaml"))]
    rows: list[dict[str, Any]] = [{"at_s": at_s, "name": name, "key": key} for at_s, name, key in told_by_hand]
    rows += [{"at_s": at_s, "name": "reference", "value": value} for at_s, value in ((2.0, 0.2), (3.0, -0.2))]
    config = {"control": {"folder": str(folder.path)}, "limits": {"torque_nm": 0.05}}
    done = run(tmp_path / "run", config=config, commands=rows, duration_s=4.0)
    assert [fields["file"] for _, fields in told(done, "controller")] == ["narrow.yaml", "lqg.yaml"]
    assert max(abs(tick.u) for tick in done.ticks if 1.52 <= tick.t < 2.5) == 0.02
    assert max(abs(tick.u) for tick in done.ticks if tick.t > 2.6) == 0.05
    assert done.torque.max_abs() == pytest.approx(0.05)
    assert replay(done.recordings[0])["equal"]


def configured(folder: Folder) -> tuple[ControllerLoader, Config]:
    config = load(None, sim=True, overrides=[f"control.folder={folder.path}"])
    return ControllerLoader(config, None), config


UNUSABLE: dict[str, tuple[dict[str, Any], str]] = {
    "another tick": ({"sample_time_s": 0.01}, "sample_time_s: designed for 0.01 s, the loop's period is 0.02 s"),
    "an unknown key": ({"colour": "red"}, "colour: unknown key"),
    "another plant": ({"plant": "tanks"}, "the daemon runs the hoop alone"),
    "a gain that is none": ({"gains__k_psi": "much"}, "gains"),
    "a model that is not there": ({"model": "none.yaml"}, "model: none.yaml: no such file"),
    "a model elsewhere": ({"model": "../../secret/none.yaml"}, "model: none.yaml: no such file"),
    "a torque beyond every limit": ({"limits__torque_nm": 5.0}, "limits.torque_nm"),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(name: str, folder: Folder) -> None:
    changes, says = UNUSABLE[name]
    loader, _ = configured(folder)
    with pytest.raises(InputError, match=says.replace(".", r"\.")) as caught:
        loader.load(folder.changed("bad.yaml", **changes), "a test")
    assert str(caught.value).startswith("bad.yaml: ") and "\n" not in str(caught.value)


def test_of_the_same_model_a_law_is_made_from_numbers_alone(folder: Folder) -> None:
    """Nothing of the filter is built again, and the numbers are the file's to the bit."""
    loader, config = configured(folder)
    running = build_tick(config, read_texts(config, None)).succession.acting.filter
    for name in ("lqg.yaml", "arx.yaml", "pid.yaml"):
        text = loader.load(folder.copied(name), "a test")
        assert make_controller(config, 0.7, {}, text, running).filter is running
        assert parse_loaded(text).controller == load_controller(SHIPPED / name)


# ------------------------------------------------------------------------------------------ trials and experiments


def test_a_law_that_lets_the_ball_go_is_taken_back_before_it_is_lost(tmp_path: Path, folder: Folder) -> None:
    bad = folder.changed("bad.yaml", gains__k_psi=-0.05, gains__k_dpsi=-0.02)
    done = played(tmp_path, folder, (5.0, "trial", bad), (7.5, "alive", ""), (2.0, "reference", 0.05), duration_s=11.0)
    ((_, fields),) = told(done, "trial_returned")
    assert fields["reason"].startswith("cost ") and fields["back_to"] == "lqg.yaml"
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 10.9} == {"RUNNING"}
    assert max(abs(tick.x_hat[2]) for tick in done.ticks if tick.t > 5.0) < 0.5
    assert max(abs(tick.x_hat[2] - 0.05) for tick in done.ticks if 10.5 < tick.t < 10.9) < 0.05


def test_a_test_signal_plays_and_ends_by_itself(tmp_path: Path, folder: Folder) -> None:
    holding = yaml.safe_load((SHIPPED / "lqg.yaml").read_text())["gains"]
    gains = {
        "table_nm": [0.03, 0.03, -0.03, -0.03] * 25,
        "torque_nm": 0.3,
        "hoop_speed_rad_s": 50.0,
        "ball_angle_rad": 0.4,
        "around": {"kind": "lqg", "gains": holding},
    }
    done = played(tmp_path, folder, (3.0, "experiment", folder.changed("signal.yaml", kind="excitation", gains=gains)))
    ((ended, fields),) = told(done, "experiment_ended")
    assert ended == pytest.approx(5.02) and fields["reason"] == "done" and fields["back_to"] == "lqg.yaml"
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 5.9} == {"RUNNING"}
    played_u = np.array([tick.u for tick in done.ticks if 3.02 <= tick.t < 5.0])
    assert 0.02 < np.abs(played_u).mean() < 0.05


# ------------------------------------------------------------------------------------------ another model


def modelled(folder: Folder, name: str, inertia: str) -> str:
    """Key of a controller on a model whose hoop has another inertia."""
    model = (defaults_folder() / "models" / "hoop.yaml").read_text()
    (folder.path / f"model_{name}").write_text(model.replace("1.518e-3", inertia))
    return folder.changed(name, model=f"model_{name}")


MOVING = tuple((2.0 + 0.5 * k, "reference", 0.1 if k % 2 else -0.05) for k in range(6))


def test_another_model_takes_over_while_the_ball_is_held_when_it_fits(tmp_path: Path, folder: Folder) -> None:
    done = played(tmp_path, folder, *MOVING, (2.2, "controller", modelled(folder, "near.yaml", "1.54e-3")))
    ((at, fields),) = told(done, "controller")
    assert at == pytest.approx(4.2, abs=0.021) and fields["file"] == "near.yaml"
    usual = largest_step(done, 3.6, 4.1)
    assert largest_step(done, 4.14, 4.4) <= usual
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 5.9} == {"RUNNING"}


def test_a_model_that_does_not_fit_is_refused_and_control_goes_on(tmp_path: Path, folder: Folder) -> None:
    done = played(tmp_path, folder, *MOVING, (2.2, "controller", modelled(folder, "far.yaml", "3.0e-3")))
    ((at, fields),) = told(done, "command_refused")
    assert at == pytest.approx(4.2, abs=0.021)
    assert fields["reason"].startswith("the model does not fit: innovations of ")
    assert told(done, "controller") == []
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 5.9} == {"RUNNING"}


def test_a_trial_on_another_model_goes_back_to_both_law_and_filter(tmp_path: Path, folder: Folder) -> None:
    near = modelled(folder, "near.yaml", "1.54e-3")
    done = played(tmp_path, folder, (2.0, "reference", 0.05), (4.2, "trial", near), (7.5, "revert", ""), duration_s=9.0)
    ((at, fields),) = told(done, "trial_returned")
    assert (at, fields["reason"], fields["back_to"]) == (7.5, "reverted", "lqg.yaml")
    assert largest_step(done, 6.0, 8.9) < 0.01
    assert {tick.mode for tick in done.ticks if 1.1 < tick.t < 8.9} == {"RUNNING"}


FRICTION_NM = 0.006
# What `hoopd design lqg` tells of a hoop with it.
LEVELS = {"theta": [0.965, 0.8], "dtheta": [0.0543, 0.022], "psi": [0.229, 0.163]}


def with_friction(folder: Folder, name: str, friction_nm: float) -> str:
    """Key of the shipped law on a model with dry friction."""
    model = (defaults_folder() / "models" / "hoop.yaml").read_text().replace("effects: []", "")
    entry = f"{{name: hoop.coulomb_friction, parameters: {{Fc: {{value: {friction_nm}, unit: N m}}}}}}"
    (folder.path / f"model_{name}").write_text(f"{model}\neffects: [{entry}]\n")
    return folder.changed(name, model=f"model_{name}", estimator__innovations=LEVELS)


def jitter(most_s: float, seed: int) -> Callable[[int], float]:
    """How late the ticks of a busy machine are."""
    late = np.random.default_rng(seed).exponential(most_s / 4, 4096)
    return lambda k: min(most_s, float(late[k % len(late)]))


@pytest.mark.proof
def test_a_model_with_the_friction_that_is_there_takes_over_whatever_the_ticks_jitter(
    tmp_path: Path, folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hoop rests, held by friction: how surprising its readings are must not follow the length of a tick."""
    serve_late(monkeypatch, late=jitter(0.004, 1), slow=jitter(0.003, 2))
    right, wrong = (with_friction(folder, name, nm) for name, nm in (("right.yaml", FRICTION_NM), ("wrong.yaml", 0.0)))
    swings = [(1.5 + 0.5 * k, "reference", 0.0 if k % 2 else 0.1) for k in range(4)]
    tries = [one for k in range(6) for one in ((6.5 + 6 * k, "trial", right), (8.8 + 6 * k, "revert", ""))]
    moved = [(43.0, "reference", 0.1), (44.0, "reference", -0.1)]
    effects = [{"name": "hoop.coulomb_friction", "parameters": {"Fc": FRICTION_NM}}]
    done = played(tmp_path, folder, *swings, *tries, *moved, (42.5, "trial", wrong), duration_s=45.5, effects=effects)
    assert [fields["file"] for _, fields in told(done, "controller")] == ["right.yaml"] * 6
    ((_, fields),) = told(done, "command_refused")
    assert fields["reason"].startswith("the model does not fit: innovations of ")


EFFECTS = (
    "effects: [{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.004, unit: N m}}}, "
    "{name: camera.angle_offset, parameters: {d: {value: 0.01, unit: rad}}}, "
    "{name: camera.latency, parameters: {d: {value: 0.02, unit: s}}}]"
)


@pytest.mark.parametrize("effects", ["effects: []", EFFECTS])
def test_a_filter_made_ready_elsewhere_has_the_same_bits(effects: str, folder: Folder) -> None:
    loader, config = configured(folder)
    model = (defaults_folder() / "models" / "hoop.yaml").read_text().replace("effects: []", effects)
    (folder.path / "found.yaml").write_text(model)
    text = loader.load(folder.changed("mine.yaml", model="found.yaml"), "a test")
    loaded = parse_loaded(text)
    there, here = prepared_filter(config, text, 0.7), filter_of(config, loaded.model, loaded.controller, 0.7)
    assert (there.levels, there.ball, there.hoop, there.key) == (here.levels, here.ball, here.hoop, here.key)
    assert bool(here.feedforward.parts) == (effects == EFFECTS)
    noise = np.random.default_rng(1).standard_normal((200, 4))
    for k, (a, b, c, u) in enumerate(0.05 * noise):
        t = 1.0 + 0.02 * k
        driver = DriverSample(t - 0.01, 0, 1, 0, a, b, 0.0, 0)
        camera = CameraSample(k, t - 0.05, t, c, 1.0, 0.0, 0.0) if k % 3 else None
        x, y = (one.estimator.update(t, u, t - 0.019, driver, camera, held=False) for one in (there, here))
        assert x.x.tobytes() == y.x.tobytes() and repr(x.surprise) == repr(y.surprise)
        assert there.feedforward.demand(x.x, u) == here.feedforward.demand(y.x, u)


def test_a_daemon_in_real_time_makes_all_ready_before_the_text_enters(folder: Folder) -> None:
    config = load(None, sim=True, overrides=[f"control.folder={folder.path}"])
    prepared: Prepared = {}
    tick = build_tick(config, read_texts(config, None), prepared)
    running = tick.succession.acting.filter
    loader = ControllerLoader(config, None, tick, prepared)
    same = loader.load(folder.copied("arx.yaml"), "a test")
    assert list(prepared) == [same] and prepared[same].filter is None
    assert make_controller(config, 0.7, prepared, same, running).filter is running and not prepared
    other = loader.load(modelled(folder, "far.yaml", "3.0e-3"), "a test")
    ready = prepared[other].filter
    assert ready is not None and make_controller(config, 0.7, prepared, other, running).filter is ready


@pytest.mark.parametrize("who", ["acting", "accepted"])
def test_a_trial_that_ends_meanwhile_leaves_no_filter_to_be_made_in_the_tick(who: str, folder: Folder) -> None:
    config = load(None, sim=True, overrides=[f"control.folder={folder.path}"])
    prepared: Prepared = {}
    tick = build_tick(config, read_texts(config, None), prepared)
    first, other = tick.succession.accepted, modelled(folder, "far.yaml", "3.0e-3")
    trial = make_controller(config, 0.7, {}, ControllerLoader(config, None).load(other, "a test"), first.filter)
    tick.succession.acting = trial
    wanted = other if who == "acting" else folder.copied("arx.yaml")
    text = ControllerLoader(config, None, tick, prepared).load(wanted, "a test")
    assert prepared[text].filter is not None  # for the other one of the two
    there = first if who == "acting" else trial
    ready = prepared[text].filter
    assert make_controller(config, 0.7, prepared, text, there.filter).filter is ready


def test_disarmed_another_model_is_the_one_of_a_daemon_that_began_with_it(tmp_path: Path, folder: Folder) -> None:
    key = modelled(folder, "far.yaml", "2.0e-3")
    loaded = played(tmp_path, folder, (0.3, "controller", key), duration_s=3.0)
    assert [fields["file"] for _, fields in told(loaded, "controller")] == ["far.yaml"]
    file = str(folder.path / "far.yaml")
    started = run(tmp_path / "started", config={"control": {"file": file}}, duration_s=3.0)
    # the filter begins 0.3 s later, with the same pictures from then on: the same ball
    pairs = [(a.x_hat[2], b.x_hat[2]) for a, b in zip(loaded.ticks, started.ticks, strict=False) if a.t > 1.0]
    assert max(abs(a - b) for a, b in pairs) < 0.01 and any(tick.u for tick in loaded.ticks)
