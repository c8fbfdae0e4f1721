"""An alternating run of two laws, tick by tick: what is to be commanded next, what the blocks cost, when it is clear.

    before -> asked -> settling -> counting -> back -> before ...      B: on trial between asked and back
    before ----------> settling -> counting ---------> before ...      A: the accepted law goes on

The candidate acts by the daemon's own `trial` and goes by `revert`: what a trial may not do ends this run, too, with
the accepted law back in that very tick. A run whose mode is left, or into which somebody else commands, is over.

Rules of this file: pure: its only clock is the ticks' own; it says what to command and others do; it judges nothing
that was not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log
from typing import Any, NamedTuple

from hoopd.core.modes import mode_words
from hoopd.core.succession import ACCEPT, ALIVE, REVERT, REVERTED, TRIAL
from hoopd.core.trial import LEAST_BASELINE_S
from hoopd.design.alternation import LEAST_PAIRS, Alternation, AlternationBlock, blocks_of
from hoopd.design.sequential_test import evidence, interval
from hoopd.design.side_effects import side_effects
from hoopd.design.weights import Weights
from hoopd.design.yardstick import REST_AFTER_S, BlockFigures, HeldSpeed, TickSample, Yardstick

# Before a trial the accepted law acts for so long, at rest.
REST_S = LEAST_BASELINE_S + 0.2
ALIVE_S = 1.0
# The candidate is read, checked, made ready and watched first; the accepted one is back in a tick.
PATIENCE_S = {"asked": 25.0, "back": 5.0}
START_S = 20.0  # until the loop runs
# What a hand does to the run that is none of ours.
MEDDLING = frozenset({"tuned", "speed"})
LEFT = "the law no longer acts"
EXPLAINED_S = 0.5  # until the event has come that tells which mode, and why
FOREIGN_S = 1.5  # a command of ours is obeyed by then
LEAST_SHARE = 0.9  # of a block's ticks: fewer, and the pair does not count

BETTER, WORSE, OPEN, RETURNED, STOPPED = ("better", "worse", "not told apart", "went back", "stopped")


# What decides, chosen before the run: the ball's error (root mean square), or the cost by the weights of the design.
BALL, COST = MEASURES = ("ball", "cost")
# What is told beside both, and decides nothing: the torque while the ball rests at the bottom (root mean square).
REST = "rest"
LEAST_NM = 1e-4  # of it: what is less moves nothing, and has no ratio
# Their places in a result, and what they are called.
RESULTS = {BALL: "ball_rms_rad", COST: "cost", REST: "torque_at_rest_nm"}
MEANINGS = {BALL: "the ball's error", COST: "the cost of the design"}


class WantedCommand(NamedTuple):
    """What the daemon is to be told."""

    name: str
    value: float = 0.0
    key: str = ""


@dataclass(frozen=True)
class BlockPair:
    """Both blocks of a pair."""

    order: str  # AB or BA
    references: tuple[float, ...]
    a: BlockFigures
    b: BlockFigures


class ControllerComparison:
    """One alternating run."""

    def __init__(
        self,
        plan: Alternation,
        key: str,
        *,
        weights: Weights | None = None,
        held: HeldSpeed | None = None,
        period_s: float = 0.02,
        by: str = BALL,
    ) -> None:
        """`key`: NAME.yaml@SHA256 of the candidate; `held`: how the hoop has to turn for a reference, if known; `by`:
        what decides, one of `MEASURES`, else ValueError."""
        if by not in MEASURES:
            raise ValueError(f"a comparison is judged by {' or '.join(MEASURES)}, not {by!r}")
        self.plan, self.key, self.pairs, self.by = plan, key, list[BlockPair](), by
        self.verdict = self.reason = ""  # empty while it goes on
        self.lost = 0  # pairs of which too few ticks came
        self._sha256 = key.partition("@")[2]
        self._blocks, self._place, self._period_s = blocks_of(plan), 0, period_s
        self._yardstick = Yardstick(weights, held, max(REST_AFTER_S, plan.hold_s / 2))
        self._done: dict[str, BlockFigures] = {}
        self._phase, self._since = "before", 0.0  # s, when the phase began
        self._first_t: float | None = None
        self._t = self._running_since = self._alive_at = self._agreed_at = self._ended_at = 0.0
        self._ran = self._on_trial = self._farewell = False
        self._wanted = 0.0  # rad, the reference that was asked for

    @property
    def over(self) -> bool:
        """Nothing more is compared."""
        return bool(self.verdict)

    @property
    def settled(self) -> bool:
        """It is over, its last orders were given, its reason is known, and no candidate is about to act."""
        unexplained = self.reason == LEFT and self._t - self._ended_at < EXPLAINED_S
        return self._farewell and self._phase != "asked" and not unexplained

    @property
    def block(self) -> AlternationBlock:
        """The one that is next or goes on."""
        return self._blocks[min(self._place, len(self._blocks) - 1)]

    @property
    def share(self) -> float:
        """Of the blocks, how many are over."""
        return self._place / len(self._blocks)

    @property
    def step(self) -> str:
        """Where it is, in words."""
        law = {"A": "the accepted law", "B": "the candidate"}[self.block.law]
        doing = {"before": "at rest", "asked": "about to take over", "back": "going back"}.get(self._phase, self._phase)
        return f"block {min(self._place + 1, len(self._blocks))} of {len(self._blocks)}: {law}, {doing}"

    # ------------------------------------------------------------------------------------------ what comes in

    def put(self, sample: TickSample) -> tuple[WantedCommand, ...]:
        """One tick; what is to be commanded now."""
        self._t = sample.t
        if self._first_t is None:
            self._first_t = sample.t
        self._yardstick.put(sample, counts=self._phase == "counting" and not self.over)
        if not self.over:
            self._watch(sample)
        if self.over:
            return self._ending()
        return (*self._advance(sample), *self._watched())

    def note(self, event: str, fields: Mapping[str, Any]) -> None:
        """One fact that the daemon tells."""
        if self.over:
            self._note_late(event, fields)
        elif event == "controller":
            self._took_over(fields)
        elif event == "trial_returned":
            self._returned(str(fields.get("reason", "")))
        elif event == "command_refused" and self._phase == "asked" and self._is_ours(fields):
            self._end(STOPPED, f"the candidate was refused: {fields.get('reason', '')}")
        elif event in MEDDLING or (event == "operator" and fields.get("command") == ACCEPT):
            self._end(STOPPED, "somebody else changed gains or controller, or drove the hoop, meanwhile")

    def refuse(self, order: WantedCommand, reason: str) -> None:
        """An order was not obeyed."""
        if not self.over and order.name != ALIVE:
            self._end(STOPPED, reason)

    def stop(self, reason: str) -> None:
        """End it from outside."""
        if not self.over:
            self._end(STOPPED, reason)

    # ------------------------------------------------------------------------------------------ what follows

    def _watch(self, sample: TickSample) -> None:
        assert self._first_t is not None
        if not sample.running:
            if self._ran:
                self._end(STOPPED, LEFT)
            elif sample.t - self._first_t > START_S:
                self._end(STOPPED, f"it did not run within {START_S:g} s: arm it first")
            return
        if not self._ran:
            self._ran, self._since, self._agreed_at = True, sample.t, sample.t
        if abs(sample.reference - self._wanted) < 1e-9:
            self._agreed_at = sample.t
        elif sample.t - self._agreed_at > FOREIGN_S:
            self._end(STOPPED, "somebody else moves the reference")
        patience = PATIENCE_S.get(self._phase)
        if patience is not None and sample.t - self._since > patience:
            self._end(STOPPED, f"the daemon did not tell within {patience:g} s that the law changed")

    def _advance(self, sample: TickSample) -> tuple[WantedCommand, ...]:
        if not self._ran:
            return ()
        passed = sample.t - self._since
        if self._phase == "before":
            return self._begin_block(passed)
        if self._phase == "settling" and passed >= self.plan.settle_s:
            self._yardstick.begin()
            self._enter("counting")
            return self._refer(self.block.references[0])
        if self._phase == "counting":
            if passed >= self.plan.counted_s:
                return self._end_block()
            return self._refer(self.block.references[int(passed / self.plan.hold_s)])
        return ()

    def _begin_block(self, passed: float) -> tuple[WantedCommand, ...]:
        orders = self._refer(0.0)
        if self.block.law == "A":
            self._enter("settling")
        elif passed >= REST_S or (self._place > 0 and self._blocks[self._place - 1].law == "A"):
            self._enter("asked")
            return (*orders, WantedCommand(TRIAL, key=self.key))
        return orders

    def _end_block(self) -> tuple[WantedCommand, ...]:
        block, figures = self.block, self._yardstick.figures
        self._done[block.law] = figures
        orders = self._refer(0.0)
        if block.law == "B":
            self._enter("back")
            orders = (*orders, WantedCommand(REVERT))
        else:
            self._next_block()
        return orders

    def _next_block(self) -> None:
        self._place += 1
        self._enter("before")
        if self._place % 2 == 0:
            self._judge()

    def _judge(self) -> None:
        first, second = self._blocks[self._place - 2 : self._place]
        a, b = self._done["A"], self._done["B"]
        least = LEAST_SHARE * self.plan.counted_s / self._period_s
        if (
            min(a.ticks, b.ticks) >= least
            and min(a.pictures, b.pictures, a.cost, b.cost, a.ball_rms_rad, b.ball_rms_rad) > 0
        ):
            self.pairs.append(BlockPair(first.law + second.law, first.references, a, b))
        else:
            self.lost += 1
        ratios = self.ratios(self.by)
        if len(ratios) >= LEAST_PAIRS and evidence(ratios) >= 1.0 / self.plan.alpha:
            self._end(BETTER if sum(ratios) < 0.0 else WORSE, f"clear after {len(ratios)} pairs")
        elif self._place >= len(self._blocks):
            self._end(OPEN, f"not clear after {len(ratios)} pairs")

    def _note_late(self, event: str, fields: Mapping[str, Any]) -> None:
        """The mode behind an end; and a candidate that was asked for before the end and acts after it goes back."""
        if event == "mode" and self.reason == LEFT:
            because = fields.get("because")
            told = mode_words(str(fields.get("mode")), map(str, because if isinstance(because, list) else ()))
            self.reason = f"{LEFT}: {told}"
        begins = event == "controller" and fields.get("command") == TRIAL
        if self._phase == "asked" and (begins or (event == "command_refused" and self._is_ours(fields))):
            self._phase = "before"
            if begins and self._is_ours(fields):
                self._on_trial, self._farewell = True, False

    def _is_ours(self, fields: Mapping[str, Any]) -> bool:
        """Whether a trial that is told is of the candidate; a refusal of none tells no file."""
        sha256 = str(fields.get("sha256", self._sha256))
        return fields.get("command") == TRIAL and sha256.startswith(self._sha256)

    def _took_over(self, fields: Mapping[str, Any]) -> None:
        if self._phase == "asked" and self._is_ours(fields):
            self._on_trial, self._alive_at = True, self._t
            self._enter("settling")
        else:
            self._end(STOPPED, "somebody else changed the controller meanwhile")

    def _returned(self, reason: str) -> None:
        self._on_trial = False
        if self._phase == "back" and reason == REVERTED:
            self._next_block()
        else:
            self._end(RETURNED if reason != REVERTED else STOPPED, f"the candidate went back: {reason}")

    def _refer(self, reference: float) -> tuple[WantedCommand, ...]:
        if reference == self._wanted:
            return ()
        self._wanted, self._agreed_at = reference, self._t
        return (WantedCommand("reference", reference),)

    def _watched(self) -> tuple[WantedCommand, ...]:
        if not self._on_trial or self._phase == "back" or self._t - self._alive_at < ALIVE_S:
            return ()
        self._alive_at = self._t
        return (WantedCommand(ALIVE),)

    def _ending(self) -> tuple[WantedCommand, ...]:
        """Once: the accepted law back, and the ball to the bottom."""
        if self._farewell:
            return ()
        self._farewell = True
        return (*((WantedCommand(REVERT),) if self._on_trial else ()), *self._refer(0.0))

    def _enter(self, phase: str) -> None:
        self._phase, self._since = phase, self._t

    def _end(self, verdict: str, reason: str) -> None:
        self.verdict, self.reason, self._ended_at = verdict, reason, self._t

    # ------------------------------------------------------------------------------------------ what it showed

    def ratios(self, measure: str) -> list[float]:
        """Logarithm of the candidate's figure over the accepted law's, pair by pair."""
        least = LEAST_NM if measure == REST else 0.0
        return [log(max(b, least) / max(a, least)) for a, b in self._figures(measure)]

    def _figures(self, measure: str) -> list[tuple[float, float]]:
        if measure == COST:
            return [(pair.a.cost, pair.b.cost) for pair in self.pairs]
        if measure == REST:
            rests = [(pair.a.rest_rms_nm, pair.b.rest_rms_nm) for pair in self.pairs]
            return [(a, b) for a, b in rests if a is not None and b is not None]
        return [(pair.a.ball_rms_rad, pair.b.ball_rms_rad) for pair in self.pairs]

    def result(self) -> dict[str, Any]:
        """What it showed so far, as plain data."""
        told = {
            "verdict": self.verdict,
            "reason": self.reason,
            "judged_by": self.by,
            "candidate": self.key,
            "pairs": [_told(pair) for pair in self.pairs],
            "lost_pairs": self.lost,
            **{place: self._change(one) for one, place in RESULTS.items()},
            "alpha": self.plan.alpha,
            "seed": self.plan.seed,
        }
        return {**told, "warnings": side_effects(told)}

    def _change(self, measure: str) -> dict[str, Any]:
        """Means of both, the change in percent with its interval, the evidence, and the interval after each pair."""
        ratios, values = self.ratios(measure), self._figures(measure)
        n = len(ratios)
        low, high = interval(ratios, self.plan.alpha)
        ends = [interval(ratios[:k], self.plan.alpha) for k in range(1, n + 1)]
        return {
            "accepted": sum(a for a, _ in values) / n if n else None,
            "candidate": sum(b for _, b in values) / n if n else None,
            "change_percent": _percent(sum(ratios) / n) if n else None,
            "interval_percent": [_percent(low), _percent(high)],
            "intervals_percent": [[_percent(one), _percent(other)] for one, other in ends],
            "evidence": evidence(ratios),
            "evidence_needed": 1.0 / self.plan.alpha,
        }


def _told(pair: BlockPair) -> dict[str, Any]:
    return {
        "order": pair.order,
        "references_rad": list(pair.references),
        "cost": {"accepted": pair.a.cost, "candidate": pair.b.cost},
        "ball_rms_rad": {"accepted": pair.a.ball_rms_rad, "candidate": pair.b.ball_rms_rad},
        "torque_at_rest_nm": {"accepted": pair.a.rest_rms_nm, "candidate": pair.b.rest_rms_nm},
    }


def _percent(logarithm: float) -> float | None:
    """A ratio's logarithm as a change in percent; None where there is no bound."""
    return 100.0 * (exp(logarithm) - 1.0) if abs(logarithm) < 10.0 else None
