"""The diagnosis as data: `hoopd.diagnosis/1`, the JSON that other programs read.

Rules of this file: what has no default is the contract and is always written, null where it is not determined; what
has one is an addition and is left out while it says nothing. Never NaN, never a wall time. Its bytes: `record_file`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

SCHEMA: Literal["hoopd.diagnosis/1"] = "hoopd.diagnosis/1"

Verdict = Literal["consistent", "parameters", "missing_physics", "unknown_physics"]
# What held-out data say of a name: they bear it out; they do, and it barely passes; they never reach what it acts on;
# they lose likelihood by it, or a simulation of them is worse with it.
Status = Literal["confirmed", "weak", "untested", "not_confirmed"]
# A number that may not be determined; NaN and infinities become None on the way out.
Number = float | None
# Among the candidates: what no name explains, and re-estimated parameters with nothing else.
NONE_OF_THESE = "none of these"
PARAMETERS = "parameters"


def _not_determined() -> None:
    """Written as null: a default that is left out while it says nothing would be no contract."""


class _Part(msgspec.Struct, kw_only=True, frozen=True, omit_defaults=True):
    """Base of all records; a reader leaves keys that it does not know alone, so that a later version stays readable."""


class Quantity(_Part, frozen=True):
    """A number with its unit, its 95 % interval where it was estimated, and the value that it started from."""

    value: Number
    unit: str
    ci95: tuple[Number, Number] | None
    nominal: Number


class Base(_Part, frozen=True):
    """The model that was judged, with its parameters as re-estimated."""

    model: str
    parameters: dict[str, Quantity]


class Location(_Part, frozen=True):
    """Where the mismatch sits. `evidence`: nats by slot; `segments`: seconds, null when it is there all the time."""

    slot: str | None
    channel: str | None
    segments: list[tuple[float, float]] | None
    depends_on: list[str]
    evidence: dict[str, Number]

    @classmethod
    def nowhere(cls, evidence: Mapping[str, Number] | None = None) -> Location:
        """No mismatch to locate."""
        return cls(slot=None, channel=None, segments=None, depends_on=[], evidence=dict(evidence or {}))


class Evidence(_Part, frozen=True):
    """Gain in log-likelihood over the re-fitted base [nats], what it had to exceed, and the gain on held-out data."""

    log_likelihood_gain: Number
    threshold: Number
    heldout_gain_percent: Number


class Ablation(_Part, frozen=True):
    """The finding taken out again, everything else re-fitted: nats lost, and held-out fit with it and without it."""

    log_likelihood_loss: Number
    heldout_with: dict[str, Number]
    heldout_without: dict[str, Number]
    heldout_nats: Number = None  # that the held-out data, on which nothing of it was fitted, gain by it


class Placebo(_Part, frozen=True):
    """The same effect driven by a shuffled regressor: its gain in nats should be none. `held`: it was none.

    `most`: of the best shuffle; `limit`: what the best of as many may gain by chance.
    """

    log_likelihood_gain: Number
    held: bool
    shuffles: int = 1
    most: Number = None
    limit: Number = None


class Alternative(_Part, frozen=True):
    """Another explanation that the data do not exclude. `behind_nats`: by how much it explains them less."""

    name: str
    behind_nats: Number
    reason: str = ""


class EffectFinding(_Part, frozen=True):
    """A named effect.

    `probability`: of the name, and of what is the same as it, among all candidates and "none of these"; `formula`: its
    law; `nearest`: of what is no name of the library, the library's name that changes most alike; `explained`: the
    share of what the re-fitted base leaves that goes with it.
    """

    name: str
    slot: str
    parameters: dict[str, Quantity]
    evidence: Evidence
    not_excluded: list[str]
    statement: str
    probability: Number = msgspec.field(default_factory=_not_determined)
    formula: str = msgspec.field(default_factory=str)
    nearest: str | None = msgspec.field(default_factory=_not_determined)
    explained: Number = msgspec.field(default_factory=_not_determined)
    alternatives: list[Alternative] = []
    ablation: Ablation | None = None
    placebo: Placebo | None = None
    status: Status | None = None  # null in files that are older than it
    reason: str = ""  # why it is not confirmed, weak, or in no model that is written
    in_model: bool | None = None  # whether a model that is written has it; null where that was not decided

    @property
    def is_unknown(self) -> bool:
        """Whether it has no name: a slot and a curve."""
        return self.name.startswith("unknown.")


class Fit(_Part, frozen=True):
    """NRMSE percent of one channel; `noise_floor`: what noise alone leaves; `ceiling`: free curves instead of laws;
    `written`: with the findings that a model is written with, where these are others than all that are shown."""

    nominal: Number
    base_refit: Number
    with_effects: Number
    noise_floor: Number
    ceiling: Number = None
    written: Number = None


# Recording -> channel -> fit.
Fits = dict[str, dict[str, Fit]]


class FreeRunEffect(_Part, frozen=True):
    """An effect that makes one free run better: share of the squared error, how often chance takes as much of it."""

    name: str
    named: bool  # among the effects of the verdict, too
    parameters: dict[str, Quantity]
    error_share: Number = None
    chance: Number = None


class FreeRunChoice(_Part, frozen=True):
    """What a simulation is better with: evidence of free runs, no names; share of the held-out error that all take."""

    effects: list[FreeRunEffect] = []
    heldout_share: Number = None
    fits: Fits = {}
    chosen_on: str = ""


class ErrorWindow(_Part, frozen=True):
    """The window of a channel with the most squared error of the final model, s; its share, out of so many windows."""

    t0: Number
    t1: Number
    share: Number
    windows: int


class FitTable(_Part, frozen=True):
    """Fits over windows of about `window_s`, s; additions: one free run, what it is better with, how it was held out,
    sources, by recording and channel the window that has most of the error (held out where anything is)."""

    train: Fits
    heldout: Fits
    window_s: Number = None  # null in files that are older than it
    free_run: Fits = {}
    free_run_choice: FreeRunChoice | None = None
    how_heldout: str = ""
    channel_source: dict[str, str] = {}
    error_windows: dict[str, dict[str, ErrorWindow]] = {}


class Curve(_Part, frozen=True):
    """What an unknown effect looks like: a value over the regressor, with its 95 % band."""

    regressor: str
    regressor_unit: str
    unit: str
    x: list[Number]
    y: list[Number]
    low: list[Number] = []
    high: list[Number] = []


class Unexplained(_Part, frozen=True):
    """What remains after the named effects. `share`: of what the re-fitted base left unexplained, 0 to 1.

    `carries_over` is false where the held-out recordings ask for such a curve too, but with other values: no model has
    it then; null without any.
    """

    fires: bool
    slot: str | None
    curve: Curve | None
    share: Number = None
    carries_over: bool | None = None
    probability: Number = None


class Remains(_Part, frozen=True):
    """The law that what nobody named still follows, more than noise allows: nats, and what chance alone reaches."""

    slot: str
    follows: str
    log_likelihood_gain: Number
    by_chance: Number


class Disagreement(_Part, frozen=True):
    """A number that the recordings would have in different ways, beyond chance: its value in each, as linear about the
    final fit; nats over one value for all, and what they have to be. `not_excluded`: others that may differ."""

    name: str
    unit: str
    by_recording: dict[str, Number]
    log_likelihood_gain: Number
    needed: Number
    not_excluded: list[str] = []


class NextExperiment(_Part, frozen=True):
    """The experiment that tells two explanations apart, and the nats that it is expected to bring."""

    signal: str
    parameters: dict[str, Quantity]
    tells_apart: tuple[str, str]
    expected_nats: Number
    reason: str = ""
    command: str = ""
    apart_nats: Number = None  # by which the recordings that are there tell the two apart


# t0 [s], t1 [s], reason.
Ignored = tuple[float, float, str]


class RecordingQuality(_Part, frozen=True):
    """Bad samples of one recording, counted over its channels, out of `samples`; late frames out of `frames`; `jumps`:
    how often a counter went on from another place, by channel."""

    missing: int | None
    late_frames: int | None
    outliers: int | None
    segments_ignored: list[Ignored] = []
    samples: int | None = None
    frames: int | None = None
    notes: list[str] = []
    jumps: dict[str, int] = {}


class DataQuality(_Part, frozen=True):
    """Bad samples counted over all recordings, and what was set aside; additions: the same for each recording."""

    missing: int | None
    late_frames: int | None
    outliers: int | None
    segments_ignored: list[Ignored]
    samples: int | None = None
    frames: int | None = None
    recordings: dict[str, RecordingQuality] = {}
    notes: list[str] = []


class Candidate(_Part, frozen=True):
    """One explanation that was tried on its own, over the re-fitted base; its surprise is what meets the threshold.

    `probability`: that it is among what acts; "none of these" is a candidate, too. `counted_with`: the finding in whose
    probability it is counted, because nothing here tells the two apart.
    """

    name: str
    log_likelihood_gain: Number
    probability: Number = None
    surprise: Number = None  # nats: the gain less what chance gives an effect with as many columns and choices
    threshold: Number = None
    needed: Number = None  # the gain that is as surprising as the threshold
    heldout_gain_percent: Number = None
    counted_with: str | None = None


class Refused(_Part, frozen=True):
    """An effect that was beyond the threshold and is not named; `reason`: why, in words."""

    name: str
    log_likelihood_gain: Number
    reason: str


class Visible(_Part, frozen=True):
    """Power: the smallest size of an effect that this data set would have shown; `largest`: end of its prior range."""

    parameter: str
    unit: str
    smallest: Number
    largest: Number = None


class UsedMemory(_Part, frozen=True):
    """The memory that was the prior: its hash (empty: a new one), means and deviations of the parameters that counted,
    nats by which names were likelier, what was left out because these recordings contradict it, and in words why."""

    sha256: str
    parameters: dict[str, list[float]]
    odds_nats: dict[str, float]
    left_out: list[str]
    recordings_again: int  # entries that were of recordings which are given again: they did not count
    contradictions: list[str]


class Diagnosis(_Part, frozen=True):
    """`hoopd.diagnosis/1`."""

    schema: Literal["hoopd.diagnosis/1"]
    verdict: Verdict
    base: Base
    location: Location
    effects: list[EffectFinding]
    fit: FitTable
    unexplained: Unexplained | None
    next_experiment: NextExperiment | None
    data_quality: DataQuality
    seed: int
    candidates: list[Candidate] = []
    refused: list[Refused] = []
    power: dict[str, Visible] = {}
    remains: Remains | None = None
    disagreement: Disagreement | None = None
    notes: list[str] = []
    memory: UsedMemory | None = None
    summary: str = ""  # in plain words; a file that is written has it
