"""Scripted faults of the rig: what goes wrong, when, for how long; applied by the wire, the board and the camera.

Rules of this file: faults are data, the table of kinds says what they mean and which numbers they take; times are run
time in s; the same script and seed do the same to the same frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from hoopd.core.frames import Answer, Decoder, Layout, Request, encode_answer, encode_request
from hoopd.sim.board import BYTE_S, FAULT_BITS, TORQUE_LIMIT_NM, FaultName, RigBoard
from hoopd.sim.lying_encoder import LIES, LyingEncoder

Direction = Literal["request", "answer"]


class KindRow(NamedTuple):
    """One kind of fault: who applies it, its numbers with defaults, its meaning."""

    side: Literal["link", "board", "camera"]
    params: Mapping[str, Any]
    meaning: str


# `rate`: probability per frame (bit_flips: per byte); `every`: every n-th frame instead of a rate, 0 is off;
# `direction`: request, answer or both.
_LINK: Final = {"direction": "both", "rate": 0.0, "every": 0}
KINDS: Final[Mapping[str, KindRow]] = {
    "bit_flips": KindRow("link", _LINK | {"bits": 1}, "bits of a frame are inverted on the wire"),
    "lost_frames": KindRow("link", _LINK | {"rate": 1.0}, "whole frames vanish"),
    "late_frames": KindRow("link", _LINK | {"rate": 1.0, "delay_s": 0.03}, "frames arrive later than they should"),
    "duplicated_frames": KindRow("link", _LINK | {"rate": 1.0}, "frames arrive twice, back to back"),
    "garbage": KindRow("link", _LINK | {"rate": 1.0, "bytes": 16}, "random bytes stand before a frame"),
    "board_silent": KindRow("link", {}, "the board hears nothing and says nothing; its own time-out goes on"),
    "implausible_speed": KindRow("link", {"value": 5000.0}, "answers carry this dtheta in rad/s with a good CRC"),
    "implausible_current": KindRow("link", {"value": 80.0}, "answers carry this current in A with a good CRC"),
    "encoder_frozen": KindRow("link", {}, "answers hold the hoop's angle and carry speed 0; the hoop turns on"),
    "encoder_coasts": KindRow("link", {}, "answers carry on with the speed of the beginning, whatever the hoop does"),
    "encoder_scale": KindRow(
        "link", {"factor": 0.5}, "turns from the beginning on and speed are multiplied; -1 is an encoder turned round"
    ),
    "drive_blocked": KindRow("link", {}, "an emergency stop holds the drive: requests reach it without enable"),
    "host_mad": KindRow(
        "link",
        {"torque_nm": TORQUE_LIMIT_NM, "pattern": "constant", "period_s": 0.4},
        "good requests carry this torque with enable, whatever the daemon asked; pattern constant or alternate",
    ),
    "board_reset": KindRow("board", {}, "the board restarts once, at the beginning"),
    "board_fault": KindRow("board", {"name": "overcurrent"}, "overcurrent, encoder or supply condition persists"),
    "camera_stall": KindRow("camera", {}, "no pictures come"),
    "black_pictures": KindRow("camera", {}, "pictures are black"),
    "ball_gone": KindRow("camera", {}, "the ball is not in the picture"),
    "false_red_object": KindRow("camera", {}, "a second red object is in the picture"),
    "ball_held": KindRow("camera", {"psi_rad": 0.3}, "pictures show the ball held at psi_rad, whatever the torque"),
    "late_pictures": KindRow("camera", {"delay_s": 0.1}, "pictures are delivered later than they should"),
    "pictures_frozen": KindRow("camera", {}, "the same picture comes again and again, with fresh stamps"),
    "picture_ball_painted": KindRow(
        "camera",
        {"psi_rad": 0.0, "swing_rad": 0.0, "period_s": 3.0},
        "in place of the ball one is painted on at psi_rad, at rest or swinging about it, without noise of its own",
    ),
    "picture_scale": KindRow("camera", {"factor": 0.5}, "pictures show the ball at factor times its angle"),
    "pictures_aged": KindRow("camera", {"delay_s": 0.1}, "pictures are this much older than their stamps say"),
}
# What the rig remembers of its plant's past for a camera that shows an older state.
OLDEST_PICTURE_S: Final = 0.5


@dataclass(frozen=True)
class ScriptedFault:
    """One fault: active in [at_s, at_s + for_s); `params` override the table's defaults."""

    kind: str
    at_s: float
    for_s: float = math.inf
    params: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown fault kind {self.kind!r}, known: {', '.join(KINDS)}")
        known = KINDS[self.kind].params
        if unknown := set(self.params) - set(known):
            raise ValueError(f"{self.kind}: unknown parameter {sorted(unknown)[0]!r}, known: {', '.join(known) or '-'}")
        if not (self.at_s >= 0.0 and self.for_s > 0.0):
            raise ValueError(f"{self.kind}: at_s must be >= 0 and for_s > 0")
        self._check_params()

    def _check_params(self) -> None:
        if self["direction"] not in (None, "request", "answer", "both"):
            raise ValueError(f"{self.kind}: direction must be request, answer or both, not {self['direction']!r}")
        if self["pattern"] not in (None, "constant", "alternate"):
            raise ValueError(f"{self.kind}: pattern must be constant or alternate, not {self['pattern']!r}")
        if self.kind == "board_fault" and self["name"] not in FAULT_BITS:
            raise ValueError(f"board_fault: name must be {', '.join(FAULT_BITS)}, not {self['name']!r}")
        for name in ("value", "psi_rad", "swing_rad", "factor", "torque_nm"):
            value = self[name]
            if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
                raise ValueError(f"{self.kind}: {name} must be a number, not {value!r}")
        for name in ("rate", "every", "bits", "bytes", "delay_s"):
            value = self[name]
            if value is not None and not (isinstance(value, int | float) and value >= 0):
                raise ValueError(f"{self.kind}: {name} must be a number >= 0, not {value!r}")
        period_s = self["period_s"]
        if period_s is not None and not (isinstance(period_s, int | float) and 0.0 < period_s < math.inf):
            raise ValueError(f"{self.kind}: period_s must be a number above 0, not {period_s!r}")
        if self.kind == "pictures_aged" and not self["delay_s"] <= OLDEST_PICTURE_S:
            raise ValueError(f"pictures_aged: delay_s must be at most {OLDEST_PICTURE_S:g}, not {self['delay_s']!r}")

    def __getitem__(self, name: str) -> Any:
        """A parameter with the table's default; None for one that this kind lacks."""
        return self.params.get(name, KINDS[self.kind].params.get(name))

    def active(self, t: float) -> bool:
        return self.at_s <= t < self.at_s + self.for_s

    def concerns(self, direction: Direction) -> bool:
        return self["direction"] in (direction, "both")


def fault_from_table(row: Mapping[str, Any]) -> ScriptedFault:
    """A fault from plain data {kind, at_s, for_s?, params?}; ValueError with one clear line."""
    known = {"kind", "at_s", "for_s", "params"}
    if unknown := set(row) - known:
        raise ValueError(f"fault: unknown key {sorted(unknown)[0]!r}, known: {', '.join(sorted(known))}")
    if missing := {"kind", "at_s"} - set(row):
        raise ValueError(f"fault: missing key {sorted(missing)[0]!r}")
    for_s = row.get("for_s")
    return ScriptedFault(row["kind"], row["at_s"], math.inf if for_s is None else for_s, dict(row.get("params") or {}))


class FaultScript:
    """All faults of one run."""

    def __init__(self, faults: Iterable[ScriptedFault] = (), seed: int = 0) -> None:
        self.faults = tuple(faults)
        self.seed = seed
        self._by_kind: dict[str, list[ScriptedFault]] = {}
        for fault in self.faults:
            self._by_kind.setdefault(fault.kind, []).append(fault)

    def active(self, t: float, kind: str) -> ScriptedFault | None:
        """The first fault of this kind that is active at run time `t`."""
        if kind not in KINDS:
            raise ValueError(f"unknown fault kind {kind!r}, known: {', '.join(KINDS)}")
        if kind not in self._by_kind:
            return None
        return next((fault for fault in self._by_kind[kind] if fault.active(t)), None)


Delivery = tuple[float, bytes]  # run time of the last byte, bytes


class FaultyWire:
    """Both directions between host and board; gives what arrives of one frame, and when."""

    def __init__(self, script: FaultScript, layout: Layout) -> None:
        self._script = script
        self._layout = layout
        self._rng = {name: np.random.default_rng([script.seed, i]) for i, name in enumerate(("request", "answer"))}
        self._frames = {"request": 0, "answer": 0}
        self._encoder = LyingEncoder(script.active)
        self._encoder_lies = any(fault.kind in LIES for fault in script.faults)

    def request(self, t: float, data: bytes) -> list[Delivery]:
        """What the board gets of bytes that the host sent, `t` their arrival without faults."""
        return self._pass(t, self._usurped(t, self._blocked(t, data)), "request")

    def answer(self, t: float, data: bytes) -> list[Delivery]:
        """What the host gets of one answer of the board, `t` its arrival without faults."""
        return self._pass(t, self._falsify(t, data), "answer")

    def _pass(self, t: float, data: bytes, direction: Direction) -> list[Delivery]:
        if not self._script.faults:
            return [(t, data)]
        self._frames[direction] += 1
        if self._script.active(t, "board_silent") or self._hit(t, "lost_frames", direction):
            return []
        out = self._garbage(t, direction) + self._flip(t, data, direction)
        if self._hit(t, "duplicated_frames", direction):
            out += out
        late = self._hit(t, "late_frames", direction)
        delay_s = float(late["delay_s"]) if late else 0.0
        return [(t + delay_s + (len(out) - len(data)) * BYTE_S, out)]

    def _hit(self, t: float, kind: str, direction: Direction) -> ScriptedFault | None:
        """The active fault of this kind, when it strikes this frame."""
        fault = self._script.active(t, kind)
        if fault is None or not fault.concerns(direction):
            return None
        if fault["every"]:
            return fault if self._frames[direction] % int(fault["every"]) == 0 else None
        return fault if self._rng[direction].random() < fault["rate"] else None

    def _flip(self, t: float, data: bytes, direction: Direction) -> bytes:
        """Invert `bits` different bits: of every n-th frame, or of each byte by rate."""
        fault = self._script.active(t, "bit_flips")
        if fault is None or not fault.concerns(direction):
            return data
        rng, bits = self._rng[direction], int(fault["bits"])
        if fault["every"]:
            strikes = self._frames[direction] % int(fault["every"]) == 0
            chosen = rng.choice(8 * len(data), min(bits, 8 * len(data)), replace=False)
            places: list[int] = chosen.tolist() if strikes else []
        else:
            hit = np.flatnonzero(rng.random(len(data)) < fault["rate"])
            places = [8 * int(i) + int(b) for i in hit for b in rng.choice(8, min(bits, 8), replace=False)]
        out = bytearray(data)
        for place in places:
            out[place // 8] ^= 1 << (place % 8)
        return bytes(out)

    def _garbage(self, t: float, direction: Direction) -> bytes:
        fault = self._hit(t, "garbage", direction)
        return self._rng[direction].bytes(int(fault["bytes"])) if fault else b""

    def _blocked(self, t: float, data: bytes) -> bytes:
        """The same request without its enable bit and with its CRC made good."""
        if self._script.active(t, "drive_blocked") is None:
            return data
        frames = Decoder(self._layout, "request", bounds={}).feed(data)
        asked = (f for f in frames if isinstance(f, Request))
        return b"".join(encode_request(self._layout, f.seq, False, f.clear_fault, f.torque_nm) for f in asked)

    def _usurped(self, t: float, data: bytes) -> bytes:
        """A request in the place of each of the daemon's: drive on, the worst torque, CRC good."""
        fault = self._script.active(t, "host_mad")
        if fault is None:
            return data
        asked = (f for f in Decoder(self._layout, "request", bounds={}).feed(data) if isinstance(f, Request))
        return b"".join(encode_request(self._layout, f.seq, True, False, _mad_torque(fault, t)) for f in asked)

    def _falsify(self, t: float, data: bytes) -> bytes:
        """The same answer with a wrong value and its CRC made good."""
        changes: dict[str, Any] = {}
        if fault := self._script.active(t, "implausible_speed"):
            changes["dtheta"] = float(fault["value"])
        if fault := self._script.active(t, "implausible_current"):
            changes["current"] = float(fault["value"])
        if not changes and not self._encoder_lies:
            return data
        frames = Decoder(self._layout, "answer", bounds={}).feed(data)
        answers = [self._lied(t, frame) for frame in frames if isinstance(frame, Answer)]
        return b"".join(encode_answer(self._layout, answer._replace(**changes)) for answer in answers)

    def _lied(self, t: float, answer: Answer) -> Answer:
        theta, dtheta = self._encoder.report(t, answer.theta, answer.dtheta)
        return answer._replace(theta=theta, dtheta=dtheta)


def _mad_torque(fault: ScriptedFault, t: float) -> float:
    """Constant, or alternating from the fault's beginning on: half a period the one way, half a period the other."""
    back = fault["pattern"] == "alternate" and (t - fault.at_s) % fault["period_s"] >= 0.5 * fault["period_s"]
    return -float(fault["torque_nm"]) if back else float(fault["torque_nm"])


class BoardFaults:
    """Carries the script's board kinds to the board; call it at the faults' edges, or whenever time passes."""

    def __init__(self, script: FaultScript) -> None:
        self._script = script
        self._done: set[int] = set()  # resets that happened
        self._injected: set[FaultName] = set()

    def update(self, t: float, board: RigBoard, t_board: float | None = None) -> None:
        """Apply what holds at run time `t`; `t_board` is the same instant on the board's clock."""
        now = t if t_board is None else t_board
        for index, fault in enumerate(self._script.faults):
            if fault.kind == "board_reset" and fault.active(t) and index not in self._done:
                self._done.add(index)
                board.reset(now)
        wanted = {f["name"] for f in self._script.faults if f.kind == "board_fault" and f.active(t)}
        for name in sorted(wanted - self._injected):
            board.inject(name, now)
        for name in sorted(self._injected - wanted):
            board.heal(name)
        self._injected = wanted
