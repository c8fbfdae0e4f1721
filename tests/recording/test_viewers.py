"""What viewers are given: layouts whose every path is a field that we record, and recordings that their own code reads.

The code of Foxglove and rerun is no dependency: set HOOPD_FOXGLOVE to the folder that tools/viewers/check_foxglove.mjs
asks for, HOOPD_RERUN to the program `rerun`.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from mcap.reader import make_reader

from hoopd.recording import mcap
from hoopd.recording.schemas import DESCRIBED, schema_bytes, topic_of

ROOT = Path(__file__).resolve().parents[2]
LAYOUTS = ROOT / "config/viewers"
CHECKS = ROOT / "tools/viewers"
SKIPPED = 77  # of the checks: the viewer's code is not there
MESSAGE_PATH = re.compile(r"(?P<topic>/[a-z/]+)(?:\{(?P<key>\w+)==.*\})?(?:\.(?P<field>\w+)(?:\[(?P<index>\d+)\])?)?")
# What a layout must show: an angle of each body and its estimate, rates, torque, faults, timing.
SHOWN = {
    *("theta", "psi", "reference", "x_hat[0]", "x_hat[2]", "dtheta", "x_hat[1]", "x_hat[3]", "u", "current"),
    *("status", "errors", "lateness_s", "execution_s"),
}
SCHEMAS = {topic_of(name): json.loads(schema_bytes(name))["properties"] for name in DESCRIBED}
ESTIMATES = 4


def holds(topic: str, field: str, index: str | None) -> bool:
    """The schema of the topic has the field, and an index where it is an array."""
    kind = SCHEMAS[topic].get(field, {}).get("type")
    return int(index) < ESTIMATES if index is not None and kind == "array" else index is None and kind is not None


def foxglove() -> dict[str, Any]:
    """The layout for Foxglove."""
    layout: dict[str, Any] = json.loads((LAYOUTS / "foxglove.json").read_text())
    return layout


def paths_of(layout: dict[str, Any]) -> Iterator[str]:
    """Message paths of all panels."""
    for panel in layout["configById"].values():
        yield from (item["value"] for item in panel.get("paths", ()))
        if panel.get("topicPath"):
            yield panel["topicPath"]


def panels_of(node: Any) -> Iterator[str]:
    """Panels in the order of the window."""
    if isinstance(node, str):
        yield node
    else:
        yield from panels_of(node["first"])
        yield from panels_of(node["second"])


def test_every_path_of_the_foxglove_layout_is_in_a_schema() -> None:
    fields = set()
    for path in paths_of(foxglove()):
        found = MESSAGE_PATH.fullmatch(path)
        assert found and found["topic"] in SCHEMAS, path
        for field, index in ((found["field"], found["index"]), (found["key"], None)):
            assert field is None or holds(found["topic"], field, index), path
        fields.add(path.removeprefix("/hoopd/tick."))
    assert {*SHOWN, "mode", "/hoopd/event.event"} <= fields


def test_every_panel_of_the_foxglove_layout_has_a_place() -> None:
    layout = foxglove()
    assert sorted(panels_of(layout["layout"])) == sorted(layout["configById"])


def test_every_curve_of_the_plotjuggler_layout_is_in_a_schema() -> None:
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    fields = set()
    for curve in root.iter("curve"):
        topic, field = curve.attrib["topic"], curve.attrib["field"]
        assert curve.attrib["name"] == f"{topic}/{field}"  # by which the older and the newer program know it
        found = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field)
        assert found and holds(topic, found[1], found[2]), field
        assert SCHEMAS[topic][found[1]]["type"] != "string", f"{field}: the program draws numbers only"
        fields.add(field)
    assert fields >= SHOWN
    for splitter in root.iter("DockSplitter"):
        assert int(splitter.attrib["count"]) == len(splitter) == len(splitter.attrib["sizes"].split(";"))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of the rig in today's form."""
    path = tmp_path / "run.mcap"
    mcap.recover(ROOT / "tests/data/before_the_move/08-line-lost.mcap", path)
    return path


def checked(command: list[str]) -> dict[str, Any]:
    """What a check prints; skipped where it says so."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if done.returncode == SKIPPED:
        pytest.skip(done.stdout.strip())
    assert done.returncode == 0, done.stdout + done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def counted(path: Path) -> dict[str, int]:
    """Messages of each topic, by the package's reader with every checksum."""
    with path.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages()]
    return {topic: topics.count(topic) for topic in sorted(set(topics))}


def test_foxglove_s_own_parser_reads_a_run(run: Path) -> None:
    node, folder = shutil.which("node"), os.environ.get("HOOPD_FOXGLOVE")
    if node is None or not folder:
        pytest.skip("needs node, and HOOPD_FOXGLOVE: a folder as tools/viewers/check_foxglove.mjs says")
    script, layout = str(CHECKS / "check_foxglove.mjs"), str(LAYOUTS / "foxglove.json")
    told = checked([node, script, folder, str(run), layout])
    assert told["problems"] == []
    assert {name: topic["messages"] for name, topic in told["topics"].items()} == counted(run)
    assert told["fields"]["hoopd.tick"] == list(SCHEMAS["/hoopd/tick"])
    assert all(told["values"].values()), told["values"]


def test_rerun_s_own_importer_reads_a_run(run: Path) -> None:
    program = os.environ.get("HOOPD_RERUN")
    if not program:
        pytest.skip("needs HOOPD_RERUN: the program rerun, see tools/viewers/check_rerun.py")
    told = checked([sys.executable, str(CHECKS / "check_rerun.py"), str(run), "--rerun", program])
    assert told["not imported"] == {}
    assert {name: told["entities"][name]["messages"] for name in counted(run)} == counted(run)


def test_the_checks_say_when_they_checked_nothing(run: Path, tmp_path: Path) -> None:
    commands = [[sys.executable, str(CHECKS / "check_rerun.py"), str(run), "--rerun", str(tmp_path / "absent")]]
    if node := shutil.which("node"):
        commands.append([node, str(CHECKS / "check_foxglove.mjs"), str(tmp_path), str(run)])
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stdout.startswith("skipped: "), done.stderr) == (SKIPPED, True, "")
