"""What is kept of a device: the newest rows, of bounded memory, whatever a stranger sends."""

from __future__ import annotations

import json
import math
import struct

import numpy as np
import pytest

from hoopd.dashboard.device import MESSAGE_BYTES, Seen, ShownDevice
from hoopd.dashboard.history import CHANNELS, WALL, WORDS, History


def test_the_newest_rows_are_kept_and_counted() -> None:
    history = History(rows=4)
    for k in range(6):
        history.append(100.0 + k, {"u": k, "x_hat": [k, -k], "mode": "READY" if k < 5 else "RUNNING", "psi": None})
    assert (history.first, history.count) == (2, 6)
    assert history.names == [WALL, "u", "x_hat_0", "x_hat_1", "mode"]
    first, rows = history.since(0, 2)
    assert first == 4 and rows == [[104.0, 4.0, 4.0, -4.0, 0.0], [105.0, 5.0, 5.0, -5.0, 1.0]]
    assert history.words == {"mode": ["READY", "RUNNING"]}


def test_a_channel_that_comes_late_or_is_missing_has_no_number_there() -> None:
    history = History(rows=3)
    history.append(1.0, {"u": 1})
    history.append(2.0, {"psi": 0.5})
    history.append(3.0, {"u": 3})
    _, rows = history.since(0, 10)
    assert np.array_equal(rows, [[1.0, 1.0, math.nan], [2.0, math.nan, 0.5], [3.0, 3.0, math.nan]], equal_nan=True)
    history.append(4.0, {})  # in the place of the first
    assert math.isnan(history.since(3, 1)[1][0][1])


def test_what_a_browser_gets_has_every_number() -> None:
    history = History(rows=3)
    for k in range(5):
        history.append(float(k), {"u": k / 3})
    packed = history.packed()
    (size,) = struct.unpack_from("<I", packed)
    header = json.loads(packed[4 : 4 + size])
    assert header == {"names": [WALL, "u"], "words": {}, "first": 2, "rows": 3} and (4 + size) % 8 == 0
    columns = np.frombuffer(packed, "<f8", offset=4 + size).reshape(2, 3)
    assert np.array_equal(columns, [[2.0, 3.0, 4.0], [2 / 3, 1.0, 4 / 3]])


def test_a_stranger_fills_no_memory() -> None:
    history = History(rows=2)
    for k in range(1000):
        history.append(
            0.0, {f"c{k}": 1.0, "word": f"w{k}", "long": "x" * 10**5, "list": [1.0] * 1000, "<b>": 1.0, "wall": 9.0}
        )
    assert len(history.names) == CHANNELS and "<b>" not in history.names
    assert len(history.words["word"]) == WORDS and len(history.words["long"][0]) <= 64
    assert history.since(0, 1)[1][0][0] == 0.0


@pytest.mark.parametrize(
    "payload",
    [b"", b"nonsense", b"[1]", b"\xff", b'"text"', b"[" * 50_000, b'{"u": ' + b"1" * MESSAGE_BYTES + b"}"],
    ids=["nothing", "words", "a list", "no text", "a text", "nested", "too long"],
)
def test_what_is_no_message_is_counted_and_changes_nothing(payload: bytes) -> None:
    device = ShownDevice("hoop", "tcp/127.0.0.1:1")
    device.take("tick", payload, "run")
    assert (device.bad, device.history.count, device.runs) == (1, 0, 0)


def test_a_reader_is_told_what_is_new_and_nothing_twice() -> None:
    device, seen = ShownDevice("hoop", "tcp/127.0.0.1:1"), Seen()
    device.take("tick", b'{"t": 1.0, "u": 0.5}', "a", 10.0)
    device.take("event", b'{"t": 1.0, "event": "mode"}', "a", 10.0)
    told = device.news(seen, 10)
    assert told["rows"] == [[10.0, 1.0, 0.5]] and told["names"] == [WALL, "t", "u"]
    assert [event["event"] for event in told["events"]] == ["mode"] and told["state"]["run"] == "a"
    assert device.news(seen, 10) == {}
    device.take("status", b'{"faults": ["link_lost"]}', "a", 10.5)
    assert device.news(seen, 10)["state"]["status"] == {"faults": ["link_lost"]}


def changed(mode: str, was: str, *because: str) -> bytes:
    """The event of another mode."""
    return json.dumps({"t": 1.0, "event": "mode", "fields": {"mode": mode, "was": was, "because": because}}).encode()


def test_the_faults_behind_a_mode_are_those_of_this_mode_whichever_message_tells_first() -> None:
    device, seen = ShownDevice("hoop", "tcp/127.0.0.1:1"), Seen()

    def said(kind: str, payload: bytes, mode: str, run: str = "a") -> str:
        device.take(kind, payload, run, 10.0)
        device.take("tick", json.dumps({"t": 1.0, "mode": mode}).encode(), run, 10.0)
        return device.mode_words

    running = b'{"mode": "RUNNING", "because": []}'
    assert said("status", running, "RUNNING") == "the mode is RUNNING"
    assert said("event", changed("FAULT", "RUNNING", "link_lost"), "FAULT") == "the mode is FAULT (link_lost)"
    assert device.news(seen, 1)["state"]["because"] == {"mode": "FAULT", "names": ["link_lost"]}
    assert said("event", changed("RUNNING", "FAULT"), "RUNNING") == "the mode is RUNNING"  # the status is of a FAULT
    assert said("status", running, "FAULT") == "the mode is FAULT"  # its event was lost: nothing is known of it yet
    assert said("status", b'{"mode": "FAULT", "because": ["camera_lost"]}', "FAULT").endswith("FAULT (camera_lost)")
    said("event", changed("STOPPING", "RUNNING", "camera_lost"), "STOPPING")
    assert said("event", changed("DISARMED", "STOPPING", "link_lost"), "DISARMED").endswith("(camera_lost, link_lost)")
    assert said("status", b"{}", "DISARMED", "b") == "the mode is DISARMED"  # another run
    assert said("status", b'{"because": ["link_lost"]}', "FAULT", "b").endswith("(link_lost)")  # tells no mode


def test_a_restart_is_another_run_and_its_rows_follow_by_the_wall_clock() -> None:
    device, seen = ShownDevice("hoop", "tcp/127.0.0.1:1"), Seen()
    for t, now in ((50.0, 10.0), (50.02, 10.03), (50.04, 10.03)):  # one came late: rows keep their distance
        device.take("tick", json.dumps({"t": t}).encode(), "a", now)
    device.take("status", b'{"faults": ["link_lost"]}', "a", 10.1)
    device.take("tick", b'{"t": 0.02}', "b", 20.0)
    told = device.news(seen, 10)
    assert [row[0] for row in told["rows"]] == pytest.approx([10.0, 10.02, 10.04, 20.0])
    assert told["state"]["runs"] == 2 and told["state"]["status"] == {}
