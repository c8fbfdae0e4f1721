"""The hoop turned by hand in the page: while it is held, and never longer, whatever lets it go."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator

import pytest
from dashboard.driven import Driven, arm, driven, log_in
from harness.browser import CHROMIUM
from shell.peers import wait_until

from hoopd.core.operator import HAND_S

STICK = "document.querySelector('#joystick svg')"
HELD = f"{STICK}.classList.contains('held')"
QUICK_S = 1.0  # a hoop that nobody drives has a tenth of its speed


def speed(rig: Driven) -> float:
    """Of the hoop now, rad/s, as the daemon tells it."""
    return float(rig.page.ask("page.device.last('x_hat_1')"))


def grip(rig: Driven, share: float) -> tuple[float, float]:
    """Take the stick and pull it; where it is held."""
    rig.page.ask(f"void {STICK}.scrollIntoView({{block: 'center'}})")
    x, y, width = rig.page.ask(
        f"(() => {{ const b = {STICK}.getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2, Math.min(b.width / 250, b.height / 44) * 100]; })()"
    )
    rig.page.mouse("mousePressed", x, y)
    rig.page.mouse("mouseMoved", x + share * width, y)
    return x + share * width, y


def turns(rig: Driven, share: float) -> tuple[float, float]:
    """Pull until the hoop turns, from rest."""
    for _ in range(10):
        arm(rig.page)
        assert stands(rig)
        rig.page.wait_for(f"{STICK}.classList.contains('may')")
        where = grip(rig, share)
        if wait_until(lambda: math.copysign(1.0, share) * speed(rig) > 3.0, 6.0):
            return where
        rig.page.mouse("mouseReleased", *where)
    raise AssertionError(f"the hoop does not turn: {rig.page.text('#answer')}")


def stands(rig: Driven) -> bool:
    """Soon after it was let go."""
    return bool(wait_until(lambda: abs(speed(rig)) < 1.0, HAND_S + QUICK_S + 2.0))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Driven]:
    """One daemon and one page for all."""
    folder = tmp_path_factory.mktemp("hand")
    with driven(folder) as one:
        one.page.wait_for("window.page && page.device && page.device.state.status.speed_limit > 0", 60)
        assert not one.page.ask(f"{STICK}.classList.contains('may')")  # nobody is logged in
        log_in(one.page)
        yield one


pytestmark = [
    pytest.mark.realtime,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)"),
]


def test_it_turns_while_it_is_held_and_the_way_that_it_is_pulled(rig: Driven) -> None:
    for share in (0.3, -0.3):
        where = turns(rig, share)
        rig.page.wait_for("document.querySelector('#joystick-text').innerText.startsWith('wanted ')")
        rig.page.mouse("mouseReleased", *where)
        assert not rig.page.ask(HELD) and stands(rig)
    rig.page.wait_for("document.querySelector('#answer').innerText.includes('let go')")
    lines = [json.loads(line) for line in (rig.folder / "audit.jsonl").read_text().splitlines()]
    told = [(one["who"], one["value"] == 0.0, one["ok"]) for one in lines if one["command"] == "speed" and one["ok"]]
    assert 4 <= len(told) <= 8 and set(told) == {("operator", False, True), ("operator", True, True)}


@pytest.mark.parametrize("event", ["blur", "pagehide"])
def test_a_page_that_looks_away_lets_go(rig: Driven, event: str) -> None:
    where = turns(rig, 0.3)
    rig.page.ask(f"void dispatchEvent(new Event('{event}'))")
    assert not rig.page.ask(HELD) and stands(rig)
    rig.page.mouse("mouseReleased", *where)


def test_keys_drive_as_long_as_they_are_held(rig: Driven) -> None:
    arm(rig.page)
    rig.page.ask(f"void {STICK}.focus()")
    for _ in range(10):
        rig.page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft", code="ArrowLeft")
    assert wait_until(lambda: speed(rig) < -3.0, 6.0)
    rig.page.call("Input.dispatchKeyEvent", type="keyUp", key="ArrowLeft", code="ArrowLeft")
    assert not rig.page.ask(HELD) and stands(rig)


def test_stop_wins_over_a_stick_that_is_still_held(rig: Driven) -> None:
    where = turns(rig, 0.3)
    rig.page.key(" ", "Space")
    rig.page.wait_for("document.querySelector('#mode').innerText === 'DISARMED'")
    rig.page.wait_for(f"!{HELD}")
    rig.page.mouse("mouseReleased", *where)


def test_a_page_that_falls_silent_stops_the_hoop_by_the_daemon_itself(rig: Driven) -> None:
    where = turns(rig, 0.3)
    rig.page.ask("void (page.commands.post = () => new Promise(() => {}))")  # the line hangs, the stick is held
    begun = time.monotonic()
    assert stands(rig) and time.monotonic() - begun < HAND_S + QUICK_S + 2.0
    rig.page.wait_for("document.querySelector('#events').innerText.includes('speed_ended')")
    rig.page.mouse("mouseReleased", *where)
    assert rig.page.errors == []
