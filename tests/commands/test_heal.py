"""`hoopd heal`: versions are listed, decided and restored; what cannot be meant is one line."""

from __future__ import annotations

import queue
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from inprocess import call

from hoopd import lab
from hoopd.commands import heal_watch, operator
from hoopd.daemon.build import build_tick, read_texts
from hoopd.daemon.report import controller_status
from hoopd.dashboard import turns
from hoopd.dashboard.work.controllers import Controllers
from hoopd.files.controller import parse_controller
from hoopd.files.controller_folder import key_of
from hoopd.files.folder_lock import alone_in
from hoopd.files.heal_versions import VersionFolder
from hoopd.files.loaded_controller import filter_key
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.heal import healing, resumption, version_copies
from hoopd.heal.plan import HealPlan
from hoopd.heal.version_copies import lay_copies
from hoopd.shell.config import load


def kept(folder: Path) -> VersionFolder:
    """A loop as it was found, one version that is proposed, and one that was left."""
    versions = VersionFolder(folder)
    versions.begin("hoop")
    versions.first("lqg.yaml@" + "0" * 64, "law", "model", 0.0, "ann")
    for state, reason in (("proposed", "new: hoop.coulomb_friction"), ("left", "camera.outliers")):
        version = versions.add(60.0, kind="physics", reason=reason, key="heal-1.yaml@" + "1" * 64)
        (versions.of(version.number) / "model.yaml").write_text("a: 1\n")
        version.sha256 = versions.hashes(version.number)
        version.state = state  # type: ignore[assignment]
        versions.keep(version, 61.0, state)
    return versions


def told(words: list[str], folder: Path) -> dict[str, Any]:
    """What an action writes."""
    path = folder.parent / "told.json"
    code, _, errors = call(["heal", *words, "--out", str(folder), "--json", str(path)])
    assert code == 0, errors
    result: dict[str, Any] = msgspec.json.decode(path.read_bytes())
    return result


def test_versions_are_listed_and_shown_with_what_happened_to_them(tmp_path: Path) -> None:
    folder = kept(tmp_path / "healed").folder
    listed = told(["list"], folder)
    assert listed["acting"] == "0000" and listed["watched"] is False
    assert [row["state"] for row in listed["versions"].values()] == ["accepted", "proposed", "left"]
    shown = told(["show", "1"], folder)
    assert shown["history"] == [[60.0, "begun"], [61.0, "proposed"]] and shown["sha256"]["model.yaml"]


def test_a_person_s_word_lies_beside_the_version_until_somebody_watches(tmp_path: Path) -> None:
    versions = kept(tmp_path / "healed")
    assert "no hoopd heal runs here" in told(["accept", "1"], versions.folder)["says"]
    decision = versions.decision(1)
    assert decision is not None and decision.accept
    code, _, errors = call(["heal", "accept", "2", "--out", str(versions.folder)])
    assert code == 2 and errors.endswith("healed: 2: is left, not proposed\n")


def test_any_version_that_acted_is_restored_by_one_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    versions, asked = kept(tmp_path / "healed"), list[dict[str, Any]]()
    versions.acts(1)
    devices: list[str] = []

    def ask(request: dict[str, str], config: object, sets: tuple[str, ...]) -> dict[str, str]:
        asked.append(request)
        devices.append(sets[-1])
        return {"mode": "RUNNING"}

    monkeypatch.setattr(operator, "ask", ask)
    assert told(["restore", "0"], versions.folder)["says"] == "version 0 acts"
    assert devices == [f"device.name={versions.loop().device}"]  # no other daemon's loop
    assert asked == [{"command": "controller", "key": "lqg.yaml@" + "0" * 64}] and versions.loop().acting == 0
    code, _, errors = call(["heal", "restore", "2", "--out", str(versions.folder)])
    assert code == 2 and "2: never acted (it is left)" in errors
    (versions.of(0) / "model.yaml").write_text("another")
    code, _, errors = call(["heal", "restore", "0", "--out", str(versions.folder)])
    assert code == 2 and "was changed after it was proposed" in errors and len(asked) == 1


LAW, MODEL = (
    "schema: hoopd.controller/1\nmodel: models/hoop.yaml  # ours\nkind: lqg\n",
    "schema: hoopd.model/1\nIh: 1\n",
)


def controllers_with(folder: Path, law: str = LAW, model: str = MODEL) -> Controllers:
    """A daemon's folder of controllers."""
    (folder / "models").mkdir(parents=True, exist_ok=True)
    (folder / "lqg.yaml").write_text(law)
    (folder / "models" / "hoop.yaml").write_text(model)
    return Controllers(folder)


def found(folder: Path, controllers: Controllers, law: str = LAW) -> VersionFolder:
    """A loop as it was found, with a copy of its own in the daemon's folder."""
    versions = VersionFolder(folder)
    versions.begin("hoop")
    versions.takes_controllers_from(controllers.folder)
    versions.first(key_of(controllers.folder / "lqg.yaml"), law, MODEL, 0.0, "ann")
    lay_copies(versions, controllers.lay_in_with, print)
    return versions


def test_what_was_found_comes_back_with_its_model_whatever_became_of_a_person_s_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controllers = controllers_with(tmp_path / "controllers")
    versions, asked = found(tmp_path / "healed", controllers), list[dict[str, str]]()

    def ask(request: dict[str, str], *_: object) -> dict[str, str]:
        asked.append(request)
        return {"mode": "READY"}

    monkeypatch.setattr(operator, "ask", ask)
    controllers_with(controllers.folder, LAW + "k: 1\n", MODEL + "bb: 2\n")  # designed and fitted anew
    assert told(["restore", "0"], versions.folder)["says"] == "version 0 acts"
    name = versions.copy_name(0)
    assert asked[0]["key"] == key_of(controllers.folder / f"{name}.yaml") == versions.read(0).copy
    assert (controllers.folder / f"{name}.yaml").read_text() == LAW.replace("models/hoop.yaml", f"{name}-model.yaml")
    assert (controllers.folder / f"{name}-model.yaml").read_text() == MODEL
    (controllers.folder / f"{name}.yaml").unlink()  # somebody cleared up: it is laid in anew
    told(["restore", "0"], versions.folder)
    assert asked[1] == asked[0] and (controllers.folder / f"{name}.yaml").exists()
    (controllers.folder / f"{name}-model.yaml").write_text("another")
    code, _, errors = call(["heal", "restore", "0", "--out", str(versions.folder)])
    assert code == 2 and "another file of that name is in the daemon's folder already" in errors
    assert len(asked) == 2 and (controllers.folder / "lqg.yaml").read_text() == LAW + "k: 1\n"


def test_a_version_is_known_by_the_filter_that_the_daemon_has_and_not_by_the_model_on_disk(tmp_path: Path) -> None:
    law = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
    before, now = (filter_key(one, parse_controller(law, "lqg.yaml")) for one in (MODEL, MODEL + "bb: 2\n"))
    controllers = controllers_with(tmp_path / "controllers", law)
    versions = found(tmp_path / "healed", controllers, law)
    key, copy = versions.read(0).key, versions.read(0).copy
    fitted = resumption.LoopFiles(law, MODEL + "bb: 2\n")

    def noted(key: str, told: str) -> int | None:
        version = resumption.note_what_acts(versions, key, 5.0, "ann", lambda: fitted, told)
        return None if version is None else version.number

    assert noted(key, before) is noted(copy, before) is noted(key, "") is None  # which an older daemon does not tell
    with pytest.raises(InputError, match=r"lqg\.yaml: model: is another one now than the daemon's"):
        noted(key, "0" * 64)
    assert noted(key, now) == versions.loop().acting == 1
    assert (versions.of(1) / "model.yaml").read_text() == fitted.model
    lay_copies(versions, controllers.lay_in_with, print)
    assert versions.read(1).copy not in ("", copy)  # beside the other one: the same law with another model
    assert noted(key, before) is None and versions.loop().acting == 0


def test_a_daemon_tells_which_filter_it_has() -> None:
    config = load(None, sim=True, overrides=["camera.backend=direct"])
    texts = read_texts(config, None)
    told = controller_status(build_tick(config, texts).succession)
    device: Any = SimpleNamespace(status={"controller": told})
    assert heal_watch._filter(device) == filter_key(texts.model, parse_controller(texts.controller, "lqg.yaml"))
    device.status = {"controller": {"purpose": "controller"}}  # of an older daemon
    assert heal_watch._filter(device) == ""


def test_a_controller_that_is_no_longer_there_is_known_by_its_key(tmp_path: Path) -> None:
    versions = found(tmp_path / "healed", controllers_with(tmp_path / "controllers"))

    def gone() -> resumption.LoopFiles:
        raise InputError("lqg.yaml", "", "its hash is another")

    assert resumption.note_what_acts(versions, versions.read(0).key, 5.0, "ann", gone) is None
    with pytest.raises(InputError, match="its hash is another"):
        resumption.note_what_acts(versions, "mine.yaml@" + "f" * 64, 5.0, "ann", gone)


def test_a_version_of_which_no_copy_can_be_laid_is_told_and_keeps_its_key(tmp_path: Path) -> None:
    controllers, said = controllers_with(tmp_path / "controllers"), list[str]()
    versions = kept(tmp_path / "healed")  # whose controller is no controller
    lay_copies(versions, controllers.lay_in_with, said.append)
    assert len(said) == 1 and "model: expected on a line of its own" in said[0]
    assert versions.read(0).keys == ("lqg.yaml@" + "0" * 64,)


@pytest.mark.parametrize(
    ("policy", "line"),
    [
        ("effects: [hoop.*]", "policy.yaml: Object missing required field `schema`"),
        ("schema: hoopd.policy/1\nefects: [hoop.*]", "policy.yaml: efects: unknown key; did you mean effects?"),
        ("schema: hoopd.policy/1\neffects: [friction]", "policy.yaml: effects[0]: 'friction' is no SLOT.EFFECT"),
        ("schema: hoopd.policy/1\nparameter_change: -1", "policy.yaml: parameter_change: "),
        ("schema: hoopd.policy/1\nlargest: {Fc: -0.1}", "policy.yaml: largest.Fc: expected SLOT.EFFECT.PARAMETER"),
        ("schema: hoopd.policy/1\npause_s: 5 N m", "policy.yaml: pause_s: "),
        ("schema: hoopd.policy/1\neffects: [hoop.nosuch]", "policy.yaml: effects[0]: no effect is called hoop.nosuch"),
        (
            "schema: hoopd.policy/1\nlargest: {hoop.coulomb_friction.FC: 0.02}",
            "policy.yaml: largest.hoop.coulomb_friction.FC: no effect or parameter is called so",
        ),
    ],
)
def test_a_policy_that_cannot_be_meant_is_one_line(policy: str, line: str, tmp_path: Path) -> None:
    (tmp_path / "policy.yaml").write_text(policy)
    words = ["heal", "--policy", str(tmp_path / "policy.yaml"), "--out", str(tmp_path / "healed")]
    code, _, errors = call(words)
    assert code == 2 and line in errors and errors.count("\n") == 1
    assert not (tmp_path / "healed").exists()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "hoopd: --recordings: the folder into which the daemon records (hoopd --record FOLDER)"),
        (["--recordings", "/nowhere"], "hoopd: /nowhere: --recordings: no such folder"),
        (["watch", "3"], "hoopd: watch: 3: takes no number"),
        (["--by", "luck"], "hoopd: --by: 'luck' is none of ball, cost"),
        (["mend"], "hoopd: ACTION: mend: unknown; known: watch, list, show, accept, leave, restore"),
        (["list"], "holds no versions: hoopd heal has not been here"),
        (["accept", "one"], "holds no versions"),
    ],
)
def test_what_cannot_be_begun_is_one_line(words: list[str], line: str, tmp_path: Path) -> None:
    code, _, errors = call(["heal", *words, "--out", str(tmp_path / "healed")])
    assert code == 2 and line in errors and errors.count("\n") == 1


def test_two_that_follow_one_daemon_are_one_too_many(tmp_path: Path) -> None:
    """Whatever folders of versions they have: each would take the other's controllers for a person's."""
    controllers = tmp_path / "controllers"
    controllers.mkdir()
    words = ["heal", "--recordings", str(tmp_path), "--controllers", str(controllers)]
    with alone_in(controllers, f"{heal_watch.HEALED}hoop", "taken"):
        code, _, errors = call([*words, "--out", str(tmp_path / "second")])
    assert code == 2
    assert errors == f"hoopd: {controllers}: --controllers: another hoopd heal follows hoop\n"
    assert not (tmp_path / "second").exists()


def test_a_daemon_in_fault_is_told_once_with_its_rows(capsys: pytest.CaptureFixture[str]) -> None:
    followed: Any = SimpleNamespace(_mode="", _device=SimpleNamespace(identity="hoop@here"))
    for mode, words in (
        ("RUNNING", "RUNNING"), ("FAULT", "FAULT (encoder.frozen)"), ("FAULT", "FAULT"), ("READY", "READY")
    ):  # fmt: skip
        followed._device.mode, followed._device.mode_words = mode, words
        heal_watch._FollowedDaemon._tell_mode(followed)
    assert capsys.readouterr().out.splitlines() == [
        "hoop@here is in FAULT (encoder.frozen): nothing is learned until it controls again",
        "hoop@here is READY",
    ]


def test_what_is_computed_has_ended_before_another_run_of_the_daemon_is_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that compute one version would write the same files."""
    ended: list[str] = []
    wanted: queue.Queue[object] = queue.Queue()

    def computes(_: object) -> None:
        wanted.get()
        time.sleep(0.2)
        ended.append("diagnosis")

    monkeypatch.setattr(turns, "ComparisonSupervisor", lambda *_: SimpleNamespace(start=int, alive=False, error=None))
    monkeypatch.setattr(healing, "Healing", lambda *_: SimpleNamespace(why="the daemon was started again"))
    monkeypatch.setattr(resumption, "note_what_acts", lambda *_: None)
    monkeypatch.setattr(version_copies, "lay_copies", lambda *_: None)
    device = SimpleNamespace(identity="hoop@here", run="one", status={})
    followed: Any = SimpleNamespace(
        _folder=kept(tmp_path / "healed"), _device=device, _files=None, _wanted=wanted, _worker=lambda plan: None,
        _work=computes, _send=None, _attend=None, _controllers=SimpleNamespace(lay_in_with=None),
    )  # fmt: skip
    heal_watch._FollowedDaemon.follow(followed, HealPlan(), None)
    assert ended == ["diagnosis"]


def test_python_has_the_versions_and_decides_by_the_same_rules(tmp_path: Path) -> None:
    folder = kept(tmp_path / "healed")
    loop = lab.heal(folder.folder)
    assert loop.acting == 0 and loop.waiting == [1] and not loop.is_followed
    assert [one.state for one in loop.versions] == ["accepted", "proposed", "left"]
    with pytest.raises(ValueError, match="2: is left, not proposed"):
        loop.accept(2)
    loop.leave(1)
    decision = folder.decision(1)
    assert loop.waiting == [] and decision is not None and not decision.accept
    with pytest.raises(ValueError, match="this version has none"):
        loop.controller(1)
    with pytest.raises(ValueError, match="holds no versions"):
        lab.heal(tmp_path / "nowhere")
