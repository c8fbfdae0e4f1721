"""Versions of a calibration: only added, noticed when they are changed, restored by a new one."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoopd.files.calibration import Calibrations, StepJudgement
from hoopd.files.reading import InputError
from hoopd.shell import config as configuration

CIRCLE = {"centre": [241.0, 239.0], "radius": 181.0}


def folder(tmp_path: Path) -> Calibrations:
    """With two versions."""
    (tmp_path / "versions").mkdir()
    versions = Calibrations(tmp_path / "versions")
    steps = {"threshold": StepJudgement(good=True, why="far apart", values={"gap": 80.0})}
    versions.add(
        {"vision": {"threshold": 90.0}}, device="hoop", who="ann", why="first", steps=steps,
        evidence={"circle.jpg": b"picture"},
    )  # fmt: skip
    versions.add({"vision": {"circle_px": CIRCLE}}, device="hoop", who="ben", why="moved")
    return versions


def loaded(tmp_path: Path, *sets: str) -> configuration.Config:
    """As the daemon reads it."""
    path = tmp_path / "hoop.yaml"
    path.write_text("calibration: {folder: versions}\nvision: {threshold: 60, ball_radius_px: 22}\n")
    return configuration.load(path, sim=False, overrides=list(sets))


def test_the_newest_counts_over_the_file_and_the_command_line_over_both(tmp_path: Path) -> None:
    folder(tmp_path)
    vision = loaded(tmp_path).vision
    assert (vision.threshold, vision.circle_px.centre, vision.ball_radius_px) == (90.0, (241.0, 239.0), 22.0)
    assert loaded(tmp_path, "vision.threshold=50").vision.threshold == 50.0
    assert loaded(tmp_path, "calibration.folder=''").vision.threshold == 60.0


def test_an_empty_folder_changes_nothing_and_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"versions: calibration\.folder: no such folder"):
        loaded(tmp_path)
    (tmp_path / "versions").mkdir()
    assert loaded(tmp_path).vision.threshold == 60.0


def test_versions_tell_who_when_why_and_what_changed(tmp_path: Path) -> None:
    first, second = folder(tmp_path).listed()
    assert first.calibration is not None and second.calibration is not None
    assert (first.calibration.who, second.calibration.who) == ("ann", "ben")
    assert [change.key for change in first.changes] == ["vision.threshold"]
    assert second.changes == (("vision.circle_px", None, CIRCLE),)
    assert second.calibration.steps["threshold"].values == {"gap": 80.0}  # what was found before still stands
    assert second.calibration.before == first.calibration.sha256


def test_an_earlier_one_comes_back_as_a_new_one(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    before = {path.name: path.read_bytes() for path in versions.folder.iterdir()}
    third = versions.restore(1, "cleo")
    assert (third.number, third.configuration, third.why) == (3, {"vision": {"threshold": 90.0}}, "restored from 1")
    assert versions.evidence(third, "0001-circle.jpg") == b"picture"
    assert {name: (versions.folder / name).read_bytes() for name in before} == before
    assert not any(one.wrong for one in versions.listed())


def test_a_version_that_was_changed_by_hand_is_noticed_and_never_used(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    newest = versions.folder / "0002.yaml"
    newest.write_text(newest.read_text().replace("181.0", "182.0"))
    with pytest.raises(InputError, match=r"0002.yaml: sha256: was changed after it was accepted.*calibration restore"):
        loaded(tmp_path)
    assert [one.wrong.split(" (")[0] for one in versions.listed()] == ["", "sha256: was changed after it was accepted"]
    versions.restore(1, "ann")
    assert loaded(tmp_path).vision.threshold == 90.0


def test_what_did_not_change_is_not_hashed_at_every_look(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    versions, read = folder(tmp_path), list[str]()
    original = Calibrations.evidence
    monkeypatch.setattr(Calibrations, "evidence", lambda *of: (read.append(of[2]), original(*of))[1])
    first = versions.listed()
    assert versions.listed() == first and read == ["0001-circle.jpg"]
    evidence = versions.folder / "0001-circle.jpg"
    evidence.write_bytes(b"PICTURE")  # as long as it was
    assert versions.listed()[0].wrong.startswith("0001-circle.jpg: was changed") and len(read) == 2


def test_a_file_that_goes_while_the_folder_is_looked_at_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    versions, original = folder(tmp_path), Path.iterdir
    gone = versions.folder / ".0003.yaml.abc"  # what a version is written to before it has its name
    monkeypatch.setattr(Path, "iterdir", lambda self: iter([*original(self), gone]))
    assert [one.number for one in versions.listed()] == [1, 2]


def test_one_that_is_missing_or_exchanged_is_noticed_by_the_next(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    (versions.folder / "0001.yaml").unlink()
    assert versions.listed()[0].wrong == "the version before it is missing, or is another one than it was"


def test_evidence_that_was_changed_is_noticed(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    (versions.folder / "0001-circle.jpg").write_bytes(b"another")
    assert versions.listed()[0].wrong.startswith("0001-circle.jpg: was changed")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "0003.yaml"),
        ("schema: hoopd.calibration/2\n", "0003.yaml"),
        ("[1, 2]", "0003.yaml"),
        ("a: [", "0003.yaml"),
    ],
)
def test_files_that_are_no_versions_are_one_line(tmp_path: Path, text: str, reason: str) -> None:
    versions = folder(tmp_path)
    (versions.folder / "0003.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        loaded(tmp_path)
    assert reason in str(caught.value) and "\n" not in str(caught.value)


def test_only_what_belongs_to_a_calibration_can_be_set(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    with pytest.raises(InputError, match=r"configuration\.control\.law: no key that a calibration may set"):
        versions.add({"control": {"law": "evil.py"}}, device="hoop", who="x", why="")
    text = (versions.folder / "0002.yaml").read_text().replace("threshold", "homography")
    (versions.folder / "0002.yaml").write_text(text)
    with pytest.raises(InputError, match="no key that a calibration may set"):
        loaded(tmp_path)


def test_another_device_s_is_refused(tmp_path: Path) -> None:
    folder(tmp_path)
    with pytest.raises(InputError, match=r"0002.yaml: device: is of 'hoop', this daemon's is 'other'"):
        loaded(tmp_path, "device.name=other")


def test_links_are_no_versions_and_names_lead_nowhere_else(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    (versions.folder / "0003.yaml").symlink_to(versions.folder / "0002.yaml")
    assert versions.listed()[-1].wrong == "is a link: no version"
    with pytest.raises(InputError, match="no such evidence"):
        versions.evidence(versions.read(1), "../../secret")


def test_one_that_cannot_be_used_keeps_nobody_from_a_disarm(tmp_path: Path) -> None:
    versions = folder(tmp_path)
    (versions.folder / "0003.yaml").write_text("nonsense\n")
    with pytest.raises(InputError):
        loaded(tmp_path)
    assert configuration.load_to_ask(tmp_path / "hoop.yaml", []).vision.threshold == 60.0
