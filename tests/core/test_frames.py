"""Codec: vectors, layouts, faults, resynchronisation, and the proof that one or two flipped bits never pass."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import example, given, settings, strategies as st

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    GARBAGE_REPORT_BYTES,
    Answer,
    Decoder,
    LinkFault,
    Request,
    encode_answer,
    encode_request,
)
from hoopd.core.layout import Field, FrameLayout, Layout, crc8, crc16, layout_from_table, layout_to_table

ANSWER = Answer(7, 1, 0, 0.5, -2.0, 0.25, 1234)
ANSWER_BYTES = encode_answer(DEFAULT_LAYOUT, ANSWER)
REQUEST_BYTES = encode_request(DEFAULT_LAYOUT, 7, True, False, 0.25)

BARE = Layout(
    request=FrameLayout("request", (Field("flags", "B"), Field("torque_nm", "h", 1e-4)), None, "none", ">"),
    answer=FrameLayout("answer", (Field("theta", "i", 2 * math.pi / 4096), Field("pad", "B")), None, "none", ">"),
)
NO_SYNC = Layout(
    request=FrameLayout("request", DEFAULT_LAYOUT.request.fields, None, "crc16"),
    answer=FrameLayout("answer", DEFAULT_LAYOUT.answer.fields, None, "crc16"),
)
NO_CRC = Layout(
    request=FrameLayout("request", DEFAULT_LAYOUT.request.fields, 0xA5, "none"),
    answer=FrameLayout("answer", DEFAULT_LAYOUT.answer.fields, 0x5A, "none"),
)

f32 = st.floats(width=32, min_value=-100, max_value=100)
answers = st.builds(
    Answer, *[st.integers(0, 255)] * 3, f32, f32, st.floats(-8, 8, width=32), board_ms=st.integers(0, 65535)
)


def flip(data: bytes, *bits: int) -> bytes:
    out = bytearray(data)
    for bit in bits:
        out[bit // 8] ^= 1 << (bit % 8)
    return bytes(out)


def bitwise_crc(data: bytes, width: int, poly: int, crc: int) -> int:
    for byte in data:
        crc ^= byte << (width - 8)
        for _ in range(8):
            crc = (crc << 1) ^ poly if crc >> (width - 1) else crc << 1
            crc &= (1 << width) - 1
    return crc


def test_check_values() -> None:
    assert crc8(b"123456789") == 0xF4
    assert crc16(b"123456789") == 0x29B1


@given(st.binary(max_size=80))
def test_tables_equal_the_bitwise_definition(data: bytes) -> None:
    assert crc8(data) == bitwise_crc(data, 8, 0x07, 0x00)
    assert crc16(data) == bitwise_crc(data, 16, 0x1021, 0xFFFF)


def test_default_lengths_and_round_trip() -> None:
    assert (len(REQUEST_BYTES), len(ANSWER_BYTES)) == (8, 20)
    assert Decoder(DEFAULT_LAYOUT).feed(ANSWER_BYTES) == [ANSWER]
    assert Decoder(DEFAULT_LAYOUT, "request").feed(REQUEST_BYTES) == [Request(7, True, False, 0.25)]


def test_counters_wrap_and_huge_torque_becomes_infinite() -> None:
    data = encode_request(DEFAULT_LAYOUT, 256 + 3, False, True, 1e300)
    assert Decoder(DEFAULT_LAYOUT, "request").feed(data) == [Request(3, False, True, math.inf)]


def test_bare_layout_needs_silence() -> None:
    data = encode_request(BARE, 5, True, False, -0.7)
    decoder = Decoder(BARE, "request")
    assert len(data) == 3
    assert decoder.feed(data[:2]) == []
    assert decoder.silence() == [LinkFault("garbage", 2)]
    (request,) = decoder.feed(data)
    assert request == Request(-1, True, False, pytest.approx(-0.7))


def test_bare_layout_scales() -> None:
    (answer,) = Decoder(BARE).feed(encode_answer(BARE, Answer(theta=1.0)))
    assert answer.theta == pytest.approx(1.0, abs=2 * math.pi / 4096)


def test_without_sync_the_crc_finds_the_frame() -> None:
    data = encode_answer(NO_SYNC, ANSWER)
    decoder = Decoder(NO_SYNC)
    events = decoder.feed(b"\x00\x01\x02" + data) + decoder.silence()
    assert ANSWER in events


def test_without_crc_an_implausible_frame_is_searched_inside() -> None:
    data = encode_answer(NO_CRC, ANSWER)
    bad = encode_answer(NO_CRC, ANSWER._replace(dtheta=1e9))
    events = Decoder(NO_CRC).feed(bad[:9] + b"\xff\x7f" + data + data)
    assert events[0].kind == "implausible"
    assert events[-1] == ANSWER


@pytest.mark.parametrize("field", ["theta", "dtheta", "current"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e6])
def test_implausible_is_a_typed_fault(field: str, value: float) -> None:
    data = encode_answer(DEFAULT_LAYOUT, ANSWER._replace(**{field: value}))
    assert Decoder(DEFAULT_LAYOUT).feed(data + ANSWER_BYTES) == [LinkFault("implausible", 1, field), ANSWER]


def test_a_bad_frame_is_one_fault_and_the_next_is_taken_at_once() -> None:
    assert Decoder(DEFAULT_LAYOUT).feed(flip(ANSWER_BYTES, 100) + ANSWER_BYTES) == [LinkFault("bad_crc", 1), ANSWER]


def test_a_good_frame_inside_a_rejected_one_is_found() -> None:
    events = Decoder(DEFAULT_LAYOUT).feed(ANSWER_BYTES[:5] + ANSWER_BYTES)
    assert events == [LinkFault("bad_crc", 1), ANSWER]


def test_garbage_is_coalesced_and_reported_in_bounded_pieces() -> None:
    decoder = Decoder(DEFAULT_LAYOUT)
    events = decoder.feed(b"\x00" * (GARBAGE_REPORT_BYTES + 3) + ANSWER_BYTES)
    assert events == [LinkFault("garbage", GARBAGE_REPORT_BYTES), LinkFault("garbage", 3), ANSWER]
    assert decoder.pending == 0


def test_the_buffer_stays_small() -> None:
    decoder = Decoder(DEFAULT_LAYOUT)
    for data in (b"\x5a" * 100_000, b"\x00" * 100_000, ANSWER_BYTES[:-1] * 5000):
        decoder.feed(data)
        assert decoder.pending < 2 * len(ANSWER_BYTES)


def frame_with_inner_sync() -> bytes:
    """A request off the grid that has the sync byte in its torque and is valid."""
    return encode_request(DEFAULT_LAYOUT, 0xA5, True, False, 0.25)


def test_off_the_grid_a_frame_with_an_inner_sync_waits_for_silence_or_more() -> None:
    frame = frame_with_inner_sync()
    held = Decoder(DEFAULT_LAYOUT, "request")
    assert held.feed(b"\x00\x01" + frame) == []
    assert held.silence() == [LinkFault("garbage", 2), Request(0xA5, True, False, 0.25)]
    streamed = Decoder(DEFAULT_LAYOUT, "request")
    assert streamed.feed(b"\x00\x01" + frame + frame)[1:3] == [Request(0xA5, True, False, 0.25)] * 2


@pytest.mark.parametrize(("kind", "frame"), [("request", REQUEST_BYTES), ("answer", ANSWER_BYTES)])
def test_no_one_or_two_flipped_bits_pass_alone(kind: str, frame: bytes) -> None:
    """Exhaustive; by linearity of the CRC it holds for every content, apart from the sync byte."""
    bits = range(8 * len(frame))
    for pattern in itertools.chain(itertools.combinations(bits, 1), itertools.combinations(bits, 2)):
        decoder = Decoder(DEFAULT_LAYOUT, kind)
        events = decoder.feed(flip(frame, *pattern)) + decoder.silence()
        assert all(isinstance(e, LinkFault) for e in events), pattern


@pytest.mark.parametrize(("kind", "step"), [("request", 1), ("answer", 7)])
def test_no_one_or_two_flipped_bits_pass_in_a_stream(kind: str, step: int) -> None:
    """good, flipped, good, good without a pause: exactly the three good ones (contents rich in sync bytes)."""
    if kind == "request":
        frames = [encode_request(DEFAULT_LAYOUT, s, True, False, t) for s, t in ((1, 0.1), (0xA5, -0.2), (3, 0.3))]
    else:
        frames = [encode_answer(DEFAULT_LAYOUT, ANSWER._replace(seq=s, board_ms=0x5A5A)) for s in (1, 0x5A, 3)]
    good = Decoder(DEFAULT_LAYOUT, kind).feed(b"".join(frames))
    bits = range(8 * len(frames[0]))
    patterns = itertools.chain(itertools.combinations(bits, 1), itertools.combinations(bits, 2))
    for pattern in itertools.islice(patterns, 0, None, step):
        decoder = Decoder(DEFAULT_LAYOUT, kind)
        events = decoder.feed(frames[0] + flip(frames[1], *pattern) + frames[1] + frames[2]) + decoder.silence()
        assert [e for e in events if not isinstance(e, LinkFault)] == good, pattern


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


chunks = st.one_of(
    st.binary(max_size=30),
    st.just(ANSWER_BYTES),
    st.just(REQUEST_BYTES),
    st.just(frame_with_inner_sync()),
    st.builds(lambda n: ANSWER_BYTES[:n], st.integers(1, 19)),
    st.builds(lambda b: flip(ANSWER_BYTES, b), st.integers(0, 159)),
    st.sampled_from([b"\xa5", b"\x5a", b"\xa5\x5a\xa5"]),
)


@pytest.mark.parametrize("layout", [DEFAULT_LAYOUT, BARE, NO_SYNC, NO_CRC])
@pytest.mark.parametrize("kind", ["request", "answer"])
@settings(max_examples=60, deadline=None)
@given(parts=st.lists(chunks, max_size=12), cuts=st.lists(st.integers(0, 10_000), max_size=6))
@example(parts=[b"\xa5" * 40, b"\x5a" * 60], cuts=[])
def test_any_bytes_whole_or_cut_or_byte_by_byte(layout: Layout, kind: str, parts: list[bytes], cuts: list[int]) -> None:
    data = b"".join(parts)
    whole, cut, single = (Decoder(layout, kind) for _ in range(3))
    a = whole.feed(data)
    b = [e for piece in pieces(data, cuts) for e in cut.feed(piece)]
    c = [e for i in range(len(data)) for e in single.feed(data[i : i + 1])]
    assert repr(a) == repr(b) == repr(c)  # repr: NaN equals itself
    assert repr(whole.silence()) == repr(cut.silence()) == repr(single.silence())


@settings(max_examples=60, deadline=None)
@given(st.lists(answers, min_size=1, max_size=5), st.binary(max_size=40))
def test_frames_after_garbage_and_silence_are_never_lost(frames: list[Answer], garbage: bytes) -> None:
    decoder = Decoder(DEFAULT_LAYOUT)
    decoder.feed(garbage)
    decoder.silence()
    assert decoder.feed(b"".join(encode_answer(DEFAULT_LAYOUT, a) for a in frames)) == frames


@settings(max_examples=60, deadline=None)
@given(st.lists(answers, min_size=1, max_size=5), st.binary(max_size=40))
def test_frames_right_after_garbage_are_never_lost(frames: list[Answer], garbage: bytes) -> None:
    decoder = Decoder(DEFAULT_LAYOUT)
    stream = garbage + b"".join(encode_answer(DEFAULT_LAYOUT, a) for a in frames)
    events = decoder.feed(stream) + decoder.silence()
    assert [e for e in events if isinstance(e, Answer)] == frames


def test_layout_table_round_trip() -> None:
    for layout in (DEFAULT_LAYOUT, BARE, NO_SYNC):
        assert layout_from_table(layout_to_table(layout)) == layout


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"sync": 300}, "sync"),
        ({"crc": "crc32"}, "crc32"),
        ({"colour": 1}, "colour"),
        ({"byte_order": "!"}, "byte_order"),
        ({"fields": [["seq", "B"]]}, "missing"),
        ({"fields": [["speed", "f"]]}, "speed"),
        ({"fields": [["theta", "s"]]}, "format"),
        ({"fields": [["theta", "f"], ["theta", "f"]]}, "twice"),
        ({"fields": [["theta", "f", 0.0]]}, "scale"),
        ({"fields": [["theta", "f"], ["seq", "f"]]}, "integer"),
        ({"fields": [["theta", "d"]] + [["pad", "d"]] * 9}, "at most"),
        ({"fields": 3}, "answer"),
    ],
)
def test_a_wrong_layout_is_one_clear_line(change: dict[str, object], word: str) -> None:
    table = layout_to_table(DEFAULT_LAYOUT)
    table["answer"] |= change
    with pytest.raises(ValueError, match=word) as caught:
        layout_from_table(table)
    assert "\n" not in str(caught.value)
