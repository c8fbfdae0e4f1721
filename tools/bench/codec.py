"""Codec under random bytes: `python tools/bench/codec.py [--cases 100000] [--seed 1]`.

Three kinds of cases in turn: (1) any bytes, whole and byte by byte, must give the same frames and typed faults and no
exception; (2) a stream with one or two flipped bits in one frame must give the other frames and nothing else;
(3) frames after garbage must all come out once the line was silent in between. Rates that a checksum cannot make zero
(frames made by pure chance of random bytes, frames lost right after garbage without a pause) are printed beside what
probability says. Exit code 1 when a figure that must be zero is not.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from hoopd.core.frames import (
    DEFAULT_LAYOUT,
    Answer,
    Decoder,
    Event,
    LinkFault,
    encode_answer,
    encode_request,
)

MUST_BE_ZERO = (
    "exceptions",
    "whole differs from bytewise",
    "false acceptances",
    "lost beside a flip",
    "lost after silence",
)


def random_frame(rng: random.Random, kind: str) -> bytes:
    """A plausible frame; a third of the contents is rich in sync bytes."""
    word = (0xA5 if kind == "request" else 0x5A) if rng.random() < 0.33 else rng.randrange(256)
    if kind == "request":
        return encode_request(DEFAULT_LAYOUT, word, True, rng.random() < 0.1, rng.uniform(-0.7, 0.7))
    values = rng.uniform(-3000, 3000), rng.uniform(-40, 40), rng.uniform(-2, 2)
    return encode_answer(DEFAULT_LAYOUT, Answer(word, 1, 0, *values, word * 257))


def flipped(rng: random.Random, frame: bytes, bits: int) -> bytes:
    out = bytearray(frame)
    for place in rng.sample(range(8 * len(frame)), bits):
        out[place // 8] ^= 1 << (place % 8)
    return bytes(out)


def frames_of(events: list[Event]) -> list[Event]:
    return [e for e in events if not isinstance(e, LinkFault)]


def any_bytes(rng: random.Random, kind: str) -> bytes:
    """Frames, pieces of frames, damaged frames and noise in any order."""
    parts = []
    for _ in range(rng.randrange(1, 6)):
        frame = random_frame(rng, kind)
        parts.append(
            rng.choice(
                [
                    frame,
                    frame[: rng.randrange(len(frame))],
                    flipped(rng, frame, rng.randrange(1, 9)),
                    rng.randbytes(rng.randrange(30)),
                    bytes([rng.choice([0xA5, 0x5A])]) * rng.randrange(20),
                ]
            )
        )
    return b"".join(parts)


def case_any(rng: random.Random, kind: str, counts: Counter[str]) -> None:
    data = any_bytes(rng, kind)
    whole, single = Decoder(DEFAULT_LAYOUT, kind), Decoder(DEFAULT_LAYOUT, kind)
    a = [*whole.feed(data), *whole.silence()]
    b = [e for i in range(len(data)) for e in single.feed(data[i : i + 1])] + single.silence()
    counts["whole differs from bytewise"] += repr(a) != repr(b)
    counts["frames"] += len(frames_of(a))


def case_flip(rng: random.Random, kind: str, counts: Counter[str]) -> None:
    frames = [random_frame(rng, kind) for _ in range(4)]
    decoder = Decoder(DEFAULT_LAYOUT, kind)
    wanted = frames_of(decoder.feed(frames[0] + frames[2] + frames[3]))
    damaged = flipped(rng, frames[1], rng.choice([1, 2]))
    decoder = Decoder(DEFAULT_LAYOUT, kind)
    got = frames_of([*decoder.feed(frames[0] + damaged + frames[2] + frames[3]), *decoder.silence()])
    counts["false acceptances"] += sum(e not in wanted for e in got)
    counts["lost beside a flip"] += sum(e not in got for e in wanted)
    counts["frames"] += len(got)


def case_garbage(rng: random.Random, kind: str, counts: Counter[str]) -> None:
    garbage, frames = rng.randbytes(rng.randrange(1, 40)), [random_frame(rng, kind) for _ in range(3)]
    wanted = frames_of(Decoder(DEFAULT_LAYOUT, kind).feed(b"".join(frames)))
    paused, direct = Decoder(DEFAULT_LAYOUT, kind), Decoder(DEFAULT_LAYOUT, kind)
    paused.feed(garbage)
    paused.silence()
    counts["lost after silence"] += paused.feed(b"".join(frames)) != wanted
    got = frames_of([*direct.feed(garbage + b"".join(frames)), *direct.silence()])
    counts["garbage bytes " + kind] += len(garbage)
    counts["chance frames " + kind] += sum(e not in wanted for e in got)
    counts["lost without a pause " + kind] += sum(e not in got for e in wanted)
    counts["frames"] += len(got)


def run(cases: int, seed: int) -> Counter[str]:
    rng, counts = random.Random(seed), Counter(dict.fromkeys(MUST_BE_ZERO, 0))
    kinds = (case_any, case_flip, case_garbage)
    begin = time.monotonic()
    for n in range(cases):
        try:
            kinds[n % 3](rng, ("request", "answer")[n // 3 % 2], counts)
        except Exception as error:
            counts["exceptions"] += 1
            sys.stderr.write(f"\ncase {n}: {error!r}\n")
        if n % 2000 == 1999 and sys.stderr.isatty():
            sys.stderr.write(f"\r{n + 1}/{cases} cases, {time.monotonic() - begin:.0f} s")
    sys.stderr.write(f"\r{cases}/{cases} cases, {time.monotonic() - begin:.0f} s\n")
    return counts


def microseconds_per_frame(kind: str, bytewise: bool) -> float:
    """Best of five runs of 2000 frames."""
    frame, decoder, best = random_frame(random.Random(1), kind), Decoder(DEFAULT_LAYOUT, kind), 1e9
    pieces = [frame[i : i + 1] for i in range(len(frame))] if bytewise else [frame]
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(2000):
            for piece in pieces:
                decoder.feed(piece)
        best = min(best, (time.perf_counter() - begin) / 2000)
    return 1e6 * best


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = run(options.cases, options.seed)
    rows = [("cases", str(options.cases)), ("frames decoded", str(counts["frames"]))]
    rows += [(f"{name} (must be 0)", str(counts[name])) for name in MUST_BE_ZERO]
    for kind, bits in (("request", 16), ("answer", 24)):
        n = counts["garbage bytes " + kind]
        rows.append(
            (f"{kind}s made of {n} random bytes", f"{counts['chance frames ' + kind]} (chance {n / 2**bits:.2f})")
        )
        rows.append((f"{kind}s lost right after garbage, no pause", str(counts["lost without a pause " + kind])))
    for kind in ("request", "answer"):
        for bytewise in (False, True):
            how = "byte by byte" if bytewise else "whole"
            rows.append((f"decode one {kind}, {how}", f"{microseconds_per_frame(kind, bytewise):.1f} us"))
    begin = time.perf_counter()
    for seq in range(20_000):
        encode_request(DEFAULT_LAYOUT, seq, True, False, 0.25)
    rows.append(("encode one request", f"{(time.perf_counter() - begin) / 20_000 * 1e6:.1f} us"))
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:<{width}}  {value}")
    return int(any(counts[name] for name in MUST_BE_ZERO))


if __name__ == "__main__":
    sys.exit(main())
