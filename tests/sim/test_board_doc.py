"""docs/reference/board.md against the code: frames, bits, checksums, vectors, timing, layout example."""

from __future__ import annotations

import json
import re
import struct
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from sim.boardbench import QUIET, Bench, Pushed

from hoopd.core import frames, layout
from hoopd.core.frames import DEFAULT_LAYOUT, Answer, Decoder, encode_answer, encode_request
from hoopd.shell.config import SimBoard
from hoopd.sim import board

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "board.md").read_text()


def tables() -> dict[str, list[list[str]]]:
    """First header cell and section of every table -> its rows of cells."""
    found: dict[str, list[list[str]]] = {}
    for block in re.findall(r"(?:^\|.*\n)+", TEXT, re.MULTILINE):
        lines = [[c.strip().strip("`") for c in line.strip().strip("|").split("|")] for line in block.splitlines()]
        section = re.findall(r"^#+ (.*)$", TEXT[: TEXT.index(block)], re.MULTILINE)[-1]
        found[f"{section.split(':')[0]}/{lines[0][0].split()[0]}"] = lines[2:]
    return found


TABLES = tables()
SIZES = {"u8": "B", "u16": "H", "f32": "f", "crc8": "B", "crc16": "H"}


@pytest.mark.parametrize("kind", ["request", "answer"])
def test_byte_tables(kind: str) -> None:
    frame = getattr(DEFAULT_LAYOUT, kind)
    rows = TABLES[f"{kind.capitalize()}/offset"]
    offset = 0
    for row in rows:
        assert int(row[0]) == offset
        offset += struct.calcsize("<" + SIZES[row[2]])
    assert offset == frame.length
    assert int(rows[0][3], 16) == frame.sync
    assert rows[-1][2] == frame.crc
    assert [(r[1], SIZES[r[2]]) for r in rows[1:-1]] == [(f.name, f.code) for f in frame.fields]


@pytest.mark.parametrize("word", ["Status", "Errors"])
def test_bits(word: str) -> None:
    prefix = {"Status": "STATUS_", "Errors": "ERROR_"}[word]
    documented = {prefix + row[2].upper(): int(row[1], 16) for row in TABLES[f"{word}/bit"]}
    assert documented == {n: v for n, v in vars(frames).items() if n.startswith(prefix)}
    assert all(1 << int(row[0]) == int(row[1], 16) for row in TABLES[f"{word}/bit"])


def test_checksums() -> None:
    for name, *_, check in TABLES["Checksums/name"]:
        assert getattr(layout, name)(b"123456789") == int(check, 16)


def test_request_vectors() -> None:
    rows = TABLES["Test vectors/request"]
    assert len(rows) == 4
    for values, text in rows:
        seq, enable, clear, torque = (float(v) for v in values.split(","))
        data = bytes.fromhex(text)
        assert encode_request(DEFAULT_LAYOUT, int(seq), bool(enable), bool(clear), torque) == data
        assert Decoder(DEFAULT_LAYOUT, "request").feed(data)[0].seq == seq


def test_answer_vectors() -> None:
    rows = TABLES["Test vectors/answer"]
    assert len(rows) == 4
    for values, text in rows:
        numbers = [float(v) if "." in v else int(v) for v in values.split(",")]
        answer = Answer(*numbers)
        assert encode_answer(DEFAULT_LAYOUT, answer) == bytes.fromhex(text)
        assert Decoder(DEFAULT_LAYOUT).feed(bytes.fromhex(text)) == [answer]


def test_timing() -> None:
    values = {row[0]: float(row[1].split()[0]) for row in TABLES["Timing/name"]}
    assert values["time-out"] == 1e3 * board.TIMEOUT_S
    assert values["partial frame"] == 1e3 * board.PARTIAL_FRAME_S
    assert values["byte"] == pytest.approx(1e6 * board.BYTE_S, abs=0.05)


def test_limits_of_its_own() -> None:
    rows = {row[0]: row for row in TABLES["Limits of its own/limit"]}
    values = {name: float(row[1].split()[0]) for name, row in rows.items()}
    constants = board.BoardConfig()
    assert values == {
        "torque limit": constants.torque_limit_nm,
        "slew limit": constants.slew_nm_per_ms,
        "overspeed": constants.overspeed_rad_s,
        "current limit": constants.current_limit_a,
        "time-out": 1e3 * constants.timeout_s,
    }
    keys = {row[3].removeprefix("sim.board."): values[name] for name, row in rows.items() if row[3] != "-"}
    assert keys == msgspec.structs.asdict(SimBoard())


def test_vectors_of_the_slew_limit() -> None:
    rows = TABLES["Vectors of the slew limit/from"]
    assert len(rows) == 4
    for cells in rows:
        before, after, *expected = map(float, cells)
        bench = Bench()
        bench.ask(0.02, before)
        bench.ask(0.04, after)
        bench.board.advance(0.06)
        got = [bench.log.torque_at(0.04 + 1e-3 * ms) for ms in (0.05, 0.45, 0.95, 1.95)]
        assert got == pytest.approx(expected, abs=1e-6)  # the request carries an f32


@pytest.mark.parametrize(("speeds", "currents"), [(1.0, 1.0), (0.3, 1.0), (1.0, 3.0), (1.3, 0.2)])
def test_vectors_of_the_cuts(speeds: float, currents: float) -> None:
    """With other limits, too: the vectors scale with them."""
    rows = TABLES["Vectors of the cuts/speed"]
    assert len(rows) == 5
    limits = {"overspeed_rad_s": 100.0 * speeds, "current_limit_a": 2.5 * currents}
    for speed, current, told, cleared_at, told_then in rows:
        hoop = Pushed()
        bench = Bench(replace(QUIET, **limits), plant=hoop)
        bench.ask(0.02, 0.1)
        hoop.dtheta, hoop.current = speeds * float(speed), currents * float(current)
        first = bench.ask(0.04, 0.1)
        hoop.dtheta, hoop.current = speeds * float(cleared_at), 0.0
        second = bench.ask(0.06, clear=True)
        for answer, words in ((first, told), (second, told_then)):
            assert [answer.status, answer.errors] == [int(word, 16) for word in words.split(", ")]


def test_a_cut_comes_within_the_time_that_is_demanded() -> None:
    """From the instant at which speed or current pass their limit, whenever that is between two requests."""
    within_s = 1e-3 * float(re.search(r"drive off within (\d+) ms", TEXT).group(1))
    weak = replace(QUIET, current_limit_a=0.1)  # passed by the first step of the slew limit
    for torque, config in ((0.7, QUIET), (-0.2, QUIET), (0.5, replace(QUIET, current_limit_a=1.0)), (0.06, weak)):
        bench = Bench(config)
        for k in range(1, 60):
            bench.ask(0.02 * k, torque)
        cut = next(row.t for row in bench.log.rows if row.reason == "fault")
        passed = 0.02 + (0.0 if config.current_limit_a < 2.5 else 100.0 / (500.0 * abs(torque)))
        assert cut - passed <= within_s
        assert bench.log.zero_for_good_from(cut) == 0.0


def test_bounds_of_the_host() -> None:
    words = re.search(r"\|theta\| <= (\d+) turns, \|dtheta\| <= (\d+) rad/s, \|current\| <= (\d+) A", TEXT)
    assert words is not None
    turns, dtheta, current = map(float, words.groups())
    assert pytest.approx({"theta": turns * 6.283185307, "dtheta": dtheta, "current": current}) == frames.ANSWER_BOUNDS


def test_the_layout_example_is_one() -> None:
    example = json.loads(re.search(r"```json\n(.*?)```", TEXT, re.DOTALL).group(1))
    other = layout.layout_from_table(example)
    assert (other.request.length, other.answer.length) == (3, 12)


def test_reasons_of_the_log() -> None:
    words = re.search(r"Reasons: ([a-z, ]+)\.", TEXT).group(1).split(", ")
    files = ("board.py", "boardprocess.py", "torquestage.py")
    source = "".join(Path(board.__file__).with_name(name).read_text() for name in files)
    for word in words:
        assert f'"{word}"' in source
