"""What has no name, proven like a name: its curve fitted with everything else, and run on the held-out recordings.

A screen has said where a curve would help; here the joint fit and data that no value of it was fitted to decide. What
had to be fitted again to a new recording pays half a nat a value: so much would chance give it. Held-out data that
refuse the values may still ask for a curve of the same variable at the same place: they reach beyond its knots, or it
stands for a law of more variables than one. Then something is there, and no model of it is kept. So it is where they
refuse it altogether, but the training data say so far beyond chance; else the curve is refused, with its reason.

Rules of this file: the held-out data refuse the values of a curve by the rule by which folds refuse a name.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from hoopd.diagnose.curves.curve import UnnamedCurve, curves
from hoopd.diagnose.curves.curve_fits import fitted_shapes, together
from hoopd.diagnose.curves.curve_screen import CurveScreen, null_quantiles
from hoopd.diagnose.curves.unknown_effects import (
    DETECTION_CHANCE,
    Survey,
    Unknown,
    judge_unknown,
    not_told_apart,
    survey,
)
from hoopd.diagnose.proof.denial import Denial
from hoopd.diagnose.proof.held_out import HeldOut, on_heldout
from hoopd.diagnose.search.candidates import UNSEEN_LOSS, UNSEEN_SHARE
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Score
from hoopd.diagnose.search.surprise import surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit


@dataclass(frozen=True)
class Proven:
    """An unknown effect as fitted."""

    unknown: Unknown  # with the gain and the shapes of the joint fit, also where the held-out data refuse them
    joint: HypothesisFit | None  # None: held-out data ask for such a curve, but refuse this one's values
    heldout: HypothesisFit | None = None  # the joint hypothesis on the held-out recordings
    denial: Denial | None = None  # what held-out data have against it, that ask for no other curve either

    @property
    def is_told(self) -> bool:
        """Whether something is there, whatever its curve: held-out data do not deny it, or it is beyond any chance."""
        return self.denial is None or self.denial.asks_for_another(self.unknown.surprise, self.unknown.threshold)


def proven(unknown: Unknown, held: HeldOut, seed: int = 0) -> Proven | None:
    """None when the joint fit does not bear it out."""
    joint, (curve,) = together([unknown.score], unknown.beside)
    gain = unknown.beside.criterion - joint.criterion
    size = surprise(gain / unknown.score.colour, unknown.score.columns)
    if size <= unknown.threshold:
        return None
    shapes = fitted_shapes(curve, joint, joint.recordings)
    found = replace(unknown, shapes=shapes, gain=gain, surprise=size)
    without = held.of(unknown.beside)
    if without is None:
        return Proven(found, joint)
    after, again = on_heldout(joint, held.stretches, unknown.beside)
    better = without.criterion - after.criterion - again / 2.0
    if better > -max(UNSEEN_LOSS, UNSEEN_SHARE * gain):
        return Proven(replace(found, carries_over=True), joint, after)
    refused = None if asked_for(unknown.curve, without, seed) else Denial({}, better, is_refuted=True)
    return Proven(replace(found, carries_over=False), None, denial=refused)


def asked_for(curve: UnnamedCurve, frozen: HypothesisFit, seed: int = 0) -> bool:
    """Whether data ask, beyond chance, for a curve of the same variable at the same place, whatever its values.

    Beside parameters fitted to these very data: frozen ones are off by what the curve is, or by chance, and a friction
    or a gain that is off looks like a curve.
    """
    stretches = [track.stretch for track in frozen.tracks]
    own = fit(stretches, frozen.effects, frozen.values, like=frozen, noise=frozen.noise)
    alike = [one for one in curves(own) if one.place == curve.place]
    screen = CurveScreen(own, alike)
    most = max((one.surprise for one in screen.scores()), default=0.0)
    return most > null_quantiles(None, screen, seed=seed).threshold(DETECTION_CHANCE)


@dataclass(frozen=True)
class Missing:
    """What has no name: the survey beside the base, and what it came to on the held-out data."""

    base: Survey
    proof: Proven | None
    beside: Survey | None = None  # beside the accepted names
    refused: Proven | None = None  # a curve that held-out data leave no evidence of

    @property
    def unknown(self) -> Unknown | None:
        """As fitted."""
        return None if self.proof is None else self.proof.unknown

    @property
    def joint(self) -> HypothesisFit | None:
        """With its curve, where the held-out data bear its values out."""
        return None if self.proof is None else self.proof.joint


def missing_of(named: Named, held: HeldOut, effects: Sequence[Effect], seed: int) -> Missing:
    """What `effects` have no name for; names that explain nothing beside it are dropped."""

    def of(found: HypothesisFit, also: Sequence[Score], fitted: Sequence[Score] = ()) -> Survey:
        return survey(found, effects, seed=seed, screen=named.screens.get(id(found)), also=also, fitted=fitted)

    first = of(named.base, named.scores, [replace(one.score, gain=one.gain) for one in named.tried])
    second = of(named.final, [s for s in named.left if s.origin is named.final]) if named.accepted else None
    proof = _proof_of(first, second, held, seed)
    if proof is not None and proof.joint is not None and not proof.unknown.beside_names:
        drop_names(named)
    if proof is not None and not proof.is_told:
        return Missing(first, None, second, refused=proof)
    return Missing(first, proof, second)


def _proof_of(first: Survey, second: Survey | None, held: HeldOut, seed: int) -> Proven | None:
    """Of what names leave; where there is none that is told, of a curve that one too small may be behind."""
    unknown = judge_unknown(first, second, seed=seed)
    if unknown is not None:
        return proven(unknown, held, seed)
    return _borne_out(first, held, seed) if second is None else None


def _borne_out(about: Survey, held: HeldOut, seed: int) -> Proven | None:
    """A curve that a name too small for itself may be behind: something acts, where data that it was not fitted to gain
    as much by it as it has to gain at all."""
    unknown = not_told_apart(about)
    proof = None if unknown is None else proven(unknown, held, seed)
    if unknown is None or proof is None or proof.heldout is None or (without := held.of(unknown.beside)) is None:
        return None
    return proof if without.criterion - proof.heldout.criterion >= about.threshold else None


def missing_instead(
    named: Named, held: HeldOut, effects: Sequence[Effect], denied: Collection[str], seed: int
) -> Missing | None:
    """What has no name where held-out data have refused all names: those explained nothing, and a curve that was no
    more than they are may. None where it is not proven either."""
    survey_of_rest = survey(
        named.base, [one for one in effects if one.name not in denied], seed=seed,
        also=[one for one in named.scores if one.member.effect.name not in denied],
        fitted=[replace(one.score, gain=one.gain) for one in named.tried if one.effect.name not in denied],
    )  # fmt: skip
    proof = _proof_of(survey_of_rest, None, held, seed)
    return None if proof is None or not proof.is_told else Missing(survey_of_rest, proof)


def drop_names(named: Named) -> None:
    """Names that explain nothing which a curve does not."""
    named.accepted.clear()
    named.losses.clear()
    named.without.clear()
    named.final = named.base
