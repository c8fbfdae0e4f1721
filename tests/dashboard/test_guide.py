"""What the steps of a guided calibration make of pictures, and how results become versions."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from dashboard.served import Served, served
from dashboard.test_calibration import SIDE, ZERO_RAD, Scene
from shell.peers import controlled, running, tick, wait_until

from hoopd.dashboard.audit import Audit
from hoopd.dashboard.calibration import About
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.guide import motion, picture_steps
from hoopd.dashboard.guide.guide import KeptCalibrations
from hoopd.dashboard.guide.picture_steps import LookedPicture as Looked
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench
from hoopd.files.calibration import Calibrations
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.shell.config import Vision
from hoopd.shell.live_picture import LivePicture
from hoopd.shell.pictures import Analysed

pytestmark = pytest.mark.realtime  # the rig's pictures come by the clock

ABOUT = About((SIDE, SIDE), (240.0, 240.0, 182.0), 0.0, 23.0, 70.0)


class SeenBall(Scene):
    """The same, with the place where the detector found the ball."""

    def __call__(self) -> Analysed:
        analysed = super().__call__()
        x, y = 240.0 - 182.0 * math.sin(ZERO_RAD), 240.0 + 182.0 * math.cos(ZERO_RAD)
        return analysed._replace(sample=analysed.sample._replace(psi=0.0, confidence=1.0, x_px=x, y_px=y))


@pytest.fixture(scope="module")
def looked() -> Looked:
    """The rig's picture of a ball at rest."""
    return Looked(Scene()().frame.data, ABOUT, 1.0)


def changed(looked: Looked, image: Any) -> Looked:
    return looked._replace(image=np.asarray(np.clip(image, 0, 255), np.uint8))


def test_light_is_judged_where_the_hoop_is(looked: Looked) -> None:
    assert picture_steps.exposure(looked).good
    bright = picture_steps.exposure(changed(looked, looked.image * 1.6 + 150.0))
    assert not bright.good and "too bright" in bright.why
    dark = picture_steps.exposure(changed(looked, looked.image * 0.15))
    assert not dark.good and "too dark" in dark.why


def test_the_circle_is_found_in_the_camera_s_own_pixels(looked: Looked) -> None:
    found = picture_steps.circle(looked)
    circle = found.part["vision"]["circle_px"]
    assert found.good and np.allclose(circle["centre"], 240.0, atol=1.0) and abs(circle["radius"] - 182.0) < 1.5
    assert cv2.imdecode(np.frombuffer(found.picture, np.uint8), cv2.IMREAD_COLOR) is not None
    larger = picture_steps.circle(looked._replace(scale=2.0)).part["vision"]["circle_px"]
    assert larger["radius"] == pytest.approx(2.0 * circle["radius"], abs=0.02)


def test_the_threshold_lies_between_ring_and_ball(looked: Looked) -> None:
    found = picture_steps.threshold(looked)
    ring, ball = found.drawings[0].curves
    level = found.part["vision"]["threshold"]
    assert found.good and (ring.label, ball.label) == ("ring", "ball")
    assert max(x for x, y in zip(ring.x, ring.y, strict=True) if y > 0.05) < level
    assert min(x for x, y in zip(ball.x, ball.y, strict=True) if y > 0.2) > level


def test_the_zero_is_a_mean_with_its_interval_and_a_moving_ball_is_doubtful() -> None:
    rng = np.random.default_rng(1)

    def at(angle: float) -> tuple[float, float]:
        return 240.0 - 182.0 * np.sin(angle), 240.0 + 182.0 * np.cos(angle)

    still = picture_steps.zero([at(0.02 + 1e-3 * rng.normal()) for _ in range(20)], (240.0, 240.0), 0.01, 0.05)
    mean, low, high = still.values["zero_angle_rad"]
    assert still.good and low < 0.02 < high and mean == pytest.approx(0.02, abs=1e-3) and "+0.0100 from" in still.why
    swings = picture_steps.zero([at(0.2 * np.sin(k)) for k in range(20)], (240.0, 240.0), 0.0, 0.05)
    turns = picture_steps.zero([at(0.02)] * 20, (240.0, 240.0), 0.0, 3.0)
    assert not swings.good and not turns.good and "moves" in swings.why and "moves" in turns.why
    few = picture_steps.zero([at(0.0)] * 3, (240.0, 240.0), 0.0, 0.0)
    assert not few.good and few.part == {}


class Rig:
    """A device that only shows pictures, its page and an operator."""

    def __init__(self, web: Served, device: str, folder: Path) -> None:
        self.web, self.device, self.folder = web, device, folder
        told = web.post("/api/login", {"user": "operator", "password": "turn"}, content_type="application/json")
        cookie = told.headers["set-cookie"].partition(";")[0]
        self.headers = {"cookie": cookie, "x_hoopd_proof": told.json["proof"], "content_type": "application/json"}

    def post(self, path: str, **content: Any) -> Any:
        return self.web.post(f"/api/guide/{path}", {"device": self.device, **content}, **self.headers).json

    @property
    def told(self) -> Any:
        return self.web.ask(f"/api/guide?device={self.device}").json


@contextlib.contextmanager
def shown(folder: Path) -> Iterator[Rig]:
    """A page whose server keeps calibrations of a device that shows one picture."""
    (folder / "versions").mkdir()
    control = controlled(folder)
    operators = Operators({control.endpoint: (control.control_endpoint, control.control_zenoh)})
    kept = KeptCalibrations(Calibrations(folder / "versions"), "hoop")
    with (
        running(control, picture=LivePicture(SeenBall(), Vision())) as telemetry,
        served(Feed([control.endpoint], {}), operators, Audit(folder / "audit.jsonl"), kept=kept) as web,
    ):
        telemetry.put(tick(1)._replace(dtheta=0.0))
        assert wait_until(lambda: bool(web.feed.devices))
        yield Rig(web, next(iter(web.feed.devices)), folder)


def test_results_become_versions_and_earlier_ones_come_back(tmp_path: Path) -> None:
    with shown(tmp_path) as rig:
        assert [step["result"] for step in rig.told["steps"]] == [None] * 7 and len(rig.told["open"]) == 7
        for step in ("circle", "zero", "threshold"):
            assert rig.post("step", step=step)["value"] == "good", step
        accepted = rig.post("accept", steps=["circle", "zero"], why="lens <b>changed</b>")
        assert accepted["ok"] and accepted["value"] == 1
        told = rig.told
        assert told["in_force"]["number"] == 1 and "zero" not in told["open"] and "threshold" in told["open"]
        version = Calibrations(tmp_path / "versions").read(1)
        assert (version.who, version.why) == ("operator", "lens <b>changed</b>")
        assert abs(version.configuration["vision"]["zero_angle_rad"] - ZERO_RAD) < 0.005
        assert rig.post("accept", steps=["threshold"])["value"] == 2
        assert rig.post("restore", number=1)["value"] == 3
        assert rig.told["versions"][0]["why"] == "restored from 1"
        shown_picture = rig.web.ask("/api/guide/evidence?number=1&name=0001-circle.jpg")
        assert shown_picture.status == 200 and shown_picture.body[:2] == b"\xff\xd8"
        lines = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        made = [one for one in lines if one["command"].startswith("calibration of")]
        assert [(one["who"], one["value"]) for one in made] == [("operator", 1), ("operator", 2)]


def test_strangers_look_and_change_nothing(tmp_path: Path) -> None:
    with shown(tmp_path) as rig:
        for path, content in (("step", {"step": "circle"}), ("accept", {"steps": ["circle"]}), ("play", {})):
            body = {"device": rig.device, **content}
            assert rig.web.post(f"/api/guide/{path}", body, content_type="application/json").status == 401
        assert rig.told["ok"]
        for query in ("number=1&name=../../etc/passwd", "number=x&name=a", "number=1&name=0001-circle.jpg"):
            assert rig.web.ask(f"/api/guide/evidence?{query}").status == 404
        assert rig.web.ask("/api/guide?device=other").status == 404


def test_what_cannot_be_done_is_one_line(tmp_path: Path) -> None:
    with shown(tmp_path) as rig:
        assert rig.post("accept", steps=["circle"])["reason"] == "steps: circle: has no result to accept"
        assert rig.post("accept", steps=[])["reason"] == "steps: choose one at least"
        assert "no step that looks" in rig.post("step", step="torque")["reason"]
        assert "--recordings" in rig.post("play")["reason"]
        assert "no such file" in rig.post("restore", number=7)["reason"]
        rig.post("step", step="circle")
        rig.post("accept", steps=["circle"])
        newest = tmp_path / "versions" / "0001.yaml"
        newest.write_text(newest.read_text().replace("radius: 18", "radius: 17"))
        assert "was changed after it was accepted" in rig.told["wrong"]
        assert "was changed after it was accepted" in rig.post("accept", steps=["circle"])["reason"]


def test_the_signal_is_laid_in_once_around_the_controller_that_acts(tmp_path: Path) -> None:
    for name in ("recordings", "results", "controllers"):
        (tmp_path / name).mkdir()
    text = (defaults_folder() / "controllers" / "lqg.yaml").read_text()
    (tmp_path / "controllers" / "lqg.yaml").write_text(text)
    bench = Bench(tmp_path / "recordings", tmp_path / "results", tmp_path / "controllers")
    assert bench.controllers is not None
    sha256 = bench.controllers.listed()[0].key.partition("@")[2]
    acting = {"file": "lqg.yaml", "sha256": sha256, "purpose": "controller"}
    key = motion.lay_in(bench, acting)
    assert key == motion.lay_in(bench, acting) and key.startswith("calibration-")
    assert "excitation" in bench.controllers.text(key)
    with pytest.raises(InputError, match="end that first"):
        motion.lay_in(bench, {**acting, "purpose": "trial"})
    with pytest.raises(InputError, match="its hash is"):
        motion.lay_in(bench, {**acting, "sha256": "0" * 64})
    with pytest.raises(InputError):
        motion.lay_in(bench, {**acting, "file": "../../secret.yaml"})
