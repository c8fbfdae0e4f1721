"""The view of what is learned and healed: everybody looks, who is logged in decides, nothing else leaves."""

from __future__ import annotations

from pathlib import Path

import pytest
from dashboard.driven import log_in
from dashboard.followed_folders import campaign, followed_folders, healed
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from shell.peers import Ticks, controlled, running

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.requests import PROOF
from hoopd.files.campaign_progress import LOCK, TAKEN
from hoopd.files.folder_lock import alone_in
from hoopd.files.heal_versions import VersionFolder


def test_it_tells_what_is_done_believed_and_asked(tmp_path: Path) -> None:
    folders = followed_folders(tmp_path)
    with served(Feed([], {}), followed=(*folders, tmp_path / "nowhere")) as web:
        learned, heal, nowhere = web.ask("/api/follow").json
        assert not learned["running"] and learned["ended"].startswith("It was broken off") and learned["asks"] == ""
        assert heal["acting"] == 0 and heal["waiting"] == [1] and "version 1 is proposed" in heal["asks"]
        assert [one["number"] for one in heal["versions"]] == [1, 0] and heal["versions"][0]["nats"] == 90.0
        assert "neither" in nowhere["reason"] and str(tmp_path) not in web.ask("/api/follow").body.decode()
        with alone_in(folders[0], LOCK, TAKEN):
            learned = web.ask("/api/follow").json[0]
            assert learned["running"] and learned["asks"] == "the operator: arm the device"
        with VersionFolder(folders[1]).watching():
            assert web.ask("/api/follow").json[1]["running"]
        (folders[0] / "progress.json").write_text("{spoiled")
        assert "progress.json" in web.ask("/api/follow").json[0]["reason"]


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("0/story.html", 200), ("1/0001/report.html", 200), ("1/0000/report.html", 404), ("2/story.html", 404),
        ("0/learn.json", 404), ("1/0001/model.yaml", 404), ("0/../healed/heal.json", 404),
        ("0/run_01/..%2f..%2fhealed%2f0001%2freport.html", 404), ("-1/story.html", 404),
    ],
)  # fmt: skip
def test_pages_leave_with_the_rights_of_a_stranger_and_nothing_else_leaves(
    tmp_path: Path, path: str, status: int
) -> None:
    with served(Feed([], {}), followed=followed_folders(tmp_path)) as web:
        answer = web.ask(f"/followed/{path}")
        assert answer.status == status
        assert status == 404 or "sandbox" in answer.headers["content-security-policy"]


def test_a_decision_needs_a_login_and_lies_beside_the_version_with_its_name(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    versions = VersionFolder(healed(tmp_path / "healed"))
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        served(Feed([settings.endpoint], {}), operators, followed=[campaign(tmp_path / "c"), versions.folder]) as web,
    ):
        wanted = {"folder": 1, "number": 1, "accept": True}
        assert web.post("/api/follow/decide", wanted, content_type="application/json").status == 401
        login = web.post("/api/login", {"user": "operator", "password": "turn"}, content_type="application/json")
        who = {"cookie": login.headers["set-cookie"].partition(";")[0], PROOF: login.json["proof"]}
        for wrong in ({"folder": 0}, {"folder": -1}, {"folder": 5}, {"number": 0}, {"number": 7}):
            answer = web.post("/api/follow/decide", wanted | wrong, content_type="application/json", **who)
            assert not answer.json["ok"] and answer.json["reason"], wrong
        assert versions.decision(1) is None
        answer = web.post("/api/follow/decide", wanted, content_type="application/json", **who)
        assert answer.json["ok"] and "once a hoopd heal runs there" in answer.json["command"]
        decision = versions.decision(1)
        assert decision is not None and decision.accept and decision.who == "operator"
        assert web.ask("/api/follow").json[1]["waiting"] == [] and ticks.take() == ()


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_a_person_reads_the_story_and_leaves_a_version_with_clicks(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    folders = followed_folders(tmp_path)
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate),
        served(Feed([settings.endpoint], {}), operators, followed=folders) as web,
        opened(tmp_path, web.origin) as page,
    ):
        page.click("[data-to=follow]")
        page.wait_for("document.querySelectorAll('#followed table').length === 2")
        text = page.text("#followed")
        assert "hoop.<b>friction" in text and "version 1 is proposed" in text and "Log in first." in text
        log_in(page)
        page.wait_for("!document.querySelector('#followed .primary').disabled")
        page.ask(
            "void [...document.querySelectorAll('#followed button')].find(b => b.innerText.startsWith('Leave')).click()"
        )
        page.wait_for("document.querySelector('#answer').innerText.includes('version 1 is left')")
        page.wait_for("!document.querySelector('#followed .primary')")  # what is below it has moved up by then
        decision = VersionFolder(folders[1]).decision(1)
        assert decision is not None and not decision.accept
        page.click("#followed article:first-child .tools button")
        page.wait_for("document.querySelector('#follow-viewer-frame').src.endsWith('/followed/0/story.html')")
        assert page.errors == []


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_a_control_that_is_pressed_is_not_replaced_before_its_click(tmp_path: Path) -> None:
    folders = followed_folders(tmp_path)
    middle = """(() => { const e = document.querySelector('#followed article:first-child .tools button');
        window.before = e; const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"""
    same = "document.contains(window.before)"
    with served(Feed([], {}), followed=folders) as web, opened(tmp_path, web.origin) as page:
        page.click("[data-to=follow]")
        page.wait_for("document.querySelectorAll('#followed table').length === 2")
        x, y = page.ask(middle)
        page.mouse("mousePressed", x, y)
        with alone_in(folders[0], LOCK, TAKEN):
            page.wait_for("fetch('/api/follow').then(a => a.json()).then(told => told[0].running)")
            page.ask("new Promise(done => setTimeout(done, 3500))")  # two of its questions
            assert page.ask(same)
            page.mouse("mouseReleased", x, y)
            page.wait_for("document.querySelector('#follow-viewer-frame').src.endsWith('/followed/0/story.html')")
            page.wait_for(f"!{same} && document.querySelector('#followed').innerText.includes('It runs')")
        assert page.errors == []
